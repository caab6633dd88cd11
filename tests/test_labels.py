"""Tables of label maps: every object as if it were alone, whatever the labels are called."""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from problems import catalogue
from skimage.measure import regionprops_table

import torchlinf
from torchlinf.labels import LARGEST, complexity_table
from torchlinf.measure import Measure, levels, ragged_profile


def label_map(sizes: tuple[int, ...] = (60, 83), seed: int = 3) -> NDArray[np.int64]:
    """Boxes with holes, laid over each other: objects of all forms, some in pieces, some cut off by the border."""
    generator = np.random.default_rng(seed)
    found = np.zeros(sizes, dtype=np.int64)
    for name in range(1, 13):
        start = [generator.integers(size) for size in sizes]
        found[tuple(slice(a, a + 2 + size // 3) for a, size in zip(start, sizes, strict=True))] = name
    found[generator.random(sizes) < 0.02] = 0
    return found


def alone(found: NDArray[np.int64], name: int) -> torchlinf.ComplexityProfile:
    return torchlinf.complexity_profile(torch.from_numpy(found == name), spatial_ndim=found.ndim)


@pytest.mark.parametrize("sizes", [(90,), (60, 83), (14, 17, 21), (6, 7, 9, 8)])
def test_every_object_has_the_numbers_that_it_has_alone(sizes: tuple[int, ...]) -> None:
    found = label_map(sizes)
    windows = {"complexity": (0.0, 1.0), "fine": (0.0, 0.25)}
    table = complexity_table(found, windows=windows, spatial_ndim=len(sizes))
    assert table["label"].tolist() == [name for name in np.unique(found) if name]
    for row, name in enumerate(table["label"]):
        expected = alone(found, name)
        assert table["radius"][row] == expected.radius
        assert table["complexity"][row] == pytest.approx(float(expected.mean()), abs=1e-9)
        assert table["fine"][row] == pytest.approx(float(expected.mean(0.0, 0.25)), abs=1e-9)
        assert 0 <= table["field_error_bound"][row] <= 1e-9
    assert len(table["label"]) > 3
    assert table["complexity"].max() > 0.1


def test_the_standard_deviation_and_other_bins() -> None:
    found = label_map()
    for options in ({"estimator": "std"}, {"bins": 64}, {"rho": 2.5, "low": 0.2, "high": 0.9, "tol": 1e-6}):
        table = complexity_table(found, **options)
        masks = torch.from_numpy(np.stack([found == name for name in table["label"]]))
        expected = torchlinf.complexity(masks, spatial_ndim=2, **options)
        np.testing.assert_allclose(table["complexity"], expected, rtol=1e-6, atol=1e-9)
        assert set(table["measure"]) == {torchlinf.Measure(**options).settings()}
        assert set(table["version"]) == {torchlinf.__version__}
        assert (table["seconds"] > 0).all()


@pytest.mark.parametrize(
    ("names", "dtype"),
    [
        ([7, 3, 250], np.uint8),
        ([127, 126, 1], np.int8),
        ([10**15, 2, 10**18], np.int64),
        ([2**64 - 1, 2**63, 5], np.uint64),
        ([LARGEST + 1, LARGEST, LARGEST - 1], np.int32),
        ([1, 2**31 - 1, 2], np.int32),
    ],
)
def test_labels_may_be_huge_and_have_gaps(names: list[int], dtype: type) -> None:
    plain = np.zeros((30, 41), dtype=dtype)
    plain[2:9, 3:20], plain[12:20, 1:30], plain[15:28, 25:39] = 1, 2, 3
    plain[20:22, 5:10] = 2
    named = np.array([0, *names], dtype=dtype)[plain]
    order = np.argsort(np.array(names, dtype=dtype))
    table, expected = complexity_table(named, properties=["area"]), complexity_table(plain, properties=["area"])
    assert table["label"].dtype == dtype
    assert table["label"].tolist() == sorted(names)
    for column in ("area", "radius", "complexity", "touches_border"):
        np.testing.assert_array_equal(table[column], expected[column][order])


def test_neither_byte_order_nor_layout_matters() -> None:
    found = label_map()
    expected = complexity_table(found)
    swapped = found.astype(">i4")
    transposed = np.asfortranarray(found)
    strided = np.repeat(found, 2, axis=1)[:, ::2]
    for other in (swapped, transposed, strided, torch.from_numpy(found)):
        table = complexity_table(other)
        assert list(table) == list(expected)
        for name, column in expected.items():
            if name != "seconds":
                np.testing.assert_array_equal(table[name], column)
    frozen = found.copy()
    frozen.flags.writeable = False
    assert complexity_table(frozen)["complexity"].tolist() == expected["complexity"].tolist()


def test_what_touches_the_border_is_flagged() -> None:
    found = np.zeros((20, 31), dtype=np.int32)
    found[0:4, 5:9], found[8:12, 0:5], found[16:20, 8:12], found[6:11, 26:31], found[6:12, 9:20] = 1, 2, 3, 4, 5
    assert complexity_table(found)["touches_border"].tolist() == [True, True, True, True, False]
    volume = np.zeros((6, 8, 10), dtype=np.int32)
    volume[0:3, 2:4, 2:4], volume[2:5, 2:7, 6:9] = 1, 2
    assert complexity_table(volume, spatial_ndim=3)["touches_border"].tolist() == [True, False]


@pytest.mark.parametrize("sizes", [(60, 83), (14, 17, 21)])
def test_properties_of_scikit_image_stand_beside(sizes: tuple[int, ...]) -> None:
    found = 5 * label_map(sizes)
    intensity = np.random.default_rng(0).random(sizes)
    names = ["label", "area", "bbox", "centroid", "intensity_mean", "euler_number"]
    spacing = tuple(0.5 + i for i in range(len(sizes)))
    table = complexity_table(
        found,
        properties=names,
        intensity_image=torch.from_numpy(intensity),
        spacing=spacing,
        spatial_ndim=len(sizes),
    )
    expected = regionprops_table(found, intensity, properties=names, spacing=spacing)
    assert list(table)[: len(expected)] == list(expected)
    for name, column in expected.items():
        np.testing.assert_allclose(table[name], column)
    assert {len(column) for column in table.values()} == {len(np.unique(found)) - 1}


@pytest.mark.parametrize("empty", [np.zeros((5, 9), np.int64), np.zeros((0, 9), np.int64), np.zeros((4, 5, 6), int)])
def test_a_map_without_objects_has_no_rows(empty: NDArray[np.int64]) -> None:
    table = complexity_table(empty, spatial_ndim=empty.ndim)
    assert list(table) == [
        "label", "radius", "complexity", "touches_border", "error_bound", "field_error_bound", "seconds", "version",
        "measure",
    ]  # fmt: skip
    assert {len(column) for column in table.values()} == {0}
    assert table["complexity"].dtype == np.float64
    assert table["label"].dtype == empty.dtype


def test_a_map_that_is_one_object() -> None:
    table = complexity_table(np.full((6, 9), 4))
    assert (table["complexity"], table["radius"], table["touches_border"]) == ([0.0], [3], [True])


@pytest.mark.parametrize(
    ("found", "error", "words"),
    [
        (np.array([[0, -1, 3]]), ValueError, r"no negative labels; got -1.*clip\(0\)"),
        (np.array([[0, 3], [-(2**63), 2**62]]), ValueError, "no negative labels; got -9223372036854775808"),
        (torch.tensor([[[0, 5], [-7, 2]]], dtype=torch.int8), ValueError, "no negative labels; got -7"),
        (np.array([[0.0, 1.0]]), TypeError, r"must hold integers; got float64.*astype"),
        (np.array([[0.0, np.nan]], np.float16), TypeError, r"must hold integers; got float16.*astype"),
        (torch.tensor([[0.0, 2.5]]), TypeError, r"must hold integers; got float32.*astype"),
        (np.array([[False, True]]), TypeError, r"must hold integers; got bool.*skimage.measure.label"),
        (np.zeros((2,) * 5, int), ValueError, r"must be \(H, W\)"),
        (np.array(3), ValueError, r"must be \(H, W\)"),
        (np.array([["a"]]), TypeError, "must hold integers"),
    ],
)
def test_what_is_no_label_map(found: NDArray[np.int64], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        complexity_table(found)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"windows": {"fine": (0.5, 0.5)}}, ValueError, "low < high"),
        ({"windows": {"radius": (0.0, 0.5)}}, ValueError, r"names of other columns; got \['radius'\]"),
        ({"windows": {"area": (0.0, 0.5)}, "properties": ["area"]}, ValueError, r"other columns; got \['area'\]"),
        (
            {"windows": {"centroid-0": (0.0, 0.5)}, "properties": ["centroid"]},
            ValueError,
            r"other columns; got \['centroid-0'\]",
        ),
        ({"windows": {}}, ValueError, "windows must name"),
        ({"windows": {"fine": (0.0, 0.5)}, "high": 0.5}, ValueError, "instead of low and high"),
        ({"rho": torch.ones(2)}, TypeError, "rho must be None or one number"),
        ({"properties": "area"}, TypeError, "properties must be a list of names"),
        ({"properties": [3]}, TypeError, "properties must be a list of names"),
        ({"properties": ["arena"]}, ValueError, r"properties must be names.*got \['arena'\]"),
        ({"properties": ["intensity_mean"]}, ValueError, "intensity_image stand beside"),
        ({"properties": ["area"], "spacing": 2.0}, TypeError, "spacing must hold one number for each axis"),
        ({"properties": ["area"], "spacing": (1.0, 0.0)}, ValueError, "spacing must be finite and above 0"),
        ({"intensity_image": np.zeros((3, 4))}, ValueError, "intensity_image must have the shape of label_map"),
        ({"tol": 0.0}, ValueError, "tol must be"),
        ({"estimator": "mean"}, ValueError, "estimator must be"),
        ({"bins": 0}, ValueError, "bins must be"),
    ],
)
def test_wrong_options(options: dict[str, object], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        complexity_table(label_map(), **options)  # type: ignore[arg-type]


def test_properties_of_lines_are_refused() -> None:
    with pytest.raises(ValueError, match="2 or 3 dimensions"):
        complexity_table(label_map((90,)), properties=["area"])


def test_profiles_of_shapes_of_different_sizes() -> None:
    masks = list(catalogue().values())
    for estimator in ("entropy", "std"):
        found = ragged_profile(masks.__getitem__, len(masks), Measure(estimator=estimator))
        for i, mask in enumerate(masks):
            expected = torchlinf.complexity_profile(torch.from_numpy(mask), estimator=estimator, spatial_ndim=2)
            torch.testing.assert_close(found.values[i], expected.values, rtol=0, atol=1e-9, equal_nan=True)
            torch.testing.assert_close(found.levels()[i], expected.levels(), rtol=0, atol=1e-9)
            assert found.radius[i] == expected.radius
    assert ragged_profile(masks.__getitem__, 0, Measure()).mean().shape == (0,)


def test_without_a_compiler_objects_are_solved_in_torch_operations(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = complexity_table(label_map())
    monkeypatch.setattr(levels, "has_compiler", lambda: False)
    table = complexity_table(label_map())
    np.testing.assert_allclose(table["complexity"], expected["complexity"], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(table["radius"], expected["radius"])


def test_masked_arrays_and_tables() -> None:
    pandas = pytest.importorskip("pandas")
    label_map = np.zeros((9, 20), dtype=int)
    label_map[1:7, 1:8], label_map[2:8, 10:18] = 1, 2 * np.tri(6, 8, dtype=int)
    expected = complexity_table(label_map * (label_map == 2), properties=["area"])
    masked = complexity_table(np.ma.masked_array(label_map, mask=label_map == 1), properties=np.array(["area"]))
    for name in ("label", "area", "complexity"):
        assert masked[name].tolist() == expected[name].tolist()
    options = {"properties": ["intensity_mean"]}
    table = complexity_table(pandas.DataFrame(label_map), intensity_image=pandas.DataFrame(label_map), **options)
    assert table["intensity_mean"].tolist() == [1, 2]
    with pytest.raises(ValueError, match="intensity_image must have no masked pixels"):
        complexity_table(label_map, intensity_image=np.ma.masked_array(label_map, mask=label_map == 1), **options)
