"""Masks on Ray: the rows of the local run, whoever is killed; and batches of masks for pipelines."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow
import pytest
from test_shards import files, png, tar, untimed
from typer.testing import CliRunner

import torchlinf
from torchlinf.cli import app
from torchlinf.scoring import COLUMNS, Score, find_masks, read_table, score_mask, score_masks, score_measure
from torchlinf.scoring.ray import Part, ScoreMasks, connected, find_shards, score_shards
from torchlinf.scoring.score import blank_row

# Ray's own settings trip over each other as soon as they are made.
pytestmark = pytest.mark.filterwarnings("ignore:`use_:DeprecationWarning:ray.data.context")
posix = pytest.mark.skipif(os.name != "posix", reason="kills as POSIX does")

# Python runs a module of this name at its start: processes of this Ray die of a file called killer.png.
DEADLY = """
import os, signal, sys
def audit(event, arguments):
    if event == "open" and str(arguments[0]).endswith("killer.png"):
        os.kill(os.getpid(), signal.SIGKILL)
sys.addaudithook(audit)
"""


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A Ray of two workers."""
    folder = tmp_path_factory.mktemp("deadly")
    (folder / "sitecustomize.py").write_text(DEADLY)
    with pytest.MonkeyPatch.context() as patch:
        root = str(Path(torchlinf.__file__).parents[1])
        patch.setenv("PYTHONPATH", os.pathsep.join([str(folder), root]))
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        with connected("local", workers=2):
            yield


def kill_worker(marker: Path) -> None:
    """Kill who works on a shard as soon as somebody does."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        if marker.exists() and (text := marker.read_text()).endswith("\n"):
            os.kill(int(text.split()[-1]), signal.SIGKILL)
            return
        time.sleep(0.002)


@posix
@pytest.mark.slow
def test_lost_workers_cost_nothing_but_the_mask_that_kills_them(cluster: None, tmp_path: Path) -> None:
    paths = [tar(tmp_path / "a.tar", 120), tar(tmp_path / "b.tar", 20, seed=500), files(tmp_path / "single", 6)]
    (tmp_path / "single" / "killer.png").write_bytes(png(0))
    (tmp_path / "broken.tar").write_bytes(b"no archive")
    paths.append(tmp_path / "broken.tar")
    out = tmp_path / "out"
    shards = find_shards(paths, files=10)
    victim = next(shard.part for shard in shards if shard.files[0].path.name == "a.tar")
    killer = threading.Thread(target=kill_worker, args=[out / f".{victim}.begun"])
    killer.start()
    parts = list(score_shards(shards, out))
    killer.join()

    expected = [row for row in score_masks(find_masks(paths)) if "killer" not in row.path]
    deadly = blank_row(
        str(tmp_path / "single" / "killer.png"),
        score_measure({}),
        "the process that scored it was killed or crashed; it may need more memory",
    )
    assert untimed(read_table(out)) == untimed(iter([*expected, deadly]))
    assert (sum(part.masks for part in parts), sum(part.failed for part in parts)) == (148, 2)
    assert sorted(os.listdir(out)) == sorted(["_settings.json", *(part.name for part in parts)])

    # Again: nothing to do. And one part lost: that one alone is done.
    assert all(part.seconds == 0 for part in score_shards(shards, out))
    (out / victim).unlink()
    again = list(score_shards(shards, out))
    assert [part.name for part in again if part.seconds > 0] == [victim]
    assert untimed(read_table(out)) == untimed(iter([*expected, deadly]))


@posix
@pytest.mark.skipif(not Path("/proc").exists(), reason="looks for processes in /proc")
@pytest.mark.slow
def test_a_killed_driver_is_started_again(cluster: None, tmp_path: Path) -> None:
    data = tmp_path / "data"
    data.mkdir()
    for number in range(12):
        tar(data / f"{number:02}.tar", 60, seed=100 * number)
    out = tmp_path / "out"
    command = [sys.executable, "-m", "torchlinf", "score", data, "--out", out, "--ray", "local", "--workers", "1"]
    driver = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not list(out.glob("*.parquet")) and time.monotonic() < deadline and driver.poll() is None:
        time.sleep(0.01)
    started = descendants(driver.pid)
    driver.kill()
    driver.wait()
    # Ray's processes see that they are alone: its agents after a minute, which is not waited for, the others at once.
    while any(running(pid) for pid in started if "Agent" not in started[pid]) and time.monotonic() < deadline:
        time.sleep(0.1)
    left = [pid for pid in started if running(pid)]
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert any("raylet" in name for name in started.values())
    assert any("ray::" in name and "Agent" not in name for name in started.values())
    assert all("Agent" in started[pid] for pid in left)
    there = {path.name: path.stat().st_mtime_ns for path in out.glob("*.parquet")}
    assert 1 <= len(there) < 12

    done = {part.name: part.seconds for part in score_shards(find_shards([data]), out)}
    assert {name for name, seconds in done.items() if seconds == 0} == set(there)
    assert all((out / name).stat().st_mtime_ns == mtime for name, mtime in there.items())
    assert untimed(read_table(out)) == untimed(score_masks(find_masks([data])))


def title(pid: int) -> str:
    """What a process calls itself; nothing if it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode()
    except OSError:
        return ""


