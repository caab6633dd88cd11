"""Connected regions by the kernel and by SciPy's graphs, against SciPy's labels."""

import itertools

import numpy as np
import pytest
from scipy import ndimage

from torchlinf.kernels import has_compiler, regions

PATHS = [pytest.param(True, marks=pytest.mark.skipif(not has_compiler(), reason="needs numba")), False]


def gathered(
    maps: np.ndarray, limit: int, budget: int, most: int, whole: bool
) -> tuple[list[tuple[int, tuple[int, ...]]], list[int]]:
    """The shape and the sorted pixels of every region of the maps, (G, N, *sizes), and their codes."""
    ndim = maps.ndim - 2
    found = regions.RegionList(maps.shape[2:], np.full(maps.shape[1], limit), budget, most)
    steps = np.array([step for step in itertools.product((-1, 0, 1), repeat=ndim) if any(step)])
    found.gather(regions.Maps(np.where(maps, 0, 1), (1,)), 0, np.tile(steps @ found.strides, (len(maps), 1)), whole)
    pixels, begin, owner, code = found.found()
    parts = [tuple(np.sort(pixels[a:b]).tolist()) for a, b in itertools.pairwise(begin.tolist())]
    return list(zip(owner.tolist(), parts, strict=True)), code.tolist()


def labelled(one: np.ndarray) -> list[tuple[int, ...]]:
    labels, count = ndimage.label(one, np.ones((3,) * one.ndim))
    return [tuple(np.flatnonzero(labels.reshape(-1) == number).tolist()) for number in range(1, count + 1)]


@pytest.mark.parametrize("compiled", PATHS)
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("sides", [(30,), (12, 17), (5, 6, 7)])
def test_regions_are_those_of_scipy(
    sides: tuple[int, ...], share: float, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(regions, "has_compiler", lambda: compiled)
    maps = np.random.default_rng(len(sides)).random((2, 3, *sides)) < share
    found, code = gathered(maps, limit=10**6, budget=10**6, most=10**6, whole=False)
    expected = [(n, region) for n in range(3) for g in range(2) for region in labelled(maps[g, n])]
    assert sorted(found) == sorted(expected)
    pairs = {(region, number) for (_, region), number in zip(found, code, strict=True)}
    assert len(pairs) == len({region for region, _ in pairs}) == len({number for _, number in pairs})


@pytest.mark.parametrize("compiled", PATHS)
def test_a_map_that_is_the_one_before_is_not_looked_at_again(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regions, "has_compiler", lambda: compiled)
    sizes = np.full((1, 2, 6, 8), regions.FAR)
    sizes[0, 0, 1, 1:4] = 1
    sizes[0, 0, 4, 2:7] = 4
    sizes[0, 1, 2, 5] = 1
    maps = regions.Maps(sizes.astype(np.int16), (2, 3, 5))
    found = regions.RegionList((6, 8), np.array([20, 20]), 11, 9)  # 3 and 3 + 5 pixels, and not 3 once more
    for kind in range(3):
        found.gather(maps, kind, np.array([[1, -1]]), False)
    _, begin, owner, _ = found.found()
    # Of the last map the run of 3 comes again, since the map is another one.
    assert list(zip(owner.tolist(), np.diff(begin).tolist(), strict=True)) in (
        [(0, 3), (1, 1), (0, 3), (0, 5)],
        [(0, 3), (1, 1), (0, 5), (0, 3)],
    )


@pytest.mark.parametrize("compiled", PATHS)
def test_what_is_too_large_or_too_many_is_left_out(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regions, "has_compiler", lambda: compiled)
    maps = np.zeros((1, 2, 7, 20), bool)
    maps[0, 0, 1, 1:15:2] = True  # 7 regions of one pixel
    maps[0, 0, 3:5, :6] = True  # and one of 12
    maps[0, 0, 6, 3:5] = True
    maps[0, 1, :, 3] = True
    sizes = [(n, len(region)) for n, region in gathered(maps, limit=11, budget=200, most=3, whole=False)[0]]
    assert sorted(sizes) == [(0, 1)] * 4 + [(0, 2), (1, 7)]  # 4 are more than 3, and as good as 7
    sizes = [(n, len(region)) for n, region in gathered(maps, limit=25, budget=20, most=9, whole=True)[0]]
    assert sorted(sizes) == [(1, 7), (1, 7)]  # 21 pixels of the first shape are beyond the budget
