"""`torchlinf score` on files of outlines: attributes beside the numbers, every format, runs that are stopped."""

import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

shapely = pytest.importorskip("shapely")
geopandas = pytest.importorskip("geopandas")
pytest.importorskip("pyogrio")
import pandas as pd  # noqa: E402
from shapely import affinity  # noqa: E402

from torchlinf import scoring  # noqa: E402
from torchlinf.cli.app import app  # noqa: E402
from torchlinf.polygons import complexity_table  # noqa: E402
from torchlinf.scoring import geodata  # noqa: E402

UTM = "EPSG:32632"
CORNER = (478_000.0, 5_420_000.0)


def town(count: int = 12) -> Any:
    """Houses with attributes, some of which are called as columns of the table are."""
    house = shapely.box(0, 0, 12, 8)
    forms = (house, shapely.union(house, shapely.box(8, 8, 12, 14)), house.difference(shapely.box(4, 4, 8, 8)))
    shapes = [
        affinity.translate(affinity.rotate(forms[i % 3], 17 * i), CORNER[0] + 30 * i, CORNER[1] + 11 * i)
        for i in range(count)
    ]
    return geopandas.GeoDataFrame(
        {
            "name": [f"house {i}, =1" if i else None for i in range(count)],
            "year": np.arange(1900, 1900 + count),
            "Area": np.linspace(0, 1, count),
            "radius": ["small"] * count,
        },
        geometry=shapes,
        crs=UTM,
    )


def write(frame: Any, path: Path, **options: Any) -> Path:
    if path.suffix == ".parquet":
        frame.to_parquet(path)
    else:
        frame.to_file(path, engine="pyogrio", **options)
    return path


def run(*arguments: Any, status: int = 0) -> str:
    found = CliRunner().invoke(app, ["score", *map(str, arguments)])
    output = found.output + (getattr(found, "stderr", "") or "")
    assert found.exit_code == status, (output, found.exception)
    return output


def read(path: Path) -> Any:
    if path.suffix == ".gpkg":
        return geopandas.read_file(path, engine="pyogrio")
    if path.suffix == ".parquet":
        return geopandas.read_parquet(path)
    return pd.read_json(path, lines=True) if path.suffix == ".jsonl" else pd.read_csv(path)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


OPTIONS = ("--resolution", "0.25", "--orientation", "own")


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".shp", ".parquet"])
@pytest.mark.parametrize("out", [".gpkg", ".csv", ".jsonl", ".parquet"])
def test_from_every_format_to_every_format(folder: Path, suffix: str, out: str) -> None:
    """A GeoJSON file holds degrees, and is projected back."""
    frame = town()
    write(frame.to_crs("EPSG:4326") if suffix == ".geojson" else frame, folder / f"town{suffix}")
    crs = ("--crs", UTM) if suffix == ".geojson" else ()
    run(f"town{suffix}", *OPTIONS, *crs, "--out", f"scores{out}")
    table = read(folder / f"scores{out}")
    expected = complexity_table(frame, resolution=0.25, orientation="own")
    assert table["path"].tolist() == [f"town{suffix}:{i}" for i in range(len(frame))]
    assert table["year"].tolist() == frame["year"].tolist()
    assert table["Area_given"].tolist() == pytest.approx(frame["Area"].tolist())
    assert set(table["radius_given"]) == {"small"}
    np.testing.assert_array_equal(table["radius"], expected["radius"])
    np.testing.assert_allclose(table["area"], expected["area"], rtol=1e-6)
    np.testing.assert_allclose(table["complexity"], expected["complexity"], atol=1e-6)
    assert (table["complexity"][::3] == 0).all()  # the plain houses, whatever their angle
    assert (table["complexity"][1::3] > 1).all()
    assert table["error"].isna().all()
    assert {"complexity_low", "complexity_high", "angle", "measure", "drawing"} <= set(table.columns)
    assert json.loads(table["drawing"][0])["resolution"] == 0.25
    if out in (".gpkg", ".parquet"):
        same = table.to_crs(UTM)
        assert shapely.hausdorff_distance(same.geometry.values, frame.geometry.values).max() < 1e-3
    else:
        assert "geometry" not in table
    assert sorted(path.name for path in folder.glob(f"scores{out}*")) == [f"scores{out}"]
    assert table["name"].isna().tolist() == [True] + [False] * 11


def test_degrees_are_a_row_that_names_the_option(folder: Path) -> None:
    write(town().to_crs("EPSG:4326"), folder / "town.geojson")
    text = run("town.geojson", *OPTIONS, "--out", "scores.csv", status=1)
    assert "1 of 1 rows have no numbers" in text
    table = read(folder / "scores.csv")
    assert table["path"].tolist() == ["town.geojson"]
    assert table["error"][0].startswith("the coordinates are degrees (EPSG:4326), not lengths; pass --crs utm")
    run("town.geojson", *OPTIONS, "--crs", "utm", "--out", "projected.gpkg")
    again = read(folder / "projected.gpkg")
    assert again.crs == "EPSG:4326"  # the geometry is kept as it was
    np.testing.assert_allclose(again["area"], town().area, rtol=1e-6)


