"""The command `torchlinf order`: its table, its picture, its exit status, and what counts as equal."""

import csv
import io
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor
from typer.testing import CliRunner

import torchlinf
from torchlinf import ComplexityProfile, complexity, complexity_profile, shapes
from torchlinf.cli import app
from torchlinf.scoring import score

run = CliRunner(env={"TERM": "dumb", "COLUMNS": "200"}).invoke

NOTCH = shapes.Appendage("right", 8, 8)
MASKS = {
    "bow": shapes.superellipse(13, 0.6),
    "box": shapes.box(20, 50),
    "disc": shapes.disc(12),
    "one": shapes.with_appendages((32, 32), [NOTCH]),
    "square": shapes.square(32),
    "turned": shapes.disc(12).flip(0),
    "two": shapes.with_appendages((32, 32), [NOTCH, shapes.Appendage("top", 8, 8)]),
}


def save(path: Path, mask: Tensor) -> None:
    Image.fromarray(np.where(np.pad(mask.numpy(), 2), 255, 0).astype(np.uint8)).save(path)


@pytest.fixture
def masks(tmp_path: Path) -> Path:
    folder = tmp_path / "masks"
    folder.mkdir()
    for name, mask in MASKS.items():
        save(folder / f"{name}.png", mask)
    return folder


def table(text: str) -> dict[str, dict[str, str]]:
    """Rows by the stem of their path, with stems in the cells too."""
    rows = list(csv.DictReader(io.StringIO(text)))
    for row in rows:
        for key in ("equal", "above", "incomparable"):
            row[key] = " ".join(sorted(Path(name).stem for name in row[key].split("; ") if name))
    return {Path(row["path"]).stem: row for row in rows}


def test_the_table_is_the_order(masks: Path) -> None:
    result = run(app, ["order", str(masks)])
    assert (result.exit_code, result.stderr) == (0, "")
    rows = table(result.stdout)
    # Means over (0, 1/4] and (0, 1] of one, two and the disc, by the definition of the mean over levels.
    means = {}
    for name in MASKS:
        levels = complexity_profile(MASKS[name], spatial_ndim=2).level_values.numpy()
        scales = np.ceil((np.arange(40000) + 0.5) / 40000 * len(levels)).astype(int) - 1
        means[name] = levels[scales[:10000]].mean(), levels[scales].mean()
        found = float(rows[name]["complexity_low"]), float(rows[name]["complexity"])
        assert found == pytest.approx(means[name], abs=1e-3)
    below = [
        (a, b) for a in means for b in means if a != b and all(x < y for x, y in zip(means[a], means[b], strict=True))
    ]
    assert {("square", "one"), ("one", "two"), ("box", "disc")} <= set(below)
    assert rows["box"]["equal"] == "square"
    assert rows["disc"]["equal"] == "turned"
    assert rows["box"]["above"] == "one"
    assert rows["one"]["above"] == "two"
    assert rows["two"]["above"] == "bow disc turned"
    # The bow is far more complex at small scales, and less by a hair over all.
    assert rows["disc"]["incomparable"] == "bow"
    assert [row["rank"] for row in rows.values()] == sorted(row["rank"] for row in rows.values())
    assert (rows["square"]["rank"], rows["one"]["rank"], rows["two"]["rank"]) == ("0", "1", "2")


def test_windows_are_chosen(masks: Path) -> None:
    rows = table(run(app, ["order", str(masks), "--window", "coarse=0.25-1"]).stdout)
    assert "coarse" in rows["one"]
    # Above a quarter of the radius nothing of the appendages is left.
    assert rows["one"]["equal"] == "box square two"
    assert (rows["one"]["above"], rows["bow"]["above"]) == ("bow", "disc turned")
    rows = table(run(app, ["order", str(masks), "--every-scale"]).stdout)
    assert rows["one"]["above"] == "two"
    assert rows["bow"]["incomparable"] == "disc turned"
    assert "complexity" in rows["one"]


