"""Rows of objects in tables of scores: names, boxes, pooling, resuming, and the command's options."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from torchlinf import complexity, complexity_profile, scoring, shapes
from torchlinf.cli.app import app
from torchlinf.scoring.ray import ScoreMasks

DISC, TRIANGLE = shapes.disc(8).numpy(), np.tri(11, dtype=bool)
MASK = np.zeros((40, 61), dtype=np.uint8)
MASK[20:37, 42:59][DISC] = 255
MASK[2:13, 5:16][TRIANGLE] = 255
MASK[30, 7:9] = 255
SIZES = [int(TRIANGLE.sum()), int(DISC.sum()), 2]  # in the order of their first rows


@pytest.fixture
def file(tmp_path: Path) -> Path:
    np.save(tmp_path / "mask.npy", MASK)
    return tmp_path / "mask.npy"


def alone(shape: Any, low: float = 0.0, high: float = 1.0) -> float:
    return complexity(torch.from_numpy(shape), low=low, high=high, spatial_ndim=2).item()


def rows_of(path: Path, **options: Any) -> list[scoring.Score]:
    return list(scoring.score_masks(scoring.find_masks([path]), **options))


def test_a_row_is_an_object(file: Path) -> None:
    rows = rows_of(file, per="object")
    assert [row.path for row in rows] == [f"{file}@{i}" for i in (1, 2, 3)]
    assert [(row.object, row.pixels, row.components, row.objects) for row in rows] == [
        (i, size, 1, None) for i, size in enumerate(SIZES, 1)
    ]
    assert [(row.top, row.bottom, row.left, row.right) for row in rows] == [
        (2, 13, 5, 16), (20, 37, 42, 59), (30, 31, 7, 9),
    ]  # fmt: skip
    assert {(row.height, row.width, row.depth, row.front, row.back) for row in rows} == {(40, 61, None, None, None)}
    for row, shape in zip(rows, (TRIANGLE, DISC, np.ones((1, 2), bool)), strict=True):
        assert row["complexity"] == alone(shape)
        assert row["complexity_low"] == alone(shape, 0.0, 0.25)
        peak, scale = complexity_profile(torch.from_numpy(shape), spatial_ndim=2).peak()
        assert (row.peak, row.peak_scale) == (peak, scale)
        assert (row.error_bound, row.angle, row.standard_error) == (0.0, None, None)


def test_boxes_are_those_in_the_image(tmp_path: Path) -> None:
    labels = np.where(MASK > 0, 5, 0).astype(np.uint8)
    labels[20:37, 42:59][DISC] = 9
    np.save(tmp_path / "map.npy", labels)
    rows = rows_of(tmp_path / "map.npy", labels=True, per="object", min_pixels=3)
    assert [row.path for row in rows] == [f"{tmp_path}/map.npy#5@1", f"{tmp_path}/map.npy#9@1"]
    assert [(row.label, row.object, row.top, row.left) for row in rows] == [(5, 1, 2, 5), (9, 1, 20, 42)]
    volume = np.zeros((9, 12, 14), dtype=bool)
    volume[2:5, 3:9, 1:4] = volume[6:8, 1:3, 9:13] = True
    np.save(tmp_path / "volume.npy", volume)
    rows = rows_of(tmp_path / "volume.npy", volume=True, per="object")
    boxes = [(row.front, row.back, row.top, row.bottom, row.left, row.right) for row in rows]
    assert boxes == [(2, 5, 3, 9, 1, 4), (6, 8, 1, 3, 9, 13)]
    assert [(row.depth, row["complexity"]) for row in rows] == [(9, 0.0)] * 2


@pytest.mark.parametrize(("pool", "weights"), [("mean", [1, 1, 1]), ("area", SIZES)])
def test_one_row_a_mask_if_objects_are_pooled(pool: str, weights: list[int], file: Path) -> None:
    (row,) = rows_of(file, per="object", pool=pool)
    each = [alone(TRIANGLE), alone(DISC), 0.0]
    assert row["complexity"] == pytest.approx(np.average(each, weights=weights), rel=1e-12)
    assert (row.path, row.objects, row.object, row.pixels) == (str(file), 3, None, sum(SIZES))
    assert (row.top, row.components) == (None, 3)
    named = scoring.score_mask(MASK > 0, per="object", pool=pool)
    assert named["complexity"] == row["complexity"]
    assert named["objects"] == 3
    assert "object" not in named


def test_where_there_is_one_row_alone_objects_are_pooled(file: Path) -> None:
    (source,) = scoring.find_masks([file])
    row = scoring.score_source(source, per="object", min_pixels=3)
    assert row["complexity"] == pytest.approx((alone(TRIANGLE) + alone(DISC)) / 2, rel=1e-12)
    assert json.loads(row.measure or "")["pool"] == "mean"
    assert scoring.score_mask(MASK > 0, per="object", min_pixels=3)["complexity"] == row["complexity"]


def test_what_has_no_object_says_so(tmp_path: Path) -> None:
    np.save(tmp_path / "empty.npy", np.zeros((5, 6), dtype=bool))
    np.save(tmp_path / "small.npy", np.eye(6, dtype=bool))
    for pool in (None, "area"):
        empty, small = rows_of(tmp_path, per="object", min_pixels=7, pool=pool)
        assert empty.error == "no foreground: no pixel is inside"
        assert small.error == "no object: every component has fewer pixels than min_pixels"
        assert (small["complexity"], small.pixels, small.radius) == (None, 6, 0)
        assert (small.objects, empty.objects) == ((0, 0) if pool else (None, None))


def test_the_angle_and_the_standard_error_are_columns(file: Path) -> None:
    rows = rows_of(file, per="object", orientation="own")
    found = [complexity_profile(torch.from_numpy(one), orientation="own", spatial_ndim=2) for one in (TRIANGLE, DISC)]
    assert [row.angle for row in rows[:2]] == [profile.angle.item() for profile in found if profile.angle is not None]
    assert [row["complexity"] for row in rows[:2]] == [profile.mean().item() for profile in found]
    rows = rows_of(file, per="object", orientation="mean", rotations=3)
    profile = complexity_profile(torch.from_numpy(DISC), orientation="mean", rotations=3, spatial_ndim=2)
    ends = scoring.WINDOWS.values()
    assert rows[1].standard_error == max(profile.standard_error(*one).item() for one in ends)
    assert rows[1].peak == profile.peak()[0]
    assert rows[1].angle is None
    (single,) = rows_of(file, orientation=30)
    assert single.angle == 30.0


@pytest.mark.parametrize("suffix", ["csv", "jsonl", "parquet"])
def test_rows_of_objects_are_read_as_they_were_written(suffix: str, file: Path, tmp_path: Path) -> None:
    options: dict[str, Any] = {"per": "object", "orientation": "own"}
    rows = rows_of(file, **options)
    with scoring.open_table(tmp_path / f"table.{suffix}", **options) as put:
        put(*rows)
    assert list(scoring.read_table(tmp_path / f"table.{suffix}")) == rows


def test_the_command_writes_objects_and_goes_on(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "table.csv"
    np.save(tmp_path / "other.npy", TRIANGLE)
    command = ["score", str(file), "--per", "object", "--min-pixels", "3", "--orientation", "own", "--out", str(out)]
    assert CliRunner().invoke(app, command).exit_code == 0
    assert [row.path for row in scoring.read_table(out)] == [f"{file}@1", f"{file}@2"]
    found = CliRunner().invoke(app, [*command, str(tmp_path / "other.npy")])
    assert found.exit_code == 0
    assert "1 of 2 masks are in" in found.output + getattr(found, "stderr", "")
    assert [row.path for row in scoring.read_table(out)] == [f"{file}@1", f"{file}@2", f"{tmp_path}/other.npy@1"]


def test_the_command_reads_degrees(file: Path) -> None:
    found = CliRunner().invoke(app, ["score", str(file), "--orientation", "-12.5", "--json"])
    (row,) = rows_of(file, orientation=-12.5)
    assert json.loads(found.output)["complexity"] == row["complexity"]
    for wrong in ("up", "inf"):
        found = CliRunner().invoke(app, ["score", str(file), "--orientation", wrong])
        assert found.exit_code == 2
    assert "orientation" not in CliRunner().invoke(app, ["profile", "--help"]).output


def test_a_class_for_ray_gives_a_row_an_object() -> None:
    pytest.importorskip("pyarrow")
    batch = {"id": np.array(["a"]), "mask": MASK[None]}
    table = ScoreMasks("mask", name="id", per="object")(batch)
    assert table["path"].to_pylist() == ["a@1", "a@2", "a@3"]
    assert table["pixels"].to_pylist() == SIZES
