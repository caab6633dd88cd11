"""Shapes that are solved once: their levels after flips, against solves of the whole."""

import itertools
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy import ndimage

import torchlinf
from torchlinf.kernels import has_compiler
from torchlinf.losses import region_flips
from torchlinf.measure import Measure, SolvedShape, complexities_after_flips, solved_shape

pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs numba")

OPTIONS: list[dict[str, Any]] = [
    {},
    {"bins": 7},
    {"levels": "rim"},
    {"rho": 2.5},
    {"rho": 9.0, "levels": "rim", "bins": 64},
    {"estimator": "std"},
    {"estimator": "std", "tol_bits": 1e-6},
    {"tol": 1e-3, "tol_bits": np.inf},
    {"tol": 0.05, "tol_bits": 0.3},
]


def blob(sides: tuple[int, ...], seed: int) -> NDArray[np.bool_]:
    """A smooth random shape, with holes and several parts as they come."""
    noise = np.random.default_rng(seed).standard_normal(sides)
    return ndimage.gaussian_filter(noise, 1.5) > -0.02


def flips_of(mask: NDArray[np.bool_], seed: int, count: int) -> list[NDArray[np.int64]]:
    """Boxes of pixels: removed, filled, or both at once; some change the radius."""
    rng = np.random.default_rng(seed)
    found = []
    for kind in itertools.islice(itertools.cycle(["remove", "fill", "both"]), count):
        low = [int(rng.integers(0, size)) for size in mask.shape]
        box = tuple(slice(a, a + int(rng.integers(1, 5))) for a in low)
        chosen = np.zeros_like(mask)
        chosen[box] = True
        chosen &= {"remove": mask, "fill": ~mask, "both": np.ones_like(mask)}[kind]
        if chosen.any() and (mask ^ chosen).any():
            found.append(np.flatnonzero(chosen))
    return found


def flipped(mask: NDArray[np.bool_], pixels: NDArray[np.int64]) -> NDArray[np.bool_]:
    after = mask.copy()
    after.reshape(-1)[pixels] ^= True
    return after


def assert_levels(found: Any, mask: NDArray[np.bool_], options: dict[str, Any]) -> None:
    whole = torchlinf.complexity_profile(torch.from_numpy(mask), spatial_ndim=mask.ndim, **options)
    assert len(found.values) == int(whole.radius)
    slack = found.error_bound + whole.level_error_bound.numpy()
    assert (np.abs(found.values - whole.level_values.numpy()) <= slack).all()
    assert found.field_error_bound <= options.get("tol", 1e-9)
    if not options.get("tol_bits", 0) and options.get("estimator") != "std":
        assert not slack.any()  # so the numbers are the same in every digit


@pytest.mark.parametrize("options", OPTIONS, ids=str)
@pytest.mark.parametrize("sides", [(70,), (23, 31), (9, 12, 10), (6, 5, 7, 6)])
def test_levels_after_a_flip_are_those_of_the_whole(sides: tuple[int, ...], options: dict[str, Any]) -> None:
    local = 0
    for seed in range(2):
        mask = blob(sides, seed)
        shape = SolvedShape(mask, Measure(**options))
        assert_levels(shape.levels, mask, options)
        for pixels in flips_of(mask, seed, 12):
            found = shape.after(pixels)
            assert_levels(found, flipped(mask, pixels), options)
            local += found.local
        again = SolvedShape(mask, Measure(**options)).levels
        assert np.array_equal(shape.after(np.zeros(0, np.int64)).values, again.values)  # all flips were undone
    assert local > 4


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_flips_that_are_kept_add_up(options: dict[str, Any]) -> None:
    mask = blob((26, 33), 5)
    shape = SolvedShape(mask, Measure(**options))
    for number, pixels in enumerate(flips_of(mask, 3, 24)):
        if number % 2:
            found = shape.after(pixels)
            assert_levels(found, flipped(mask, pixels), options)
        else:
            found = shape.after(pixels, keep=True)
            mask = flipped(mask, pixels)
            assert np.array_equal(shape.mask, mask)
            assert found is shape.levels
            assert_levels(found, mask, options)


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_many_flips_tried_at_once_leave_the_shape_as_it_is(options: dict[str, Any]) -> None:
    mask = blob((27, 22), 5)
    flips = [*flips_of(mask, 3, 24), np.flatnonzero(mask)[::3]]  # the last one reaches everywhere
    shape = SolvedShape(mask, Measure(**options))
    before = shape.levels.values.copy()
    for _ in range(2):  # the second time from what the first has left
        found = shape.after_each(flips)
        assert len(found) == len(flips)
        for pixels, levels in zip(flips, found, strict=True):
            assert_levels(levels, flipped(mask, pixels), options)
    assert len({levels.local for levels in found}) == 2
    assert np.array_equal(shape.levels.values, before)
    assert np.array_equal(shape.mask, mask)
    assert shape.after_each([]) == []


