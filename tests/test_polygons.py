"""Tables of outlines: drawn exactly, each in its own frame, whatever library they come from."""

import json
import math
import re
import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

shapely = pytest.importorskip("shapely")
geopandas = pytest.importorskip("geopandas")
import pandas as pd  # noqa: E402
from shapely import affinity  # noqa: E402

import torchlinf  # noqa: E402
from torchlinf.polygons import complexity_table  # noqa: E402
from torchlinf.polygons.drawing import draw, draw_at_radius, edges_of  # noqa: E402

HOUSE = shapely.box(0, 0, 12, 8)
ELL = shapely.union(HOUSE, shapely.box(8, 8, 12, 14))
RING = shapely.box(0, 0, 9, 15).difference(shapely.box(3, 3, 6, 9))
BOW_TIE = shapely.Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])
ANGLES = (0.0, 3.0, 11.25, 20.0, 33.3, 45.0, -7.0, -44.9, 71.0, 180.0)


def ell_mask() -> NDArray[np.bool_]:
    """`ELL` by hand, four pixels to the unit, the largest y on top."""
    mask = np.zeros((56, 48), dtype=bool)
    mask[24:] = True
    mask[:24, 32:] = True
    return mask


def complexity_of(mask: NDArray[np.bool_], **options: Any) -> float:
    return float(torchlinf.complexity(torch.from_numpy(mask.copy()), spatial_ndim=2, **options))


def number(geometry: Any, name: str = "complexity", **options: Any) -> float:
    table = complexity_table([geometry], **{"resolution": 0.25, **options})
    assert table["error"].tolist() == [None]
    return float(table[name][0])


def blob(generator: np.random.Generator, centre: tuple[float, float], size: float) -> Any:
    """A star-shaped polygon with 5 to 30 corners, far from convex."""
    angles = np.sort(generator.uniform(0, 2 * np.pi, generator.integers(5, 30)))
    radii = size * generator.uniform(0.3, 1.0, len(angles))
    return shapely.Polygon(np.stack([np.cos(angles), np.sin(angles)], 1) * radii[:, None] + centre)


def random_shapes(count: int, seed: int = 5) -> list[Any]:
    """Polygons with holes, and multipolygons of them."""
    generator = np.random.default_rng(seed)
    shapes = []
    while len(shapes) < count:
        parts = [blob(generator, (x, 0.4 * x), 9.0) for x in range(0, 15 * int(generator.integers(1, 4)), 15)]
        holes = [blob(generator, part.representative_point().coords[0], 3.0) for part in parts if part.is_valid]
        shape = shapely.union_all([p for p in parts if p.is_valid]).difference(
            shapely.union_all([h for h in holes if h.is_valid])
        )
        if shape.is_valid and shape.area > 20 and shape.geom_type in ("Polygon", "MultiPolygon"):
            shapes.append(shape)
    return shapes


def test_the_random_shapes_have_holes_and_parts() -> None:
    shapes = random_shapes(40)
    assert sum(shape.geom_type == "MultiPolygon" for shape in shapes) > 5
    assert sum(len(part.interiors) for shape in shapes for part in shapely.get_parts(shape)) > 10


@pytest.mark.parametrize("resolution", [0.31, 1.0, 2.7])
def test_a_pixel_is_inside_if_its_centre_is(resolution: float) -> None:
    """The oracle is shapely, asked for every centre that is not on the outline as far as rounding goes."""
    for shape in random_shapes(40):
        drawn = draw(edges_of(np.array([shape]))[0], resolution, max_pixels=10**6)
        west, south, east, north = shape.bounds
        height, width = round((north - south) / resolution), round((east - west) / resolution)
        assert drawn.shape == (height, width)
        x = (west + east) / 2 + (np.arange(width) + 0.5 - width / 2) * resolution
        y = (south + north) / 2 - (np.arange(height) + 0.5 - height / 2) * resolution
        centres = shapely.points(*np.meshgrid(x, y))
        clear = shapely.distance(shape.boundary, centres) > 1e-5 * resolution
        assert clear.mean() > 0.99
        np.testing.assert_array_equal(drawn[clear], shapely.contains(shape, centres)[clear])


