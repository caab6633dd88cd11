"""The selection of tiles and the residual that is kept for each, against the residual of the whole array."""

import numpy as np
import pytest
from scipy import ndimage

from torchlinf.kernels import active_set, grid
from torchlinf.kernels.active_set import ActiveSet

SIDES = {1: (83,), 2: (21, 75), 3: (11, 13, 70), 4: (4, 9, 10, 35)}


def random_case(ndim: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A padded ragged mask, and positive values on it."""
    rng = np.random.default_rng(seed)
    noise = ndimage.gaussian_filter(rng.normal(size=SIDES[ndim]), 1.2)
    mask = np.pad(noise > -0.3 * noise.std(), 1)
    return mask, np.where(mask, rng.random(mask.shape), 0.0)


def residual(mask: np.ndarray, v: np.ndarray, screening: float) -> np.ndarray:
    """R(v) by scipy's filters."""
    high, low = ndimage.maximum_filter(v, 3), ndimage.minimum_filter(v, 3)
    return np.where(mask, high + low - (2 + screening) * v + 1, 0.0)


def bounds(found: ActiveSet, geometry: grid.Grid, v: np.ndarray) -> tuple[float, float]:
    return found.update_bound(v.reshape(-1), 0.01, np.empty((4, geometry.shape[-1])))


def selected(found: ActiveSet, size: int) -> np.ndarray:
    """The selection as flat flags, each pixel at most once."""
    count = np.zeros(size, int)
    for start, end in zip(found.starts, found.ends, strict=True):
        count[start:end] += 1
    assert count.max(initial=0) <= 1
    return count.astype(bool)


@pytest.mark.parametrize("ndim", [1, 2, 3, 4])
def test_bounds_are_those_of_the_whole_array(ndim: int) -> None:
    mask, v = random_case(ndim, seed=ndim)
    geometry = grid.make_grid(mask)
    r = residual(mask, v, 0.01)
    assert bounds(ActiveSet(geometry), geometry, v) == pytest.approx((r.max(), -r.min()), rel=1e-12)


def swept(mask: np.ndarray, v: np.ndarray, active: np.ndarray, weight: float, backward: bool) -> None:
    """One sweep in place, row by row: a row sees the new values of the rows before it."""
    block = np.stack(np.meshgrid(*[(-1, 0, 1)] * mask.ndim, indexing="ij")).reshape(mask.ndim, -1)
    rows = list(np.ndindex(mask.shape[:-1]))
    for row in reversed(rows) if backward else rows:
        columns = np.flatnonzero(mask[row] & active[row])
        if columns.size:
            around = [np.array(row)[:, None, None] + block[:-1, :, None], columns + block[-1][:, None]]
            values = v[(*(np.broadcast_to(c, around[1].shape) for c in around[0]), around[1])]
            v[row][columns] = (values.max(0) + values.min(0) + 1) * weight


@pytest.mark.parametrize("ndim", [1, 2, 3, 4])
def test_sweeps_of_the_selection_measure_what_the_last_one_moved(ndim: int) -> None:
    mask, v = random_case(ndim, seed=10 + ndim)
    geometry, weight = grid.make_grid(mask), 1 / 2.01
    found = ActiveSet(geometry)
    largest = max(bounds(found, geometry, v))
    r = np.abs(residual(mask, v, 0.01))
    found.select(0.97 * largest)
    active = selected(found, v.size).reshape(v.shape)
    expected = v.copy()
    for number in range(3):
        before = expected.copy()
        swept(mask, expected, active, weight, backward=number % 2 == 1)
    moved = np.abs(expected - before).max() / weight
    still = r[mask & ~active]
    given = found.sweep(v.reshape(-1), weight, 3, np.empty((4, geometry.shape[-1])), lambda: None)
    np.testing.assert_allclose(v, expected, rtol=1e-14)
    assert given == pytest.approx(max(moved, still.max(initial=0)), rel=1e-10)
    found.select(0.5 * given)  # by what has moved, and elsewhere by the residual of before
    r = residual(mask, v, 0.01)
    assert bounds(found, geometry, v) == pytest.approx((r.max(), -r.min()), rel=1e-12)


@pytest.mark.parametrize("ndim", [1, 2, 3, 4])
def test_selection_is_the_tiles_above_the_threshold_and_their_neighbours(ndim: int) -> None:
    mask, v = random_case(ndim, seed=20 + ndim)
    geometry = grid.make_grid(mask)
    found = ActiveSet(geometry)
    bounds(found, geometry, v)
    threshold = 0.95 * np.abs(residual(mask, v, 0.01)).max()
    tile = np.stack(np.indices(mask.shape)) // np.array(
        [active_set.ROWS] * (ndim - 1) + [active_set.COLUMNS]
    ).reshape(-1, *[1] * ndim)  # fmt: skip
    above = {tuple(t) for t in tile[:, np.abs(residual(mask, v, 0.01)) > threshold].T.tolist()}
    beside = np.zeros(mask.shape, bool)
    for seed in above:
        beside |= (np.abs(tile - np.array(seed).reshape(-1, *[1] * ndim)) <= 1).all(0)
    found.select(threshold)
    chosen = selected(found, v.size).reshape(v.shape)
    assert np.array_equal(chosen, beside & mask)
    assert found.share == pytest.approx(chosen.sum() / mask.sum())


def test_the_whole_shape_is_selected_at_first_and_may_be_none_of_it() -> None:
    mask, _ = random_case(2, seed=3)
    geometry = grid.make_grid(mask)
    found = ActiveSet(geometry)
    assert np.array_equal(selected(found, mask.size), mask.reshape(-1))
    assert found.share == 1
    found.select(0.0)
    assert found.share == 0
