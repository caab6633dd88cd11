"""Outlines that are simplified: areas in closed form, sides that stay, validity, and drawings that fit."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

import torchlinf

shapely = pytest.importorskip("shapely")
affinity = pytest.importorskip("shapely.affinity")

from torchlinf.polygons import simplify  # noqa: E402
from torchlinf.polygons.drawing import draw, edges_of, grid_of  # noqa: E402
from torchlinf.polygons.flipped_outline import flipped_outline  # noqa: E402

HOUSE = shapely.box(0, 0, 12, 8)
BUMP = shapely.box(5, 8, 6, 9)
NOTCH = shapely.box(3, 7, 4, 8)


def with_bump(angle: float, by: tuple[float, float] = (0.0, 0.0)) -> "shapely.Geometry":
    """A house of 12 x 8 with a bump of 1 x 1, turned and moved."""
    return affinity.translate(affinity.rotate(shapely.union(HOUSE, BUMP), angle, origin=(0, 0)), *by)


@pytest.mark.parametrize("angle", [0.0, 20.0, -37.5])
@pytest.mark.parametrize(("given", "area"), [(shapely.union(HOUSE, BUMP), 96), (shapely.difference(HOUSE, NOTCH), 96)])
def test_a_bump_and_a_notch_go_and_the_wall_goes_through(angle: float, given: "shapely.Geometry", area: float) -> None:
    turned = affinity.rotate(given, angle, origin=(0, 0))
    table = simplify([turned], resolution=0.25, weight=3.0)
    house = affinity.rotate(HOUSE, angle, origin=(0, 0))
    assert table["geometry"][0].symmetric_difference(house).area < 1e-6
    assert shapely.get_num_coordinates(table["geometry"][0]) == 5  # no corner is left on the wall
    assert table["area_after"][0] == pytest.approx(area, abs=1e-6)
    assert table["changed_area"][0] == pytest.approx(1, abs=1e-6)
    assert (table["changed"][0], table["after"][0]) == (16, 0.0)


def flipped(
    shape: "shapely.Geometry", region: "shapely.Geometry", inside: bool, side: float = 0.25
) -> "shapely.Geometry":
    """A shape in which every pixel whose centre lies in a region is flipped to inside or outside."""
    edges = edges_of(np.array([shape]))
    grid, before = grid_of(edges[0], side, 10**6), draw(edges[0], side, 10**6)
    y, x = np.mgrid[: grid.height, : grid.width] + 0.5
    centres = grid.points(np.stack([x, y], axis=-1)) + edges.centres[0]
    hit = shapely.contains_xy(region, centres[..., 0], centres[..., 1])
    assert (before[hit] != inside).any()
    outline = shapely.transform(shape, lambda points: grid.pixels(points - edges.centres[0]))
    found = flipped_outline(outline, before, np.where(hit, inside, before))
    return shapely.transform(found, lambda points: grid.points(points) + edges.centres[0])


@pytest.mark.parametrize("offset", [0.03, 0.08, 0.11, 0.17, 0.22])
def test_no_step_is_left_where_a_wall_lies_between_pixels(offset: float) -> None:
    """A wing holds the box, so the wall in question is at any place between two lines of pixels."""
    wing = shapely.box(9, 8, 12, 10 + offset)
    tall = shapely.union_all([HOUSE, BUMP, wing])
    found = flipped(tall, shapely.box(4.5, 8, 6.5, 9.5), False)
    wanted = shapely.union(HOUSE, wing)
    assert found.symmetric_difference(wanted).area < 1e-6
    assert shapely.get_num_coordinates(found) == shapely.get_num_coordinates(wanted)
    deep = shapely.difference(shapely.union(HOUSE, wing), NOTCH)
    found = flipped(deep, shapely.box(2.5, 6.5, 4.5, 8), True)
    wanted = shapely.union(HOUSE, wing)
    assert found.symmetric_difference(wanted).area < 1e-6
    assert shapely.get_num_coordinates(found) == shapely.get_num_coordinates(wanted)


def test_corners_that_no_flip_has_touched_are_exactly_those_that_were_given() -> None:
    given = with_bump(23.0, (398363.573, 6472917.922))
    (found,) = simplify([given], resolution=0.25, weight=3.0)["geometry"]
    before = {tuple(point) for point in shapely.get_coordinates(given)}
    assert {tuple(point) for point in shapely.get_coordinates(found)} < before


def test_diagonals_keep_their_two_corners() -> None:
    """A chamfer is drawn as stairs; a bump elsewhere goes, and the chamfer stays one side."""
    chamfered = shapely.Polygon([(0, 0), (12, 0), (12, 5), (9, 8), (6, 8), (6, 9), (5, 9), (5, 8), (0, 8)])
    found = flipped(chamfered, shapely.box(4.5, 8, 6.5, 9.5), False)
    wanted = shapely.Polygon([(0, 0), (12, 0), (12, 5), (9, 8), (0, 8)])
    assert found.symmetric_difference(wanted).area < 1e-6
    assert shapely.get_num_coordinates(found) == 6


def test_a_bump_on_a_diagonal_wall_goes_without_a_step() -> None:
    """In the frame of the map the wall is drawn as stairs, and the bump's foot lies anywhere on them."""
    turned, bump = affinity.rotate(HOUSE, 33, origin=(0, 0)), affinity.rotate(BUMP, 33, origin=(0, 0))
    found = flipped(shapely.union(turned, bump), shapely.difference(bump.buffer(0.5), turned), False)
    assert shapely.get_num_coordinates(found) <= 9
    assert found.hausdorff_distance(turned) < 0.125  # half a pixel