def test_outlines_on_the_grid_are_drawn_pixel_by_pixel() -> None:
    drawn = draw(edges_of(np.array([ELL]))[0], 0.25, max_pixels=10**4)
    np.testing.assert_array_equal(drawn, ell_mask())
    ring = draw(edges_of(np.array([RING]))[0], 1.0, max_pixels=10**4)
    expected = np.ones((15, 9), dtype=bool)
    expected[6:12, 3:6] = False
    np.testing.assert_array_equal(ring, expected)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("sides", [(12.0, 8.0), (10.12, 10.119), (9.3, 1.7), (31.0, 0.13)])
def test_a_rectangle_at_any_angle_has_complexity_zero_in_its_own_frame(
    sides: tuple[float, float], angle: float
) -> None:
    turned = affinity.rotate(shapely.box(0, 0, *sides), angle)
    far = affinity.translate(turned, 478_235.087, 4_424_039.323)  # as map coordinates are
    for shape in (turned, far):
        table = complexity_table([shape], resolution=0.25, orientation="own")
        assert table["complexity"][0] == 0.0
        assert table["radius"][0] == math.ceil(round(min(sides) / 0.25) / 2)
        assert table["pixels"][0] == round(sides[0] / 0.25) * round(sides[1] / 0.25)
        assert (table["angle"][0] + angle) % 90 == pytest.approx(0, abs=1e-3) or (
            (table["angle"][0] + angle) % 90 == pytest.approx(90, abs=1e-3)
        )
        assert -45 < table["angle"][0] <= 45


def test_on_the_grid_a_turned_rectangle_is_complex() -> None:
    assert number(affinity.rotate(HOUSE, 20)) > 2
    assert number(HOUSE) == 0


@pytest.mark.parametrize("angle", ANGLES)
def test_an_outline_is_drawn_anew_in_its_own_frame(angle: float) -> None:
    expected = complexity_of(ell_mask())
    assert expected > 0.5
    assert number(affinity.rotate(ELL, angle), orientation="own") == pytest.approx(expected, abs=1e-9)
    assert number(affinity.rotate(ELL, angle), orientation=-angle) == pytest.approx(expected, abs=1e-9)
    assert number(affinity.rotate(ELL, angle), "angle", orientation=-angle) == -angle


def test_where_an_outline_lies_does_not_matter() -> None:
    for shape in random_shapes(4):
        there = affinity.translate(shape, 478_235.0, -4_424_039.5)
        for orientation in (None, "own"):
            assert number(there, orientation=orientation) == pytest.approx(
                number(shape, orientation=orientation), abs=1e-6
            )


def test_quarter_turns_and_reflections_change_nothing() -> None:
    moves: list[Callable[[Any], Any]] = [
        lambda shape: affinity.rotate(shape, 90, origin=(0, 0)),
        lambda shape: affinity.rotate(shape, 180, origin=(0, 0)),
        lambda shape: affinity.scale(shape, -1, 1, origin=(0, 0)),
    ]
    for shape in random_shapes(5, seed=8):
        for orientation in (None, "own", "mean"):
            expected = number(shape, resolution=0.5, orientation=orientation)
            for move in moves[: 2 if orientation == "mean" else 3]:
                found = number(move(shape), resolution=0.5, orientation=orientation)
                assert found == pytest.approx(expected, abs=1e-6), (orientation, shape.wkt)


