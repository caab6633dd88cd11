"""Label maps in files and COCO files of every kind: one row a label, with its id, category and image."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pycocotools import mask as coco
from typer.testing import CliRunner

from torchlinf.cli import app
from torchlinf.labels import complexity_table
from torchlinf.scoring import JOURNAL, Score, find_masks, read_source, score_masks

run = CliRunner(env={"TERM": "dumb", "COLUMNS": "200"}).invoke

MAP = np.zeros((40, 62), dtype=np.uint16)
MAP[3:17, 2:30] = 7
MAP[20:38, 5:19] = 300
MAP[20:28, 5:9] = 0
MAP[2:9, 40:60] = 65535
MAP[30:36, 30:60] = 7  # a second part of the same label


def save(path: Path, array: np.ndarray) -> Path:
    Image.fromarray(array).save(path)
    return path


def test_a_row_for_each_label_is_that_of_the_table_of_labels(tmp_path: Path) -> None:
    path = save(tmp_path / "map.png", MAP)
    rows = list(score_masks(find_masks([path]), labels=True))
    table = complexity_table(MAP.astype(int), properties=["area"])
    assert [row.path for row in rows] == [f"{path}#7", f"{path}#300", f"{path}#65535"]
    assert [row.label for row in rows] == table["label"].tolist()
    assert [row.inside for row in rows] == ["label 7", "label 300", "label 65535"]
    assert [row.pixels for row in rows] == table["area"].tolist()
    assert [row["complexity"] for row in rows] == table["complexity"].tolist()
    assert {(row.height, row.width, row.depth) for row in rows} == {(40, 62, None)}
    assert [row.components for row in rows] == [2, 1, 1]
    ignored = score_masks(find_masks([path]), labels=True, ignore=65535)
    assert [row.label for row in ignored] == [7, 300]


def test_maps_without_labels_and_with_wrong_ones_are_rows(tmp_path: Path) -> None:
    np.save(tmp_path / "empty.npy", np.zeros((4, 5), np.uint8))
    np.save(tmp_path / "negative.npy", np.array([[0, -1], [3, 3]]))
    np.save(tmp_path / "share.npy", np.array([[0, 0.5], [3, 3]]))
    rows = {Path(row.path).name: row for row in score_masks(find_masks([tmp_path]), labels=True)}
    assert "no foreground" in rows["empty.npy"].error
    assert "got -1. Pass --ignore -1" in rows["negative.npy"].error
    assert "whole numbers" in rows["share.npy"].error
    (row,) = score_masks(find_masks([tmp_path / "negative.npy"]), labels=True, ignore=[-1])
    assert (row.label, row.pixels) == (3, 2)


def table(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_the_command_asks_and_is_answered(tmp_path: Path) -> None:
    path = str(save(tmp_path / "map.png", MAP))
    asked = run(app, ["score", path])
    assert asked.exit_code == 1
    assert "4 values (0, 7, 300, 65535), and inside is not clear: pass --labels" in table(asked.stdout)[0]["error"]
    for options, rule, pixels in (
        (["--label", "300"], "label 300", (MAP == 300).sum()),
        (["--nonzero"], "nonzero", (MAP > 0).sum()),
        (["--nonzero", "--ignore", "300", "--ignore", "7"], "nonzero except 300, 7", (MAP == 65535).sum()),
        (["--threshold", "299"], "> 299", (MAP > 299).sum()),
    ):
        (row,) = table(run(app, ["score", path, *options]).stdout)
        assert (row["inside"], row["pixels"], row["error"]) == (rule, str(pixels), "")
    wrong = run(app, ["score", path, "--label", "3", "--nonzero"])
    assert wrong.exit_code == 2
    assert "got label and nonzero" in " ".join(wrong.stderr.replace("│", " ").split())
    assert run(app, ["order", path, "--label", "7"]).exit_code == 0


def test_labels_are_resumed_by_the_file(tmp_path: Path) -> None:
    paths = [str(save(tmp_path / f"{i}.png", MAP + np.uint16(i) * (MAP > 0) * (MAP < 999))) for i in range(2)]
    out = tmp_path / "scores.csv"
    assert run(app, ["score", paths[0], "--labels", "--out", str(out)]).exit_code == 0
    again = run(app, ["score", *paths, "--labels", "--out", str(out)])
    assert "1 of 2 masks are in" in again.stderr
    names = [row["path"] for row in table(out.read_text())]
    assert names == [f"{paths[0]}#{label}" for label in (7, 300, 65535)] + [
        f"{paths[1]}#{label}" for label in (8, 301, 65535)
    ]
    assert not out.with_name(out.name + JOURNAL).exists()


SIZE = [20, 30]
BOX = [2.0, 3.0, 12.0, 3.0, 12.0, 9.0, 2.0, 9.0]


def annotations(folder: Path, content: object) -> list[Score]:
    (folder / "a.json").write_text(json.dumps(content))
    return list(score_masks(find_masks([folder / "a.json"])))


def test_one_bad_image_refuses_its_own_annotations_only(tmp_path: Path) -> None:
    images = [{"id": 1, "height": 20, "width": 30, "file_name": "x/1.jpg"}, {"id": 2, "file_name": "2.jpg"}, 5]
    each = [{"id": i, "image_id": i, "category_id": 9, "segmentation": [BOX]} for i in (1, 2)]
    rows = annotations(tmp_path, {"images": images, "annotations": each, "categories": [{"id": 9, "name": "cat"}]})
    assert [(row.image, row.category, row.pixels) for row in rows] == [("x/1.jpg", "cat", 60), ("2.jpg", "cat", None)]
    assert "no image of known size" in rows[1].error


def test_ids_that_stand_twice_lose_no_mask(tmp_path: Path) -> None:
    images = [{"id": 1, "height": 20, "width": 30}]
    each = [{"id": 4, "image_id": 1, "segmentation": [BOX]}, {"id": 4, "image_id": 1, "segmentation": [BOX[:6]]}]
    rows = annotations(tmp_path, {"images": images, "annotations": [*each, 17]})
    assert [row.path.rpartition(":")[2] for row in rows] == ["4", "4~2", "2"]
    assert rows[0].pixels == 60 > rows[1].pixels > 20
    assert "not an object" in rows[2].error


@pytest.mark.parametrize("stray", [[5.0, 5.0], [1.0, 1.0, 8.0, 8.0], []])
def test_a_stray_point_does_not_spoil_a_mask(stray: list[float], tmp_path: Path) -> None:
    images = [{"id": 1, "height": 20, "width": 30}]
    each = [{"id": i, "image_id": 1, "segmentation": parts} for i, parts in enumerate(([BOX, stray], BOX, [stray]))]
    rows = annotations(tmp_path, {"images": images, "annotations": each})
    assert [row.pixels for row in rows] == [60, 60, None]
    assert "three or more pairs" in rows[2].error


def test_a_list_of_results(tmp_path: Path) -> None:
    mask = np.zeros(SIZE, dtype=np.uint8)
    mask[4:9, 5:20] = 1
    packed = coco.encode(np.asfortranarray(mask))["counts"].decode()
    one = {"image_id": 42, "category_id": 18, "score": 0.2, "segmentation": {"size": SIZE, "counts": packed}}
    rows = annotations(tmp_path, [one, one, {**one, "segmentation": [BOX]}])
    assert [row.path.rpartition(":")[2] for row in rows] == ["0", "1", "2"]
    assert [(row.image, row.category, row.pixels) for row in rows[:2]] == [("42", "18", 75)] * 2
    assert "no image of known size has the id 42" in rows[2].error


def test_panoptic_files_have_their_pictures_beside_them(tmp_path: Path) -> None:
    ids = np.where(MAP == 7, 7, np.where(MAP == 300, 300, np.where(MAP > 0, 70000, 0)))
    picture = np.stack([ids % 256, ids // 256 % 256, ids // 65536], axis=-1).astype(np.uint8)
    segments = [{"id": 7, "category_id": 1}, {"id": 70000, "category_id": 2}, {"id": 5, "category_id": 1}]
    content = {
        "images": [{"id": 3, "file_name": "3.jpg", "height": 40, "width": 62}],
        "annotations": [{"image_id": 3, "file_name": "3.png", "segments_info": segments}],
        "categories": [{"id": 1, "name": "sky"}, {"id": 2, "name": "road"}],
    }
    missing = annotations(tmp_path, content)
    assert all("its PNG is not there: 3.png" in row.error for row in missing)
    (tmp_path / "a").mkdir()
    save(tmp_path / "a" / "3.png", picture)
    rows = annotations(tmp_path, content)
    assert [(row.path.rpartition(":")[2], row.category, row.image, row.label) for row in rows] == [
        ("3.png#7", "sky", "3.jpg", 7), ("3.png#70000", "road", "3.jpg", 70000), ("3.png#5", "sky", "3.jpg", 5)
    ]  # fmt: skip
    assert [row.pixels for row in rows] == [(ids == 7).sum(), (ids == 70000).sum(), 0]
    np.testing.assert_array_equal(read_source(find_masks([tmp_path / "a.json"])[1]), ids == 70000)
    content["annotations"][0]["file_name"] = "../a/3.png"
    assert all("leads elsewhere" in row.error for row in annotations(tmp_path, content))
