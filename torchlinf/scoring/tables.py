"""Tables in files: written in one piece at the end, and continued where an earlier run ended."""

import csv
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from glob import escape
from itertools import chain
from pathlib import Path
from typing import TextIO, Unpack

from torchlinf.measure import Measure, MeasureOptions, takes
from torchlinf.scoring import parquet
from torchlinf.scoring.atomic_write import replace_file
from torchlinf.scoring.journal import JOURNAL, Journal
from torchlinf.scoring.names import split_name
from torchlinf.scoring.options import score_measure
from torchlinf.scoring.rows import (
    WINDOWS,
    NoTableError,
    Score,
    columns,
    csv_line,
    from_csv,
    from_json,
    json_line,
    window_columns,
)
from torchlinf.scoring.summary import print_table


@dataclass(frozen=True)
class Writer:
    """What takes rows, called with one at a time.

    Attributes:
        write: keeps rows, all or none.
        done: of every mask that the table held before, the path and the error, None if there was none.
        failed: paths of the masks that the table held before with an error; with `retry` they are not in `done`.
    """

    write: Callable[..., None]
    done: Mapping[str, str | None] = field(default_factory=dict)
    failed: frozenset[str] = frozenset()

    def __call__(self, *rows: Score) -> None:
        """Keep the rows of a source, all or none, so that a stopped run leaves no source half done."""
        self.write(*rows)


@takes(MeasureOptions, windows=WINDOWS)
@contextmanager
def open_table(
    path: str | os.PathLike[str] | None,
    *,
    as_json: bool = False,
    resume: bool = False,
    retry: bool = False,
    **options: Unpack[MeasureOptions],
) -> Iterator[Writer]:
    """Open what takes the rows: a file, standard output, or a terminal, which gets the table when all rows are there.

    Rows go into a journal beside the file at once, named as the file with ".part" behind, each as a JSON object on a
    line. At the end of the context the file is made of the journal, in one piece, and the journal is removed. If the
    context ends by an exception, or the program is killed, the journal stays and a later call resumes from it.

    Args:
        path: the file: Parquet if its name ends in .parquet, JSON lines if in .jsonl, else CSV; None for standard
            output. Into standard output, and into what is not a plain file, rows go at once.
        as_json: JSON lines instead of CSV, also on a terminal.
        resume: keep the rows that the file and its journal hold, and add to them; otherwise both are removed.
        retry: as `resume`, but rows with an error are not in `done`; a new row takes the place of an old one.
        {measure options}

    Yields:
        The function that takes a row, or several. Its attribute `done` names the masks that the table holds already.

    Raises:
        OSError: the table cannot be opened or written, or another run is writing it.
        NoTableError: a ValueError: rows are to be kept, and the file is not a table of scores, or its rows were
            measured with other options. It is left as it was.
        ImportError: pyarrow, which Parquet needs, is not installed.

    Example:
        >>> import tempfile
        >>> from torchlinf.scoring import find_masks, score_masks
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     for name in ("a.png", "b.png"):
        ...         with open_table(f"{folder}/scores.jsonl", resume=True) as put:
        ...             for row in score_masks(find_masks([name])):
        ...                 put(row)
        ...     [row.path for row in read_table(f"{folder}/scores.jsonl")]
        ['a.png', 'b.png']
    """
    measure = score_measure(options)
    if path is None:
        with _stream(sys.stdout, as_json, measure) as write:
            yield Writer(write)
        return
    path, resume = Path(path), resume or retry
    if path.exists() and not path.is_file():
        with path.open("w", encoding="utf-8", newline="") as file, _stream(file, as_json, measure) as write:
            yield Writer(write)
        return
    if path.suffix.lower() == ".parquet":
        parquet.require_pyarrow()
    with Journal(path.with_name(path.name + JOURNAL)) as journal:
        if not resume:
            path.resolve().unlink(missing_ok=True)  # a link stays one
            journal.clear()
        kept = chain(read_table(path) if path.exists() else (), journal.rows())
        done: dict[str, str | None] = {}
        for row in _of_this_measure(kept, measure):
            if done.get(source := split_name(row.path)[0]) is not None:
                del done[source]  # it failed as a whole, and was scored again
            done[row.path] = row.error
        failed = frozenset(name for name, error in done.items() if error is not None)
        yield Writer(journal.append, {name: done[name] for name in done if not (retry and name in failed)}, failed)
        if len(journal) or not path.exists():
            _convert(journal, path, columns(measure.named_windows()), as_json)
            journal.clear()