def test_a_hole_counts_and_a_square_ring_is_simple() -> None:
    table = complexity_table([RING], resolution=0.5)
    assert table["area"].tolist() == [RING.area] == [9 * 15 - 18]
    assert table["pixels"].tolist() == [4 * (9 * 15 - 18)]
    assert table["radius"].tolist() == [6]  # the hole leaves 6 x 6 units above it
    even = shapely.box(0, 0, 9, 9).difference(shapely.box(3, 3, 6, 6))
    assert number(even) == 0
    assert number(affinity.rotate(even, 28), orientation="own") == 0


def test_a_multipolygon_is_one_shape_or_one_row_a_polygon() -> None:
    parts = [affinity.rotate(ELL, 30), affinity.translate(affinity.rotate(HOUSE, 10), 40, 3)]
    whole = shapely.MultiPolygon(parts)
    both = complexity_table([whole, HOUSE], resolution=0.25, orientation="own")
    assert both["index"].tolist() == [0, 1]
    assert both["area"].tolist() == pytest.approx([ELL.area + HOUSE.area, HOUSE.area])
    assert both["complexity"][0] > 2  # no frame suits two houses that stand at different angles
    each = complexity_table([whole, HOUSE], resolution=0.25, orientation="own", per="object")
    assert each["index"].tolist() == [0, 0, 1]
    assert each["object"].tolist() == [1, 2, 1]
    expected = complexity_of(ell_mask())
    assert each["complexity"].tolist() == pytest.approx([expected, 0, 0], abs=1e-9)
    assert each["angle"].tolist() == pytest.approx([-30, -10, 0], abs=1e-6)
    mean = complexity_table([whole, HOUSE], resolution=0.25, orientation="own", per="object", pool="mean")
    assert mean["objects"].tolist() == [2, 1]
    assert mean["complexity"].tolist() == pytest.approx([expected / 2, 0], abs=1e-9)
    assert mean["radius"].tolist() == [16, 16]
    assert np.isnan(mean["angle"][0])
    assert mean["resolution"].tolist() == [0.25, 0.25]
    area = complexity_table([whole], resolution=0.25, orientation="own", per="object", pool="area")
    assert area["complexity"][0] == pytest.approx(expected * ELL.area / (ELL.area + HOUSE.area), abs=1e-9)


def test_small_polygons_can_be_left_out() -> None:
    whole = shapely.MultiPolygon([HOUSE, shapely.box(20, 0, 21, 1), shapely.box(30, 0, 30.1, 0.1)])
    rows = complexity_table([whole, BOW_TIE], resolution=0.5, per="object", min_pixels=5)
    assert rows["index"].tolist() == [0, 1]
    assert rows["pixels"].tolist() == [24 * 16, 0]
    assert rows["error"][0] is None
    assert "Self-intersection" in rows["error"][1]
    assert complexity_table([whole], resolution=0.5, per="object")["pixels"].tolist() == [24 * 16, 4, 0]
    pooled = complexity_table([whole], resolution=0.5, per="object", min_pixels=5, pool="mean")
    assert pooled["objects"].tolist() == [1]
    assert pooled["area"][0] == pytest.approx(whole.area)
    assert pooled["seconds"][0] > 0
    none = complexity_table([whole], resolution=0.5, per="object", min_pixels=500, pool="mean")
    assert none["error"].tolist() == ["every polygon has fewer pixels than min_pixels"]
    assert np.isnan(none["complexity"][0])


