"""Oblong pixels: a box stays a box, whole ratios are repetitions, and every function says what it measured."""

import numpy as np
import pytest
import tifffile
import torch

from torchlinf import complexity, equal_spacing
from torchlinf.labels import complexity_table
from torchlinf.scoring import find_masks, read_mask, score_masks


def blob(seed: int, *size: int) -> np.ndarray:
    """A random shape of several parts with holes."""
    noise = np.random.default_rng(seed).random(size)
    return (noise + np.roll(noise, 1, -1) + np.roll(noise, 1, -2)) > 1.2


def value(mask: np.ndarray) -> float:
    return complexity(torch.from_numpy(np.ascontiguousarray(mask)), spatial_ndim=mask.ndim).item()


@pytest.mark.parametrize(
    "spacing", [(3.0, 1.0), (1.5, 0.5), (0.9, 0.3), (float(np.float32(0.9)), float(np.float32(0.3)))]
)
def test_a_whole_ratio_repeats_every_pixel(spacing: tuple[float, float]) -> None:
    mask = blob(0, 2, 11, 17)
    np.testing.assert_array_equal(equal_spacing(mask, spacing), np.repeat(mask, 3, axis=-2))
    swapped = equal_spacing(torch.from_numpy(mask), spacing[::-1])
    assert torch.equal(swapped, torch.from_numpy(mask).repeat_interleave(3, dim=-1))


def test_labels_and_dtypes_stay() -> None:
    labels = np.random.default_rng(1).integers(0, 5, (4, 6, 7)).astype(np.uint16)
    cubes = equal_spacing(labels, (2.0, 1.0, 4.0))
    np.testing.assert_array_equal(cubes, labels.repeat(2, axis=0).repeat(4, axis=2))
    assert cubes.dtype == np.uint16


def nearest(pixels: int, size: float, cube: float) -> list[int]:
    """The pixel under the centre of each cube, by plain arithmetic."""
    count = max(1, int(np.floor(pixels * size / cube + 0.5)))
    start = (pixels * size - count * cube) / 2
    # Of an even number of pixels and an odd one of cubes a centre lies on a border: the later pixel has it.
    return [int(np.floor((start + (j + 0.5) * cube) / size + 1e-9)) for j in range(count)]


@pytest.mark.parametrize("seed", range(20))
def test_any_ratio_takes_the_pixel_under_each_centre(seed: int) -> None:
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, 40, 2)
    tall, wide, cube = rng.uniform(0.2, 5.0, 3)
    mask = rng.random((height, width)) > 0.5
    rows, columns = nearest(height, tall, cube), nearest(width, wide, cube)
    np.testing.assert_array_equal(equal_spacing(mask, (tall, wide), voxel=cube), mask[np.ix_(rows, columns)])