def test_broken_outlines_are_rows_and_the_others_go_on(folder: Path) -> None:
    frame = town()
    bow_tie = shapely.Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])
    frame.loc[3, "geometry"], frame.loc[5, "geometry"] = bow_tie, None
    write(frame, folder / "town.gpkg")
    assert "2 of 12 rows have no numbers" in run("town.gpkg", *OPTIONS, "--out", "scores.gpkg", status=1)
    table = read(folder / "scores.gpkg")
    assert table["error"].notna().tolist() == [i in (3, 5) for i in range(12)]
    assert "Self-intersection" in table["error"][3]
    assert table["error"][5] == "there is no geometry"
    assert table["radius"].tolist()[3:6:2] == [0, 0]
    assert shapely.equals_exact(table.geometry[3], bow_tie)
    # The table is there, so nothing is measured; what failed still counts.
    text = run("town.gpkg", *OPTIONS, "--out", "scores.gpkg", status=1)
    assert "is there already, with 12 rows" in text
    run("town.gpkg", *OPTIONS, "--repair", "--out", "repaired.csv", status=1)
    assert read(folder / "repaired.csv")["error"].notna().sum() == 1


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("missing.gpkg", None, "no such file"),
        ("empty.gpkg", b"", "cannot be read"),
        ("noise.geojson", b"{", "cannot be read"),
        ("plain.parquet", "parquet", "cannot be read"),
        ("none.geojson", b'{"type": "FeatureCollection", "features": []}', "the coordinates are degrees"),
    ],
)
def test_a_file_that_cannot_be_used_is_a_row(folder: Path, name: str, content: Any, words: str) -> None:
    write(town(3), folder / "town.gpkg")
    if content == "parquet":
        pd.DataFrame({"a": [1]}).to_parquet(folder / name)
    elif content is not None:
        (folder / name).write_bytes(content)
    run(name, "town.gpkg", *OPTIONS, "--out", "scores.csv", status=1)
    table = read(folder / "scores.csv")
    assert table["path"].tolist() == [name, *(f"town.gpkg:{i}" for i in range(3))]
    assert words in table["error"][0]
    assert table["error"][1:].isna().all()
    assert table["year"].tolist()[1:] == [1900, 1901, 1902]


def test_a_layer_without_outlines_has_no_rows(folder: Path) -> None:
    write(town(3)[:0], folder / "empty.gpkg")
    for out in ("scores.csv", "scores.gpkg"):
        run("empty.gpkg", *OPTIONS, "--out", out)
        table = read(folder / out)
        assert len(table) == 0
        assert {"path", "year", "complexity", "error"} <= set(table.columns)


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".shp", ".parquet"])
@pytest.mark.usefixtures("parts_of_two")
def test_the_parts_of_a_file_are_known_from_its_header(folder: Path, suffix: str) -> None:
    path = write(town(7).to_crs("EPSG:4326"), folder / f"town{suffix}")
    assert geodata.number_of_parts(path, None) == 4
    assert len(list(geodata.parts_of(path, geodata.GeoOptions(resolution=1.0, crs=UTM), {}))) == 4
    assert geodata.number_of_parts(folder / f"missing{suffix}", None) == 1


def test_layers(folder: Path) -> None:
    write(town(3), folder / "town.gpkg", layer="houses")
    write(town(5), folder / "town.gpkg", layer="sheds", mode="a")
    assert "1 of 1" in run("town.gpkg", *OPTIONS, "--out", "scores.csv", status=1)
    assert read(folder / "scores.csv")["error"][0] == "it has the layers houses, sheds; pass --layer"
    run("town.gpkg", *OPTIONS, "--layer", "sheds", "--out", "sheds.csv")
    assert read(folder / "sheds.csv")["path"].tolist() == [f"town.gpkg:sheds:{i}" for i in range(5)]
    run("town.gpkg", *OPTIONS, "--layer", "roads", "--out", "roads.csv", status=1)
    assert "it has no layer roads of outlines, but houses, sheds" in read(folder / "roads.csv")["error"][0]


