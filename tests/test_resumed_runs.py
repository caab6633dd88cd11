"""`torchlinf score` called again on the table of an earlier run: stopped, killed, or out of space."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from tests.mask_files import noise
from torchlinf import Measure, scoring
from torchlinf.cli import app
from torchlinf.scoring import JOURNAL, WINDOWS, Score, open_table, read_table

run = CliRunner(env={"TERM": "dumb", "COLUMNS": "200"}).invoke


def save(path: Path, mask: np.ndarray) -> None:
    Image.fromarray(np.where(mask, 255, 0).astype(np.uint8)).save(path)


@pytest.fixture
def masks(tmp_path: Path) -> Path:
    """A folder of three masks and one broken file."""
    folder = tmp_path / "masks"
    folder.mkdir()
    for i in range(3):
        save(folder / f"{i}.png", noise(i, 9, 14))
    (folder / "bad.png").write_bytes(b"no image")
    return folder


def paths(table: Path) -> list[str]:
    return [Path(row.path).name for row in read_table(table)]


@pytest.mark.parametrize("name", ["scores.csv", "scores.jsonl", "scores.parquet"])
def test_what_is_in_the_table_is_not_scored_again(name: str, masks: Path, tmp_path: Path) -> None:
    table = tmp_path / name
    command = ["score", str(masks), "--out", str(table)]
    values = dict.fromkeys(WINDOWS, -1.0)  # no mask has this complexity
    before = Score(str(masks / "1.png"), values=values, measure=Measure(windows=WINDOWS).settings())
    with open_table(table) as put:
        put(before)
    result = run(app, command)
    assert result.exit_code == 1
    assert "1 of 4 masks are in" in result.stderr
    assert "1 of 4 masks failed; the column 'error' says why. --retry" in result.stderr
    assert paths(table) == ["1.png", "0.png", "2.png", "bad.png"]
    assert next(read_table(table)) == before
    again = run(app, command)  # complete: the same status, and nothing done
    assert again.exit_code == 1
    assert "4 of 4 masks are in" in again.stderr
    assert paths(table) == ["1.png", "0.png", "2.png", "bad.png"]
    save(masks / "bad.png", noise(3, 9, 14))
    assert run(app, command).exit_code == 1
    assert run(app, [*command, "--retry"]).exit_code == 0
    assert [row.error for row in read_table(table)] == [None] * 4
    assert next(read_table(table)) == before
    assert run(app, [*command, "--overwrite"]).exit_code == 0
    assert paths(table) == ["0.png", "1.png", "2.png", "bad.png"]
    assert all(row["complexity"] > 0 for row in read_table(table))


def test_a_table_of_other_settings_is_not_continued(masks: Path, tmp_path: Path) -> None:
    table = tmp_path / "scores.csv"
    command = ["score", str(masks), "--out", str(table)]
    assert run(app, [*command, "--window", "fine=0-0.25"]).exit_code == 1
    before = table.read_bytes()
    result = run(app, command)
    assert result.exit_code == 2
    assert "scores.csv cannot be continued: its rows were measured with other options" in result.stderr
    assert "--overwrite" in result.stderr
    assert table.read_bytes() == before
    assert run(app, [*command, "--window", "fine=0-0.25"]).exit_code == 1
    assert table.read_bytes() == before
    assert run(app, [*command, "--overwrite"]).exit_code == 1
    assert table.read_bytes() != before


@pytest.mark.parametrize("name", ["notes.csv", "notes.jsonl", "notes.parquet"])
def test_what_is_no_table_is_not_touched(name: str, masks: Path, tmp_path: Path) -> None:
    (tmp_path / name).write_text("what was there before\n")
    result = run(app, ["score", str(masks), "--out", str(tmp_path / name)])
    assert result.exit_code == 2
    assert f"{tmp_path / name} cannot be continued: it" in result.stderr
    assert "--overwrite" in result.stderr
    assert (tmp_path / name).read_text() == "what was there before\n"
    assert sorted(os.listdir(tmp_path)) == ["masks", name]
    assert run(app, ["score", str(masks), "--out", str(tmp_path / name), "--overwrite"]).exit_code == 1
    assert len(paths(tmp_path / name)) == 4


def test_two_runs_on_one_table(masks: Path, tmp_path: Path) -> None:
    with open_table(tmp_path / "scores.csv"):
        result = run(app, ["score", str(masks), "--out", str(tmp_path / "scores.csv")])
    assert result.exit_code == 2
    assert "another run is writing it" in result.stderr


@pytest.mark.parametrize("extra", ["parquet", "coco"])
def test_without_an_extra_it_says_what_to_install(
    extra: str, masks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, {"parquet": "pyarrow.parquet", "coco": "pycocotools.mask"}[extra], None)
    (masks / "coco.json").write_text(json.dumps({"images": [], "annotations": []}))
    path = masks / "coco.json" if extra == "coco" else masks
    result = run(app, ["score", str(path), "--out", str(tmp_path / "scores.parquet")])
    assert result.exit_code == 2
    assert f"pip install 'torchlinf[{extra}]'" in result.stderr
    assert os.listdir(tmp_path) == ["masks"]
    if extra == "coco":
        result = run(app, ["profile", str(path), "--plot", str(tmp_path / "picture.png")])
        assert result.exit_code == 2
        assert "pip install 'torchlinf[coco]'" in result.stderr


def test_a_mask_that_is_reached_twice_is_scored_once(masks: Path) -> None:
    result = run(app, ["score", str(masks), str(masks / "*.png"), str(masks / "0.png"), "--json"])
    assert [Path(json.loads(line)["path"]).name for line in result.stdout.splitlines()] == [
        "0.png", "1.png", "2.png", "bad.png"
    ]  # fmt: skip


def test_an_annotation_whose_id_is_no_text(tmp_path: Path) -> None:
    """JSON may hold half of a pair of surrogates, which no file can."""
    annotation = {"id": "\ud800", "image_id": 1, "segmentation": {"size": [2, 3], "counts": [2, 3, 1]}}
    content = {"images": [{"id": 1, "height": 2, "width": 3}], "annotations": [annotation]}
    content["annotations"].append({"id": "\udfff", "image_id": "\ud800"})
    (tmp_path / "a.json").write_text(json.dumps(content))
    result = run(app, ["score", str(tmp_path / "a.json"), "--out", str(tmp_path / "scores.csv")])
    assert result.exit_code == 1
    good, bad = read_table(tmp_path / "scores.csv")
    assert (good.path, good.pixels) == (f"{tmp_path}/a.json:\\ud800", 3)
    assert (bad.image, bad.error) == ("\\ud800", "the annotation has no segmentation")


# Killed runs.

needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes as Linux lists them")


@pytest.fixture
def many(tmp_path: Path) -> Path:
    """A folder of masks that take some seconds."""
    folder = tmp_path / "many"
    folder.mkdir()
    for i in range(160):
        save(folder / f"{i:03}.png", noise(i, 40, 50))
    return folder


def children(process: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def wait_for(condition: Callable[[], object], seconds: float = 60) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def lines(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.exists() else 0


@needs_linux
@pytest.mark.parametrize(("name", "workers"), [("scores.csv", 2), ("scores.parquet", 1)])
@pytest.mark.slow
def test_killed_again_and_again_the_table_is_complete(name: str, workers: int, many: Path, tmp_path: Path) -> None:
    table, growing = tmp_path / name, tmp_path / (name + JOURNAL)
    command = [sys.executable, "-m", "torchlinf", "score", str(many), "--out", str(table), "--workers", str(workers)]
    for count in (1, 40):
        with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
            wait_for(lambda count=count: lines(growing) >= count)
            workers_left = children(process.pid)
            if count > 1:  # the first kill may come before the workers
                assert len(workers_left) >= workers if workers > 1 else not workers_left
            process.send_signal(signal.SIGKILL)
            assert process.wait(timeout=60) == -signal.SIGKILL
        wait_for(lambda left=workers_left: not any(os.path.exists(f"/proc/{pid}") for pid in left))
        assert not table.exists()
        found = [row.path for row in read_table(growing)]
        assert count - 1 <= len(set(found)) == len(found) < 160
    assert subprocess.run(command, check=True, capture_output=True, timeout=100).stdout == b""
    found = {row.path: replace(row, seconds=None) for row in read_table(table)}
    assert len(list(read_table(table))) == len(found) == 160
    masks = scoring.find_masks([many])[::10]
    assert [replace(row, seconds=None) for row in scoring.score_masks(masks)] == [found[mask.name] for mask in masks]
    assert sorted(os.listdir(tmp_path)) == ["many", name]


@needs_linux
@pytest.mark.slow
def test_a_killed_worker_costs_nothing(many: Path, tmp_path: Path) -> None:
    table = tmp_path / "scores.csv"
    command = [sys.executable, "-m", "torchlinf", "score", str(many), "--out", str(table), "--workers", "2"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        wait_for(lambda: lines(tmp_path / f"scores.csv{JOURNAL}") > 10)
        spawned = [pid for pid in children(process.pid) if "spawn_main" in Path(f"/proc/{pid}/cmdline").read_text()]
        os.kill(spawned[0], signal.SIGKILL)
        assert process.wait(timeout=100) == 0
        assert process.stderr.read() == ""
    assert paths(table) == [f"{i:03}.png" for i in range(160)]


# Disks that are full.


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[tuple[Path, Callable[[int], None]]]:
    """A folder on a disk of 64 KiB, and what makes it larger."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "torchlinf-test", str(disk)]
    try:
        subprocess.run(mount, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no disk can be mounted")
    try:
        yield disk, lambda size: subprocess.run(["mount", "-o", f"remount,size={size}k", str(disk)], check=True)
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)  # a writer that failed may have a file open