def running(pid: int) -> bool:
    """Whether there is such a process, other than one that has ended and that nobody has asked for."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def descendants(pid: int) -> dict[int, str]:
    """The processes below one, with their titles."""
    parents = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
    found = {pid}
    while new := {child for child, parent in parents.items() if parent in found} - found:
        found |= new
    return {child: title(child) for child in found - {pid}}


def test_a_part_that_cannot_be_written_ends_the_job(cluster: None, tmp_path: Path) -> None:
    (shard,) = find_shards([tar(tmp_path / "a.tar", 2)])
    (tmp_path / "out" / shard.part / "in the way").mkdir(parents=True)
    with pytest.raises(IsADirectoryError):
        list(score_shards([shard], tmp_path / "out"))


@pytest.mark.parametrize("batch_format", ["numpy", "pyarrow"])
def test_batches_of_a_pipeline(cluster: None, tmp_path: Path, batch_format: str) -> None:
    import ray.data

    folder = files(tmp_path / "single", 5)
    (folder / "broken.png").write_bytes(png(0)[:40])
    expected = untimed(score_masks(find_masks([folder])))
    data = ray.data.read_binary_files(str(folder), include_paths=True)
    found = data.map_batches(ScoreMasks("bytes"), batch_format=batch_format, batch_size=4).take_all()
    assert untimed(map(Score.of, found)) == expected


# --- batches, without Ray -------------------------------------------------------------------------------------------


def test_masks_as_bytes_paths_and_arrays_have_the_numbers_of_files(tmp_path: Path) -> None:
    folder = files(tmp_path / "single", 3)
    np.save(folder / "array.npy", np.random.default_rng(0).random((9, 14)) > 0.2)
    np.savez(folder / "array.npz", np.tri(5, 7))
    (folder / "empty.png").write_bytes(b"")
    paths = sorted(map(str, folder.iterdir()))
    expected = untimed(score_masks(find_masks([folder])))
    content = np.array([Path(path).read_bytes() for path in paths], dtype=object)
    as_numpy = {"path": np.array(paths), "bytes": content}
    for batch in (as_numpy, pyarrow.table({name: list(column) for name, column in as_numpy.items()})):
        for column in ("bytes", "path"):
            table = ScoreMasks(column)(batch)
            assert tuple(table.column_names) == COLUMNS
            assert untimed(map(Score.of, table.to_pylist())) == expected
    masks = np.random.default_rng(1).random((3, 12, 17)) > 0.2
    for number, mask in enumerate(masks):
        np.save(folder / f"m{number}.npy", mask)
    rows = ScoreMasks("mask", name="id")({"id": np.arange(3), "mask": masks[:, None]}).to_pylist()
    same = ScoreMasks("path")({"path": np.array([str(folder / f"m{number}.npy") for number in range(3)])}).to_pylist()
    assert [row["path"] for row in rows] == ["0", "1", "2"]
    for row, other in zip(rows, same, strict=True):
        assert row["error"] is None
        assert row | {"path": "", "seconds": 0} == other | {"path": "", "seconds": 0}


def test_batches_take_the_options_of_the_measure() -> None:
    batch = {"path": np.array(["a"]), "mask": np.tri(9, 13)[None]}
    row = ScoreMasks("mask", windows={"fine": (0, 0.25)}, bins=64)(batch).to_pylist()[0]
    assert row["fine"] == score_mask(np.tri(9, 13) > 0, high=0.25, bins=64)["complexity"]
    assert "complexity" not in row
    with pytest.raises(ValueError, match="bins must be an integer"):
        ScoreMasks("mask", bins=0)


def test_settings_of_batches() -> None:
    grey = np.array([[0, 3, 5, 0], [0, 5, 5, 0]])
    batch = {"path": np.array(["https://a//b"]), "mask": grey[None]}
    (row,) = ScoreMasks("mask", threshold=4)(batch).to_pylist()
    assert (row["path"], row["pixels"]) == ("https://a//b", 3)
    assert ScoreMasks("mask", threshold=4, invert=True)(batch)["pixels"].to_pylist() == [5]
    assert "more than the limit of 7" in ScoreMasks("mask", max_pixels=7)(batch)["error"][0].as_py()
    volume = {"path": np.array(["v"]), "mask": np.ones((1, 4, 6, 5))}
    assert ScoreMasks("mask", spatial_ndim=3)(volume)["depth"].to_pylist() == [4]


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.ones((8, 9, 3)), r"must be \(H, W\) and hold pixels; got \(8, 9, 3\).*spatial_ndim=3"),
        (np.ones((0, 9)), r"got \(0, 9\)"),
        (np.array([["a"]]), "must be bool, integer or floating point"),
        (None, "must be bool, integer or floating point; got object"),
        (np.full((3, 4), np.nan), "no foreground"),  # NaN is no data, and outside
        (np.zeros((3, 4)), "no foreground"),
        (b"", "empty"),
        (b"\x93NUMPY", "truncated or damaged"),
        (b"GIF89a", "not an image|truncated or damaged"),
        ("/no/such.png", "no such file"),
    ],
)
def test_what_is_no_mask_is_a_row(value: object, words: str) -> None:
    column = np.empty(1, dtype=object)
    column[0] = value
    (row,) = ScoreMasks("mask")({"path": np.array(["x"]), "mask": column}).to_pylist()
    assert row["path"] == "x"
    assert row["complexity"] is None
    assert re.search(words, row["error"])


def test_wrong_arguments() -> None:
    with pytest.raises(ValueError, match="spatial_ndim must be 2 or 3; got 1"):
        ScoreMasks("mask", spatial_ndim=1)
    for batch in ({"mask": np.ones((1, 2, 2))}, pyarrow.table({"mask": [b""]})):
        with pytest.raises(KeyError, match="must hold the column 'path'; got mask"):
            ScoreMasks("mask")(batch)


# --- errors before anything starts ----------------------------------------------------------------------------------


def test_without_ray_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ImportError, match=r"needs ray.*pip install 'torchlinf\[ray\]'"), connected("local"):
        pass
    with pytest.raises(ImportError, match="needs ray"):
        next(score_shards([], tmp_path / "out"))
    command = ["score", str(tar(tmp_path / "a.tar", 1)), "--out", str(tmp_path / "out"), "--ray", "local"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 2
    assert "pip install 'torchlinf[ray]'" in result.stderr


def test_the_command_on_ray_wants_a_folder_masks_and_a_cluster(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    run = CliRunner().invoke
    for out in ([], ["--out", "scores.csv"], ["--out", __file__]):
        result = run(app, ["score", str(tmp_path), "--ray", "local", *out])
        assert (result.exit_code, "writes a folder of Parquet files" in result.stderr) == (2, True)
    result = run(app, ["score", str(tmp_path), "--out", str(tmp_path / "out"), "--ray", "local"])
    assert (result.exit_code, "no masks found" in result.stderr) == (2, True)

    for option in ("--json", "--overwrite", "--retry"):
        result = run(app, ["score", str(tmp_path), "--out", str(tmp_path / "out"), "--ray", "local", option])
        assert (result.exit_code, "it always goes on in its folder" in result.stderr) == (2, True)

    def unreachable(*_: object, **__: object) -> None:
        raise ConnectionError("nobody answers")

    monkeypatch.setattr("ray.init", unreachable)
    tar(tmp_path / "a.tar", 1)
    result = run(app, ["score", str(tmp_path), "--out", str(tmp_path / "out"), "--ray", "auto"])
    assert result.exit_code == 2
    assert "Ray cannot be reached at auto (nobody answers)." in result.stderr


def test_the_command_on_ray_says_what_was_there_and_that_it_was_stopped(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    command = ["score", str(tar(tmp_path / "a.tar", 1)), "--out", str(tmp_path / "out"), "--ray", "local"]
    monkeypatch.setattr("torchlinf.cli.score_on_ray.connected", lambda *_, **__: contextlib.nullcontext())

    def two_parts(*_: object, **__: object) -> Iterator[Part]:
        yield Part("a.parquet", masks=1, failed=0)
        yield Part("b.parquet", masks=1, failed=0, seconds=0.5)

    monkeypatch.setattr("torchlinf.cli.score_on_ray.score_shards", two_parts)
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0
    assert "1 of 2 parts were in" in result.stderr

    def stopped(*_: object, **__: object) -> Iterator[Part]:
        raise KeyboardInterrupt

    monkeypatch.setattr("torchlinf.cli.score_on_ray.score_shards", stopped)
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 130
    assert "Stopped; the same command goes on" in result.stderr
