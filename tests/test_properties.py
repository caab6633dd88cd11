"""What holds for every shape, tried on shapes that hypothesis makes up: in 1 to 3 dimensions, connected or not."""

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from torch import Tensor

from torchlinf import chessboard_distance, complexity_profile, solve_field

METHODS = ("compiled", "batched", "accelerated", "monotone")
TOLERANCES = tuple(10.0**-k for k in range(1, 10))
ROUNDING = 1e-13  # relative: sums of a few ulps

several = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@st.composite
def masks(draw: st.DrawFn) -> Tensor:
    """A mask of 1 to 3 dimensions: boxes put on each other and taken away, and single pixels flipped."""
    sizes = tuple(draw(st.lists(st.integers(1, 13), min_size=1, max_size=3).filter(lambda s: np.prod(s) <= 500)))
    mask = np.zeros(sizes, dtype=bool)
    for inside in draw(st.lists(st.booleans(), min_size=1, max_size=6)):
        corners = [sorted((draw(st.integers(0, size)), draw(st.integers(0, size)))) for size in sizes]
        mask[tuple(slice(low, high) for low, high in corners)] = inside
    flipped = draw(st.sampled_from([0.0, 0.05, 0.4]))
    noise = draw(arrays(np.float64, sizes, elements=st.floats(0, 1)))
    return torch.from_numpy(mask ^ (noise < flipped))


def field(mask: Tensor, rho: float = 3.0, tol: float = 1e-11, method: str = "auto") -> Tensor:
    return solve_field(mask, rho=rho, tol=tol, method=method, spatial_ndim=mask.ndim).value


@several
@given(masks(), st.data())
def test_a_larger_shape_has_a_larger_field_and_distance(mask: Tensor, data: st.DataObject) -> None:
    fewer = mask & torch.from_numpy(data.draw(arrays(bool, tuple(mask.shape))))
    assert (field(fewer) <= field(mask) * (1 + 4e-11)).all()
    d_few, d_all = (chessboard_distance(m, spatial_ndim=m.ndim) for m in (fewer, mask))
    assert (d_few <= d_all).all()


@several
@given(masks(), st.lists(st.integers(0, 3), min_size=6, max_size=6))
def test_outside_pixels_around_a_shape_change_nothing(mask: Tensor, margins: list[int]) -> None:
    padded = torch.nn.functional.pad(mask, margins[: 2 * mask.ndim])
    found, expected = (complexity_profile(m, spatial_ndim=m.ndim) for m in (padded, mask))
    assert torch.equal(found.level_values, expected.level_values)
    assert torch.equal(found.radius, expected.radius)


@several
@given(masks(), st.sampled_from(TOLERANCES), st.sampled_from(METHODS), st.data())
def test_at_every_tolerance_flips_agree_within_the_bounds_of_both(
    mask: Tensor, tol: float, method: str, data: st.DataObject
) -> None:
    axes = data.draw(st.lists(st.sampled_from(range(mask.ndim)), unique=True))
    one = solve_field(mask, tol=tol, method=method, spatial_ndim=mask.ndim)
    other = solve_field(mask.flip(axes), tol=tol, method=method, spatial_ndim=mask.ndim)
    # value / (1 + q) <= f <= value / (1 - p), and both p and q are at most the bound
    low, high = (one.value / (1 + one.error_bound), one.value / (1 - one.error_bound))
    mirrored = other.value.flip(axes)
    assert (mirrored / (1 - other.error_bound) >= low * (1 - ROUNDING)).all()
    assert (mirrored / (1 + other.error_bound) <= high * (1 + ROUNDING)).all()


@several
@given(masks(), st.floats(0.5, 50), st.floats(1, 4))
def test_a_longer_screening_raises_the_field_within_its_bound(mask: Tensor, rho: float, factor: float) -> None:
    """With s = 1 / rho^2 > s', f' solves the equation of s up to (s' - s) f', so that f' / (1 + q) <= f <= f'."""
    short, long = field(mask, rho), field(mask, rho * factor)
    q = (rho**-2 - (rho * factor) ** -2) * long.max()
    assert (short <= long * (1 + 4e-11)).all()
    assert (long / (1 + q) <= short * (1 + 4e-11)).all()


@several
@given(masks(), st.floats(0.5, 50))
def test_the_field_lies_between_that_of_one_pixel_and_the_square_of_rho(mask: Tensor, rho: float) -> None:
    """A pixel alone has 1 / (1 + s). A field that is constant has 1 / s = rho^2."""
    inside = field(mask, rho)[mask]
    assert (inside >= (1 - 1e-10) / (1 + rho**-2)).all()
    assert (inside <= rho**2 * (1 + 1e-10)).all()


@several
@given(masks())
def test_the_distance_is_the_number_of_erosions_that_a_pixel_survives(mask: Tensor) -> None:
    ndim, expected, left = mask.ndim, torch.zeros(mask.shape, dtype=torch.int32), mask.numpy()
    while left.any():
        expected += torch.from_numpy(left)
        padded = np.pad(left, 1)
        left = np.lib.stride_tricks.sliding_window_view(padded, (3,) * ndim).all(axis=tuple(range(ndim, 2 * ndim)))
    assert torch.equal(chessboard_distance(mask, spatial_ndim=ndim), expected)


@pytest.mark.parametrize("method", METHODS)
@several
@given(masks())
def test_the_methods_agree_within_their_bounds(method: str, mask: Tensor) -> None:
    found, expected = field(mask, tol=1e-7, method=method), field(mask)
    assert ((found - expected).abs() <= 1.1e-7 * expected).all()


@several
@given(masks())
def test_the_field_is_largest_exactly_where_the_distance_is(mask: Tensor) -> None:
    if not mask.any():
        return
    f = solve_field(mask, tol=1e-12, spatial_ndim=mask.ndim).value
    distance = chessboard_distance(mask, spatial_ndim=mask.ndim)
    deepest = distance == distance.max()
    assert (f[deepest] >= f.max() * (1 - 1e-10)).all()
    assert (f[~deepest] < f.max() * (1 - 1e-10)).all()