def test_several_files_with_other_attributes(folder: Path) -> None:
    other = town(2).to_crs("EPSG:3857")[["geometry"]].assign(owner=["a", "b"])
    write(town(3), folder / "one.gpkg")
    write(other, folder / "two.gpkg")
    run("one.gpkg", "two.gpkg", *OPTIONS, "--out", "scores.gpkg")
    table = read(folder / "scores.gpkg")
    assert table["path"].tolist() == ["one.gpkg:0", "one.gpkg:1", "one.gpkg:2", "two.gpkg:0", "two.gpkg:1"]
    assert table["owner"].tolist()[3:] == ["a", "b"]
    assert table["owner"].isna().tolist() == [True] * 3 + [False] * 2
    assert table.crs == UTM
    assert table.geometry[3].centroid.distance(table.geometry[0].centroid) < 0.01
    # Web Mercator makes lengths larger; the numbers are of the drawing in the file's own coordinates.
    assert table["area"][3] > 1.5 * table["area"][0]


def test_polygons_as_objects(folder: Path) -> None:
    parts = list(town(3).geometry)
    write(geopandas.GeoDataFrame(geometry=[shapely.MultiPolygon(parts), parts[0]], crs=UTM), folder / "town.gpkg")
    run("town.gpkg", *OPTIONS, "--per", "object", "--out", "scores.csv")
    table = read(folder / "scores.csv")
    assert table["path"].tolist() == ["town.gpkg:0@1", "town.gpkg:0@2", "town.gpkg:0@3", "town.gpkg:1@1"]
    assert table["object"].tolist() == [1, 2, 3, 1]
    run("town.gpkg", *OPTIONS, "--per", "object", "--pool", "area", "--out", "pooled.csv")
    assert read(folder / "pooled.csv")["objects"].tolist() == [3, 1]


def test_onto_standard_output(folder: Path) -> None:
    write(town(3), folder / "town.gpkg")
    lines = run("town.gpkg", "--pixels-per-radius", 16, "--window", "fine=0-0.25").splitlines()
    assert lines[0].startswith("path,name,year,Area_given,radius_given,area,pixels,radius,fine,resolution,error_bound")
    assert len(lines) == 4
    rows = [json.loads(line) for line in run("town.gpkg", "--pixels-per-radius", 16, "--json").splitlines()]
    assert [row["radius"] for row in rows] == [16, 16, 16]
    assert rows[0]["name"] is None is rows[0]["error"]


