"""The command on a terminal, real but for its width: no name steers it, ends the command, or vanishes."""

import os
import re
import sys
import threading
import time
from io import BufferedWriter, FileIO, TextIOWrapper
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from torchlinf import Measure, complexity_profile, shapes, solve_field
from torchlinf._helpers import parallel
from torchlinf._helpers.terminal import printable
from torchlinf.cli import app, main
from torchlinf.cli.order_table import print_order
from torchlinf.cli.progress import progress
from torchlinf.order import dominance
from torchlinf.scoring import COLUMNS, WINDOWS, Score, print_table, read_table, write_table

pty = pytest.importorskip("pty", reason="terminals are those of POSIX")

STEERING = re.compile("[\x00-\x08\x0b-\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\ufffd]")
HOSTILE = {  # the bytes of a name, and how it is shown
    b"esc\x1b[2Japed.png": r"esc\x1b[2Japed",
    b"new\nline.png": r"new\nline",
    b"ring\x07.png": r"ring\x07",
    "one\x9b31m.png".encode(): r"one\x9b31m",
    b"bad\xff.png": r"bad\xff",
    "turn\u202egnp.png".encode(): r"turn\u202egnp",
    b"[bold]b[red].png": "[bold]b[red]",
    b"$\\frac$.png": "$\\frac$",
    b"_under.png": "_under",
    "grün.png".encode(): "grün",
}


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of masks, no two of the same shape."""
    folder = tmp_path_factory.mktemp("hostile") / "m"
    folder.mkdir()
    for i, name in enumerate(HOSTILE):
        mask = np.zeros((12, 17), dtype=np.uint8)
        mask[2:10, 3 : 6 + i] = 255
        mask[5, 4] = 0
        Image.fromarray(mask).save(folder / "plain.png")
        try:
            (folder / "plain.png").rename(os.path.join(os.fsencode(folder), name).decode("utf-8", "surrogateescape"))
        except OSError:
            pytest.skip("the file system takes no such names")
    return folder


def on_terminal(
    monkeypatch: pytest.MonkeyPatch, *arguments: str, width: int = 100, encoding: str = "utf-8"
) -> tuple[int, str, str]:
    """Call the command; its status, and what it wrote to a terminal as standard output and as standard error."""
    texts: dict[str, bytes] = {}
    readers, streams = [], []

    def read(name: str, end: int) -> None:
        parts = []
        while True:
            try:
                part = os.read(end, 65536)
            except OSError:  # how Linux says that the other end is closed
                part = b""
            if not part:
                break
            parts.append(part)
        texts[name] = b"".join(parts)

    with monkeypatch.context() as patch:
        patch.setenv("TERM", "dumb")
        patch.setenv("COLUMNS", str(width))
        patch.setattr(sys, "argv", ["torchlinf", *arguments])
        for name in ("stdout", "stderr"):
            screen, keyboard = pty.openpty()
            errors = "strict" if name == "stdout" else "backslashreplace"
            streams.append(TextIOWrapper(BufferedWriter(FileIO(keyboard, "w")), encoding=encoding, errors=errors))
            patch.setattr(sys, name, streams[-1])
            readers.append(threading.Thread(target=read, args=(name, screen)))
            readers[-1].start()
        try:
            with pytest.raises(SystemExit) as ended:
                main()
        finally:
            for stream in streams:
                stream.close()
            for reader in readers:
                reader.join()
    out, err = (texts[name].decode(encoding).replace("\r\n", "\n") for name in ("stdout", "stderr"))
    return int(ended.value.code or 0), out, err


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "ascii"])
def test_no_name_steers_the_terminal_or_ends_a_command(
    encoding: str, hostile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(hostile.parent)
    table = str(tmp_path / "t.csv")
    commands = {
        "drawn": ["score", "m"],
        "as CSV": ["score", "m", "--out", "-"],
        "as JSON": ["score", "m", "--json"],
        "to a file": ["score", "m", "--out", table],
        "again": ["score", "m", "--out", table],
        "order": ["order", "m", "--plot", str(tmp_path / "o.png")],
        "profile": ["profile", "m", "--plot", str(tmp_path / "p.png")],
        "compare": ["compare", table, str(tmp_path / "new.csv"), "--out", "-"],
    }
    shown = {}
    for what, command in commands.items():
        if what == "compare":
            rows = list(read_table(table))
            assert sorted(row.path for row in rows) == sorted(
                "m/" + name.decode("utf-8", "backslashreplace") for name in HOSTILE
            )
            moved = [
                Score(row.path, values={name: value + 1 for name, value in row.values.items()}, measure=row.measure)
                for row in rows
            ]
            write_table(tmp_path / "new.csv", moved, columns=COLUMNS)
        status, out, err = on_terminal(monkeypatch, *command, encoding=encoding)
        assert status == 0, (what, out, err)
        assert not STEERING.search(out + err), (what, STEERING.search(out + err))
        shown[what] = out + err
    assert "10 of 10 masks are in" in shown["again"]
    for name in HOSTILE.values():
        name = printable(name, encoding)
        for what in ("drawn", "as CSV", "order", "compare"):
            assert name in shown[what], (what, name)


def test_no_message_steers_the_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    esc, plain = "\x1b[2Jx\n\udcff[/]", "\x9b31m\n\x07\udcff"  # brackets would make a pattern
    (tmp_path / "table.csv").write_text("path\n")
    Path("empty" + esc.replace("/", "")).mkdir()
    commands = [
        (1, ["score", plain]),
        (1, ["order", plain]),
        (1, ["profile", plain, "--plot", "p.png"]),
        (2, ["score", esc]),
        (2, ["score", "empty" + esc.replace("/", "")]),
        (2, ["score", "x.png", "--out", f"{esc}.xlsx"]),
        (2, ["score", "x.png", "--out", f"{esc}/a.csv"]),
        (2, ["score", "x.png", "--window", f"{esc}=0-1"]),
        (2, ["score", "x.png", "--window", f"{esc}"]),
        (2, ["score", f"--{esc}"]),
        (2, ["score", "x.png", "--workers", esc]),
        (2, [esc]),
        (2, ["profile", "x.png", "--plot", f"{esc}.txt"]),
        (2, ["compare", esc, esc]),
        (2, ["compare", "table.csv", "table.csv", "--column", esc]),
        (2, ["compare", "table.csv", "table.csv", "--join", esc]),
        (2, ["report", esc, "--out", "r.html"]),
        (2, ["report", "table.csv", "--out", esc]),
    ]
    for status, command in commands:
        code, out, err = on_terminal(monkeypatch, *command)
        assert (code, "Traceback" in err) == (status, False), (command, err)
        assert not STEERING.search(out + err), (command, err)


@pytest.mark.parametrize("width", [40, 60])
def test_names_are_visible_in_narrow_terminals(
    width: int, hostile: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    names = [f"mask-{i:010d}.png" for i in range(3)]  # 19 characters
    measure = Measure(windows=WINDOWS).settings()
    rows = [
        Score(name, 3000, 4000, None, 12_000_000 - i, 800, 12, dict.fromkeys(WINDOWS, 2.5 + i), 4.25, 0.5,
              measure=measure)
        for i, name in enumerate(names)
    ]  # fmt: skip
    print_table(rows)
    out = capsys.readouterr().out
    assert all(len(line) <= width for line in out.split("\n"))
    column = 19 if width == 60 else 16  # folded at 40
    assert all(name[:column] in out for name in names)
    assert "complexity" in out
    assert "2.500" in out
    assert "Not shown, for want of width:" in " ".join(out.split())

    for name, shift in (("old.csv", 0.0), ("new.csv", 1.0)):
        moved = [Score(row.path, values={w: v + shift for w, v in row.values.items()}) for row in rows]
        write_table(tmp_path / name, moved, columns=COLUMNS)
    result = CliRunner(env={"TERM": "dumb", "COLUMNS": str(width)}).invoke(
        app, ["compare", str(tmp_path / "old.csv"), str(tmp_path / "new.csv")]
    )
    assert all(name[:column] in result.stdout for name in names)
    assert "+1.000" in result.stdout

    masks = {name: shapes.box(4 + i, 6) for i, name in enumerate(names)}
    profiles = {name: complexity_profile(mask, spatial_ndim=2) for name, mask in masks.items()}
    print_order(dominance(profiles), profiles)
    out = capsys.readouterr().out.split("Longest")[0]
    assert all(name[:8] in out for name in names)
    assert all(len(line) <= width for line in out.split("\n"))


def test_names_of_any_width_and_any_windows(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    values = {f"a window with a long name {i}": 1.0 for i in range(3)}
    print_table([Score("面" * 30 + "/ä.png", values=values, peak=1.0, peak_scale=0.5), Score("b.png", error="x\x1by")])
    out = capsys.readouterr().out
    assert "面面" in out
    assert "a window with a long name 0" in out
    assert r"failed b.png: x\x1by" in out


def test_the_bar_shows_what_a_long_solve_says(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # what rich takes for a terminal
    monkeypatch.setenv("COLUMNS", "120")
    told = ""

    def until_told(text: str) -> None:
        nonlocal told
        end = time.monotonic() + 60
        while text not in told:
            assert time.monotonic() < end, told
            time.sleep(0.05)  # the bar is drawn ten times a second
            told += capsys.readouterr().err

    with progress(0, 2, shown=True) as advance:
        parallel.tell("4,711 pixels, residual 3e-02")
        until_told("4,711 pixels, residual 3e-02")
        advance()
        until_told("1/2")
    parallel.tell("nobody listens any more")
    told += capsys.readouterr().err
    assert "4,711" not in told[told.rindex("1/2") :]  # another mask has begun
    assert "nobody" not in told


def test_without_a_terminal_nothing_is_told(capsys: pytest.CaptureFixture) -> None:
    with progress(0, 2, shown=True) as advance:
        parallel.tell("4,711 pixels, residual 3e-02")
        advance()
    assert capsys.readouterr().err == ""


def test_the_solve_of_a_large_shape_says_how_far_it_is() -> None:
    said: list[str] = []
    mask = shapes.disc(160)
    with parallel.told_to(said.append):
        solve_field(mask, spatial_ndim=2)
    assert len(said) >= 3  # before, after and in between solves
    assert all(text.startswith(f"{int(mask.sum()):,} pixels, residual ") for text in said)
    count = len(said)
    solve_field(mask, spatial_ndim=2)
    assert len(said) == count
