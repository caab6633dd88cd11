"""`torchlinf simplify`: files of the same kind with simpler masks, and the table of what was changed."""

import csv
from collections.abc import Iterator
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


def doubtful() -> np.ndarray:
    """Probabilities of a house whose bump is in doubt."""
    probability = np.where(house(bump=False), 0.999, 0.001).astype(np.float32)
    probability[BUMP] = 0.51
    return probability


@pytest.mark.parametrize("options", [(), ("--threshold", 0.5), ("--probability",), ("--ignore", 7)])
@pytest.mark.parametrize(
    ("value", "said"),
    [
        (np.nan, "2 NaN"),
        (np.inf, "2 greater than 1 (up to inf)"),
        (-9999, "2 less than 0 (down to -9999.0)"),
        (1.0000001, "2 greater than 1 (up to 1.00000011"),
    ],
)
def test_no_other_price_for_numbers_that_are_no_probabilities(
    options: tuple[object, ...], value: float, said: str, tmp_path: Path
) -> None:
    probability = doubtful()
    probability[0, :2] = value
    np.save(tmp_path / "p.npy", probability)
    assert call(tmp_path / "p.npy", "--out", tmp_path / "out", *options)[0] == 1
    (row,) = table(tmp_path / "out")
    assert said in row["error"]
    assert "--ignore -9999" in row["error"]
    assert not (tmp_path / "out" / "p.npy").exists()


def test_a_threshold_that_no_probability_has_is_one_of_other_numbers(tmp_path: Path) -> None:
    np.save(tmp_path / "height.npy", house() * 5.5 + 0.25)
    assert call(tmp_path / "height.npy", "--out", tmp_path / "out", "--threshold", 2.5, "--weight", 3)[0] == 0
    np.testing.assert_array_equal(np.load(tmp_path / "out" / "height.npy"), house(bump=False) * 5.5 + 0.25)
    np.save(tmp_path / "p.npy", doubtful())
    assert call(tmp_path / "p.npy", "--out", tmp_path / "wrong", "--threshold", 127)[0] == 1
    assert "must lie between 0 and 1; got 127" in table(tmp_path / "wrong")[0]["error"]


