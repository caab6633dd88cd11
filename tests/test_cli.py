"""The command: what it prints and writes, its exit status, and what is left when it is stopped."""

import csv
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tarfile
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from typer.testing import CliRunner

import torchlinf
from torchlinf import Measure, complexity
from torchlinf.cli import app, main
from torchlinf.scoring import COLUMNS, JOURNAL, WINDOWS, read_table

COMMANDS = ("score", "simplify", "compare", "profile", "order", "warm-up")

run = CliRunner(env={"TERM": "dumb", "COLUMNS": "200"}).invoke


def blob(seed: int, height: int, width: int) -> np.ndarray:
    """A smooth random shape in an image that is higher or wider."""
    generator = np.random.default_rng(seed)
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    angle = np.arctan2(y, x)
    reach = 0.6 + sum(0.06 * generator.standard_normal() * np.cos(k * angle + k) for k in range(1, 7))
    return np.hypot(x, y) < reach


@pytest.fixture
def masks(tmp_path: Path) -> Path:
    """A folder of three masks."""
    folder = tmp_path / "masks"
    folder.mkdir()
    for i, name in enumerate(["a.png", "b.png", "c.png"]):
        Image.fromarray(np.where(blob(i, 31, 44), 255, 0).astype(np.uint8)).save(folder / name)
    return folder


@pytest.fixture
def bad(masks: Path) -> Path:
    """The folder, with four files that hold no mask."""
    (masks / "empty.png").write_bytes(b"")
    (masks / "text.tif").write_bytes(b"no image")
    (masks / "truncated.png").write_bytes((masks / "a.png").read_bytes()[:90])
    Image.new("L", (8, 5)).save(masks / "black.png")
    return masks


def table(text: str) -> list[dict[str, str]]:
    rows = list(csv.DictReader(io.StringIO(text)))
    assert all(tuple(row) == COLUMNS and None not in row.values() for row in rows)
    return rows


def test_version_and_help() -> None:
    assert run(app, ["--version"]).output == f"torchlinf {torchlinf.__version__}\n"
    for command in ([], ["score"], ["profile"]):
        result = run(app, [*command, "--help"])
        assert result.exit_code == 0
        assert "Usage" in result.output
    for words in ("--threshold", "--workers", "label map", "--labels", "complexity_low", "Exit status"):
        assert words in run(app, ["score", "--help"]).output


def test_python_m_is_the_command() -> None:
    called = subprocess.run(
        [sys.executable, "-m", "torchlinf", "--version"], capture_output=True, text=True, check=True
    )
    assert called.stdout == f"torchlinf {torchlinf.__version__}\n"
    assert called.stderr == ""


@pytest.mark.parametrize("command", [["--version"], ["--help"], *([name, "--help"] for name in COMMANDS)])
def test_help_and_version_load_no_torch(command: list[str]) -> None:
    script = f"""
import sys
from torchlinf.cli import main
sys.argv = ["torchlinf", *{command}]
try:
    main()
finally:
    print("torch" in sys.modules, "numba" in sys.modules, file=sys.stderr)
"""
    called = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert called.stderr == "False False\n"
    assert called.stdout


@pytest.mark.parametrize("command", ["score", "profile", "order"])
def test_the_help_shows_the_defaults_of_the_measure(command: str) -> None:
    measure, shown = Measure(), " ".join(run(app, [command, "--help"]).output.replace("│", " ").split())
    for name in ("low", "high", "bins", "estimator", "tol"):
        value = getattr(measure, name)
        text = f"{value:g}" if isinstance(value, float) else str(value)
        assert re.search(rf"--{name} .*?\[default: \({text}\)\]", shown), name


def test_warm_up_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    called = []
    monkeypatch.setattr("torchlinf.warming.warm_up", lambda: called.append(1) or 1.5)
    result = run(app, ["warm-up"])
    assert (result.exit_code, called) == (0, [1])
    assert result.output.startswith("The kernels are compiled (")


