"""Tests of block extrema and residual."""

import numpy as np
import problems
import pytest
import torch

from torchlinf.field.stencil import block_max, block_min, residual

SIZES = [(7,), (1,), (5, 8), (1, 6), (3, 4, 5), (2, 3, 2, 4)]


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("signed", [False, True])
def test_block_extrema_equal_the_definition(sizes: tuple[int, ...], signed: bool) -> None:
    values = np.random.default_rng(0).random((2, *sizes)) - (0.5 if signed else 0.0)
    found_max = block_max(torch.from_numpy(values), len(sizes)).numpy()
    found_min = block_min(torch.from_numpy(values), len(sizes)).numpy()
    for i in range(2):
        padded = np.pad(values[i], 1)
        for pixel in np.ndindex(*sizes):
            around = [padded[tuple(k + 1 for k in other)] for other in problems.block(pixel)]
            assert found_max[i][pixel] == max(around)
            assert found_min[i][pixel] == min(around)


def test_integers_and_strides() -> None:
    values = torch.randint(0, 9, (4, 6, 5), generator=torch.Generator().manual_seed(0))
    assert torch.equal(block_max(values.mT, 2), block_max(values, 2).mT)
    assert torch.equal(block_max(values.double(), 2), block_max(values, 2).double())


@pytest.mark.parametrize("sizes", SIZES)
def test_residual_equals_the_definition(sizes: tuple[int, ...]) -> None:
    generator = np.random.default_rng(1)
    masks = generator.random((3, *sizes)) < 0.8
    values = generator.random(masks.shape) * 5 * masks
    rho = np.array([0.5, 2.0, 7.0])
    found = residual(torch.from_numpy(values), torch.from_numpy(masks), torch.from_numpy(rho**-2))
    for i in range(3):
        expected = problems.naive_residual(values[i], masks[i], rho[i])
        np.testing.assert_allclose(found[i].numpy(), expected, atol=1e-12)


def test_residual_loses_nothing_where_values_are_large() -> None:
    """1e8, 1e8 + 1/2, 1e8 in float64: M + N + 1 - 2 v summed in the order it is written is wrong by ulps of 4e8."""
    value = torch.tensor([[0.0, 1e8, 1e8 + 2**-24 * 3, 1e8 - 2**-24 * 5, 0.0]], dtype=torch.float64)
    mask = torch.tensor([[False, True, True, True, False]])
    found = residual(value, mask, torch.zeros(1, dtype=torch.float64))
    assert found[0, 2].item() == 1 - (value[0, 2] - value[0, 3]).item()
