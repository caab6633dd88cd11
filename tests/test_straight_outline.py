"""Outlines that are made straight: walls that were drawn on a grid come back, and what is no stair stays."""

from pathlib import Path

import numpy as np
import pytest

shapely = pytest.importorskip("shapely")
affinity = pytest.importorskip("shapely.affinity")

from torchlinf.polygons import simplify  # noqa: E402
from torchlinf.polygons.straight_outline import straight_outline, straight_outlines  # noqa: E402

TOLERANCE = 0.85  # pixels
HOUSE = shapely.box(0.3, 0.2, 30, 20)
ELL = shapely.difference(shapely.box(0.3, 0.2, 40, 30), shapely.box(18, 12, 41, 31))


def traced(shape: "shapely.Geometry", pixel: float = 1.0) -> "shapely.Geometry":
    """The union of the pixels whose centres are inside, without corners on straight sides."""
    left, low, right, high = shapely.bounds(shape) / pixel
    x, y = np.meshgrid(np.arange(np.floor(left), np.ceil(right)), np.arange(np.floor(low), np.ceil(high)))
    hit = shapely.contains_xy(shape, (x + 0.5) * pixel, (y + 0.5) * pixel)
    x, y = x[hit], y[hit]
    return shapely.simplify(shapely.union_all(shapely.box(x * pixel, y * pixel, (x + 1) * pixel, (y + 1) * pixel)), 0)


def corners(shape: "shapely.Geometry") -> int:
    return int(shapely.get_num_coordinates(shape)) - len(shapely.get_rings(shape))


def directions(shape: "shapely.Geometry") -> np.ndarray:
    """Degrees of the sides, less half turns."""
    step = np.diff(shapely.get_coordinates(shape.exterior), axis=0)
    return np.degrees(np.arctan2(step[:, 1], step[:, 0])) % 180


def distances(old: "shapely.Geometry", new: "shapely.Geometry") -> tuple[float, float]:
    """The largest distance of a point of either boundary from the other one."""
    points = [shapely.points(shapely.get_coordinates(shapely.segmentize(one.boundary, 0.2))) for one in (old, new)]
    return shapely.distance(points[0], new.boundary).max(), shapely.distance(points[1], old.boundary).max()


def iou(one: "shapely.Geometry", other: "shapely.Geometry") -> float:
    return one.intersection(other).area / one.union(other).area


@pytest.mark.parametrize("angle", [0, 3, 10, 20, 33, 45, 60])
@pytest.mark.parametrize(("shape", "number"), [(HOUSE, 4), (ELL, 6)])
def test_walls_that_were_drawn_on_a_grid_come_back(angle: float, shape: "shapely.Geometry", number: int) -> None:
    true = affinity.rotate(shape, angle)
    new = straight_outline(traced(true), TOLERANCE)
    assert corners(new) == number
    off = (directions(new) - angle + 45) % 90 - 45
    assert np.abs(off).max() < 1.0  # one pixel in 30 is 1.9 degrees
    # Walls at 0 and at 45 degrees may be half a pixel, or half its diagonal, off: no grid tells more.
    assert iou(new, true) > (0.95 if angle % 45 == 0 else 0.98)


def test_a_diagonal_wall_stays_one_diagonal_side() -> None:
    for cut in (5, 8, 12):
        chamfered = shapely.Polygon([(0, 0), (30, 0), (30, 20 - cut), (30 - cut, 20), (0, 20)])
        slanted = shapely.Polygon([(0, 0), (30, 0), (30, 20 - cut), (0, 20)])
        new = straight_outline(traced(chamfered), TOLERANCE)
        assert corners(new) == 5
        assert np.abs(directions(new) - 135).min() < 4
        new = straight_outline(traced(slanted), TOLERANCE)
        assert corners(new) == 4
        assert np.abs(directions(new) - (180 - np.degrees(np.arctan2(cut, 30)))).min() < 2


