"""Tables in files: written in one piece at the end, and continued where an earlier run ended."""

import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from glob import escape
from itertools import chain
from pathlib import Path
from typing import Any, TextIO, Unpack

from torchlinf.measure import Measure, MeasureOptions, takes
from torchlinf.scoring import parquet
from torchlinf.scoring.atomic_write import replace_file
from torchlinf.scoring.journal import JOURNAL, Group, Journal
from torchlinf.scoring.options import score_measure
from torchlinf.scoring.rows import KINDS, WINDOWS, NoTableError, Score, columns, csv_line, from_cells, json_line
from torchlinf.scoring.summary import print_table
from torchlinf.scoring.table_files import (
    JSON_LINES,
    PARQUET,
    STANDARD_OUTPUT,
    TableFormat,
    is_table,
    read_cells,
    send_text,
    shown_cells,
    table_format,
    without_index,
    writing,
)


@dataclass(frozen=True)
class Writer:
    """What takes rows, called with one at a time.

    Attributes:
        write: keeps rows, all or none.
        done: of every mask that the table held before, the path and the error, None if there was none.
        failed: of those that are to be scored anew, the path and the error; empty without `retry`.
    """

    write: Callable[..., None]
    done: Mapping[str, str | None] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)

    def __call__(self, *rows: Score, instead_of: Sequence[str] = ()) -> None:
        """Keep the rows of a source, all or none, so that a stopped run leaves no source half done.

        Args:
            rows: each takes the place of an earlier one of the same path.
            instead_of: paths of further rows to drop, such as the failure of a label map whose labels are `rows`.
        """
        self.write(*rows, instead_of=instead_of)


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

    Rows go into a journal beside the file at once, named as the file with ".part" behind, as JSON, the rows of a source
    on one line. At the end of the context the file is made of the journal, in one piece, and the journal is removed. If
    the context ends by an exception, or the program is killed, the journal stays and a later call resumes from it.

    Args:
        path: the file: CSV (.csv, or no suffix), .tsv, JSON lines (.jsonl), each also with .gz behind, or Parquet
            (.parquet); None or "-" for standard output. Into standard output, and into what is not a plain file, rows
            go at once, as CSV. None draws a table if standard output is a terminal.
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
        ValueError: no table is written in the format of this suffix.
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
    if path is None or os.fspath(path) == STANDARD_OUTPUT:
        with _stream(sys.stdout, as_json, measure, drawn=path is None) as write:
            yield Writer(write)
        return
    path, resume = Path(path), resume or retry
    if path.exists() and not path.is_file():
        with path.open("w", encoding="utf-8", newline="") as file, _stream(file, as_json, measure) as write:
            yield Writer(write)
        return
    if table_format(path, as_json=as_json).kind == PARQUET:
        parquet.require_pyarrow()
    names = columns(measure.named_windows())
    with Journal(path.with_name(path.name + JOURNAL)) as journal:
        if not resume:
            path.resolve().unlink(missing_ok=True)  # a link stays one
            journal.clear()
        held: dict[str, str | None] = {}
        if path.exists():
            held = {row.path: row.error for row in _rows_to_continue(path, measure)}
        for group in journal.groups():
            for name in group.instead_of:
                held.pop(name, None)
            for row in group.rows:
                _require_measure(row, measure)
                held[row.path] = row.error
        failed = {name: error for name, error in held.items() if retry and error is not None}
        yield Writer(journal.append, {name: error for name, error in held.items() if name not in failed}, failed)
        if len(journal) or not path.exists():
            _convert(journal, path, names, as_json)
            journal.clear()


def write_table(
    path: str | os.PathLike[str], rows: Iterable[Score], *, columns: Sequence[str], as_json: bool = False
) -> None:
    """Write a whole table in one piece: there is the whole file at the end, or what was there before.

    A text that a spreadsheet would take for a formula, since it begins with `=`, `+`, `-`, `@` or a line break or tab,
    has an apostrophe in front in CSV. `read_table` takes it away again.

    Args:
        path: the file: CSV (.csv, or no suffix), .tsv, JSON lines (.jsonl), each also with .gz behind, or Parquet
            (.parquet).
        rows: any number; they are taken one after the other.
        columns: names of the columns, those of every row.
        as_json: JSON lines whatever the name.

    Raises:
        ValueError: no table is written in the format of this suffix.
        OSError: the file cannot be written.
        ImportError: pyarrow, which Parquet needs, is not installed.
    """
    path = Path(path)
    form = table_format(path, as_json=as_json)

    def write(temporary: Path) -> None:
        if form.kind == PARQUET:
            parquet.require_pyarrow()
            parquet.write(temporary, rows, columns)
            return
        with writing(temporary, form.compressed) as file:
            file.writelines(_lines(rows, columns, form))

    replace_file(path, write)