def test_json_holds_lists(masks: Path) -> None:
    result = run(app, ["order", str(masks), "--json"])
    rows = {Path(row["path"]).stem: row for row in map(json.loads, result.stdout.splitlines())}
    assert list(rows["box"]) == [
        "path", "rank", "complexity_low", "complexity", "equal", "above", "incomparable", "radius",
        "error_bound", "field_error_bound", "seconds", "version", "measure",
    ]  # fmt: skip
    assert rows["box"]["version"] == torchlinf.__version__
    assert json.loads(rows["box"]["measure"])["windows"] == {"complexity_low": [0, 0.25], "complexity": [0, 1]}
    assert (rows["box"]["radius"], rows["box"]["seconds"] > 0) == (10, True)
    assert rows["box"]["equal"] == [str(masks / "square.png")]
    assert rows["two"]["rank"] == 2


def test_what_fails_is_named_and_the_rest_go_on(masks: Path, tmp_path: Path) -> None:
    (masks / "empty.png").write_bytes(b"")
    Image.new("L", (8, 5)).save(masks / "black.png")
    picture = tmp_path / "order.png"
    result = run(app, ["order", str(masks), str(tmp_path / "gone.png"), "--plot", str(picture)])
    assert result.exit_code == 1
    assert sorted(table(result.stdout)) == sorted(MASKS)
    assert "black.png: no foreground" in result.stderr
    assert "empty.png" in result.stderr
    assert "gone.png: no such file" in result.stderr
    assert result.stderr.count("\n") == 3
    assert picture.exists()
    alone = run(app, ["order", str(masks / "empty.png"), "--plot", str(tmp_path / "none.png")])
    assert (alone.exit_code, alone.stdout) == (1, "")
    assert not (tmp_path / "none.png").exists()


