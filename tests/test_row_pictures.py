"""Every row of a table finds its mask again, by what the row says; and what a retry does to maps and stacks."""

import csv
import io
import json
import tarfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from torchlinf.cli import app
from torchlinf.report.masks import MaskReader, profile_values
from torchlinf.scoring import Score, find_masks, read_table, score_masks

run = CliRunner(env={"TERM": "dumb", "COLUMNS": "200"}).invoke

MAP = np.zeros((30, 47), dtype=np.uint8)
MAP[2:12, 3:20] = 7
MAP[15:28, 5:19] = 15
MAP[15:20, 5:9] = 0
MAP[4:22, 24:44] = 90
MAP[0, :] = 255


def found(rows: list[Score]) -> list[np.ndarray]:
    """The masks of rows; each must have as many pixels as its row says, and the profile that was scored."""
    reader = MaskReader()
    masks = []
    for row in rows:
        assert row.error is None, row.error
        mask = reader(row.cells())
        assert mask.sum() == row.pixels
        values, note = profile_values(mask, row.cells())
        assert (note, values.size > 0) == ("", True)
        masks.append(mask)
    return masks


def same(masks: list[np.ndarray], expected: list[np.ndarray]) -> None:
    for mask, other in zip(masks, expected, strict=True):
        np.testing.assert_array_equal(mask, other)


def test_rows_of_labels_and_stacks(tmp_path: Path) -> None:
    Image.fromarray(MAP).save(tmp_path / "map.png")
    np.save(tmp_path / "stack.npy", np.stack([MAP, MAP[::-1]]))
    rows = list(score_masks(find_masks([tmp_path / "map.png"]), labels=True, ignore=255))
    same(found(rows), [label == MAP for label in (7, 15, 90)])
    rows = list(score_masks(find_masks([tmp_path / "stack.npy"]), labels=True, stack=True, ignore=255))
    assert rows[4].path == f"{tmp_path}/stack.npy[1]#15"
    same(found(rows), [page == label for page in (MAP, MAP[::-1]) for label in (7, 15, 90)])
    rows = list(score_masks(find_masks([tmp_path / "stack.npy"]), stack=True, nonzero=True))
    same(found(rows), [MAP > 0, MAP[::-1] > 0])


@pytest.mark.parametrize(
    ("options", "mask"),
    [
        ({"nonzero": True}, MAP > 0),
        ({"nonzero": True, "ignore": [255, 7]}, (MAP > 0) & (MAP != 255) & (MAP != 7)),
        ({"label": 15}, MAP == 15),
        ({"label": 15, "invert": True, "ignore": 255}, (MAP != 15) & (MAP != 255)),
        ({"threshold": 14.5}, MAP > 14),
        ({"threshold": 14.5, "invert": True}, MAP <= 14),
    ],
)
def test_rows_of_every_rule(options: dict[str, object], mask: np.ndarray, tmp_path: Path) -> None:
    Image.fromarray(MAP).save(tmp_path / "map.png")
    same(found(list(score_masks(find_masks([tmp_path]), **options))), [mask])


def test_rows_without_an_option(tmp_path: Path) -> None:
    Image.fromarray(np.where(MAP > 0, 255, 0).astype(np.uint8)).save(tmp_path / "a.png")
    Image.fromarray(np.where(MAP > 0, 255, 0).astype(np.uint8)).save(tmp_path / "b.jpg", quality=90)
    np.save(tmp_path / "c.npy", np.where(MAP > 0, 0.75, 0.25))
    np.save(tmp_path / "d.npy", np.where(MAP > 0, 1, -1))
    same(found(list(score_masks(find_masks([tmp_path])))), [MAP > 0] * 4)


def test_rows_of_archives_volumes_and_descriptions(tmp_path: Path) -> None:
    file = io.BytesIO()
    Image.fromarray(MAP).save(file, "PNG")
    with tarfile.open(tmp_path / "a.tgz", "w:gz") as archive:
        info = tarfile.TarInfo("x/map.png")
        info.size = len(file.getvalue())
        archive.addfile(info, io.BytesIO(file.getvalue()))
    rows = list(score_masks(find_masks([tmp_path / "a.tgz"]), labels=True, ignore=255))
    same(found(rows), [label == MAP for label in (7, 15, 90)])
    volume = np.stack([MAP > 0, MAP > 7, MAP > 15])
    np.save(tmp_path / "v.npy", volume)
    rows = list(score_masks(find_masks([tmp_path / "v.npy"]), volume=True, spacing=(2.5, 1.0, 1.0)))
    assert rows[0].spacing == "2.5 x 1 x 1 in cubes of 1"
    same(found(rows), [volume])
    shapes = [{"label": "a", "points": [[3, 4], [20, 9]], "shape_type": "rectangle"}]
    content = {"shapes": shapes, "imageHeight": 30, "imageWidth": 47}
    (tmp_path / "me.json").write_text(json.dumps(content))
    box = np.zeros((30, 47), dtype=bool)
    box[4:10, 3:21] = True
    same(found(list(score_masks(find_masks([tmp_path / "me.json"])))), [box])
    same(found(list(score_masks(find_masks([tmp_path / "me.json"]), invert=True))), [~box])
    picture = np.dstack([MAP, 0 * MAP, 0 * MAP])
    Image.fromarray(picture).save(tmp_path / "1.png")
    segments = [{"id": 7, "category_id": 1}, {"id": 15, "category_id": 1}]
    annotation = {"image_id": 1, "file_name": "1.png", "segments_info": segments}
    (tmp_path / "pan.json").write_text(json.dumps({"images": [], "annotations": [annotation]}))
    rows = list(score_masks(find_masks([tmp_path / "pan.json"])))
    same(found(rows), [MAP == 7, MAP == 15])