@pytest.mark.parametrize(
    ("name", "free", "masks"),
    # KiB; the last two: full at the end only
    [("scores.csv", 20, 75), ("scores.csv", 52, 80), ("scores.parquet", 52, 82)],
)
def test_a_full_disk(
    name: str,
    free: int,
    masks: int,
    small_disk: tuple[Path, Callable[[int], None]],
    many: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    disk, enlarge = small_disk
    row = Score("", values=dict.fromkeys(WINDOWS, 0.5), measure=Measure(windows=WINDOWS).settings())
    monkeypatch.setattr("torchlinf.scoring.score._numbers", lambda inside, *_: [replace(row, pixels=int(inside.sum()))])
    for path in list(many.iterdir())[masks:]:
        path.unlink()
    (disk / "ballast").write_bytes(bytes(1024 * (64 - free)))
    command = ["score", str(many), "--out", str(disk / name), "--workers", "1"]
    for _ in range(2):
        result = run(app, command)
        assert result.exit_code == 2
        assert "cannot be written (" in result.stderr
        assert "No space left on device" in result.stderr
        assert "the same command goes on" in result.stderr
    journal = disk / (name + JOURNAL)
    count = len(paths(journal))
    assert count == masks if free == 52 else 10 < count < masks
    assert sorted(os.listdir(disk)) == ["ballast", journal.name]
    enlarge(256)
    result = run(app, command)
    assert result.exit_code == 0
    assert f"{count} of {masks} masks are in" in result.stderr
    assert sorted(paths(disk / name)) == sorted(path.name for path in many.iterdir())
    assert sorted(os.listdir(disk)) == ["ballast", name]