def test_holes_are_filled_made_and_kept() -> None:
    yard = shapely.difference(shapely.box(0, 0, 16, 12), shapely.box(5, 4, 10, 8))
    assert flipped(yard, shapely.box(5, 4, 10, 8), True).equals(shapely.box(0, 0, 16, 12))
    made = flipped(yard, shapely.box(12, 4, 14, 8), False)
    assert made.symmetric_difference(shapely.difference(yard, shapely.box(12, 4, 14, 8))).area < 1e-6
    kept = flipped(shapely.union(yard, shapely.box(7, 12, 8, 13)), shapely.box(6, 12, 9, 14), False)
    assert kept.symmetric_difference(yard).area < 1e-6


def test_what_is_simple_or_too_dear_is_the_same_object() -> None:
    shapes = [HOUSE, with_bump(10.0)]
    table = simplify(shapes, resolution=0.25, weight=1e6)
    assert table["geometry"][0] is HOUSE
    assert table["geometry"][1] is shapes[1]
    assert table["flips"].tolist() == [0, 0]
    assert (table["changed_area"] == 0).all()


def test_the_drawing_is_what_simplify_makes_of_the_mask() -> None:
    given = with_bump(0.0)
    table = simplify([given], resolution=0.25, weight=3.0)
    mask = torch.zeros(36, 48, dtype=torch.bool)
    mask[4:], mask[:4, 20:24] = True, True
    found = torchlinf.simplify(mask, weight=3.0, keep_topology=True, spatial_ndim=2)
    assert table["before"][0] == float(found.before)
    assert table["changed"][0] == int((found.mask ^ mask).sum())


def blob(rng: np.random.Generator, kind: int) -> "shapely.Geometry":
    """A random polygon: of boxes, a star, or of discs with a hole."""
    if kind == 0:
        corners, sizes = rng.uniform(0, 20, (5, 2)), rng.uniform(3, 18, (5, 2))
        boxes = [shapely.box(*low, *(low + size)) for low, size in zip(corners, sizes, strict=True)]
        return affinity.rotate(shapely.union_all(boxes), rng.uniform(-5, 5))
    if kind == 1:
        angles = np.sort(rng.uniform(0, 2 * np.pi, 20))
        radii = rng.uniform(8, 20, 20)
        return shapely.Polygon(np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1))
    discs = [
        shapely.Point(at).buffer(r) for at, r in zip(rng.uniform(0, 25, (6, 2)), rng.uniform(2, 8, 6), strict=True)
    ]
    return shapely.union_all(discs).difference(shapely.Point(rng.uniform(5, 20, 2)).buffer(3))


@pytest.mark.parametrize("kind", [0, 1, 2])
@pytest.mark.parametrize("weight", [0.0, 3.0])
def test_the_new_outline_is_valid_and_its_drawing_is_the_new_mask(kind: int, weight: float) -> None:
    """Of random polygons; a pixel whose centre lies on a side that was made straight may differ."""
    rng = np.random.default_rng(kind)
    pixels = different = 0
    for _ in range(12):
        shape = max(shapely.get_parts(blob(rng, kind)), key=shapely.area)
        if not shapely.is_valid(shape):
            continue
        edges = edges_of(np.array([shape]))
        grid, before = grid_of(edges[0], 1.0, 10**6), draw(edges[0], 1.0, 10**6)
        after = torchlinf.simplify(torch.from_numpy(before), weight=weight, max_change=1.0, spatial_ndim=2).mask.numpy()
        outline = shapely.transform(shape, lambda points, e=edges, g=grid: g.pixels(points - e.centres[0]))
        found = flipped_outline(outline, before, after)
        assert shapely.is_valid(found)
        y, x = np.mgrid[: grid.height, : grid.width] + 0.5
        off = shapely.contains_xy(found, x, y) != after
        pixels, different = pixels + int(after.sum()), different + int(off.sum())
        assert (shapely.distance(shapely.boundary(found), shapely.points(x[off], y[off])) < 0.75).all()
    assert different <= 0.01 * pixels


