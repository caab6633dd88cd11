"""`torchlinf simplify`: files of the same kind with simpler masks, and the table of what was changed."""

import csv
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from torchlinf.cli.app import app

WALL = slice(10, 50), slice(10, 60)  # 40 x 50
BUMP = slice(30, 34), slice(60, 63)  # 12 pixels
PALETTE = [0, 0, 0, 255, 0, 0, 0, 255, 0, 9, 8, 7]


def house(bump: bool = True) -> np.ndarray:
    """A box of 40 x 50 in 60 x 80, with a bump."""
    mask = np.zeros((60, 80), dtype=bool)
    mask[WALL] = True
    if bump:
        mask[BUMP] = True
    return mask


def label_map() -> np.ndarray:
    """Label 1 with a bump, and label 2 to the right of it, which has a notch full of label 3."""
    labels = house().astype(np.uint8)
    labels[10:50, 64:78] = 2
    labels[20:23, 70:73] = 3
    return labels


def call(*arguments: object) -> "tuple[int, str]":
    result = CliRunner().invoke(app, ["simplify", *map(str, arguments)])
    return result.exit_code, result.output


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "simplified.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def masks(tmp_path: Path) -> Path:
    folder = tmp_path / "masks"
    (folder / "below").mkdir(parents=True)
    Image.fromarray(house().astype(np.uint8) * 255).save(folder / "grey.png")
    Image.fromarray(house()).save(folder / "below" / "bit.png")
    Image.fromarray(house().astype(np.uint8) * 7).save(folder / "seven.bmp")
    np.save(folder / "array.npy", house())
    return folder


def test_masks_are_written_in_their_own_kind_with_their_own_values(masks: Path, tmp_path: Path) -> None:
    out = tmp_path / "simpler"
    assert call(masks, "--out", out, "--weight", 3, "--workers", 1)[0] == 0
    wanted = house(bump=False)
    with Image.open(out / "below" / "bit.png") as image:
        assert image.mode == "1"
        np.testing.assert_array_equal(np.asarray(image), wanted)
    for name, value in (("grey.png", 255), ("seven.bmp", 7)):
        with Image.open(out / name) as image:
            assert image.mode == "L"
            np.testing.assert_array_equal(np.asarray(image), wanted * np.uint8(value))
    array = np.load(out / "array.npy")
    assert array.dtype == bool
    np.testing.assert_array_equal(array, wanted)
    for row in table(out):
        assert (row["changed"], row["cost"], row["after"]) == ("12", "12.0", "0.0")
        assert int(row["flips"]) >= 1
        assert float(row["before"]) > 0
        assert not row["error"]


def test_a_label_map_keeps_its_palette_and_every_other_label(tmp_path: Path) -> None:
    image = Image.fromarray(label_map())
    image.putpalette(PALETTE)
    (tmp_path / "in").mkdir()
    image.save(tmp_path / "in" / "map.png")
    out = tmp_path / "out"
    assert call(tmp_path / "in" / "map.png", "--out", out, "--labels", "--weight", 3)[0] == 0
    with Image.open(out / "map.png") as written:
        assert written.mode == "P"
        assert written.getpalette("RGB")[: len(PALETTE)] == PALETTE
        labels = np.asarray(written)
    given = label_map()
    assert not labels[BUMP].any()
    np.testing.assert_array_equal(labels[WALL], 1)
    np.testing.assert_array_equal(labels == 3, given == 3)  # label 2 would be simpler with them, but they are not free
    assert set(given[labels == 2]) == {2}
    rows = {row["label"]: row for row in table(out)}
    assert rows.keys() == {"1", "2", "3"}
    assert rows["1"]["path"].endswith("map.png#1")
    assert int(rows["2"]["changed"]) == int((labels != given)[given == 2].sum())
    assert float(rows["2"]["before"]) > float(rows["2"]["after"]) + 3 * int(rows["2"]["changed"]) / (given == 2).sum()