def test_a_panoptic_picture_is_decoded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from torchlinf.scoring import last_read

    picture = np.dstack([MAP, 0 * MAP, 0 * MAP])
    annotations = []
    for i in range(3):
        Image.fromarray(np.roll(picture, i, axis=1)).save(tmp_path / f"{i}.png")
        segments = [{"id": label} for label in (7, 15, 90)]
        annotations.append({"image_id": i, "file_name": f"{i}.png", "segments_info": segments})
    (tmp_path / "pan.json").write_text(json.dumps({"images": [], "annotations": annotations}))
    decoded: list[Path] = []
    read = last_read.read_values

    def counted(path: Path, *arguments: object) -> object:
        decoded.append(path)
        return read(path, *arguments)

    monkeypatch.setattr(last_read, "read_values", counted)
    rows = list(score_masks(find_masks([tmp_path / "pan.json"])))
    assert [row.pixels for row in rows] == [(label == MAP).sum() for label in (7, 15, 90)] * 3
    assert decoded == [tmp_path / f"{i}.png" for i in range(3)]


def test_a_score_makes_a_report_with_a_picture_in_every_row(tmp_path: Path) -> None:
    pytest.importorskip("bokeh")
    Image.fromarray(MAP).save(tmp_path / "map.png")
    page, out = tmp_path / "page.html", tmp_path / "scores.csv"
    command = ["score", str(tmp_path / "map.png"), "--labels", "--ignore", "255", "--report", str(page)]
    for more in (["--out", str(out)], []):
        result = run(app, [*command, *more])
        assert result.exit_code == 0
        assert "3 of 3 masks, 3 pictures, 3 profiles" in result.stderr
        assert page.stat().st_size > 10_000
        page.unlink()
    assert len(list(csv.reader(io.StringIO(result.stdout)))) == 4
    assert run(app, ["report", str(out), "--out", str(page)]).exit_code == 0
    wrong = run(app, [*command[:-1], str(tmp_path / "page.csv")])
    assert wrong.exit_code == 2
    assert "not the name of a page" in " ".join(wrong.stderr.replace("│", " ").split())


def test_retry_scores_a_map_again_that_failed_in_part(tmp_path: Path) -> None:
    Image.fromarray(MAP).save(tmp_path / "map.png")
    out, command = tmp_path / "scores.csv", ["score", str(tmp_path / "map.png"), "--labels", "--ignore", "255"]
    (tmp_path / "whole.png").write_bytes(b"?")
    command += [str(tmp_path / "whole.png"), "--out", str(out)]
    assert run(app, command).exit_code == 1
    rows = list(csv.reader(io.StringIO(out.read_text())))
    assert [row[0].rpartition("/")[2] for row in rows[1:]] == ["map.png#7", "map.png#15", "map.png#90", "whole.png"]
    rows[2][rows[0].index("error")] = "its field did not converge"
    with out.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)
    Image.fromarray(MAP).save(tmp_path / "whole.png")
    assert "2 of 2 masks are in" in run(app, command).stderr  # without --retry nothing is scored
    again = run(app, [*command, "--retry"])
    assert (again.exit_code, "are in" in again.stderr) == (0, False)
    names = [Path(row.path).name for row in read_table(out)]
    assert sorted(names) == sorted(f"{name}.png#{label}" for name in ("map", "whole") for label in (7, 15, 90))
    assert [row.error for row in read_table(out)] == [None] * 6


def test_segments_of_panoptic_files_are_resumed_with_labels_too(tmp_path: Path) -> None:
    """Their names end like those of labels."""
    Image.fromarray(np.dstack([MAP, 0 * MAP, 0 * MAP])).save(tmp_path / "1.png")
    segments = [{"id": 7}, {"id": 15}]
    annotation = {"image_id": 1, "file_name": "1.png", "segments_info": segments}
    (tmp_path / "pan.json").write_text(json.dumps({"images": [], "annotations": [annotation]}))
    command = ["score", str(tmp_path / "pan.json"), "--labels", "--out", str(tmp_path / "scores.csv")]
    assert run(app, command).exit_code == 0
    assert "2 of 2 masks are in" in run(app, command).stderr


def test_rows_of_objects(tmp_path: Path) -> None:
    Image.fromarray(np.where(MAP > 0, 255, 0).astype(np.uint8)).save(tmp_path / "a.png")
    rows = list(score_masks(find_masks([tmp_path]), per="object", min_pixels=60))
    assert [row.path for row in rows] == [f"{tmp_path}/a.png@{i}" for i in (1, 2, 3)]  # the line above has 47 pixels
    same(found(rows), [MAP == 7, MAP == 90, MAP == 15])