def test_every_part_of_a_multipolygon_is_simplified_in_its_own_frame() -> None:
    both = shapely.MultiPolygon([with_bump(0.0), with_bump(30.0, (40, 0))])
    table = simplify([both], resolution=0.25, weight=3.0)
    (found,) = table["geometry"]
    assert (table["objects"][0], table["changed"][0]) == (2, 32)
    assert np.isnan(table["angle"][0])
    assert shapely.is_valid(found)
    assert shapely.area(shapely.get_parts(found)) == pytest.approx([96.0, 96.0])


def test_parts_and_holes_without_a_pixel_stay_as_they_are() -> None:
    """Real multipolygons have slivers, whose area counts."""
    sliver, hole = shapely.box(40, 0, 40.02, 30), shapely.box(2, 2, 2.01, 2.01)
    table = simplify([shapely.MultiPolygon([sliver, with_bump(20.0).difference(hole)])], resolution=0.25, weight=3.0)
    (found,) = table["geometry"]
    assert (table["error"][0], table["objects"][0], table["changed"][0], table["after"][0]) == (None, 2, 16, 0.0)
    assert (table["resolution"][0], table["angle"][0]) == (0.25, pytest.approx(-20))
    wanted = shapely.MultiPolygon([sliver, affinity.rotate(HOUSE, 20, origin=(0, 0)).difference(hole)])
    assert found.symmetric_difference(wanted).area < 1e-6
    assert [len(part.interiors) for part in sorted(found.geoms, key=shapely.area)] == [0, 1]
    assert table["area"][0] == pytest.approx(97 + 0.6 - 1e-4, abs=1e-9)
    assert table["area_after"][0] == pytest.approx(96 + 0.6 - 1e-4, abs=1e-6)
    both = simplify([shapely.MultiPolygon([sliver, shapely.box(50, 0, 50.02, 30)])], resolution=0.25)
    assert both["geometry"][0] is None
    assert "no pixel's centre is inside" in both["error"][0]


def overlap(shapes: np.ndarray) -> float:
    return max(one.intersection(shapes[j]).area for i, one in enumerate(shapes) for j in range(i))


def test_flips_gain_nothing_of_a_neighbour() -> None:
    """A lodger fills the notch of a house to a part; alone, the notch goes."""
    house, lodger = shapely.difference(HOUSE, NOTCH), shapely.box(3, 7.25, 4, 10)
    house, lodger = (affinity.rotate(shape, 20, origin=(0, 0)) for shape in (house, lodger))
    alone = simplify([house], resolution=0.25, weight=3.0)["geometry"][0]
    assert alone.intersection(lodger).area == pytest.approx(0.75, abs=1e-6)
    table = simplify([lodger, house], resolution=0.25, weight=3.0)
    assert overlap(table["geometry"]) < 1e-6
    parts = shapely.MultiPolygon([house, affinity.translate(lodger, 20, 20)])  # of one geometry: nothing in the way
    assert simplify([parts], resolution=0.25, weight=3.0)["changed"][0] == 16


def test_what_a_new_side_takes_of_a_neighbour_is_cut_off() -> None:
    """Less than half a pixel of the notch is the lodger's: no pixel's centre, so the notch is filled but for that."""
    house, lodger = shapely.difference(HOUSE, NOTCH), shapely.box(3, 7.9, 4, 10)
    house, lodger = (affinity.rotate(shape, 20, origin=(0, 0)) for shape in (house, lodger))
    table = simplify([house, lodger], resolution=0.25, weight=3.0)
    assert (table["changed"][0], table["after"][0], table["changed"][1]) == (16, 0.0, 0)
    assert overlap(table["geometry"]) < 1e-6
    assert table["area_after"] == pytest.approx([96 - 0.1, 2.1], abs=1e-6)