@pytest.mark.parametrize("angle", [0, 15, 30, 45])
def test_a_notch_deeper_than_the_tolerance_stays(angle: float) -> None:
    notch = shapely.box(12, 16, 16, 21)
    true = affinity.rotate(shapely.difference(HOUSE, notch), angle, origin=(15, 10))
    new = straight_outline(traced(true), TOLERANCE)
    turned = affinity.rotate(shapely.box(12, 16, 16, 20), angle, origin=(15, 10))
    assert new.intersection(turned).area < 0.25 * turned.area
    assert corners(new) == 8


def test_holes_stay_and_become_straight() -> None:
    true = affinity.rotate(shapely.difference(shapely.box(0, 0, 40, 30), shapely.box(10, 8, 28, 20)), 20)
    new = straight_outline(traced(true), TOLERANCE)
    assert len(new.interiors) == 1
    assert corners(new) == 8
    assert shapely.is_valid(new)
    assert iou(new, true) > 0.97


def test_random_outlines_stay_valid_and_near() -> None:
    """Of 500; nothing of the old one is farther than the tolerance, and nothing of the new than sqrt(2) of it."""
    rng = np.random.default_rng(0)
    count = fewer = 0
    while count < 500:
        corner, size = rng.uniform(0, 18, (4, 2)), rng.uniform(2, 14, (4, 2))
        parts = [affinity.rotate(shapely.box(*low, *(low + by)), rng.uniform(0, 90)) for low, by in zip(corner, size)]  # noqa: B905
        shape = shapely.difference(shapely.union_all(parts[:3]), parts[3])
        old = shape if count % 5 == 0 else traced(shape)
        if shapely.is_empty(old):
            continue
        old = max(shapely.get_parts(old), key=shapely.area)
        tolerance = (0.5, 0.75, 1.5)[count % 3]
        new = straight_outline(old, tolerance)
        assert new.geom_type == "Polygon"
        assert shapely.is_valid(new)
        assert len(new.interiors) == len(old.interiors)
        assert corners(new) <= corners(old)
        there, back = distances(old, new)
        assert there <= tolerance * 1.001
        assert back <= tolerance * 1.4144
        count, fewer = count + 1, fewer + (corners(new) < corners(old))
    assert fewer > 400


def test_the_unit_and_the_place_do_not_matter() -> None:
    old = traced(affinity.rotate(ELL, 20))
    new = straight_outline(old, TOLERANCE)

    def moved(shape: "shapely.Geometry") -> "shapely.Geometry":
        return affinity.translate(affinity.scale(shape, 0.1, 0.1, origin=(0, 0)), 398363.5, 6472917.25)

    far = straight_outline(moved(old), 0.1 * TOLERANCE)
    assert corners(far) == corners(new)
    assert far.symmetric_difference(moved(new)).area < 1e-3 * far.area


def test_what_has_no_stairs_is_the_same_object() -> None:
    for shape in (shapely.box(0, 0, 12, 8), affinity.rotate(shapely.box(0, 0, 12, 8), 20), ELL):
        assert straight_outline(shape, TOLERANCE) is shape
    both = shapely.MultiPolygon([shapely.box(0, 0, 12, 8), shapely.box(20, 0, 32, 8)])
    assert straight_outlines(np.array([both, None]), TOLERANCE).tolist() == [both, None]


def test_neighbours_overlap_no_more_than_before() -> None:
    """Houses in a row share walls that were drawn as stairs."""
    row = [affinity.rotate(shapely.box(10 * i, 0, 10 * i + 10, 18 + 2 * i), 25, origin=(0, 0)) for i in range(4)]
    old = np.array([traced(house) for house in row])
    alone = np.array([straight_outline(house, TOLERANCE) for house in old])
    pairs = [(i, j) for i in range(4) for j in range(i)]
    assert max(alone[i].intersection(alone[j]).area for i, j in pairs) > 0.1  # there is something to do
    new = straight_outlines(old, TOLERANCE)
    assert max(new[i].intersection(new[j]).area for i, j in pairs) < 1e-5
    assert all(shapely.is_valid(new))
    assert sum(map(corners, new)) < sum(map(corners, old)) / 4
    assert min(map(iou, new, row)) > min(map(iou, old, row))


