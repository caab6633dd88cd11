"""What the paper says of its field, one statement a test: docs/paper has a row for each."""

import pytest
import torch
from torch import Tensor
from torch.nn.functional import max_pool2d, pad

from torchlinf import chessboard_distance, complexity_profile, linf_field, shapes
from torchlinf.shapes import Appendage


def field_of_constant(mask: Tensor, constant: float, rho: float) -> Tensor:
    """f of max_B f + min_B f - (2 + 1/rho^2) f + constant = 0, by plain iteration from 0."""
    inside = pad(mask.double()[None, None], [1] * 4)
    f = torch.zeros_like(inside)
    for _ in range(20_000):
        largest, smallest = max_pool2d(f, 3, 1, 1), -max_pool2d(-f, 3, 1, 1)
        after = (largest + smallest + constant) * inside / (2 + rho**-2)
        if (after - f).abs().max() <= 1e-14 * constant:
            break
        f = after
    return f[0, 0, 1:-1, 1:-1]


def test_normalised_the_constant_on_the_right_does_not_matter() -> None:
    shape = shapes.with_appendages((20, 34), [Appendage("right", 10, 6), Appendage("top", 7, 4)])
    rho = float(chessboard_distance(shape, spatial_ndim=2).max())
    one, other = field_of_constant(shape, 1.0, rho), field_of_constant(shape, 7.5, rho)
    assert float(other.max() / one.max()) == pytest.approx(7.5)
    for found in (one, other):
        torch.testing.assert_close(linf_field(shape, spatial_ndim=2), found / found.max(), rtol=0, atol=1e-9)


def test_with_the_radius_as_screening_length_the_field_is_robust_in_scale() -> None:
    """One shape at three sizes: f / max f at t = 1/2 beside the middle of the left side, where nothing is appended."""
    halfway: dict[str, list[float]] = {"own": [], "fixed": []}
    for radius in (16, 32, 64):
        appendages = [Appendage("right", radius, radius // 2), Appendage("top", radius // 2, radius // 2)]
        shape = shapes.with_appendages((2 * radius, 2 * radius), appendages)
        assert chessboard_distance(shape, spatial_ndim=2).max() == radius
        for name, rho in (("own", None), ("fixed", 16.0)):
            field = linf_field(shape, rho=rho, spatial_ndim=2)
            halfway[name].append(float(field[len(field) - radius, radius // 2 - 1]))
    assert halfway["own"] == pytest.approx([0.752, 0.758, 0.762], abs=5e-4)
    assert halfway["fixed"] == pytest.approx([0.752, 0.798, 0.894], abs=5e-4)


@pytest.mark.parametrize("width", [32, 80, 96])
def test_an_appendage_acts_only_within_half_its_width_of_its_contact(width: int) -> None:
    square = shapes.square(128)
    joined = shapes.with_appendages((128, 128), [Appendage("right", width, 48)])
    changed = (linf_field(joined, spatial_ndim=2)[:, :128] - linf_field(square, spatial_ndim=2)).abs() > 1e-9
    row, column = torch.meshgrid(torch.arange(128), torch.arange(128), indexing="ij")
    start = (128 - width) // 2
    beyond = torch.stack([start - row, row - (start + width - 1), torch.zeros_like(row)]).amax(dim=0)
    to_contact = torch.maximum(beyond, 128 - column)  # chessboard distance to the appendage
    assert int(to_contact[changed].max()) == width // 2 - 1


@pytest.mark.parametrize(("shape", "radius"), [(shapes.disc(64), 46), (shapes.rectangle(50, 128), 25)])
def test_there_are_as_many_scales_as_the_radius_has_pixels(shape: Tensor, radius: int) -> None:
    distance = chessboard_distance(shape, spatial_ndim=2)
    assert distance[shape].unique().tolist() == list(range(1, radius + 1))
    assert len(complexity_profile(shape, spatial_ndim=2).levels()) == radius