def test_levels_of_a_few_values_that_many_pixels_have() -> None:
    # A cell of 64 pixels or more is counted apart from the smaller ones.
    mask = np.zeros((60, 90), bool)
    mask[5:55, 5:85] = True
    shape = SolvedShape(mask, Measure())
    local = 0
    for place in [(5, 5), (5, 84), (4, 20), (54, 83), (55, 30)]:
        pixels = np.array([np.ravel_multi_index(place, mask.shape)])
        mask = flipped(mask, pixels)
        assert_levels(shape.after(pixels, keep=True), mask, {})
        local += shape.levels.local
    assert local > 0


def test_a_large_flip_and_one_that_leaves_nothing() -> None:
    mask = np.zeros((40, 52), bool)
    mask[3:37, 4:47] = True
    mask[1:3, 20:23] = True
    shape = SolvedShape(mask, Measure())
    everything = np.flatnonzero(mask)
    assert shape.after(everything).values.size == 0
    assert_levels(
        shape.after(np.flatnonzero(np.eye(40, 52, dtype=bool) & mask)),
        flipped(mask, np.flatnonzero(np.eye(40, 52, dtype=bool) & mask)),
        {},
    )
    assert shape.after(everything, keep=True).values.size == 0
    assert not shape.mask.any()
    assert_levels(shape.after(everything, keep=True), mask, {})


def test_complexities_are_those_of_the_masks_and_threads_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    masks = [blob((22, 30), 0), blob((31, 18), 1), np.zeros((5, 6), bool)]
    flips = [flips_of(masks[0], 0, 9), flips_of(masks[1], 1, 4), []]
    measure = Measure(low=0.1, high=0.7)
    expected = complexities_after_flips(masks, flips, measure)
    for mask, some, (before, after) in zip(masks, flips, expected, strict=True):
        values = [
            float(torchlinf.complexity(torch.from_numpy(m), low=0.1, high=0.7, spatial_ndim=2))
            for m in [mask, *(flipped(mask, pixels) for pixels in some)]
        ]
        assert np.array_equal([before, *after], values, equal_nan=True)
    monkeypatch.setattr(torch, "get_num_threads", lambda: 7)
    for (before, after), (also, same) in zip(complexities_after_flips(masks, flips, measure), expected, strict=True):
        assert np.array_equal([before, *after], [also, *same], equal_nan=True)


def test_without_a_compiler_every_shape_is_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    mask = blob((14, 19), 2)
    flips = [flips_of(mask, 0, 4)]
    [(before, after)] = complexities_after_flips([mask], flips, Measure(bins=32))
    monkeypatch.setattr(solved_shape, "has_compiler", lambda: False)
    monkeypatch.setattr("torchlinf.measure.levels.has_compiler", lambda: False)
    [(also, same)] = complexities_after_flips([mask], flips, Measure(bins=32))
    assert before == pytest.approx(also)
    assert after == pytest.approx(same)


def masks_in(variable: str, count: int) -> list[NDArray[np.bool_]]:
    """Real masks, from the folder that an environment variable names."""
    from PIL import Image

    folder = os.environ.get(variable)
    if folder is None:
        pytest.skip(f"set {variable} to a folder with train/masks")
    files = sorted((Path(folder) / "train" / "masks").iterdir())[:count]
    masks = [np.atleast_3d(np.asarray(Image.open(file)))[..., 0] > 0 for file in files]
    return [mask for mask in masks if mask.any()]


@pytest.mark.parametrize("variable", ["TORCHLINF_BUILDINGS", "TORCHLINF_FACADES"])
def test_flips_of_real_masks_have_the_complexity_of_the_whole(variable: str) -> None:
    masks = masks_in(variable, 6)
    inside = torch.from_numpy(np.stack(masks))
    regions = region_flips.select(inside, region_flips.candidates(inside.double(), 0.5, 8), 8)
    shapes = [[mask, *(flipped(mask, pixels) for pixels in some)] for mask, some in zip(masks, regions, strict=True)]
    for (before, after), whole in zip(complexities_after_flips(masks, regions, Measure()), shapes, strict=True):
        values = torchlinf.complexity(torch.from_numpy(np.stack(whole)), spatial_ndim=2)
        assert np.array_equal([before, *after], values)
