"""Tables that are continued: whatever a killed run left, each row is there once in the end."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet
import pytest

from torchlinf import Measure
from torchlinf.scoring import COLUMNS, JOURNAL, WINDOWS, NoTableError, Score, open_table, read_table, write_table
from torchlinf.scoring.atomic_write import replace_file
from torchlinf.scoring.journal import Journal
from torchlinf.scoring.rows import csv_line, json_line

SETTINGS = {"version": "0.0.1", "measure": Measure(windows=WINDOWS).settings()}
NONE = dict.fromkeys(WINDOWS)


def values(*numbers: float) -> dict[str, float]:
    return dict(zip(WINDOWS, numbers, strict=True))


ROWS = [
    Score("plain.png", 9, 13, None, 100, 4, 1, values(2.5, 3.5, 1.5), 4.25, 0.1, 1e-12, 0.125, **SETTINGS),
    Score('a, "q"\nname\r.png', 5, 7, 3, 60, 2, 1, values(0.1 + 0.2, 1e-300, 0.0), 5e17, 1 / 3, 0.0, 0.5, **SETTINGS),
    Score('half "quoted', values=NONE, error='no "such" file, or so', **SETTINGS),
    Score("übel\\xe9.png", values=NONE, error="empty", **SETTINGS),
]
FORMATS = ["csv", "jsonl", "parquet"]


def text(suffix: str, rows: list[Score]) -> bytes:
    """The table, written by hand as the format has it."""
    if suffix == "csv":
        return "".join([csv_line(COLUMNS), *(csv_line(row.cells().values()) for row in rows)]).encode()
    return "".join(map(json_line, rows)).encode()


def go_on(path: Path, rows: list[Score] = ROWS, **options: bool) -> dict[str, str | None]:
    """What the command does: write what is not there."""
    with open_table(path, **{"resume": True, **options}) as put:
        for row in rows:
            if row.path not in put.done:
                put(row)
    return dict(put.done)


def leave(path: Path, rows: list[Score]) -> None:
    """A run that is stopped after some rows."""
    with pytest.raises(KeyboardInterrupt), open_table(path, resume=True) as put:  # noqa: PT012
        for row in rows:
            put(row)
        raise KeyboardInterrupt


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_table_says_what_was_written(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scores.{suffix}"
    with open_table(path) as put:
        for row in ROWS:
            put(row)
    assert list(read_table(path)) == ROWS
    assert os.listdir(tmp_path) == [path.name]
    if suffix == "parquet":
        read = pyarrow.parquet.read_table(path)
        assert read.column_names == list(COLUMNS)
        assert read["depth"].to_pylist() == [row.depth for row in ROWS]
    else:
        assert path.read_bytes() == text(suffix, ROWS)


@pytest.mark.parametrize("suffix", FORMATS)
def test_killed_at_any_byte_and_continued_it_is_complete(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scores.{suffix}"
    journal, whole = tmp_path / f"scores.{suffix}{JOURNAL}", text("jsonl", ROWS)
    ends = [len(text("jsonl", ROWS[:count])) for count in range(1, len(ROWS) + 1)]
    sizes = {*range(0, len(whole), 41), *ends, *(end - 1 for end in ends), *(end + 1 for end in ends[:-1])}
    for size in sorted(sizes):
        journal.write_bytes(whole[:size])
        written = [row for row, end in zip(ROWS, ends, strict=True) if end <= size]
        assert list(read_table(journal)) == written  # while the run goes on
        assert list(go_on(path)) == [row.path for row in written]
        assert list(read_table(path)) == ROWS, size
        assert os.listdir(tmp_path) == [path.name]
        path.unlink()


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_stopped_run_goes_on_behind_a_table_and_its_journal(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scores.{suffix}"
    leave(path, ROWS[:2])
    assert os.listdir(tmp_path) == [path.name + JOURNAL]
    assert go_on(path, ROWS[:3]) == {row.path: None for row in ROWS[:2]}
    before = path.read_bytes()
    leave(path, ROWS[3:])
    assert path.read_bytes() == before
    assert list(go_on(path)) == [row.path for row in ROWS]
    assert list(read_table(path)) == ROWS
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("suffix", FORMATS)
def test_killed_while_a_table_is_put_in_its_place(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / f"scores.{suffix}"
    go_on(path, ROWS[:1])
    for stop in ("before", "after"):
        with monkeypatch.context() as patch:
            substitute = Path.replace

            def killed(self: Path, target: Path, stop: str = stop, substitute: object = substitute) -> None:
                if stop == "after":
                    substitute(self, target)
                raise KeyboardInterrupt

            patch.setattr(Path, "replace", killed)
            with pytest.raises(KeyboardInterrupt):
                go_on(path, ROWS[:3])
        assert (tmp_path / f"scores.{suffix}{JOURNAL}").stat().st_size > 0
        (tmp_path / f".scores.{suffix}.123.tmp").write_bytes(b"PAR1")  # a kill leaves it
        assert len(go_on(path, ROWS[:3])) == 3
        assert list(read_table(path)) == ROWS[:3]
        assert os.listdir(tmp_path) == [path.name]
        path.unlink()
        go_on(path, ROWS[:1])


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_complete_table_is_left_alone(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scores.{suffix}"
    go_on(path)
    before = path.stat()
    go_on(path)
    assert path.stat().st_ino == before.st_ino
    assert path.stat().st_mtime_ns == before.st_mtime_ns


@pytest.mark.parametrize("suffix", FORMATS)
def test_what_failed_is_tried_again_if_asked(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scores.{suffix}"
    go_on(path)
    repaired = replace(ROWS[2], pixels=5, error=None)
    assert len(go_on(path, [repaired])) == 4
    assert go_on(path, [repaired, ROWS[3]], retry=True) == {row.path: None for row in ROWS[:2]}
    assert list(read_table(path)) == [*ROWS[:2], repaired, ROWS[3]]
    go_on(path, [repaired, replace(ROWS[3], error="still")], retry=True)
    assert list(read_table(path)) == [*ROWS[:2], repaired, replace(ROWS[3], error="still")]


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_retry_that_is_stopped_goes_on(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scores.{suffix}"
    go_on(path, ROWS[:3])
    leave(path, ROWS[3:])
    repaired = replace(ROWS[2], pixels=5, error=None)
    with pytest.raises(KeyboardInterrupt), open_table(path, retry=True) as put:  # noqa: PT012
        assert len(put.done) == 2
        put(replace(ROWS[3], error="twice"))
        put(repaired)
        raise KeyboardInterrupt
    assert go_on(path, retry=True) == {row.path: None for row in [*ROWS[:2], repaired]}
    assert list(read_table(path)) == [*ROWS[:2], repaired, ROWS[3]]


@pytest.mark.parametrize("suffix", FORMATS)
def test_without_resume_the_table_begins_anew(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scores.{suffix}"
    go_on(path)
    with open_table(path) as put:
        assert not put.done
        put(ROWS[1])
    assert list(read_table(path)) == [ROWS[1]]
    leave(path, ROWS[:1])
    with open_table(path) as put:
        put(ROWS[3])
    assert list(read_table(path)) == [ROWS[3]]


def test_json_whatever_the_name(tmp_path: Path) -> None:
    with open_table(tmp_path / "scores.json", as_json=True) as put:
        put(ROWS[0])
    assert (tmp_path / "scores.json").read_bytes() == text("jsonl", ROWS[:1])
    assert list(read_table(tmp_path / "scores.json")) == ROWS[:1]
    go_on(tmp_path / "scores.json", as_json=True)
    assert list(read_table(tmp_path / "scores.json")) == ROWS


OTHERS = {
    "notes.csv": b"what was there before\n",
    "old.csv": b"path,height\na.png,3\n",
    "short.csv": text("csv", []) + b"a.png,3\n",
    "text.csv": text("csv", ROWS[:1]).replace(b"100", b"a hundred"),
    "cut.csv": text("csv", ROWS)[:-30],
    "binary.csv": bytes(range(256)),
    "csv.jsonl": text("csv", ROWS[:1]),
    "other.jsonl": b'{"path": "a.png", "colour": "red"}\n',
    "number.jsonl": b'{"path": 3}\n',
    "list.jsonl": b"[1, 2]\n",
    "cut.jsonl": text("jsonl", ROWS)[:-30],
    "text.parquet": b"PAR1 what was there before",
    "empty.parquet": b"",
    "empty.csv": b"",
}


@pytest.mark.parametrize("name", OTHERS)
def test_what_is_no_table_is_left_as_it_is(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(OTHERS[name])
    with pytest.raises(NoTableError, match=r"^(it (is|holds)|its)"):
        go_on(path)
    assert path.read_bytes() == OTHERS[name]
    assert os.listdir(tmp_path) == [name]
    go_on(path, resume=False)
    assert list(read_table(path)) == ROWS


def test_a_journal_that_is_none_is_left_as_it_is(tmp_path: Path) -> None:
    journal = tmp_path / f"scores.csv{JOURNAL}"
    journal.write_bytes(b"what was there before\n")
    with pytest.raises(NoTableError, match=r"^line 1 of its journal .*\.part is not a row"):
        go_on(tmp_path / "scores.csv")
    assert journal.read_bytes() == b"what was there before\n"


def test_a_parquet_file_with_other_columns_is_no_table(tmp_path: Path) -> None:
    path = tmp_path / "other.parquet"
    pyarrow.parquet.write_table(pyarrow.table({"path": ["a.png"], "height": [3]}), path)
    with pytest.raises(NoTableError, match="columns"):
        go_on(path)
    with pytest.raises(NoTableError, match="columns"):
        list(read_table(path))
    assert pyarrow.parquet.read_table(path).num_rows == 1


@pytest.mark.parametrize("suffix", FORMATS)
def test_one_run_at_a_time(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scores.{suffix}"
    with open_table(path, resume=True) as put:
        put(ROWS[0])
        for resume in (True, False):
            with pytest.raises(OSError, match="another run is writing it"), open_table(path, resume=resume):
                pass
        put(ROWS[1])
    assert list(read_table(path)) == ROWS[:2]


def test_a_run_that_ended_in_between_is_another_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The journal is opened, then that run removes it and ends, and only then comes the lock."""
    fcntl = pytest.importorskip("fcntl")
    path = tmp_path / "scores.csv.part"
    lock = fcntl.flock

    def late(file: object, how: int) -> None:
        path.unlink()
        lock(file, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with pytest.raises(OSError, match="another run"):
        Journal(path)


def test_a_folder_of_tables_is_one_table(tmp_path: Path) -> None:
    for number, suffix in enumerate(("parquet", "jsonl", "csv")):
        go_on(tmp_path / f"{number}.{suffix}", [ROWS[number]])
    (tmp_path / "notes.txt").write_text("no table")
    assert list(read_table(tmp_path)) == ROWS[:3]


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_link_to_a_table_stays_a_link(suffix: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    link = tmp_path / f"link.{suffix}"
    link.symlink_to(tmp_path / "folder" / f"scores.{suffix}")
    go_on(link, ROWS[3:])
    go_on(link, ROWS[:1], resume=False)
    (tmp_path / "folder" / f".scores.{suffix}.123.tmp").write_bytes(b"PAR1")  # a kill leaves it
    go_on(link)
    assert os.listdir(tmp_path / "folder") == [f"scores.{suffix}"]
    assert link.is_symlink()
    assert list(read_table(tmp_path / "folder" / f"scores.{suffix}")) == ROWS


def test_a_table_that_cannot_be_written_leaves_what_was_there(tmp_path: Path) -> None:
    def fail(temporary: Path) -> None:
        temporary.write_text("half")
        raise OSError(28, "No space left on device")

    (tmp_path / "scores.csv").write_text("before")
    with pytest.raises(OSError, match="No space"):
        replace_file(tmp_path / "scores.csv", fail)
    assert (tmp_path / "scores.csv").read_text() == "before"
    assert os.listdir(tmp_path) == ["scores.csv"]


def test_without_pyarrow_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "old.parquet").write_bytes(b"?")
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    for name in ("new.parquet", "old.parquet"):
        with pytest.raises(ImportError, match=r"pip install 'torchlinf\[parquet\]'"), open_table(tmp_path / name):
            pass
    with pytest.raises(ImportError, match=r"pip install 'torchlinf\[parquet\]'"):
        list(read_table(tmp_path / "old.parquet"))
    with pytest.raises(ImportError, match=r"pip install 'torchlinf\[parquet\]'"):
        write_table(tmp_path / "new.parquet", ROWS, columns=COLUMNS)
    assert os.listdir(tmp_path) == ["old.parquet"]
    with open_table(tmp_path / "table.csv") as put:  # nothing else needs it
        put(ROWS[0])


def test_a_folder_without_tables_is_none(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no table")
    with pytest.raises(NoTableError, match=r"holds no \.csv"):
        list(read_table(tmp_path))
