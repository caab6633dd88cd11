"""Tables that are continued: whatever a killed run left, each row is there once in the end."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet
import pytest

from torchlinf.scoring import COLUMNS, NoTableError, Score, line_file, open_table, read_table
from torchlinf.scoring.atomic_write import replace_file
from torchlinf.scoring.rows import csv_header, csv_line, json_line, parse
from torchlinf.scoring.tables import JOURNAL

ROWS = [
    Score("plain.png", 9, 13, None, 100, 4, 1, 2.5, 3.5, 1.5, 4.25, 0.1, 1e-12, 0.125),
    Score('a, "quoted"\nname\r.png', 5, 7, 3, 60, 2, 1, 0.1 + 0.2, 1e-300, 0.0, 5e17, 1 / 3, 0.0, 0.5),
    Score('half "quoted', error='no "such" file, or so'),
    Score("übel\\xe9.png", error="empty"),
]
FORMATS = ["csv", "jsonl"]


def text(suffix: str, rows: list[Score]) -> bytes:
    """The table, written by hand as the format has it."""
    lines = [csv_header(), *map(csv_line, rows)] if suffix == "csv" else map(json_line, rows)
    return "".join(lines).encode()


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


@pytest.mark.parametrize("suffix", [*FORMATS, "parquet"])
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
def test_cut_at_any_byte_and_continued_it_is_complete(suffix: str, tmp_path: Path) -> None:
    path, whole = tmp_path / f"scores.{suffix}", text(suffix, ROWS)
    ends = [len(text(suffix, ROWS[:count])) for count in range(len(ROWS) + 1)]
    for size in range(len(whole) + 1):
        path.write_bytes(whole[:size])
        done = go_on(path)
        assert path.read_bytes() == whole, size
        assert list(done) == [row.path for row, end in zip(ROWS, ends[1:], strict=True) if end <= size]


@pytest.mark.parametrize("suffix", FORMATS)
def test_of_a_table_that_is_being_written_the_whole_rows_are_read(suffix: str) -> None:
    whole = text(suffix, ROWS)
    ends = [len(text(suffix, ROWS[:count])) for count in range(1, len(ROWS) + 1)]
    for size in range(len(whole) + 1):
        read = list(parse(whole[:size].splitlines(keepends=True)))
        assert read == [(row, end) for row, end in zip(ROWS, ends, strict=True) if end <= size]


def test_a_parquet_file_is_continued_from_what_lies_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "scores.parquet"
    journal = tmp_path / f"scores.parquet{JOURNAL}"
    whole = text("jsonl", ROWS)
    for size in range(0, len(whole) + 1, 31):  # the run was killed before there was a Parquet file
        journal.write_bytes(whole[:size])
        go_on(path)
        assert list(read_table(path)) == ROWS
        assert os.listdir(tmp_path) == [path.name]
        path.unlink()
    leave(path, ROWS[:2])
    assert os.listdir(tmp_path) == [journal.name]
    assert go_on(path, ROWS[:3]) == {row.path: None for row in ROWS[:2]}
    leave(path, ROWS[3:])  # killed with a Parquet file beside the journal
    assert list(go_on(path)) == [row.path for row in ROWS]
    assert list(read_table(path)) == ROWS
    assert os.listdir(tmp_path) == [path.name]


def test_killed_while_a_parquet_file_is_put_in_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scores.parquet"
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
        assert (tmp_path / f"scores.parquet{JOURNAL}").stat().st_size > 0
        (tmp_path / ".scores.parquet.123.tmp").write_bytes(b"PAR1")  # a kill leaves it
        assert len(go_on(path, ROWS[:3])) == 3
        assert list(read_table(path)) == ROWS[:3]
        assert os.listdir(tmp_path) == [path.name]
        path.unlink()
        go_on(path, ROWS[:1])


def test_a_complete_parquet_file_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "scores.parquet"
    go_on(path)
    before = path.stat()
    go_on(path)
    assert path.stat().st_ino == before.st_ino
    assert path.stat().st_mtime_ns == before.st_mtime_ns


@pytest.mark.parametrize("suffix", [*FORMATS, "parquet"])
def test_what_failed_is_tried_again_if_asked(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scores.{suffix}"
    go_on(path)
    repaired = replace(ROWS[2], pixels=5, error=None)
    assert len(go_on(path, [repaired])) == 4
    assert go_on(path, [repaired, ROWS[3]], retry=True) == {row.path: None for row in ROWS[:2]}
    assert list(read_table(path)) == [*ROWS[:2], repaired, ROWS[3]]
    path.write_bytes(path.read_bytes()[: -10 if suffix != "parquet" else None])
    go_on(path, [repaired, replace(ROWS[3], error="still")], retry=True)
    assert list(read_table(path)) == [*ROWS[:2], repaired, replace(ROWS[3], error="still")]


def test_a_retry_of_a_parquet_file_that_is_killed_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "scores.parquet"
    go_on(path)
    repaired = replace(ROWS[2], pixels=5, error=None)
    with pytest.raises(KeyboardInterrupt), open_table(path, retry=True) as put:  # noqa: PT012
        put(repaired)
        raise KeyboardInterrupt
    assert list(go_on(path, [*ROWS[:2], repaired])) == [row.path for row in ROWS]
    # What was not reached is as it was; what was scored again counts.
    assert sorted(read_table(path), key=str) == sorted([*ROWS[:2], repaired, ROWS[3]], key=str)


@pytest.mark.parametrize("suffix", [*FORMATS, "parquet"])
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


OTHERS = {
    "notes.csv": b"what was there before\n",
    "old.csv": b"path,height\na.png,3\n",
    "json.csv": json_line(ROWS[0]).encode(),
    "short.csv": csv_header().encode() + b"a.png,3\n",
    "text.csv": csv_header().encode() + csv_line(ROWS[0]).replace("100", "a hundred").encode(),
    "binary.csv": bytes(range(256)),
    "csv.jsonl": text("csv", ROWS[:1]),
    "other.jsonl": b'{"path": "a.png", "colour": "red"}\n',
    "number.jsonl": b'{"path": 3}\n',
    "list.jsonl": b"[1, 2]\n",
    "text.parquet": b"PAR1 what was there before",
    "empty.parquet": b"",
}


@pytest.mark.parametrize("name", OTHERS)
def test_what_is_no_table_is_left_as_it_is(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(OTHERS[name])
    with pytest.raises(NoTableError, match=r"^(it (does|is)|its|the row)"):
        go_on(path)
    assert path.read_bytes() == OTHERS[name]
    assert os.listdir(tmp_path) == [name]
    go_on(path, resume=False)
    assert list(read_table(path)) == ROWS


def test_a_parquet_file_with_other_columns_is_no_table(tmp_path: Path) -> None:
    path = tmp_path / "other.parquet"
    pyarrow.parquet.write_table(pyarrow.table({"path": ["a.png"], "height": [3]}), path)
    with pytest.raises(NoTableError, match="columns"):
        go_on(path)
    with pytest.raises(NoTableError, match="columns"):
        list(read_table(path))
    assert pyarrow.parquet.read_table(path).num_rows == 1


@pytest.mark.parametrize("suffix", [*FORMATS, "parquet"])
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
    """The file is opened, then that run puts another in its place and ends, and only then comes the lock."""
    fcntl = pytest.importorskip("fcntl")
    path = tmp_path / "scores.csv"
    go_on(path)
    lock = fcntl.flock

    def late(file: object, how: int) -> None:
        replace_file(path, lambda new: new.write_bytes(text("csv", ROWS[:2])))
        lock(file, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with pytest.raises(OSError, match="another run"):
        line_file.LineFile(path)
    assert list(read_table(path)) == ROWS[:2]


def test_a_folder_of_tables_is_one_table(tmp_path: Path) -> None:
    for number, suffix in enumerate(("parquet", "jsonl", "csv")):
        go_on(tmp_path / f"{number}.{suffix}", [ROWS[number]])
    (tmp_path / "notes.txt").write_text("no table")
    assert list(read_table(tmp_path)) == ROWS[:3]


def test_a_link_to_a_parquet_file_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link.parquet").symlink_to(tmp_path / "folder" / "scores.parquet")
    go_on(tmp_path / "link.parquet", ROWS[3:])
    go_on(tmp_path / "link.parquet", ROWS[:1], resume=False)
    (tmp_path / "folder" / ".scores.parquet.123.tmp").write_bytes(b"PAR1")  # a kill leaves it
    go_on(tmp_path / "link.parquet")
    assert os.listdir(tmp_path / "folder") == ["scores.parquet"]
    assert (tmp_path / "link.parquet").is_symlink()
    assert list(read_table(tmp_path / "folder" / "scores.parquet")) == ROWS


def test_without_pyarrow_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "old.parquet").write_bytes(b"?")
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    for name in ("new.parquet", "old.parquet"):
        with pytest.raises(ImportError, match=r"pip install 'torchlinf\[parquet\]'"), open_table(tmp_path / name):
            pass
    with pytest.raises(ImportError, match=r"pip install 'torchlinf\[parquet\]'"):
        list(read_table(tmp_path / "old.parquet"))
    assert os.listdir(tmp_path) == ["old.parquet"]
    with open_table(tmp_path / "table.csv") as put:  # nothing else needs it
        put(ROWS[0])


def test_a_folder_without_tables_is_none(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no table")
    with pytest.raises(NoTableError, match=r"holds no \.csv"):
        list(read_table(tmp_path))
