"""Tables in files: of whole rows only, whenever the writing ends, and continued where it ended."""

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from glob import escape
from pathlib import Path

from torchlinf.scoring import parquet
from torchlinf.scoring.line_file import LineFile
from torchlinf.scoring.rows import NoTableError, Score, csv_header, csv_line, json_line, parse
from torchlinf.scoring.terminal import print_table

JSON_BEGINNING = b'{"path": '
JOURNAL = ".part"  # what is scored already, beside a Parquet file, which is written in one piece at the end


@dataclass(frozen=True)
class Writer:
    """What takes rows, called with one at a time.

    Attributes:
        write: writes a row, in full or not at all.
        done: of every row that the table held before, the path and the error, None if there was none.
    """

    write: Callable[[Score], None]
    done: Mapping[str, str | None] = field(default_factory=dict)

    def __call__(self, row: Score) -> None:
        """Write a row."""
        self.write(row)


@contextmanager
def open_table(
    path: str | os.PathLike[str] | None, *, as_json: bool = False, resume: bool = False, retry: bool = False
) -> Iterator[Writer]:
    """Open what takes the rows: a file, standard output, or a terminal, which gets the table when all rows are there.

    Args:
        path: the file: Parquet if its name ends in .parquet, JSON lines if in .jsonl, else CSV; None for standard
            output.
        as_json: JSON lines instead of CSV, also on a terminal.
        resume: keep the whole rows that the file holds, and write behind them; otherwise they are lost.
        retry: of the rows that the file holds keep those without an error only.

    Yields:
        The function that writes one row, in full or not at all. Its attribute `done` names what the table holds
        already. Rows are in the file at once, but in a Parquet file all of them at the end; until then they are in
        a file beside it, from which a later call resumes.

    Raises:
        OSError: the table cannot be opened or written, or another run is writing it.
        NoTableError: a ValueError: rows are to be kept, and the file is no such table. It is left as it was.
        ImportError: pyarrow, which Parquet needs, is not installed.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     for name in ("a.png", "b.png"):
        ...         with open_table(f"{folder}/scores.jsonl", resume=True) as put:
        ...             put(Score(name))
        ...     [row.path for row in read_table(f"{folder}/scores.jsonl")]
        ['a.png', 'b.png']
    """
    if path is None:
        with _standard_output(as_json) as write:
            yield Writer(write)
        return
    path, resume = Path(path), resume or retry
    if path.suffix.lower() == ".parquet":
        with _parquet_table(path, resume, retry) as writer:
            yield writer
        return
    with LineFile(path) as lines:
        yield _line_writer(lines, path, as_json or path.suffix.lower() == ".jsonl", resume, retry)


def read_table(path: str | os.PathLike[str]) -> Iterator[Score]:
    """Read the rows of a table: CSV, JSON lines, Parquet, or a folder of such files (all of them, sorted by name).

    Raises:
        OSError: it cannot be read.
        NoTableError: a ValueError: it is no table of `torchlinf score`.
        ImportError: pyarrow, which Parquet needs, is not installed.
    """
    path = Path(path)
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in (".csv", ".jsonl", ".parquet"))
        if not files:
            raise NoTableError("the folder holds no .csv, .jsonl or .parquet file")
        for file in files:
            yield from read_table(file)
    elif path.suffix.lower() == ".parquet":
        yield from parquet.rows(path)
    else:
        with path.open("rb") as lines:
            yield from (row for row, _ in parse(lines))


@contextmanager
def _parquet_table(path: Path, resume: bool, retry: bool) -> Iterator[Writer]:
    parquet.require_pyarrow()
    journal = path.with_name(path.name + JOURNAL)
    with LineFile(journal) as lines:
        try:
            before = parquet.done(path) if resume and path.exists() else {}
            after = _line_writer(lines, journal, True, resume, retry)
            if not resume:
                path.resolve().unlink(missing_ok=True)  # a link stays one
            failed = {name for name, error in before.items() if retry and error is not None}
            kept = {name: error for name, error in before.items() if name not in failed}
            yield Writer(after.write, kept | dict(after.done))
            if failed or not path.exists() or journal.stat().st_size:
                _merge(path, journal, failed)
            lines.cut(0)
        finally:
            if journal.stat().st_size == 0:
                journal.unlink()


def _merge(path: Path, journal: Path, failed: set[str]) -> None:
    """Put the journal's rows behind those of a Parquet file; killed and called again, it does the same."""
    real = path.resolve()
    for leftover in real.parent.glob(f".{escape(real.name)}.*.tmp"):  # of a run that was killed right here
        leftover.unlink()
    with journal.open("rb") as file:
        names = {row.path for row, _ in parse(file)}
        file.seek(0)
        parquet.extend(path, (row for row, _ in parse(file)), without=names | failed)


def _line_writer(lines: LineFile, path: Path, as_json: bool, resume: bool, retry: bool) -> Writer:
    done, end = _kept(path, as_json) if resume and path.is_file() else ({}, 0)
    line = json_line if as_json else csv_line
    header = "" if as_json else csv_header()
    lines.cut(end)
    if retry and any(done.values()):
        with path.open("rb") as file:
            lines.replace([header, *(line(row) for row, _ in parse(file) if row.error is None)])
        done = {name: error for name, error in done.items() if error is None}
    elif end == 0 and header:
        lines.write(header)
    return Writer(lambda row: lines.write(line(row)), done)


def _kept(path: Path, as_json: bool) -> tuple[dict[str, str | None], int]:
    """What a table holds, and where its last whole row ends; nothing of any other file may be cut."""
    beginning = JSON_BEGINNING if as_json else csv_header().encode()
    with path.open("rb") as lines:
        start = lines.read(len(beginning))
        if beginning.startswith(start) and start != beginning:  # empty, or killed at once
            return {}, 0
        if start != beginning:
            raise NoTableError(f"it does not begin as {'JSON lines' if as_json else 'CSV'} of this version")
        lines.seek(0)
        done, end = {}, 0 if as_json else len(beginning)
        for row, end in parse(lines):  # noqa: B007  # the end of the last one counts
            done[row.path] = row.error
    return done, end


@contextmanager
def _standard_output(as_json: bool) -> Iterator[Callable[[Score], None]]:
    if not as_json and sys.stdout.isatty():
        rows: list[Score] = []
        try:
            yield rows.append
        finally:
            print_table(rows)
        return
    if not as_json:
        _print(csv_header())
    yield lambda row: _print(json_line(row) if as_json else csv_line(row))


def _print(line: str) -> None:
    sys.stdout.write(line)
    sys.stdout.flush()  # a reader may wait for it