@pytest.mark.parametrize("kind", ["ignore", "nodata", "NaN"])
@pytest.mark.parametrize("invert", [False, True])
def test_probabilities_without_data_are_left_out_and_stay(kind: str, invert: bool, tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile")
    nodata = np.nan if kind == "NaN" else -9999
    left_out = np.zeros((60, 80), dtype=bool)
    left_out[:5] = left_out[20:23, 10:12] = True  # a part of the margin, and a notch, which would be filled
    probability = 1 - doubtful() if invert else doubtful()
    probability[left_out] = nodata
    wanted = (house(bump=False) ^ invert).astype(np.float32)
    wanted[left_out] = nodata
    tags = [] if kind == "ignore" else [(42113, "s", 0, str(nodata), True)]
    tifffile.imwrite(tmp_path / "p.tif", probability, extratags=tags, metadata=None)
    options = (*(["--ignore", -9999] if kind == "ignore" else []), *(["--invert"] if invert else []))
    assert call(tmp_path / "p.tif", "--out", tmp_path / "out", "--weight", 10, *options)[0] == 0
    (row,) = table(tmp_path / "out")
    found = tifffile.imread(tmp_path / "out" / "p.tif")
    np.testing.assert_array_equal(found[left_out], wanted[left_out])
    assert set(np.unique(found[~left_out])) == {0, 1}
    # The notch makes other flips pay too; but none is of the pixels that are left out.
    assert int(row["changed"]) == int(((found > 0.5) ^ invert ^ house())[~left_out].sum()) >= 12
    assert not ((found > 0.5) ^ invert)[BUMP].any()
    assert row["inside"] == ("not " if invert else "") + "> 0.5" + (" except -9999" if kind == "ignore" else "")


def test_what_is_ignored_is_not_written_as_white(tmp_path: Path) -> None:
    Image.fromarray(np.where(house(), 200, 255).astype(np.uint8)).save(tmp_path / "grey.png")
    assert call(tmp_path / "grey.png", "--out", tmp_path / "out", "--probability", "--ignore", 255)[0] == 1
    assert "pixels without data that are 255" in table(tmp_path / "out")[0]["error"]


@pytest.mark.parametrize("void", [0, 255])
def test_ignored_pixels_of_masks_stay(void: int, tmp_path: Path) -> None:
    mask = house().astype(np.uint8) * 15
    mask[20:23, 10:12] = void  # a notch, which is filled unless it is void
    mask[:10] = mask[50:] = void  # most of what is not inside
    np.save(tmp_path / "m.npy", mask)
    options = ("--threshold", 14, "--ignore", 255, "--weight", 3)
    assert call(tmp_path / "m.npy", "--out", tmp_path / "out", *options)[0] == 0
    found = np.load(tmp_path / "out" / "m.npy")
    np.testing.assert_array_equal(found == 255, mask == 255)
    assert not found[BUMP].any()
    assert bool((found[20:23, 10:12] == (255 if void else 15)).all())


@pytest.mark.parametrize("options", [(), ("--labels",), ("--label", 3), ("--probability",)])
def test_an_empty_mask_is_written_and_done(options: tuple[object, ...], tmp_path: Path) -> None:
    Image.fromarray(np.zeros((9, 12), np.uint8)).save(tmp_path / "none.png")
    for _ in range(2):
        code, said = call(tmp_path / "none.png", "--out", tmp_path / "out", *options)
        assert code == 0
        (row,) = table(tmp_path / "out")
        assert (row["error"], row["before"], row["after"], row["changed"]) == ("", "", "", "0")
        with Image.open(tmp_path / "out" / "none.png") as image:
            assert not np.asarray(image).any()
    assert "1 of 1 masks are in" in said


def test_an_empty_prediction_is_written_as_a_mask(tmp_path: Path) -> None:
    np.save(tmp_path / "p.npy", np.full((9, 12), 0.2, np.float32))
    assert call(tmp_path / "p.npy", "--out", tmp_path / "out")[0] == 0
    np.testing.assert_array_equal(np.load(tmp_path / "out" / "p.npy"), np.zeros((9, 12), np.float32))


def test_arrays_and_grey_images_of_probabilities_together(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    np.save(folder / "doubtful.npy", doubtful())
    np.save(folder / "certain.npy", house().astype(np.float64))  # of 0 and 1, which alone would be a mask
    flat = np.where(house(bump=False), 255, 0).astype(np.uint8)
    flat[BUMP] = 130  # three values, as a label map has
    Image.fromarray(flat).save(folder / "flat.png")
    assert call(folder, "--out", tmp_path / "out", "--probability", "--weight", 10)[0] == 0
    costs = {Path(row["path"]).stem: float(row["cost"]) for row in table(tmp_path / "out")}
    assert costs["doubtful"] == pytest.approx(12 * np.log(0.51 / 0.49), rel=1e-4)
    assert costs["flat"] == pytest.approx(12 * np.log(130 / 125), rel=1e-4)
    assert costs["certain"] == 0


def test_files_of_others_are_not_written_over(tmp_path: Path) -> None:
    np.save(tmp_path / "m.npy", house())
    out = tmp_path / "out"
    out.mkdir()
    (out / "m.npy").write_bytes(b"mine")
    code, said = call(tmp_path / "m.npy", "--out", out)
    assert code == 2
    assert "pass --overwrite" in " ".join(said.replace("│", " ").split())
    assert [path.name for path in out.iterdir()] == ["m.npy"]
    assert (out / "m.npy").read_bytes() == b"mine"
    assert call(tmp_path / "m.npy", "--out", out, "--overwrite", "--weight", 3)[0] == 0
    np.testing.assert_array_equal(np.load(out / "m.npy"), house(bump=False))


@pytest.mark.parametrize("ending", [KeyboardInterrupt, MemoryError])
def test_a_run_that_ended_between_a_file_and_its_row_goes_on(
    ending: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.save(tmp_path / "m.npy", house())
    out = tmp_path / "out"

    def end(*_: object, **__: object) -> Iterator[None]:
        (out / "m.npy").write_bytes(b"of this run")
        raise ending
        yield

    with monkeypatch.context() as patch:
        patch.setattr("torchlinf.scoring.simplify_groups", end)
        assert call(tmp_path / "m.npy", "--out", out, "--weight", 3)[0] in (1, 130)
    assert call(tmp_path / "m.npy", "--out", out, "--weight", 3)[0] == 0
    np.testing.assert_array_equal(np.load(out / "m.npy"), house(bump=False))


def test_errors_name_what_this_command_has_and_what_differs(tmp_path: Path) -> None:
    np.save(tmp_path / "map.npy", label_map())
    assert call(tmp_path / "map.npy", "--out", tmp_path / "out")[0] == 1
    error = table(tmp_path / "out")[0]["error"]
    assert "pass --labels for a row each, --label 1 for one, or --threshold" in error
    assert "--nonzero" not in error
    code, said = call(tmp_path / "map.npy", "--out", tmp_path / "out", "--weight", 7, "--labels")
    assert code == 2
    assert "other options: labels false, not true, weight 30.0, not 7.0. It is as it was" in " ".join(said.split())


def test_an_interrupt_of_outlines_says_that_nothing_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    geopandas, shapely = pytest.importorskip("geopandas"), pytest.importorskip("shapely")
    pytest.importorskip("pyogrio")
    frame = geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 12, 8)], crs="EPSG:32633")
    frame.to_file(tmp_path / "in.gpkg", engine="pyogrio")

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("torchlinf.scoring.simplified_outlines", stop)
    code, said = call(tmp_path / "in.gpkg", "-o", tmp_path / "out.gpkg", "--resolution", 0.25)
    assert code == 130
    assert said.splitlines()[-1] == "Stopped; nothing was written, and the same command begins anew."
    assert [path.name for path in tmp_path.iterdir()] == ["in.gpkg"]