def read_table(path: str | os.PathLike[str]) -> Iterator[Score]:
    """Read the rows of a table: CSV, JSON lines, Parquet, or a folder of such files (all of them, sorted by name).

    The table may have been saved by another program: with an index, further columns, which are passed over, columns in
    another order, whole numbers as 31.0, a byte order mark, other line ends, semicolons or tabs between the cells. It
    needs the column `path` and one of complexity; columns that are missing are None in every row.

    Args:
        path: the file or folder. A file that begins with "{" or "[" holds JSON, like the journal of a run that goes on,
            whose name ends in .part; all other text is CSV. Files may be compressed by gzip.

    Yields:
        Rows, one after the other.

    Raises:
        OSError: it cannot be read.
        NoTableError: a ValueError: it is not a table of `torchlinf score`.
        ImportError: pyarrow, which Parquet needs, is not installed.
    """
    path = Path(path)
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if is_table(file))
        if not files:
            raise NoTableError("the folder holds no .csv, .tsv, .jsonl or .parquet file")
        for file in files:
            yield from read_table(file)
    else:
        yield from (row for _, row in _rows(path, _require_path))


def _rows(path: Path, check: Callable[[tuple[str, ...]], None]) -> Iterator[tuple[Mapping[str, Any], Score]]:
    """The rows of a file, each with the cells that it was made of."""
    for where, cells in read_cells(path, check):
        try:
            yield cells, from_cells(cells)
        except NoTableError:
            raise
        except ValueError as error:
            raise NoTableError(f"it holds a line that is not a row ({where}: {error})") from error


def _require_path(names: tuple[str, ...]) -> None:
    if "path" not in names:
        raise NoTableError("its columns are not those of a table of scores: there is no path")


def _require_columns(names: tuple[str, ...]) -> None:
    _require_path(names)
    if missing := [name for name in KINDS if name not in names]:
        raise NoTableError(f"its columns are not all those of this version: there is no {', '.join(missing)}")


def _rows_to_continue(path: Path, measure: Measure) -> Iterator[Score]:
    """The rows of a table that will be written anew, which must have all columns, and none that others have added."""
    known: tuple[str, ...] = ()
    for cells, row in _rows(path, _require_columns):
        _require_measure(row, measure)
        if tuple(cells) != known:
            known = tuple(cells)
            added = [name for name in without_index(known) if name not in KINDS and name not in row.values]
            if added:
                raise NoTableError(f"its columns {', '.join(added)} were added by others, and would be lost")
        yield row


def _convert(journal: Journal, path: Path, columns: Sequence[str], as_json: bool) -> None:
    """Put the journal's rows behind those of a table; a row takes the place of earlier ones of the same mask."""
    real = path.resolve()
    for leftover in real.parent.glob(f".{escape(real.name)}.*.tmp"):  # of a run that was killed right here
        leftover.unlink()
    replaced = Counter(name for group in journal.groups() for name in _replaced(group))

    def last(group: Group) -> list[Score]:
        replaced.subtract(_replaced(group))
        return [row for row in group.rows if not replaced[row.path]]

    before = (row for row in read_table(path) if row.path not in replaced) if path.exists() else ()
    rows = chain(before, chain.from_iterable(map(last, journal.groups())))
    write_table(path, rows, columns=columns, as_json=as_json)


def _replaced(group: Group) -> list[str]:
    """The paths of which earlier rows are dropped."""
    return [*group.instead_of, *(row.path for row in group.rows)]


def _require_measure(row: Score, measure: Measure) -> None:
    """Raise if a row was not measured like this."""
    settings, windows = measure.settings(), list(measure.named_windows())
    if row.measure == settings and (missing := [name for name in windows if name not in row.values]):
        raise NoTableError(f"its columns are not all those of its measure: there is no {', '.join(missing)}")
    if (row.measure, list(row.values)) != (settings, windows):
        raise NoTableError(f"its rows were measured with other options, {row.measure}; got {settings}")


def _lines(rows: Iterable[Score], columns: Sequence[str], form: TableFormat) -> Iterator[str]:
    if form.kind == JSON_LINES:
        yield from map(json_line, rows)
        return
    yield csv_line(columns, delimiter=form.delimiter)
    yield from (csv_line(row.cells().values(), delimiter=form.delimiter) for row in rows)


@contextmanager
def _stream(file: TextIO, as_json: bool, measure: Measure, drawn: bool = False) -> Iterator[Callable[..., None]]:
    """What sends each row on at once, as text.

    Args:
        file: where to. What its encoding does not have goes there as an escape.
        as_json: JSON lines instead of CSV.
        measure: how the rows were measured.
        drawn: for a terminal, the table for people when the context ends, instead of CSV.
    """
    is_terminal = file.isatty()
    if drawn and is_terminal and not as_json:
        shown: list[Score] = []
        try:
            yield lambda *rows, instead_of=(): shown.extend(rows)
        finally:
            print_table(shown)
        return

    def line(cells: Iterable[Any]) -> str:
        return csv_line(shown_cells(cells) if is_terminal else cells)

    def send(*rows: Score, instead_of: Sequence[str] = ()) -> None:
        """Send rows on; what has been sent before stays."""
        send_text(file, "".join(json_line(row) if as_json else line(row.cells().values()) for row in rows))

    if not as_json:
        send_text(file, line(columns(measure.named_windows())))
    yield send