class Stopped:
    """Measures so many parts, and is interrupted then."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, parts: int | None) -> None:
        self.calls, self._parts = 0, parts
        self._table = complexity_table
        monkeypatch.setattr(geodata, "complexity_table", self)

    def __call__(self, outlines: Any, **options: Any) -> Any:
        if len(outlines):
            if self.calls == self._parts:
                raise KeyboardInterrupt
            self.calls += 1
        return self._table(outlines, **options)


@pytest.fixture
def parts_of_two(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geodata, "PART", 2)


@pytest.mark.usefixtures("parts_of_two")
def test_a_run_that_was_stopped_goes_on(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(town(7), folder / "town.gpkg")
    run("town.gpkg", *OPTIONS, "--out", "whole.csv")
    stopped = Stopped(monkeypatch, 2)
    assert "goes on where this one was" in run("town.gpkg", *OPTIONS, "--out", "scores.csv", status=130)
    assert stopped.calls == 2
    assert not (folder / "scores.csv").exists()
    with (folder / "scores.csv.part").open("a") as journal:
        journal.write('{"file": "town.gpkg", "beg')  # a kill may cut a line off
    assert "measured with other options" in run("town.gpkg", "--resolution", 1, "--out", "scores.csv", status=2)
    rest = Stopped(monkeypatch, None)
    run("town.gpkg", *OPTIONS, "--out", "scores.csv")
    assert rest.calls == 2  # of four parts
    assert not (folder / "scores.csv.part").exists()
    pd.testing.assert_frame_equal(
        read(folder / "scores.csv").drop(columns="seconds"), read(folder / "whole.csv").drop(columns="seconds")
    )
    again = Stopped(monkeypatch, None)
    assert "is there already, with 7 rows" in run("town.gpkg", *OPTIONS, "--out", "scores.csv")
    assert again.calls == 0
    run("town.gpkg", *OPTIONS, "--out", "scores.csv", "--overwrite")
    assert again.calls == 4


@pytest.mark.usefixtures("parts_of_two")
def test_a_file_that_has_changed_meanwhile_is_not_continued(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(town(7), folder / "town.gpkg")
    Stopped(monkeypatch, 2)
    run("town.gpkg", *OPTIONS, "--out", "scores.csv", status=130)
    Stopped(monkeypatch, None)
    write(town(9), folder / "town.gpkg")
    text = run("town.gpkg", *OPTIONS, "--out", "scores.csv", status=2)
    assert "town.gpkg had 7 outlines when it was begun, and has 9 now" in " ".join(text.split())


def test_a_table_of_something_else_is_left_alone(folder: Path) -> None:
    write(town(3), folder / "town.gpkg")
    write(town(2), folder / "other.gpkg")
    for name, content, words in (
        ("notes.csv", "a,b\n1,2\n", "is not a table of outlines"),
        ("noise.gpkg", "noise", "is not a table of outlines"),
    ):
        (folder / name).write_text(content)
        assert words in " ".join(run("town.gpkg", *OPTIONS, "--out", name, status=2).split())
        assert (folder / name).read_text() == content
    run("town.gpkg", *OPTIONS, "--out", "scores.csv")
    assert "other options" in run("town.gpkg", "--resolution", 1, "--out", "scores.csv", status=2)
    assert "it is of other files" in run("other.gpkg", *OPTIONS, "--out", "scores.csv", status=2)


WRONG = [
    (("town.gpkg",), "resolution must be given"),
    (("town.gpkg", "--resolution", "1", "--pixels-per-radius", "9"), "got both"),
    (("town.gpkg", "--resolution", "-1"), "resolution must be finite and above 0"),
    (("town.gpkg", *OPTIONS, "--threshold", "3"), "--threshold is not for outlines"),
    (("town.gpkg", *OPTIONS, "--labels", "--invert"), "--labels, --invert is not for outlines"),
    (("town.gpkg", *OPTIONS, "--ray", "local"), "--ray is not for outlines"),
    (("town.gpkg", *OPTIONS, "--per", "object", "--connectivity", "1"), "--connectivity is not for outlines"),
    (("town.gpkg", "mask.png", *OPTIONS), "must be scored apart"),
    (("mask.png", "--resolution", "1"), "--resolution is for files of outlines"),
    (("mask.png", "--repair", "--crs", "utm"), "--crs, --repair is for files of outlines"),
    (("town.gpkg", *OPTIONS, "--crs", "EPSG:nothing"), "is no system of coordinates"),
    (("town.gpkg", *OPTIONS, "--crs", "EPSG:4326"), "has degrees; pass a projected system"),
    (("town.gpkg", *OPTIONS, "--out", "town.gpkg"), "is one of the files to score"),
    (("town.gpkg", *OPTIONS, "--out", "scores.shp"), "a table of outlines is .csv, .jsonl, .parquet, .gpkg"),
    (("town.gpkg", *OPTIONS, "--out", "no/scores.csv"), "does not exist"),
    (("town.gpkg", *OPTIONS, "--out", "scores.csv", "--json"), "has not the name of JSON lines"),
    (("town.gpkg", *OPTIONS, "--overwrite"), "--overwrite needs a table"),
]


@pytest.mark.parametrize(("arguments", "words"), WRONG)
def test_wrong_usage(folder: Path, arguments: tuple[str, ...], words: str) -> None:
    write(town(2), folder / "town.gpkg")
    before = sorted(path.name for path in folder.iterdir())
    text = run(*arguments, status=2)
    assert words in " ".join(text.replace("│", " ").split()), text
    assert sorted(path.name for path in folder.iterdir()) == before


def test_without_the_extra_the_message_names_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(town(2), folder / "town.gpkg")
    monkeypatch.setitem(sys.modules, "geopandas", None)
    assert "torchlinf[geo]" in run("town.gpkg", *OPTIONS, status=2)


def test_the_table_is_one_of_scores(folder: Path) -> None:
    """Other commands read it, whatever attributes stand beside."""
    write(town(4), folder / "town.gpkg")
    run("town.gpkg", *OPTIONS, "--out", "scores.csv")
    rows = list(scoring.read_table(folder / "scores.csv"))
    assert [row.path for row in rows] == [f"town.gpkg:{i}" for i in range(4)]
    assert [row["complexity"] == 0 for row in rows] == [True, False, True, True]  # a U of one thickness is simple too


@pytest.mark.slow
@pytest.mark.skipif("TORCHLINF_FOOTPRINTS" not in os.environ, reason="needs the outlines of Bubenec and Boulder")
def test_real_footprints(folder: Path) -> None:
    """Bubenec: the complexity follows the unfilled share of the smallest rectangle. Boulder is in degrees."""
    from scipy.stats import spearmanr

    data = Path(os.environ["TORCHLINF_FOOTPRINTS"])
    run(data / "bubenec_144.gpkg", *OPTIONS, "--out", "bubenec.gpkg")
    table = read(folder / "bubenec.gpkg")
    unfilled = 1 - table.area / table.geometry.minimum_rotated_rectangle().area
    assert spearmanr(table["complexity"], unfilled).statistic >= 0.73
    run(data / "boulder_13491.gpkg", *OPTIONS, "--crs", "utm", "--out", "boulder.parquet", status=1)
    boulder = read(folder / "boulder.parquet")
    assert len(boulder) == 13_491
    assert boulder["error"].notna().sum() == 10
    assert boulder["complexity"].median() == pytest.approx(1.4, abs=0.1)
