"""Where the complexity sits: the shares add up to it, and are those of a loop over levels and pixels."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import torch
from problems import naive_distance, naive_field, random_batch
from torch import Tensor

import torchlinf
from torchlinf import complexity, complexity_map, shapes

WINDOWS = [(0.0, 1.0), (0.0, 0.25), (0.3, 0.35), (0.5, 1.0)]
SIZES = [(60,), (21, 34), (9, 13, 11), (5, 6, 5, 7)]


def naive_map(mask: np.ndarray, low: float, high: float, bins: int = 1024, rho: float | None = None) -> np.ndarray:
    """The definition, pixel by pixel, from the oracles' field and distance."""
    distance, field = naive_distance(mask), naive_field(mask, rho)
    radius = distance.max()
    bin_of = np.minimum(np.floor(field / field.max() * bins + 1e-6), bins - 1)
    share = np.zeros(mask.shape)
    for k in range(1, radius + 1):
        length = max(0.0, min(k / radius, high) - max((k - 1) / radius, low))
        level = distance == k
        for pixel in np.argwhere(level):
            alike = np.sum(level & (bin_of == bin_of[tuple(pixel)]))
            share[tuple(pixel)] = -math.log2(alike / level.sum()) / level.sum() * length / (high - low)
    return share


def sums(share: Tensor) -> Tensor:
    return share.flatten(2).sum(dim=2)


@pytest.mark.parametrize(("low", "high"), WINDOWS)
@pytest.mark.parametrize("size", SIZES)
def test_the_shares_add_up_to_the_complexity(size: tuple[int, ...], low: float, high: float) -> None:
    masks = random_batch(len(size), 12, size).reshape(4, 3, *size)
    masks[2, 1] = False
    share = complexity_map(masks, low=low, high=high)
    assert share.shape == masks.shape
    torch.testing.assert_close(sums(share), complexity(masks, low=low, high=high), rtol=0, atol=1e-12, equal_nan=True)
    assert (share[masks] >= 0).all()
    masks[2, 1] = True  # its map is NaN; everywhere else the outside has no share
    assert share[~masks].abs().sum() == 0


@pytest.mark.parametrize("size", [(40,), (13, 17), (6, 7, 6), (4, 5, 3, 4)])
def test_random_shapes_equal_the_naive_oracle(size: tuple[int, ...]) -> None:
    masks = random_batch(20 + len(size), 4, size)
    for low, high in WINDOWS:
        found = complexity_map(masks[:, None], low=low, high=high)[:, 0]
        for mask, share in zip(masks.numpy(), found.numpy(), strict=True):
            if mask.any():
                np.testing.assert_allclose(share, naive_map(mask, low, high), rtol=0, atol=1e-9)


def test_other_bins_and_screening_lengths_equal_the_naive_oracle() -> None:
    mask = shapes.disc(12)
    found = complexity_map(mask, bins=40, rho=3.0, spatial_ndim=2)
    np.testing.assert_allclose(found.numpy(), naive_map(mask.numpy(), 0.0, 1.0, 40, 3.0), rtol=0, atol=1e-12)
    assert not torch.equal(found, complexity_map(mask, bins=40, spatial_ndim=2))
    assert not torch.equal(found, complexity_map(mask, rho=3.0, spatial_ndim=2))


def test_the_share_of_an_appendage_in_closed_form() -> None:
    """Level 1 of a 4-square with a 2 x 2 appendage: the rim of the square, and each column of the appendage."""
    shape = shapes.with_appendages((4, 4), [shapes.Appendage("right", width=2, depth=2)])
    share = complexity_map(shape, high=0.5, spatial_ndim=2)
    assert share[1, 4].item() == pytest.approx(math.log2(16 / 2) / 16)
    assert share[0, 0].item() == pytest.approx(math.log2(16 / 12) / 16)
    assert (share[1:3, 1:3] == 0).all()