def test_a_field_that_cannot_be_solved_stops_nothing(masks: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = score.ragged_profile

    def stubborn(mask_at, count, measure):  # type: ignore[no-untyped-def]
        if mask_at(0).sum() == 1000:
            raise RuntimeError("did not converge")
        return real(mask_at, count, measure)

    monkeypatch.setattr(score, "ragged_profile", stubborn)
    result = run(app, ["order", str(masks)])
    assert result.exit_code == 1
    assert "box.png: RuntimeError: did not converge" in result.stderr
    assert sorted(table(result.stdout)) == sorted(set(MASKS) - {"box"})


@pytest.mark.parametrize(("error", "equal"), [(1e-9, "turned"), (1e-11, "")])
def test_values_whose_intervals_meet_count_as_equal(
    error: float, equal: str, masks: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every profile is moved by another multiple of 1e-10, which is within the first error and beyond the second."""
    real, moved = score.ragged_profile, []

    def shaken(mask_at, count, measure) -> ComplexityProfile:  # type: ignore[no-untyped-def]
        profile = real(mask_at, count, measure)
        moved.append(len(moved) * 1e-10)
        values = profile.level_values + moved[-1]
        return replace(
            profile, level_values=values, level_error_bound=torch.full_like(profile.level_error_bound, error)
        )

    monkeypatch.setattr(score, "ragged_profile", shaken)
    rows = table(run(app, ["order", str(masks)]).stdout)
    assert len(set(moved)) == len(MASKS)
    assert rows["disc"]["equal"] == equal
    assert rows["box"]["equal"] == ("square" if equal else "")


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_plot_writes_a_picture(suffix: str, masks: Path, tmp_path: Path) -> None:
    picture = tmp_path / f"order.{suffix}"
    result = run(app, ["order", str(masks), "--plot", str(picture)])
    assert (result.exit_code, result.stderr) == (0, "")
    assert picture.stat().st_size > 5000
    if suffix == "svg":
        drawn = picture.read_text()
        assert all(f"<!-- {name}" in drawn for name in MASKS)
        assert "masks/" not in drawn  # short names


def test_names_that_would_be_equal_are_told_apart(masks: Path, tmp_path: Path) -> None:
    save(tmp_path / "disc.png", MASKS["disc"])
    picture = tmp_path / "order.svg"
    result = run(app, ["order", str(masks), str(tmp_path / "disc.png"), str(masks / "disc.png"), "-p", str(picture)])
    assert result.exit_code == 0
    rows = list(csv.DictReader(io.StringIO(result.stdout)))
    assert len(rows) == len(MASKS) + 1  # what is named twice is there once
    (row,) = [row for row in rows if row["path"] == str(tmp_path / "disc.png")]
    assert row["equal"] == f"{masks / 'disc.png'}; {masks / 'turned.png'}"
    assert picture.read_text().count("disc") >= 2


def test_threshold_invert_and_max_pixels(tmp_path: Path) -> None:
    disc = np.pad(MASKS["disc"].numpy(), 1)  # 27 x 27 with the frame
    Image.fromarray(np.where(disc, 200, 60).astype(np.uint8)).save(tmp_path / "grey.png")

    def measured(*options: str) -> float:
        result = run(app, ["order", str(tmp_path / "grey.png"), *options])
        return float(table(result.stdout)["grey"]["complexity"])

    expected = [float(complexity(torch.from_numpy(mask), spatial_ndim=2)) for mask in (disc, ~disc)]
    assert len({0.0, *expected}) == 3
    assert measured("-t", "150") == pytest.approx(expected[0])
    assert measured("-t", "150", "-i") == pytest.approx(expected[1])
    assert measured("-t", "10") == 0.0  # all of the array
    assert measured("--max-pixels", "729") == pytest.approx(expected[0])
    assert run(app, ["order", str(tmp_path / "grey.png"), "--max-pixels", "728"]).exit_code == 1


def test_wrong_usage(masks: Path, tmp_path: Path) -> None:
    (tmp_path / "nothing").mkdir()
    many = tmp_path / "many"
    many.mkdir()
    for i in range(41):
        (many / f"{i}.png").symlink_to(masks / "box.png")
    wrong = {
        "Missing argument": ["order"],
        "no masks found": ["order", str(tmp_path / "nothing")],
        "no suffix of a picture": ["order", str(masks), "--plot", str(tmp_path / "out.txt")],
        "does not exist": ["order", str(masks), "--plot", str(tmp_path / "no" / "out.png")],
        "is one of the masks": ["order", str(masks), "--plot", str(masks / "box.png")],
        "one picture holds 40": ["order", str(many), "--plot", str(tmp_path / "out.png")],
    }
    for words, command in wrong.items():
        result = run(app, command)
        assert (result.exit_code, result.stdout) == (2, ""), command
        assert words in result.stderr


def test_a_picture_that_cannot_be_written(masks: Path, tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("the system has no device that is always full")
    (tmp_path / "full.png").symlink_to("/dev/full")
    result = run(app, ["order", str(masks), "--plot", str(tmp_path / "full.png")])
    assert result.exit_code == 2
    assert "The picture cannot be written (No space left on device)" in result.stderr
    assert sorted(table(result.stdout)) == sorted(MASKS)


@pytest.mark.skipif(os.name != "posix", reason="closed pipes are reported as POSIX has them")
def test_a_reader_who_leaves_ends_the_run_in_silence(masks: Path) -> None:
    command = [sys.executable, "-m", "torchlinf", "order", str(masks)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        assert process.wait(timeout=60) == 141
        assert process.stderr.read() == ""


def test_without_matplotlib_only_the_picture_fails(
    masks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    result = run(app, ["order", str(masks), "--plot", str(tmp_path / "out.png")])
    assert result.exit_code == 2
    assert "pip install 'torchlinf[plot]'" in result.stderr
    assert run(app, ["order", str(masks)]).exit_code == 0
