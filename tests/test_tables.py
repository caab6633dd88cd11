"""The table: rows as text, and files that hold whole rows whatever happens."""

import csv
import dataclasses
import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from torchlinf.scoring import COLUMNS, Score, find_masks, open_table, print_table, score_masks
from torchlinf.scoring.line_file import LineFile
from torchlinf.scoring.rows import csv_header, csv_line, json_line


def test_rows_as_text_say_the_same_as_rows(tmp_path: Path) -> None:
    np.save(tmp_path / "a, b.npy", np.tri(9, 13))
    (tmp_path / "c.png").write_bytes(b"")
    rows = list(score_masks(find_masks([tmp_path])))
    assert [row.error is None for row in rows] == [True, False]
    parsed = list(csv.DictReader(io.StringIO(csv_header() + "".join(csv_line(row) for row in rows))))
    assert tuple(parsed[0]) == COLUMNS
    for row, cells in zip(rows, parsed, strict=True):
        assert json.loads(json_line(row)) == dataclasses.asdict(row)
        for name, value in dataclasses.asdict(row).items():
            assert cells[name] == "" if value is None else type(value)(cells[name]) == value


def test_columns_are_those_that_were_promised() -> None:
    assert COLUMNS == (
        "path", "height", "width", "depth", "pixels", "radius", "components", "complexity", "complexity_low",
        "complexity_high", "peak", "peak_scale", "error_bound", "seconds", "error",
    )  # fmt: skip


class FullDisk:
    """A raw file that takes 10 bytes at a time, and 100 in all."""

    def __init__(self, file: io.FileIO) -> None:
        self.file = file

    def write(self, data: bytes) -> int:
        room = min(10, 100 - self.file.tell())
        if room == 0:
            raise OSError(28, "No space left on device")
        return self.file.write(data[:room])

    def __getattr__(self, name: str) -> object:
        return getattr(self.file, name)


def test_a_full_disk_leaves_whole_lines(tmp_path: Path) -> None:
    line = "x" * 29 + "\n"
    with LineFile(tmp_path / "table.csv") as table:
        table._file = FullDisk(table._file)
        for _ in range(3):
            table.write(line)
        with pytest.raises(OSError, match="No space left"):
            table.write(line)
    assert (tmp_path / "table.csv").read_text() == 3 * line


def test_rows_can_be_read_as_soon_as_they_are_written(tmp_path: Path) -> None:
    with open_table(tmp_path / "table.csv") as write:
        assert (tmp_path / "table.csv").read_text() == csv_header()
        write(Score("a.png"))
        assert (tmp_path / "table.csv").read_text() == csv_header() + csv_line(Score("a.png"))


def test_on_a_terminal_the_table_is_drawn(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    row = Score("masks/[a].png", 9, 13, None, 100, 4, 1, 2.5, 3.5, 1.5, 4.25, 0.5, 1e-12, 0.1)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "dumb")  # no colours

    def interrupted() -> None:
        with open_table(None) as write:
            write(row)
            write(Score("masks/b.png", error="no such file"))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    shown = capsys.readouterr().out
    assert "[a].png" in shown
    assert "2.500" in shown
    assert "failed b.png: no such file" in shown


@pytest.mark.parametrize(
    ("paths", "shown"),
    [
        (["m/a.png", "m/b/c.png"], ["a.png", "b/c.png"]),
        (["m/a.png"], ["a.png"]),
        (["a.png", "b.png"], ["a.png", "b.png"]),
        (["/m/a.png", "b.png"], ["/m/a.png", "b.png"]),
        (["/m/a.png", "/n/b.png"], ["/m/a.png", "/n/b.png"]),
    ],
)
def test_names_are_cut_by_what_they_share(
    paths: list[str], shown: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    print_table([Score(path, error="empty") for path in paths])
    assert capsys.readouterr().out == "".join(f"failed {name}: empty\n" for name in shown)


def test_a_table_of_nothing_is_empty(capsys: pytest.CaptureFixture[str]) -> None:
    print_table([])
    assert capsys.readouterr().out == ""