def test_the_mean_and_the_least_of_rotations_are_those_of_the_drawings() -> None:
    shapes = [affinity.rotate(ELL, 17), *random_shapes(3)]
    windows = {"fine": (0.0, 0.25), "coarse": (0.25, 1.0)}
    angles = [0.0, 22.5, 45.0, 67.5]
    alone = [complexity_table(shapes, resolution=0.5, orientation=angle, windows=windows) for angle in angles]
    mean = complexity_table(shapes, resolution=0.5, orientation="mean", rotations=4, windows=windows)
    errors = []
    for name in windows:
        values = np.stack([table[name] for table in alone])
        np.testing.assert_allclose(mean[name], values.mean(axis=0), atol=1e-12)
        errors.append(values.std(axis=0, ddof=1) / 2)
    np.testing.assert_allclose(mean["standard_error"], np.max(errors, axis=0), atol=1e-12)
    np.testing.assert_array_equal(mean["radius"], np.max([table["radius"] for table in alone], axis=0))
    assert "angle" not in mean
    whole = np.stack([complexity_table(shapes, resolution=0.5, orientation=angle)["complexity"] for angle in angles])
    least = complexity_table(shapes, resolution=0.5, orientation="least", rotations=4, windows=windows)
    np.testing.assert_array_equal(least["angle"], np.array(angles)[whole.argmin(axis=0)])
    for i, angle in enumerate(least["angle"]):
        assert least["fine"][i] == alone[angles.index(angle)]["fine"][i]
    pooled = complexity_table(
        [shapely.MultiPolygon([HOUSE, affinity.translate(affinity.rotate(ELL, 17), 40, 0)])],
        resolution=0.5, orientation="mean", rotations=4, per="object", pool="mean",
    )  # fmt: skip
    values = np.array(
        [
            (number(HOUSE, orientation=angle, resolution=0.5) + number(shapes[0], orientation=angle, resolution=0.5))
            / 2
            for angle in angles
        ]
    )
    assert pooled["complexity"][0] == pytest.approx(values.mean(), abs=1e-9)
    assert pooled["standard_error"][0] == pytest.approx(values.std(ddof=1) / 2, abs=1e-9)


def test_every_outline_at_the_same_detail() -> None:
    shapes = [affinity.rotate(HOUSE, 25), affinity.scale(ELL, 20, 20), *random_shapes(12)]
    table = complexity_table(shapes, pixels_per_radius=24, orientation="own")
    assert (np.abs(table["radius"] - 24) <= 1).all()
    assert (table["radius"] == 24).mean() > 0.8
    assert table["complexity"][0] == 0
    assert table["resolution"][0] == pytest.approx(8 / 48, rel=0.03)
    larger = [affinity.scale(shape, 1000, 1000, origin=(0, 0)) for shape in shapes]
    scaled = complexity_table(larger, pixels_per_radius=24, orientation="own")
    np.testing.assert_allclose(scaled["resolution"], 1000 * table["resolution"], rtol=1e-6)
    np.testing.assert_allclose(scaled["complexity"], table["complexity"], atol=1e-6)
    again = [
        number(shape, resolution=side, orientation="own")
        for shape, side in zip(shapes, table["resolution"], strict=True)
    ]
    np.testing.assert_allclose(table["complexity"], again, atol=1e-12)


def test_an_outline_without_room_for_the_radius_gives_the_nearest() -> None:
    """A star of thin rays: its radius jumps."""
    comb = shapely.union_all([shapely.box(0, 0, 40, 1), *(shapely.box(x, 0, x + 0.01, 9) for x in range(0, 40, 3))])
    mask, resolution = draw_at_radius(edges_of(np.array([comb]))[0], 1, max_pixels=10**6)
    assert mask.any()
    assert resolution > 0.1


def test_a_radius_that_needs_too_many_pixels_is_an_error() -> None:
    fence = shapely.box(0, 0, 1000, 0.1)
    (error,) = complexity_table([fence], pixels_per_radius=50, max_pixels=10_000)["error"]
    assert re.fullmatch(r"\d+ x \d+ pixels at a resolution of \S+ are more than the limit of 10000, for a radius of 50 "
                        "pixels; pass fewer pixels_per_radius", error)  # fmt: skip
    assert complexity_table([fence], pixels_per_radius=1, max_pixels=100_000)["radius"].tolist() == [1]