def test_as_the_last_step_of_simplify() -> None:
    bumpy = affinity.rotate(shapely.union(shapely.box(0, 0, 60, 40), shapely.box(25, 40, 30, 43)), 20)
    old = traced(bumpy)
    plain = simplify([old, HOUSE, None], resolution=0.5, weight=3.0)
    found = simplify([old, HOUSE, None], resolution=0.5, weight=3.0, straighten=TOLERANCE)
    for name in ("flips", "changed", "before", "after"):
        np.testing.assert_array_equal(found[name], plain[name])
    assert corners(found["geometry"][0]) == 4 < corners(plain["geometry"][0])
    assert found["geometry"][1] is HOUSE
    assert found["geometry"][2] is None
    assert found["changed_area"][0] == pytest.approx(old.symmetric_difference(found["geometry"][0]).area)
    assert found["area_after"][0] == pytest.approx(found["geometry"][0].area)
    assert np.isnan(found["area_after"][2])
    alone = simplify([old], resolution=0.5, weight=1e9, straighten=TOLERANCE)
    assert alone["flips"][0] == 0
    assert corners(alone["geometry"][0]) == 8


def test_parts_of_a_multipolygon_are_made_straight_each_alone() -> None:
    both = shapely.MultiPolygon([traced(affinity.rotate(HOUSE, 20)), traced(affinity.translate(HOUSE, 60))])
    (new,) = simplify([both], resolution=0.5, weight=1e9, straighten=TOLERANCE)["geometry"]
    assert [corners(part) for part in new.geoms] == [4, 4]


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_tolerance_must_be_above_zero(value: float) -> None:
    with pytest.raises(ValueError, match="straighten must be finite and above 0"):
        simplify([HOUSE], resolution=1.0, straighten=value)
    with pytest.raises(TypeError, match="straighten must be a number"):
        simplify([HOUSE], resolution=1.0, straighten="1")


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".parquet"])
def test_the_command_writes_straight_outlines(tmp_path: Path, suffix: str) -> None:
    geopandas = pytest.importorskip("geopandas")
    testing = pytest.importorskip("typer.testing")
    from torchlinf.cli.app import app

    old = geopandas.GeoDataFrame({"name": ["a", "b"]}, geometry=[traced(affinity.rotate(HOUSE, 20)), HOUSE], crs=32633)
    old.to_file(tmp_path / "town.gpkg")
    out = tmp_path / f"straight{suffix}"
    command = ["simplify", str(tmp_path / "town.gpkg"), "-o", str(out), "--resolution", "0.5", "--straighten", "0.75"]
    for more in ([], ["--overwrite"]):
        done = testing.CliRunner().invoke(app, [*command, "--weight", "1000", *more])
        assert done.exit_code == 0, done.output
    new = geopandas.read_parquet(out) if suffix == ".parquet" else geopandas.read_file(out)
    assert [corners(shape) for shape in new.geometry] == [4, 4]
    assert new["flips"].tolist() == [0, 0]
    assert {file.name for file in tmp_path.iterdir()} == {"town.gpkg", out.name}
    masks = testing.CliRunner().invoke(app, ["simplify", str(tmp_path), "-o", "x", "--straighten", "1"])
    assert masks.exit_code == 2


def test_a_shapefile_that_cannot_be_written_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    geopandas = pytest.importorskip("geopandas")
    from torchlinf.scoring import write_outlines

    frame = geopandas.GeoDataFrame({"name": ["a"]}, geometry=[HOUSE], crs=32633)
    write_outlines(tmp_path / "town.shp", frame)
    (tmp_path / "town.qix").write_bytes(b"an index of the old file")
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    whole = geopandas.GeoDataFrame.to_file

    def failing(self: object, path: Path, **options: object) -> None:
        whole(self, path, **options)
        raise OSError("the disk is full")

    monkeypatch.setattr(geopandas.GeoDataFrame, "to_file", failing)
    other = geopandas.GeoDataFrame({"name": ["b"]}, geometry=[ELL], crs=32633)
    with pytest.raises(OSError, match="full"):
        write_outlines(tmp_path / "town.shp", other)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before
    monkeypatch.undo()
    write_outlines(tmp_path / "town.shp", other)
    assert geopandas.read_file(tmp_path / "town.shp")["name"].tolist() == ["b"]
    assert not (tmp_path / "town.qix").exists()