def test_one_label_is_simplified_and_the_others_stay(tmp_path: Path) -> None:
    np.save(tmp_path / "map.npy", label_map().astype(np.int32) * 1000)
    assert call(tmp_path / "map.npy", "--out", tmp_path / "out", "--label", 1000, "--weight", 3)[0] == 0
    found, wanted = np.load(tmp_path / "out" / "map.npy"), label_map().astype(np.int32) * 1000
    wanted[BUMP] = 0
    assert found.dtype == np.int32
    np.testing.assert_array_equal(found, wanted)


def test_what_is_certain_stays_and_what_is_doubtful_goes(tmp_path: Path) -> None:
    """The same bump, with log-odds of ln(0.51 / 0.49) a pixel, and of 16."""
    for name, inside in (("doubtful", 0.51), ("certain", 1.0)):
        probability = np.where(house(bump=False), 0.999, 0.001).astype(np.float32)
        probability[BUMP] = inside
        np.save(tmp_path / f"{name}.npy", probability)
    assert call(tmp_path / "*.npy", "--out", tmp_path / "out", "--weight", 10)[0] == 0
    doubtful, certain = np.load(tmp_path / "out" / "doubtful.npy"), np.load(tmp_path / "out" / "certain.npy")
    np.testing.assert_array_equal(doubtful, house(bump=False).astype(np.float32))
    np.testing.assert_array_equal(certain, house().astype(np.float32))
    rows = {Path(row["path"]).stem: row for row in table(tmp_path / "out")}
    assert float(rows["doubtful"]["cost"]) == pytest.approx(12 * np.log(0.51 / 0.49), rel=1e-4)
    assert rows["certain"]["cost"] == "0.0"


def test_grey_images_are_probabilities_only_if_it_is_said(tmp_path: Path) -> None:
    grey = np.where(house(bump=False), 255, 0).astype(np.uint8)
    grey[BUMP] = 130
    grey[:4, ::3] = 20  # soft shades, so that it is no label map
    Image.fromarray(grey).save(tmp_path / "soft.png")
    assert call(tmp_path / "soft.png", "--out", tmp_path / "a", "--weight", 100)[0] == 0
    assert call(tmp_path / "soft.png", "--out", tmp_path / "b", "--weight", 100, "--probability", "-t", 127)[0] == 0
    assert [table(tmp_path / name)[0]["changed"] for name in "ab"] == ["0", "12"]
    with Image.open(tmp_path / "b" / "soft.png") as image:
        np.testing.assert_array_equal(np.asarray(image), house(bump=False) * np.uint8(255))