# What is wrong, and what the row says.
BROKEN = {
    "bow tie": (BOW_TIE, r"the geometry is invalid \(Self-intersection\[1 1\]\); repair it"),
    "hole outside": (
        shapely.Polygon(HOUSE.exterior, [shapely.box(20, 20, 21, 21).exterior]),
        r"invalid \(Hole lies outside shell",
    ),
    "nan": ({"type": "Polygon", "coordinates": [[(0, 0), (1, math.nan), (1, 1), (0, 0)]]}, "Invalid Coordinate"),
    "empty": (shapely.Polygon(), "the geometry is empty"),
    "none": (None, "there is no geometry"),
    "point": (shapely.Point(1, 1), "a Point has no inside"),
    "line": (shapely.LineString([(0, 0), (1, 1)]), "a LineString has no inside"),
    "collection": (shapely.GeometryCollection([HOUSE]), "a GeometryCollection has no inside"),
    "speck": (shapely.box(500, 500, 500.01, 500.01), "no pixel's centre is inside at a resolution of 0.25"),
    "degrees": (shapely.box(8.54, 47.37, 8.5402, 47.3701), "if the coordinates are degrees, project them to metres"),
    "kilometres": (shapely.box(0, 0, 9e5, 9e5), "3600000 x 3600000 pixels at a resolution of 0.25 are more than"),
    "no json": ({"type": "Polygon", "coordinates": [[["a", 1]]]}, "not a geometry"),
    "run lengths": ({"segmentation": {"counts": [1], "size": [1, 1]}}, "run lengths are a mask"),
    "odd": ([1.0, 2.0, 3.0, 4.0, 5.0], "not a geometry"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_geometry_is_one_row_with_a_clear_word(name: str) -> None:
    geometry, words = BROKEN[name]
    table = complexity_table([HOUSE, geometry, affinity.rotate(ELL, 9)], resolution=0.25, orientation="own")
    assert table["error"][0] is None is table["error"][2]
    assert table["complexity"][0] == 0
    assert table["complexity"][2] == pytest.approx(complexity_of(ell_mask()), abs=1e-9)
    assert re.search(words, table["error"][1]), table["error"][1]
    assert table["radius"][1] == 0
    for column in ("complexity", "angle", "error_bound", "field_error_bound", "resolution"):
        assert np.isnan(table[column][1]), column
    with pytest.raises(ValueError, match=rf"geometries must be polygons that can be measured; got 1: .*{words}.*Pass"):
        complexity_table([HOUSE, geometry], resolution=0.25, orientation="own", errors="raise")


def test_what_is_large_enough_may_have_small_coordinates() -> None:
    """Nothing is refused for looking like degrees, as long as it can be drawn."""
    assert number(shapely.box(8, 47, 12, 49), resolution=0.1) == 0


def test_degrees_are_refused_as_the_reference_system_says() -> None:
    series = geopandas.GeoSeries([shapely.box(8.54, 47.37, 8.5402, 47.3701)], crs="EPSG:4326")
    with pytest.raises(ValueError, match=r"got degrees \(EPSG:4326\). Pass frame.to_crs"):
        complexity_table(series, resolution=0.25)
    projected = series.to_crs(series.estimate_utm_crs())
    assert complexity_table(projected, resolution=0.25, orientation="own")["complexity"][0] < 0.2
    old = {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}},
        "features": [],
    }
    with pytest.raises(ValueError, match="got degrees"):
        complexity_table(old, resolution=0.25)


def test_invalid_geometries_can_be_repaired() -> None:
    table = complexity_table([BOW_TIE], resolution=0.05, repair=True)
    assert table["error"].tolist() == [None]
    assert table["area"].tolist() == [2.0]
    spike = shapely.Polygon([(0, 0), (4, 0), (4, 3), (9, 3), (4, 3), (0, 3)])  # becomes a box and a line
    assert complexity_table([spike], resolution=0.5)["error"][0] is not None
    assert number(spike, repair=True) == 0


def feature(shape: Any, **more: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(shape), **more}


