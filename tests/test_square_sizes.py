"""Sizes of pixels by the squares and runs that hold them, and maps of them, against SciPy and plain loops."""

import numpy as np
import pytest
from scipy import ndimage

from torchlinf.kernels import has_compiler, regions

pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs numba")
SIDES = (2, 3, 5, 8)


def masks() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    smooth = ndimage.gaussian_filter(rng.standard_normal((23, 31)), 1.5) > 0
    return [smooth, rng.random((12, 7)) < 0.9, np.ones((4, 17), bool), np.zeros((3, 5), bool)]


@pytest.mark.parametrize("mask", masks())
@pytest.mark.parametrize("around", [0, 8])
def test_squares_are_the_openings_of_scipy(mask: np.ndarray, around: int) -> None:
    from torchlinf.kernels.openings import square_sizes

    found = square_sizes(mask, around, SIDES)
    assert (found[~mask] == regions.FAR).all()
    padded = np.pad(np.pad(mask, around, constant_values=True), 8)
    inner = tuple(slice(around + 8, around + 8 + size) for size in mask.shape)
    expected = np.where(mask, regions.FAR, 0)
    for side in reversed(SIDES):
        expected[mask & ~ndimage.binary_opening(padded, np.ones((side, side)))[inner]] = side - 1
    assert np.array_equal(found[mask], expected[mask])


@pytest.mark.parametrize("shape", [(40,), (9, 14), (4, 5, 6)])
@pytest.mark.parametrize("endless", [False, True])
def test_runs_are_those_of_a_plain_loop(shape: tuple[int, ...], endless: bool) -> None:
    from torchlinf.kernels.openings import run_lengths

    mask = np.random.default_rng(1).random(shape) < 0.7
    for axis in range(len(shape)):
        expected = np.full(shape, regions.FAR)
        for place in np.argwhere(mask):
            line = mask[tuple(slice(None) if i == axis else p for i, p in enumerate(place))]
            first = last = place[axis]
            while first > 0 and line[first - 1]:
                first -= 1
            while last < len(line) - 1 and line[last + 1]:
                last += 1
            if not (endless and (first == 0 or last == len(line) - 1)):
                expected[tuple(place)] = last - first + 1
        assert np.array_equal(run_lengths(mask, axis, endless), expected)


@pytest.mark.parametrize("compiled", [True, False])
def test_maps_hold_the_smaller_sizes_first(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regions, "has_compiler", lambda: compiled)
    sizes = np.random.default_rng(2).integers(0, 12, (3, 2, 9, 11)).astype(np.int16)
    maps = regions.Maps(sizes, SIDES)
    for g, n in np.ndindex(3, 2):
        for k, side in enumerate(SIDES):
            below = maps.order[g, n, : maps.ends[g, n, k]]
            assert sorted(below.tolist()) == np.flatnonzero(sizes[g, n] < side).tolist()