def write_table(
    path: str | os.PathLike[str], rows: Iterable[Score], *, columns: Sequence[str], as_json: bool = False
) -> None:
    """Write a whole table in one piece: there is the whole file at the end, or what was there before.

    Args:
        path: the file: Parquet if its name ends in .parquet, JSON lines if in .jsonl, else CSV.
        rows: any number; they are taken one after the other.
        columns: names of the columns, those of every row.
        as_json: JSON lines whatever the name.

    Raises:
        OSError: the file cannot be written.
        ImportError: pyarrow, which Parquet needs, is not installed.
    """
    path = Path(path)

    def write(temporary: Path) -> None:
        if path.suffix.lower() == ".parquet":
            parquet.require_pyarrow()
            parquet.write(temporary, rows, columns)
            return
        with temporary.open("w", encoding="utf-8", newline="") as file:
            file.writelines(_lines(rows, columns, as_json or path.suffix.lower() == ".jsonl"))

    replace_file(path, write)


def read_table(path: str | os.PathLike[str]) -> Iterator[Score]:
    """Read the rows of a table: CSV, JSON lines, Parquet, or a folder of such files (all of them, sorted by name).

    Args:
        path: the file or folder. A file that begins with "{" holds JSON lines, like the journal of a run that goes on,
            whose name ends in .part; all other text is CSV.

    Yields:
        Rows, one after the other.

    Raises:
        OSError: it cannot be read.
        NoTableError: a ValueError: it is not a table of `torchlinf score`.
        ImportError: pyarrow, which Parquet needs, is not installed.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in (".csv", ".jsonl", ".parquet"))
        if not files:
            raise NoTableError("the folder holds no .csv, .jsonl or .parquet file")
        for file in files:
            yield from read_table(file)
    elif suffix == ".parquet":
        yield from parquet.read(path)
    else:
        yield from _read_text(path)


def _convert(journal: Journal, path: Path, columns: Sequence[str], as_json: bool) -> None:
    """Put the journal's rows behind those of a table; a row takes the place of earlier ones of the same mask.

    The rows of a map or stack also take the place of the one row that said why it had none.
    """
    real = path.resolve()
    for leftover in real.parent.glob(f".{escape(real.name)}.*.tmp"):  # of a run that was killed right here
        leftover.unlink()
    coming = Counter(row.path for row in journal.rows())
    parts = {source for row in journal.rows() if row.error is None and (source := split_name(row.path)[0]) != row.path}

    def is_last(row: Score) -> bool:
        coming[row.path] -= 1
        return not coming[row.path]

    def is_kept(row: Score) -> bool:
        return row.path not in coming and not (row.error is not None and row.path in parts)

    before = filter(is_kept, read_table(path)) if path.exists() else ()
    write_table(path, chain(before, filter(is_last, journal.rows())), columns=columns, as_json=as_json)


def _of_this_measure(rows: Iterable[Score], measure: Measure) -> Iterator[Score]:
    """The rows, if each was measured like this."""
    settings, windows = measure.settings(), tuple(measure.named_windows())
    for row in rows:
        if (row.measure, tuple(row.values)) != (settings, windows):
            raise NoTableError(f"its rows were measured with other options, {row.measure}; got {settings}")
        yield row


def _read_text(path: Path) -> Iterator[Score]:
    """The rows of CSV or JSON lines; of a journal, which may be written just now, the complete lines."""
    suffix = path.suffix.lower()
    with path.open(encoding="utf-8", newline="") as file:
        try:
            is_json = suffix in (".jsonl", JOURNAL) or file.read(1) == "{"
            file.seek(0)
            if is_json:
                yield from (from_json(line) for line in file if suffix != JOURNAL or line.endswith("\n"))
            else:
                yield from _from_csv_lines(file)
        except NoTableError:
            raise
        except (ValueError, csv.Error) as error:
            raise NoTableError(f"it holds a line that is not a row ({error})") from error


def _from_csv_lines(file: TextIO) -> Iterator[Score]:
    lines = csv.reader(file, strict=True)
    names = next(lines, [])
    window_columns(names)
    return (from_csv(names, cells) for cells in lines)


def _lines(rows: Iterable[Score], columns: Sequence[str], as_json: bool) -> Iterator[str]:
    if as_json:
        yield from map(json_line, rows)
        return
    yield csv_line(columns)
    yield from (csv_line(row.cells().values()) for row in rows)


@contextmanager
def _stream(file: TextIO, as_json: bool, measure: Measure) -> Iterator[Callable[..., None]]:
    """What sends each row on at once, as text; for a terminal, the table for people when the context ends."""
    if not as_json and file.isatty():
        shown: list[Score] = []
        try:
            yield lambda *rows: shown.extend(rows)
        finally:
            print_table(shown)
        return

    def send(line: str) -> None:
        file.write(line)
        file.flush()  # a reader may wait for it

    if not as_json:
        send(csv_line(columns(measure.named_windows())))
    yield lambda *rows: send("".join(json_line(row) if as_json else csv_line(row.cells().values()) for row in rows))