def coco(shape: Any) -> list[list[float]]:
    """Polygons without holes as COCO has them, y down."""
    return [(np.array(part.exterior.coords)[:-1] * (1, -1)).reshape(-1).tolist() for part in shapely.get_parts(shape)]


def forms() -> dict[str, tuple[Any, list[Any]]]:
    """The same two shapes as every library has them, and what the rows are to be called."""
    shapes = [affinity.rotate(ELL, 20), shapely.MultiPolygon([HOUSE, affinity.translate(affinity.rotate(ELL, 70), 30)])]
    collection = {"type": "FeatureCollection", "features": [feature(one) for one in shapes]}
    named = {
        "type": "FeatureCollection",
        "features": [feature(one, id=name) for one, name in zip(shapes, "ab", strict=True)],
    }
    annotations = [{"id": 7 - i, "segmentation": coco(one)} for i, one in enumerate(shapes)]
    frame = geopandas.GeoDataFrame({"year": [1900, 2000]}, geometry=shapes, index=["x", "y"], crs="EPSG:32632")
    return {
        "list": (shapes, [0, 1]),
        "tuple": (tuple(shapes), [0, 1]),
        "array": (np.array(shapes, dtype=object), [0, 1]),
        "series": (geopandas.GeoSeries(shapes, index=[5, 3]), [5, 3]),
        "frame": (frame, ["x", "y"]),
        "geometry array": (frame.geometry.values, [0, 1]),
        "column": (pd.Series(shapes, index=[2, 2]), [2, 2]),
        "dicts": ([shapely.geometry.mapping(one) for one in shapes], [0, 1]),
        "features": (collection["features"], [0, 1]),
        "collection": (collection, [0, 1]),
        "interface": (SimpleNamespace(__geo_interface__=collection), [0, 1]),
        "interfaces": ([SimpleNamespace(__geo_interface__=feature(one)) for one in shapes], [0, 1]),
        "names": (json.loads(json.dumps(named)), ["a", "b"]),
        "coco lists": ([coco(shapes[0])[0], coco(shapes[1])], [0, 1]),
        "coco annotations": (annotations, [7, 6]),
        "coco file": ({"images": [], "annotations": annotations}, [7, 6]),
    }


@pytest.mark.parametrize("name", forms())
@pytest.mark.filterwarnings("ignore:.*without a CRS")
def test_every_library_gives_the_same_table(name: str) -> None:
    given, index = forms()[name]
    expected = complexity_table(forms()["list"][0], resolution=0.5, orientation=10)
    table = complexity_table(given, resolution=0.5, orientation=10)
    assert table["index"].tolist() == index
    assert list(table) == list(expected)
    for column in ("pixels", "radius"):
        np.testing.assert_array_equal(table[column], expected[column])
    for column in ("area", "complexity"):
        np.testing.assert_allclose(table[column], expected[column], rtol=1e-9)


def test_one_geometry_is_a_table_of_one_row() -> None:
    for given in (ELL, shapely.geometry.mapping(ELL), feature(ELL), {"segmentation": coco(ELL)}):
        assert complexity_table(given, resolution=0.5)["pixels"].tolist() == [4 * ELL.area]


def test_coco_polygons_that_overlap_are_one_area() -> None:
    table = complexity_table([[[0, 0, 4, 0, 4, 4, 0, 4], [2, 2, 6, 2, 6, 6, 2, 6], [9, 9], []]], resolution=0.5)
    assert table["error"].tolist() == [None]
    assert table["area"].tolist() == [28]