def test_geotiffs_keep_their_place(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile")
    scale = (33550, "d", 3, (0.5, 0.5, 0.0), True)
    tifffile.imwrite(tmp_path / "tile.tif", house().astype(np.uint8), extratags=[scale], metadata=None)
    assert call(tmp_path / "tile.tif", "--out", tmp_path / "out", "--weight", 3)[0] == 0
    with tifffile.TiffFile(tmp_path / "out" / "tile.tif") as tiff:
        assert tiff.pages[0].tags[33550].value == (0.5, 0.5, 0.0)
        np.testing.assert_array_equal(tiff.asarray(), house(bump=False))


def test_broken_files_are_rows_and_the_others_are_written(masks: Path, tmp_path: Path) -> None:
    (masks / "broken.png").write_bytes(b"\x89PNG, but not really")
    Image.fromarray(house().astype(np.uint8) * 255).save(masks / "lossy.jpg")
    code, said = call(masks, "--out", tmp_path / "out", "--weight", 3)
    assert code == 1
    assert "2 of 6 masks failed" in said
    errors = {Path(row["path"]).name: row["error"] for row in table(tmp_path / "out")}
    assert "no .jpg file is written" in errors["lossy.jpg"]
    assert errors["broken.png"]
    assert sorted(path.name for path in (tmp_path / "out").glob("*.*")) == [
        "array.npy", "grey.png", "seven.bmp", "simplified.csv",
    ]  # fmt: skip


def test_a_run_goes_on_where_it_was(masks: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert call(masks, "--out", out, "--weight", 3)[0] == 0
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.*")}
    (out / "grey.png").unlink()
    code, said = call(masks, "--out", out, "--weight", 3)
    assert code == 0
    assert "3 of 4 masks are in" in said
    assert (out / "grey.png").exists()
    assert all(path.stat().st_mtime_ns == time for path, time in before.items() if path.suffix in (".npy", ".bmp"))
    assert len(table(out)) == 4
    assert call(masks, "--out", out, "--weight", 4)[0] == 2  # other options
    assert call(masks, "--out", out, "--weight", 4, "--overwrite")[0] == 0


def test_no_mask_is_written_over(masks: Path, tmp_path: Path) -> None:
    for given, out in ((masks, masks), (masks, masks / "new"), (masks / "grey.png", masks)):
        code, said = call(given, "--out", out)
        assert code == 2
        assert "--out" in said
    (tmp_path / "grey.png").write_bytes((masks / "grey.png").read_bytes())
    assert call(masks / "grey.png", tmp_path / "grey.png", "--out", tmp_path / "out")[0] == 2
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--weight", "-1"), "weight must"),
        (("--resolution", "1"), "files of outlines"),
        (("--orientation", "mean"), "orientation"),
    ],
)
def test_wrong_options_are_refused(masks: Path, tmp_path: Path, options: tuple[str, ...], message: str) -> None:
    code, said = call(masks, "--out", tmp_path / "out", *options)
    assert code == 2
    assert message in said


def test_outlines_keep_attributes_and_coordinates(tmp_path: Path) -> None:
    geopandas, shapely = pytest.importorskip("geopandas"), pytest.importorskip("shapely")
    pytest.importorskip("pyogrio")
    box = shapely.box(500000, 5400000, 500012, 5400008)
    bumpy = shapely.union(box, shapely.box(500005, 5400008, 500006, 5400009))
    frame = geopandas.GeoDataFrame(
        {"year": [1, 2, 3], "area": [0, 0, 0]}, geometry=[box, bumpy, None], crs="EPSG:32633"
    )
    frame.to_file(tmp_path / "in.gpkg", engine="pyogrio")
    code, said = call(tmp_path / "in.gpkg", "-o", tmp_path / "out.gpkg", "--resolution", 0.25, "--weight", 3)
    assert code == 1
    assert "1 of 3 outlines are as they were" in said
    found = geopandas.read_file(tmp_path / "out.gpkg", engine="pyogrio")
    assert found.crs == frame.crs
    assert found["year"].tolist() == [1, 2, 3]
    assert "area_given" in found
    assert found.geometry[0].equals(box)
    assert found.geometry[1].symmetric_difference(box).area < 1e-4
    assert found.geometry[2] is None
    assert call(tmp_path / "in.gpkg", "-o", tmp_path / "out.gpkg", "--resolution", 0.25)[0] == 2  # it is there
    assert call(tmp_path / "in.gpkg", "-o", tmp_path / "in.gpkg", "--resolution", 0.25, "--overwrite")[0] == 2
    assert call(tmp_path / "in.gpkg", "-o", tmp_path / "new.gpkg")[0] == 2  # no size of a pixel
    assert call(tmp_path / "in.gpkg", "-o", tmp_path / "new.geojson", "--resolution", 0.25, "--labels")[0] == 2


@pytest.mark.parametrize("option", ["--label", "--threshold", "--ignore"])
def test_an_option_of_masks_is_refused_for_outlines_though_it_is_zero(tmp_path, option):
    code, said = call(tmp_path / "in.gpkg", "-o", tmp_path / "out.gpkg", "--resolution", 0.25, option, 0)
    assert code == 2
    assert f"{option} is not for outlines" in " ".join(said.replace("│", " ").split())
