"""The table: rows as text, and files that hold whole rows whatever happens."""

import csv
import io
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from torchlinf.scoring import COLUMNS, NoTableError, Score, find_masks, open_table, print_table, read_table, score_masks
from torchlinf.scoring.journal import Journal
from torchlinf.scoring.rows import KINDS, csv_line, json_line


def test_rows_as_text_say_the_same_as_rows(tmp_path: Path) -> None:
    np.save(tmp_path / "a, b.npy", np.tri(9, 13))
    (tmp_path / "c.png").write_bytes(b"")
    rows = list(score_masks(find_masks([tmp_path])))
    assert [row.error is None for row in rows] == [True, False]
    lines = [csv_line(COLUMNS), *(csv_line(row.cells().values()) for row in rows)]
    parsed = list(csv.DictReader(io.StringIO("".join(lines))))
    assert tuple(parsed[0]) == COLUMNS
    for row, cells in zip(rows, parsed, strict=True):
        assert json.loads(json_line(row)) == row.cells()
        for name, value in row.cells().items():
            assert cells[name] == "" if value is None else type(value)(cells[name]) == value


def test_columns_are_those_that_were_promised() -> None:
    assert COLUMNS == (
        "path", "height", "width", "depth", "pixels", "radius", "components", "complexity", "complexity_low",
        "complexity_high", "peak", "peak_scale", "error_bound", "field_error_bound", "seconds", "inside", "spacing",
        "label", "object", "objects", "top", "bottom", "left", "right", "front", "back", "angle", "standard_error",
        "category", "image", "error", "version", "measure",
    )  # fmt: skip


class FullDisk:
    """A raw file that takes 10 bytes at a time, and so many in all."""

    def __init__(self, file: io.FileIO, size: int) -> None:
        self.file, self.size = file, size

    def write(self, data: bytes) -> int:
        room = min(10, self.size - self.file.tell())
        if room == 0:
            raise OSError(28, "No space left on device")
        return self.file.write(data[:room])

    def __getattr__(self, name: str) -> object:
        return getattr(self.file, name)


def test_a_full_disk_leaves_whole_lines(tmp_path: Path) -> None:
    row = Score("a.png")
    with Journal(tmp_path / "table.part") as journal:
        journal._file = FullDisk(journal._file, 3 * len(json_line(row)) + 70)
        for _ in range(3):
            journal.append(row)
        with pytest.raises(OSError, match="No space left"):
            journal.append(row)
    assert (tmp_path / "table.part").read_text() == 3 * json_line(row)


def test_rows_can_be_read_as_soon_as_they_are_written(tmp_path: Path) -> None:
    with open_table(tmp_path / "table.csv") as write:
        write(Score("a.png"))
        assert [row.path for row in read_table(tmp_path / "table.csv.part")] == ["a.png"]
        assert not (tmp_path / "table.csv").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


@pytest.mark.skipif(sys.platform == "win32", reason="named pipes are those of POSIX")
def test_rows_go_into_a_pipe_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    reader = os.open(tmp_path / "pipe.csv", os.O_RDONLY | os.O_NONBLOCK)
    with open_table(tmp_path / "pipe.csv", resume=True, windows={"fine": (0, 0.5)}) as write:
        write(Score("a.png", values={"fine": 0.5}))
        header, row = os.read(reader, 4096).decode().splitlines()
        assert header.split(",")[7] == "fine"
        assert row == "a.png,,,,,,,0.5" + 23 * ","
    os.close(reader)
    assert os.listdir(tmp_path) == ["pipe.csv"]


@pytest.mark.parametrize("suffix", ["csv", "jsonl", "parquet"])
def test_windows_are_columns(suffix: str, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.tri(9, 13))
    np.save(tmp_path / "b.npy", np.zeros((4, 4)))
    windows = {"fine, of all": (0.0, 0.25), "coarse": (0.25, 1.0)}
    rows = list(score_masks(find_masks([tmp_path]), windows=windows))
    with open_table(tmp_path / f"scores.{suffix}", windows=windows) as put:
        for row in rows:
            put(row)
    read = list(read_table(tmp_path / f"scores.{suffix}"))
    assert read == rows
    assert [type(value) for value in read[0].values.values()] == [float, float]
    assert read[1].values == dict.fromkeys(windows)
    assert list(read[0].cells()) == [*COLUMNS[:7], *windows, *COLUMNS[10:]]


def test_no_window_has_the_name_of_another_column() -> None:
    assert set(COLUMNS) - set(KINDS) == {"complexity", "complexity_low", "complexity_high"}
    for name in (*KINDS, "values", ""):
        with (
            pytest.raises(ValueError, match="names that no other column has"),
            open_table(None, windows={name: (0, 1)}),
        ):
            pass


@pytest.mark.parametrize("suffix", ["csv", "jsonl", "parquet"])
@pytest.mark.parametrize(
    "other", [{"bins": 64}, {"windows": None}, {"windows": {"fine": (0, 0.25)}}, {"rho": 2.0}, {"tol": 1e-6}]
)
def test_a_table_of_other_settings_is_not_continued(suffix: str, other: dict[str, object], tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.tri(9, 13))
    path, masks = tmp_path / f"scores.{suffix}", find_masks([tmp_path])
    with open_table(path) as put:
        put(next(score_masks(masks)))
    before = path.read_bytes()
    with (
        pytest.raises(NoTableError, match=r"measured with other options.*; got"),
        open_table(path, resume=True, **other),
    ):
        pass
    assert path.read_bytes() == before
    with open_table(path, **other) as put:
        put(next(score_masks(masks, **other)))
    path.rename(tmp_path / f"scores.{suffix}.part") if suffix == "jsonl" else None
    with pytest.raises(NoTableError, match="measured with other options"), open_table(path, resume=True):
        pass
    assert sorted(os.listdir(tmp_path)) == ["a.npy", f"scores.{suffix}{'.part' if suffix == 'jsonl' else ''}"]


def test_on_a_terminal_the_table_is_drawn(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"complexity": 2.5, "complexity_low": 3.5, "other": 1.5}
    row = Score("masks/[a].png", 9, 13, None, 100, 4, 1, values, 4.25, 0.5, 1e-12, 0.1)
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
    assert next(line for line in shown.split("\n") if "pixels" in line).split() == [
        "mask",
        "pixels",
        "D",
        "parts",
        "complexity",
        "low",
        "other",
        "peak",
        "at",
    ]
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