def test_the_columns() -> None:
    table = complexity_table([ELL, None], resolution=0.5, high=0.5)
    assert list(table) == [
        "index", "area", "pixels", "radius", "complexity", "resolution", "error_bound", "field_error_bound", "seconds",
        "error", "version", "measure",
    ]  # fmt: skip
    kinds = {name: column.dtype.kind for name, column in table.items()}
    assert {name: kinds[name] for name in ("index", "pixels", "radius", "error", "area")} == {
        "index": "i", "pixels": "i", "radius": "i", "error": "O", "area": "f",
    }  # fmt: skip
    assert set(table["measure"]) == {torchlinf.Measure(high=0.5).settings()}
    assert set(table["version"]) == {torchlinf.__version__}
    assert table["complexity"][0] == pytest.approx(complexity_of(ell_mask()[1::2, 1::2], high=0.5), abs=1e-9)
    assert pd.DataFrame(table).set_index("index").loc[0, "pixels"] == 4 * ELL.area
    empty = complexity_table([], resolution=0.5, windows={"fine": (0, 0.25)}, per="object", orientation="mean")
    assert {len(column) for column in empty.values()} == {0}
    assert {"fine", "object", "standard_error"} <= set(empty)


def test_a_field_that_cannot_be_solved_is_one_row(monkeypatch: pytest.MonkeyPatch) -> None:
    from torchlinf.polygons import measuring

    solve = measuring.ragged_profile

    def failing(mask_at: Callable[[int], NDArray[np.bool_]], count: int, measure: torchlinf.Measure) -> Any:
        if any(mask_at(i).sum() == ell_mask().sum() for i in range(count)):
            raise RuntimeError("fields must converge; got one that does not")
        return solve(mask_at, count, measure)

    monkeypatch.setattr(measuring, "ragged_profile", failing)
    table = complexity_table([HOUSE, ELL, RING], resolution=0.25)
    assert [error is None for error in table["error"]] == [True, False, True]
    assert table["error"][1] == "RuntimeError: fields must converge; got one that does not"
    assert table["radius"].tolist()[0::2] == [16, 12]


WRONG = [
    ({}, ValueError, "resolution must be given, or pixels_per_radius instead; got neither"),
    ({"resolution": 1, "pixels_per_radius": 8}, ValueError, "got both, 1 and 8"),
    ({"resolution": 0}, ValueError, "resolution must be finite and above 0; got 0"),
    ({"resolution": "1"}, TypeError, "resolution must be a number above 0; got '1'"),
    ({"pixels_per_radius": 2.5}, TypeError, "pixels_per_radius must be an integer of 1 or more; got 2.5"),
    ({"resolution": 1, "errors": "ignore"}, ValueError, "errors must be one of 'row', 'raise'; got 'ignore'"),
    ({"resolution": 1, "repair": 1}, TypeError, "repair must be True or False; got 1"),
    ({"resolution": 1, "max_pixels": 0}, ValueError, "max_pixels must be an integer of 1 or more; got 0"),
    ({"resolution": 1, "orientation": np.eye(3)}, ValueError, "orientation must be of two dimensions; got a 3 x 3"),
    ({"resolution": 1, "windows": {"area": (0, 1)}}, ValueError, r"windows must not bear the names of other .*'area'"),
    ({"resolution": 1, "rho": torch.ones(1)}, TypeError, "rho must be None or one number here"),
    ({"resolution": 1, "connectivity": 1}, TypeError, "connectivity is not an option here"),
]  # fmt: skip


@pytest.mark.parametrize(("options", "error", "words"), WRONG)
def test_wrong_arguments_are_refused(options: dict[str, Any], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        complexity_table([HOUSE], **options)


@pytest.mark.parametrize("given", [3, "footprints.gpkg", None, {"a": 1}, {"type": "FeatureCollection", "features": 3}])
def test_what_is_no_geometry_is_refused(given: Any) -> None:
    with pytest.raises((TypeError, ValueError), match=r"geometries must be .+; got .+ Pass shapely polygons"):
        complexity_table(given, resolution=1.0)


def test_without_shapely_the_message_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "shapely", None)
    with pytest.raises(ImportError, match=r"measuring outlines needs shapely; .*torchlinf\[geo\]"):
        complexity_table([[0, 0, 1, 0, 1, 1]], resolution=0.1)