def test_the_command_leaves_the_process_as_it_was(masks: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import logging
    import warnings

    import torch

    def state() -> list[object]:
        loggers = logging.getLogger("tifffile").disabled, logging.root.manager.disable
        handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
        return [list(warnings.filters), list(sys.warnoptions), loggers, handlers, torch.get_num_threads(), *os.environ]

    before = state()
    monkeypatch.setattr(sys, "argv", ["torchlinf", "score", str(masks), "--workers", "2", "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert state() == before


@pytest.mark.parametrize(
    ("options", "columns"),
    [
        (["--low", "0.1", "--high", "0.6"], {"complexity": (0.1, 0.6)}),
        (["--window", "fine=0-.25", "--window", "a b=2.5e-1-1"], {"fine": (0, 0.25), "a b": (0.25, 1)}),
        (["--bins", "64", "--rho", "3.5", "--tol", "1e-6", "--estimator", "std"], WINDOWS),
    ],
)
def test_score_takes_the_options_of_the_measure(
    options: list[str], columns: dict[str, tuple[float, float]], masks: Path
) -> None:
    result = run(app, ["score", str(masks / "a.png"), "--json", *options])
    assert (result.exit_code, result.stderr) == (0, "")
    (row,) = map(json.loads, result.stdout.splitlines())
    plain = {"bins": 64, "rho": 3.5, "tol": 1e-6, "estimator": "std"} if "--bins" in options else {}
    mask = torch.from_numpy(blob(0, 31, 44))
    assert list(row)[7:-23] == list(columns)
    for name, (low, high) in columns.items():
        assert row[name] == complexity(mask, spatial_ndim=2, low=low, high=high, **plain).item()
    assert row["version"] == torchlinf.__version__
    assert json.loads(row["measure"])["bins"] == plain.get("bins", 1024)


@pytest.mark.parametrize("command", ["score", "profile", "order"])
def test_wrong_options_of_the_measure(command: str, masks: Path, tmp_path: Path) -> None:
    wrong = {
        "bins must be an integer of 1 or more; got 0": ["--bins", "0"],
        "low and high must obey": ["--low", "0.5", "--high", "0.25"],
        "tol must be finite and above 0": ["--tol", "-1"],
        "rho must be finite and above 0": ["--rho", "0"],
        "a window must be NAME=LOW-HIGH; got 0-0.5": ["--window", "0-0.5"],
        "a window must be NAME=LOW-HIGH; got a=b-1": ["--window", "a=b-1"],
        "name of its own; got a twice": ["--window", "a=0-0.5", "--window", "a=0-1"],
        "names that no other column has; got 'path'": ["--window", "path=0-0.5"],
        "windows must stand instead of low and high": ["--window", "a=0-0.5", "--low", "0.5"],
        "estimator must be one of 'entropy', 'std'; got 'median'": ["--estimator", "median"],
    }
    plot = ["--plot", str(tmp_path / "out.png")] if command == "profile" else []
    for words, options in wrong.items():
        result = run(app, [command, str(masks), *plot, *options])
        assert (result.exit_code, result.stdout) == (2, ""), words
        assert words in " ".join(result.stderr.replace("│", " ").split()), result.stderr


def test_score_into_a_pipe_prints_csv_and_nothing_else(masks: Path) -> None:
    result = run(app, ["score", str(masks)])
    assert result.exit_code == 0
    assert result.stderr == ""
    rows = table(result.stdout)
    assert [Path(row["path"]).name for row in rows] == ["a.png", "b.png", "c.png"]
    assert [row["pixels"] for row in rows] == [str(blob(i, 31, 44).sum()) for i in range(3)]
    assert all(
        float(row["complexity"]) > 0 and float(row["field_error_bound"]) <= 1e-9 and row["error"] == "" for row in rows
    )


def test_score_into_a_file_says_the_same(masks: Path, tmp_path: Path) -> None:
    result = run(app, ["score", str(masks), "--out", str(tmp_path / "scores.csv"), "--workers", "2"])
    assert (result.exit_code, result.stdout) == (0, "")
    written, printed = table((tmp_path / "scores.csv").read_text()), table(run(app, ["score", str(masks)]).stdout)
    for row in (*written, *printed):
        row["seconds"] = ""
    assert written == printed


def test_json(masks: Path, tmp_path: Path) -> None:
    result = run(app, ["score", str(masks), str(tmp_path / "gone.png"), "--json"])
    rows = [json.loads(line) for line in result.stdout.splitlines()]
    assert result.exit_code == 1
    assert [tuple(row) for row in rows] == [COLUMNS] * 4
    assert rows[0]["height"] == 31
    assert rows[0]["depth"] is None
    assert rows[3]["error"] == "no such file"


def test_members_of_shards(masks: Path, tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "shard-0.tar", "w") as archive:
        for name, member in (("a.png", "1.mask.png"), ("b.png", "1.image.png"), ("c.png", "2.mask.png")):
            archive.add(masks / name, member)
    result = run(app, ["score", str(tmp_path / "*.tar"), "--members", "*.mask.png"])
    assert result.exit_code == 0
    assert [row["path"].rpartition(":")[2] for row in table(result.stdout)] == ["1.mask.png", "2.mask.png"]
    stderr = run(app, ["score", str(tmp_path / "*.tar"), "--members", "*.npy"]).stderr
    assert "no masks found" in stderr
    assert "members that match *.npy" in " ".join(stderr.replace("│", " ").split())


def test_what_fails_is_a_row_and_the_rest_go_on(bad: Path) -> None:
    result = run(app, ["score", str(bad)])
    assert result.exit_code == 1
    assert "4 of 7 masks failed" in result.stderr
    rows = {Path(row["path"]).name: row for row in table(result.stdout)}
    errors = {name: row["error"] for name, row in rows.items() if row["error"]}
    assert sorted(errors) == ["black.png", "empty.png", "text.tif", "truncated.png"]
    assert "no foreground" in errors["black.png"]
    assert "empty" in errors["empty.png"]
    assert "not a TIFF" in errors["text.tif"]
    assert "truncated" in errors["truncated.png"]
    assert all(row["complexity"] for name, row in rows.items() if name not in errors)


def test_threshold_invert_and_max_pixels(tmp_path: Path) -> None:
    ramp = np.arange(240, dtype=np.uint8).reshape(12, 20)
    Image.fromarray(ramp).save(tmp_path / "ramp.png")

    def pixels(*options: str) -> str:
        return table(run(app, ["score", str(tmp_path / "ramp.png"), *options]).stdout)[0]["pixels"]

    assert pixels() == "112"
    assert pixels("--threshold", "199") == "40"
    assert pixels("-t", "199", "-i") == "200"
    assert pixels("--max-pixels", "240") == "112"
    assert pixels("--max-pixels", "239") == ""


def test_wrong_usage(masks: Path, tmp_path: Path) -> None:
    (tmp_path / "nothing").mkdir()
    (masks / "d.txt").write_bytes((masks / "a.png").read_bytes())  # a mask by another name
    (tmp_path / "link").symlink_to(masks)
    many = [str(Path(shutil.copytree(masks, tmp_path / str(i)))) for i in range(5)]
    wrong = {
        "Missing argument": ["score"],
        "no masks found": ["score", str(tmp_path / "nothing")],
        "No such option": ["score", str(masks), "--frobnicate"],
        "workers": ["score", str(masks), "--workers", "0"],
        "has the name of a mask": ["score", str(masks), "--out", str(masks / "a.png")],
        "would hold CSV": ["score", str(masks), "--out", "scores.json"],
        "leave --json out": ["score", str(masks), "--out", "scores.parquet", "--json"],
        "pass one of them": ["score", str(masks), "--out", "scores.csv", "--retry", "--overwrite"],
        "need a table": ["score", str(masks), "--retry"],
        "one of the files to score": ["score", str(masks / "d.txt"), "--out", str(tmp_path / "link" / "d.txt")],
        "Missing option '--plot'": ["profile", str(masks)],
        "no suffix of a picture": ["profile", str(masks), "--plot", str(tmp_path / "out.txt")],
        "does not exist": ["profile", str(masks), "--plot", str(tmp_path / "no" / "out.png")],
        "the name of a file": ["score", str(masks), "--out", str(masks)],
        "is one of the masks": ["profile", str(masks), "--plot", str(masks / "a.png")],
        "one picture holds 12": ["profile", *many, "--plot", str(tmp_path / "out.png")],
    }
    for words, command in wrong.items():
        result = run(app, command)
        assert result.exit_code == 2, command
        assert words in result.stderr
    before = blob(0, 31, 44)
    np.testing.assert_array_equal(np.asarray(Image.open(masks / "a.png")) > 0, before)


def test_a_table_that_cannot_be_written(masks: Path) -> None:
    if not os.path.exists("/dev/full"):
        pytest.skip("the system has no device that is always full")
    result = run(app, ["score", str(masks), "--out", "/dev/full"])
    assert result.exit_code == 2
    assert "cannot be written" in result.stderr


def test_a_missing_folder_is_named_before_the_work(masks: Path) -> None:
    result = run(app, ["score", str(masks), "--out", "no/such/folder/scores.csv"])
    assert result.exit_code == 2
    assert "the folder no/such/folder does not exist; make it" in " ".join(result.stderr.replace("│", " ").split())


def start(*arguments: str, **options: object) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-m", "torchlinf", "score", *arguments], text=True, **options)


@pytest.fixture
def many(tmp_path: Path) -> Path:
    """A folder with more masks than are scored before the tests lose patience."""
    folder = tmp_path / "many"
    folder.mkdir()
    Image.fromarray(np.where(blob(0, 190, 260), 255, 0).astype(np.uint8)).save(folder / "0.png")
    for i in range(1, 3000):
        (folder / f"{i}.png").symlink_to(folder / "0.png")
    return folder


@pytest.mark.skipif(os.name != "posix", reason="signals are sent as POSIX has them")
@pytest.mark.parametrize(("stop", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)])
@pytest.mark.slow
def test_a_stopped_run_leaves_whole_rows(stop: signal.Signals, status: int, many: Path, tmp_path: Path) -> None:
    if stop == signal.SIGINT and signal.getsignal(stop) == signal.SIG_IGN:
        pytest.skip("the tests run in the background, where shells switch Ctrl-C off")
    out = tmp_path / f"scores.csv{JOURNAL}"
    command = [str(many), "--out", str(tmp_path / "scores.csv"), "--workers", "2"]
    with start(*command, stderr=subprocess.PIPE, start_new_session=True) as process:
        while process.poll() is None and not (out.exists() and out.read_text().count("\n") > 5):
            time.sleep(0.02)
        # Ctrl-C in a terminal goes to the workers too.
        os.killpg(process.pid, stop) if stop == signal.SIGINT else process.send_signal(stop)
        assert process.wait(timeout=60) == status
        assert process.stderr.read() == (
            "Stopped; the same command goes on where this one was.\n" if stop == signal.SIGINT else ""
        )
    assert os.listdir(tmp_path) == ["many", out.name] or os.listdir(tmp_path) == [out.name, "many"]
    rows = list(read_table(out))
    assert 5 <= len(rows) < 3000
    assert all(row.field_error_bound <= 1e-9 for row in rows)


@pytest.mark.skipif(os.name != "posix", reason="signals are sent as POSIX has them")
@pytest.mark.slow
def test_a_reader_who_leaves_ends_the_run_in_silence(many: Path) -> None:
    with start(str(many), stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout.readline() == ",".join(COLUMNS) + "\n"
        process.stdout.close()
        assert process.wait(timeout=60) == 141
        assert process.stderr.read() == ""


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_profile_writes_a_picture(suffix: str, masks: Path, tmp_path: Path) -> None:
    picture = tmp_path / f"profiles.{suffix}"
    result = run(app, ["profile", str(masks), "--plot", str(picture)])
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")
    assert picture.stat().st_size > 5000
    if suffix == "png":
        assert np.asarray(Image.open(picture).convert("L")).std() > 10  # it is not blank


def test_profile_draws_what_it_can(bad: Path, tmp_path: Path) -> None:
    result = run(app, ["profile", str(bad), "--plot", str(tmp_path / "out.png")])
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 4
    assert "black.png: no foreground" in result.stderr
    assert (tmp_path / "out.png").exists()
    alone = run(app, ["profile", str(bad / "empty.png"), "--plot", str(tmp_path / "none.png")])
    assert alone.exit_code == 1
    assert not (tmp_path / "none.png").exists()


def test_without_matplotlib_profile_says_what_to_install(
    masks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    result = run(app, ["profile", str(masks), "--plot", str(tmp_path / "out.png")])
    assert result.exit_code == 2
    assert "pip install 'torchlinf[plot]'" in result.stderr
    assert run(app, ["score", str(masks)]).exit_code == 0
