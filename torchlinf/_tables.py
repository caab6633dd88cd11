"""Tables in files: of whole rows only, whenever the writing ends, and continued where it ended."""

import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from torchlinf import _parquet
from torchlinf._rows import NoTableError, Score, csv_header, csv_line, json_line, parse
from torchlinf._terminal import print_table

JSON_BEGINNING = b'{"path": '
JOURNAL = ".part"  # what is scored already, beside a Parquet file, which is written in one piece at the end


@dataclass(frozen=True)
class Writer:
    """What takes rows, called with one at a time.

    Attributes:
        write: writes a row, in full or not at all.
        done: paths of the rows that the table held before.
    """

    write: Callable[[Score], None]
    done: frozenset[str] = frozenset()

    def __call__(self, row: Score) -> None:
        """Write a row."""
        self.write(row)


@contextmanager
def open_table(path: str | os.PathLike[str] | None, as_json: bool = False, *, resume: bool = False) -> Iterator[Writer]:
    """Open what takes the rows: a file, standard output, or a terminal, which gets the table when all rows are there.

    Args:
        path: the file, Parquet if its name ends in .parquet; None for standard output.
        as_json: JSON lines instead of CSV, also on a terminal.
        resume: keep the whole rows that the file holds, and write behind them; otherwise they are lost.

    Yields:
        The function that writes one row, in full or not at all. Its attribute `done` names what the table holds
        already. Rows are in the file at once, but in a Parquet file all of them at the end; until then they are in
        a file beside it, from which a later call resumes.

    Raises:
        OSError: the table cannot be opened or written, or another run is writing it.
        NoTableError: a ValueError: `resume` is set and the file is no such table.
        ImportError: pyarrow, which Parquet needs, is not installed.
    """
    if path is None:
        with _standard_output(as_json) as write:
            yield Writer(write)
        return
    path = Path(path)
    with ExitStack() as stack:
        if path.suffix.lower() == ".parquet":
            _parquet.require_pyarrow()
            journal = path.with_name(path.name + JOURNAL)
            lines = stack.enter_context(LineFile(journal))
            before = _parquet.names(path) if resume else frozenset()
            if not resume:
                path.unlink(missing_ok=True)
            yield _writer(lines, journal, as_json=True, resume=resume, before=before)
            with journal.open("rb") as file:
                new = (row for row, _ in parse(file) if row.path not in before)
                _parquet.extend(path, new)
            journal.unlink()
        else:
            lines = stack.enter_context(LineFile(path))
            yield _writer(lines, path, as_json=as_json, resume=resume)


def read_table(path: str | os.PathLike[str]) -> Iterator[Score]:
    """Read the rows of a table: CSV, JSON lines, Parquet, or a folder of such files (all of them, sorted by name).

    Raises:
        OSError: it cannot be read.
        NoTableError: a ValueError: it is no table of `torchlinf score`.
        ImportError: pyarrow, which Parquet needs, is not installed.
    """
    path = Path(path)
    if path.is_dir():
        for file in sorted(path.iterdir()):
            if file.suffix.lower() in (".csv", ".jsonl", ".parquet"):
                yield from read_table(file)
    elif path.suffix.lower() == ".parquet":
        yield from _parquet.rows(path)
    else:
        with path.open("rb") as lines:
            yield from (row for row, _ in parse(lines))


def _writer(
    lines: "LineFile", path: Path, *, as_json: bool, resume: bool, before: frozenset[str] = frozenset()
) -> Writer:
    done, end = _kept(path, as_json) if resume and path.is_file() else (frozenset[str](), 0)
    lines.cut(end)
    if not as_json and end == 0:
        lines.write(csv_header())
    line = json_line if as_json else csv_line
    return Writer(lambda row: lines.write(line(row)), before | done)


def _kept(path: Path, as_json: bool) -> tuple[frozenset[str], int]:
    """The paths in a table, and where its last whole row ends; nothing of any other file may be cut."""
    beginning = JSON_BEGINNING if as_json else csv_header().encode()
    with path.open("rb") as lines:
        start = lines.read(len(beginning))
        if beginning.startswith(start) and start != beginning:  # empty, or killed at once
            return frozenset(), 0
        if start != beginning:
            raise NoTableError(f"it does not begin as {'JSON lines' if as_json else 'CSV'} of this version")
        lines.seek(0)
        names, end = set(), 0 if as_json else len(beginning)
        for row, end in parse(lines):  # noqa: B007  # the end of the last one counts
            names.add(row.path)
    return frozenset(names), end


@contextmanager
def _standard_output(as_json: bool) -> Iterator[Callable[[Score], None]]:
    if not as_json and sys.stdout.isatty():
        rows: list[Score] = []
        try:
            yield rows.append
        finally:
            print_table(rows)
        return
    file = StandardOutput()
    if not as_json:
        file.write(csv_header())
    yield lambda row: file.write(json_line(row) if as_json else csv_line(row))


class StandardOutput:
    """Standard output, line by line, for a reader who waits for them."""

    def write(self, line: str) -> None:
        """Write a line, which ends with a line break."""
        sys.stdout.write(line)
        sys.stdout.flush()


class LineFile:
    """A text file of whole lines, which one run at a time writes.

    Each line goes to the system in one unbuffered write: a program that is interrupted or killed leaves no half line,
    and what was written can be read while the program still runs.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("ab", buffering=0)
        _lock(self._file)

    def cut(self, size: int) -> None:
        """Drop what stands behind the first `size` bytes."""
        with suppress(io.UnsupportedOperation):
            if self._file.seekable() and os.fstat(self._file.fileno()).st_size > size:
                self._file.truncate(size)

    def write(self, line: str) -> None:
        """Append a line, which ends with a line break; if it cannot be written in full, not at all.

        Raises:
            OSError: it cannot be written, for example because the disk is full.
        """
        data, written = line.encode(), 0
        try:
            while written < len(data):
                written += self._file.write(data[written:])
        except OSError:
            if written:
                with suppress(OSError):  # a pipe cannot be cut back
                    self._file.truncate(self._file.seek(-written, io.SEEK_CUR))
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


def _lock(file: io.FileIO) -> None:
    try:
        import fcntl
    except ImportError:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        file.close()
        raise OSError(error.errno, "another run is writing it") from error
    except OSError:
        return  # file systems without locks