@pytest.mark.parametrize("seed", range(10))
def test_a_box_stays_a_box_and_no_pixel_is_lost(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spacing = tuple(rng.uniform(0.3, 4.0, 3))
    mask = np.zeros((9, 14, 11), dtype=bool)
    mask[2:8, 1:12, 3:9] = True
    assert value(equal_spacing(mask, spacing)) == 0.0
    numbered = np.arange(9 * 14 * 11).reshape(9, 14, 11)
    np.testing.assert_array_equal(np.unique(equal_spacing(numbered, spacing)), numbered.ravel())


@pytest.mark.parametrize("spacing", [(1.0, 1.7), (2.5, 1.0), (1.0, 1.234567)])
def test_flips_and_turns_go_along(spacing: tuple[float, float]) -> None:
    # Of 11 and 17 pixels no cube of these sizes has its centre on a border between two, where one side has to win.
    mask = blob(3, 11, 17)
    cubes = equal_spacing(mask, spacing)
    np.testing.assert_array_equal(equal_spacing(mask.T, spacing[::-1]), cubes.T)
    if spacing != (2.5, 1.0):
        np.testing.assert_array_equal(equal_spacing(mask[::-1, ::-1], spacing), cubes[::-1, ::-1])


def test_cubes_are_left_alone() -> None:
    mask = blob(4, 8, 9)
    assert equal_spacing(mask, (0.7, 0.7)) is mask
    assert equal_spacing(mask, (2.0, 2.0), voxel=2.0) is mask
    assert equal_spacing(mask, (2.0, 2.0), voxel=1.0).shape == (16, 18)
    assert equal_spacing(mask[:0], (3.0, 1.0)).shape == (0, 9)


def test_what_is_wrong_says_so() -> None:
    mask = blob(5, 8, 9)
    for spacing, error, words in (
        (2.0, TypeError, "spacing must hold one number for each axis"),
        ((), TypeError, "spacing must hold one number for each axis"),
        ((1.0, 0.0), ValueError, "spacing must be finite and above 0"),
        ((1.0, 2.0, 3.0), ValueError, "got 3 numbers for shape"),
        ((1e9, 1.0), ValueError, r"8000000000 x 9 cubes of 1. Pass a larger voxel"),
    ):
        with pytest.raises(error, match=words):
            equal_spacing(mask, spacing)
    with pytest.raises(TypeError, match="mask must be a tensor or an array; got list"):
        equal_spacing([[1, 0]], (1.0, 2.0))
    with pytest.raises(ValueError, match="voxel must be finite and above 0"):
        equal_spacing(mask, (1.0, 2.0), voxel=-1.0)


def test_a_table_of_labels_is_that_of_the_objects_in_cubes() -> None:
    labels = np.zeros((15, 40), dtype=int)
    labels[1:6, 2:30] = 4
    labels[8:14, 3:35] = 9
    labels[8:11, 3:12] = 0
    table = complexity_table(labels, spacing=(3.0, 1.0))
    assert table["complexity"][0] == 0.0
    assert table["radius"].tolist() == [8, 9]  # of 15 x 28 and 18 x 32 squares
    cubes = np.repeat(labels[8:14, 3:35] == 9, 3, axis=0)
    assert table["complexity"][1] == value(cubes)
    assert table["spacing"].tolist() == ["3 x 1 in cubes of 1"] * 2
    plain = complexity_table(labels)
    assert "spacing" not in plain
    assert plain["complexity"][1] != table["complexity"][1]
    same = complexity_table(labels, spacing=(0.5, 0.5), properties=["area"])
    assert same["complexity"].tolist() == plain["complexity"].tolist()
    assert same["area"][0] == 5 * 28 / 4
    fine = complexity_table(labels, spacing=(3.0, 1.0), voxel=0.5)
    assert fine["radius"].tolist() == [15, 18]
    with pytest.raises(ValueError, match="voxel must stand beside spacing"):
        complexity_table(labels, voxel=1.0)
    with pytest.raises(ValueError, match="one number for each of the 2 axes"):
        complexity_table(labels, spacing=(1.0, 1.0, 1.0))
    volume = np.stack([labels, labels])
    deep = complexity_table(volume, spacing=(20.0, 3.0, 1.0), spatial_ndim=3)
    assert deep["radius"].tolist() == [8, 9]  # two slices make forty cubes
    assert deep["complexity"][0] == 0.0
    thin = np.zeros((9, 9), dtype=int)
    thin[0, 0] = thin[8, 8] = thin[0, 8] = thin[8, 0] = 1
    with pytest.raises(ValueError, match=r"nothing is left of label 1\. Pass a smaller voxel"):
        complexity_table(thin, spacing=(1.0, 1.0), voxel=3.0)


def test_masks_in_files_take_the_spacing_that_is_given(tmp_path) -> None:  # type: ignore[no-untyped-def]
    mask = blob(6, 12, 17)
    np.save(tmp_path / "a.npy", mask)
    sources = find_masks([tmp_path])
    (row,) = score_masks(sources, spacing=(2.0, 1.0))
    own = mask[mask.any(axis=1).nonzero()[0][0] :]
    assert own.shape == mask.shape  # the shape fills its array, so that cutting it out changes nothing
    assert row["complexity"] == value(np.repeat(mask, 2, axis=0))
    assert (row.spacing, row.pixels, row.height) == ("2 x 1 in cubes of 1", mask.sum(), 12)
    (same,) = score_masks(sources, spacing=(2.0,))
    (plain,) = score_masks(sources)
    assert same["complexity"] == plain["complexity"]
    assert (same.spacing, plain.spacing) == ("2 x 2", None)
    for options, words in (
        ({"spacing": (1.0, 2.0, 3.0)}, "--spacing has 3 numbers, and the mask 2 axes"),
        ({"spacing": "header"}, "does not say how large its pixels are"),
        ({"voxel": 2.0}, "--voxel needs the size of a pixel"),
        ({"spacing": (1.0, 2.0), "voxel": 1e-4}, "Pass a larger voxel"),
    ):
        (row,) = score_masks(sources, **options)
        assert words in row.error
    with pytest.raises(ValueError, match="spacing must be numbers, 'header' or 'pixels'; got 'mm'"):
        list(score_masks(sources, spacing="mm"))


def test_a_tiff_says_its_spacing_where_it_is_asked(tmp_path) -> None:  # type: ignore[no-untyped-def]
    volume = blob(7, 4, 9, 13)
    sizes = {"PhysicalSizeX": 0.5, "PhysicalSizeY": 0.25, "PhysicalSizeZ": 1.5}
    tifffile.imwrite(tmp_path / "a.ome.tif", volume.astype(np.uint8), metadata={"axes": "ZYX", **sizes})
    imagej = {"axes": "ZYX", "spacing": 1.5, "unit": "um"}
    tifffile.imwrite(tmp_path / "b.tif", volume.astype(np.uint8), imagej=True, resolution=(2, 4), metadata=imagej)
    geo = [(33550, "d", 3, (10.0, 20.0, 0.0), True)]
    tifffile.imwrite(tmp_path / "c.tif", volume[0].astype(np.uint8), extratags=geo, metadata=None)
    tifffile.imwrite(tmp_path / "d.tif", volume[0].astype(np.uint8), resolution=(2, 4), metadata=None)
    rows = list(score_masks(find_masks([tmp_path]), volume=True, spacing="header"))
    assert [row.error for row in rows] == [None] * 4
    cubes = ["1.5 x 0.25 x 0.5 in cubes of 0.25"] * 2
    assert [row.spacing for row in rows] == [*cubes, "20 x 10 in cubes of 10", "0.25 x 0.5 in cubes of 0.25"]
    assert [row.spacing for row in score_masks(find_masks([tmp_path]), volume=True)] == [None] * 4
    np.testing.assert_array_equal(read_mask(tmp_path / "b.tif", volume=True), volume)