@pytest.mark.parametrize("size", [(50,), (18, 27), (7, 9, 8)])
def test_flips_and_axis_swaps_move_the_map(size: tuple[int, ...]) -> None:
    masks = random_batch(30 + len(size), 6, size).reshape(3, 2, *size)
    share = complexity_map(masks)
    for axis in range(2, masks.ndim):
        for move in (lambda x, a=axis: x.flip(a), lambda x, a=axis: x.transpose(2, a).flip(2)):
            torch.testing.assert_close(complexity_map(move(masks)), move(share), rtol=0, atol=0, equal_nan=True)


def test_a_batch_equals_its_shapes_one_by_one_to_the_last_bit() -> None:
    masks = random_batch(40, 6, (19, 26)).reshape(3, 2, 19, 26)
    masks[1, 0] = False
    batch = complexity_map(masks, low=0.1, high=0.7)
    for b in range(3):
        for c in range(2):
            alone = complexity_map(masks[b, c], low=0.1, high=0.7, spatial_ndim=2)
            torch.testing.assert_close(batch[b, c], alone, rtol=0, atol=0, equal_nan=True)


def test_an_empty_shape_is_nan_all_over_and_full_masks_and_single_pixels_are_zero() -> None:
    masks = torch.zeros(3, 1, 6, 9)
    masks[1] = 1
    masks[2, 0, 0, 8] = 1
    share = complexity_map(masks)
    assert share[0].isnan().all()
    assert share[1:].abs().max() == 0.0
    for none in (torch.zeros(0, 3, 4, 5), torch.zeros(2, 0, 6)):
        assert complexity_map(none).shape == none.shape


@pytest.mark.parametrize("dtype", [torch.bool, torch.uint8, torch.int64, torch.bfloat16, torch.float32])
def test_dtype_and_strides_of_the_mask_do_not_matter(dtype: torch.dtype) -> None:
    masks = random_batch(50, 2, (15, 22))[:, None]
    expected = complexity_map(masks)
    assert expected.dtype == torch.float64
    assert torch.equal(complexity_map(masks.to(dtype)), expected)
    assert torch.equal(complexity_map(masks.to(dtype).mT.contiguous().mT), expected)
    assert torch.equal(complexity_map(masks, dtype=torch.float32), expected.float())


def test_methods_agree_and_numba_is_not_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    masks = random_batch(60, 6, (17, 24))[:, None]
    expected = complexity_map(masks)
    torch.testing.assert_close(complexity_map(masks, method="accelerated", tol=1e-11), expected, rtol=0, atol=1e-12)
    monkeypatch.setattr("torchlinf.kernels.has_compiler", lambda: False)
    torch.testing.assert_close(complexity_map(masks, tol=1e-11), expected, rtol=0, atol=1e-12)
    torch.testing.assert_close(sums(expected), complexity(masks, tol=1e-11), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"low": 0.5, "high": 0.5}, ValueError, r"low and high must obey 0 <= low < high <= 1; got low=0\.5"),
        ({"bins": 0}, ValueError, r"bins must be an integer of 1 or more; got 0\. Pass"),
        ({"rho": -1.0}, ValueError, r"rho must be .*above 0; got -1\.0\. Pass"),
        ({"method": "magic"}, ValueError, r"method must be one of .*; got 'magic'\. Pass"),
        ({"dtype": torch.int32}, TypeError, r"dtype must be a floating-point dtype; got torch\.int32\. Pass"),
        ({"spatial_ndim": 5}, ValueError, r"spatial_ndim must be from 1 to 4; got 5\. Pass"),
    ],
)
def test_bad_options_are_named(options: Mapping[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        complexity_map(torch.ones(1, 1, 4, 5), **options)
    with pytest.raises(ValueError, match=r"mask must be \(B, C, \*spatial\).*got \(4, 5\)"):
        torchlinf.complexity_map(torch.ones(4, 5))