def test_of_two_that_gain_the_same_the_later_one_stays_as_it_was() -> None:
    """They cross, and have a hole in common that both would fill."""
    hole, options = shapely.box(9, 4, 10, 5), {"resolution": 0.25, "weight": 3.0, "keep_topology": False}
    wide, high = shapely.box(0, 0, 20, 10).difference(hole), shapely.box(5, -5, 15, 16).difference(hole)
    alone = [simplify([shape], **options)["area_after"][0] for shape in (wide, high)]
    assert alone == pytest.approx([200, 210], abs=1e-6)
    table = simplify([wide, high], **options)
    assert overlap(table["geometry"]) == pytest.approx(overlap([wide, high]), abs=1e-6)
    assert (table["changed"][0], table["after"][0], table["area_after"][0]) == (16, 0.0, pytest.approx(200, abs=1e-6))
    assert table["geometry"][1] is high
    columns = ("flips", "changed", "changed_area", "area_after", "after")
    assert [table[name][1] for name in columns] == [0, 0, 0, high.area, table["before"][1]]
    together = simplify([wide, high], straighten=0.01, **options)
    assert overlap(together["geometry"]) == pytest.approx(99, abs=1e-6)


def test_outlines_with_heights_come_out_without() -> None:
    flat = shapely.box(30, 0, 42, 8)
    given = [shapely.force_3d(with_bump(20.0), 5.0), shapely.force_3d(affinity.translate(HOUSE, 0, 30), 5.0), flat]
    table = simplify(given, resolution=0.25, weight=3.0)
    assert not shapely.has_z(table["geometry"]).any()
    assert table["changed"].tolist() == [16, 0, 0]
    assert table["geometry"][2] is flat
    assert shapely.has_z(given).tolist() == [True, True, False]


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".parquet"])
def test_a_layer_with_heights_is_written_without_any(tmp_path: Path, suffix: str) -> None:
    geopandas = pytest.importorskip("geopandas")
    from torchlinf.scoring import simplified_outlines, write_outlines

    tiny = shapely.box(90, 0, 90.01, 0.01)
    given = [
        with_bump(20.0),
        affinity.translate(HOUSE, 0, 30),
        shapely.MultiPolygon([affinity.translate(HOUSE, 50)]),
        tiny,
    ]
    frame = geopandas.GeoDataFrame(geometry=shapely.force_3d(given, 5.0), crs="EPSG:32633")
    frame.to_file(tmp_path / "town.gpkg")
    options = {"resolution": 0.25, "weight": 3.0}
    found = simplified_outlines(tmp_path / "town.gpkg", options, None, None, lambda: None)
    write_outlines(tmp_path / f"simpler{suffix}", found)
    read = geopandas.read_parquet if suffix == ".parquet" else geopandas.read_file
    new = read(tmp_path / f"simpler{suffix}")
    assert not new.has_z.any()
    assert new["changed"].tolist() == [16, 0, 0, 0]
    assert new["error"].isna().tolist() == [True, True, True, False]
    assert new.area.tolist() == pytest.approx([96, 96, 96, 1e-4], abs=1e-6)


def test_what_cannot_be_simplified_is_a_row_with_the_reason() -> None:
    bow = shapely.Polygon([(0, 0), (4, 4), (4, 0), (0, 4)])
    given = [None, shapely.Point(1, 1), bow, shapely.Polygon(), shapely.box(0, 0, 0.01, 0.01), with_bump(0.0)]
    table = simplify(given, resolution=0.25, weight=3.0)
    assert [error is None for error in table["error"]] == [False] * 5 + [True]
    assert table["geometry"][:5].tolist() == [None] * 5
    assert "invalid" in table["error"][2]
    assert simplify([bow], resolution=0.25, repair=True)["error"].tolist() == [None]
    with pytest.raises(ValueError, match="geometries must be polygons"):
        simplify(given, resolution=0.25, errors="raise")


def test_a_geodataframe_keeps_its_index() -> None:
    geopandas = pytest.importorskip("geopandas")
    frame = geopandas.GeoDataFrame(geometry=[HOUSE, with_bump(5.0)], index=["a", "b"], crs="EPSG:32633")
    table = simplify(frame, resolution=0.25, weight=3.0)
    assert table["index"].tolist() == ["a", "b"]
    assert json.loads(table["measure"][0])["orientation"] == "own"
    with pytest.raises(ValueError, match="degrees"):
        simplify(frame.to_crs("EPSG:4326"), resolution=0.25)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "resolution must be given"),
        ({"resolution": 1.0, "orientation": "mean"}, "orientation must be one frame"),
        ({"resolution": 1.0, "weight": -1.0}, "weight must"),
        ({"resolution": 1.0, "max_change": 0.0}, "max_change must"),
    ],
)
def test_wrong_options_are_refused_before_the_work(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        simplify([HOUSE], **options)


def test_every_outline_at_one_radius_has_the_same_detail() -> None:
    shapes = [with_bump(10.0), affinity.scale(with_bump(10.0), 7, 7)]
    table = simplify(shapes, pixels_per_radius=16, weight=3.0)
    assert table["resolution"][1] == pytest.approx(7 * table["resolution"][0], rel=1e-9)
    assert table["changed"][0] == table["changed"][1] > 0
