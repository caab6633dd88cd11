"""The journal of a table: the rows that are scored already, beside the file that they will be in.

A row is appended to the journal as soon as there is one, and the table is made of it at the end, in one piece. So a
run that ends early, however it ends, loses no row, and the next one goes on from the journal.

A line is a row, as a JSON object with a path. Several rows of one source, such as those of a label map, stand on one
line, as {"rows": [...], "instead_of": [...]}: a line that was cut off is dropped as a whole, so that no source is left
half done.
"""

import io
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, Self

from torchlinf.scoring.rows import KINDS, NoTableError, Score, from_cells

JOURNAL = ".part"  # what the name of the table is followed by


class Group(NamedTuple):
    """Rows of one source.

    Attributes:
        rows: all of them.
        instead_of: paths of earlier rows that are no longer true, beside those that `rows` have.
    """

    rows: tuple[Score, ...]
    instead_of: tuple[str, ...] = ()


def rows_of_line(cells: Any) -> list[Any]:
    """The rows, as cells, of a line that has been parsed."""
    if isinstance(cells, dict) and "path" not in cells and isinstance(cells.get("rows"), list):
        return list(cells["rows"])
    return [cells]


class Journal:
    """A file of rows, each a JSON object on a line of its own, which one run at a time writes.

    Each row goes to the system in one unbuffered write. A program that is interrupted or killed leaves no more than one
    incomplete line, at the end; the next run drops it. Rows are not forced onto the disk one by one: that would cost
    more than scoring them, and only a failure of the whole machine could lose them.
    """

    def __init__(self, path: Path, of: Callable[[Mapping[str, Any]], Any] = from_cells) -> None:
        """Open the journal, or make it, and drop an incomplete last line.

        Args:
            path: the file.
            of: makes a row of its cells; a ValueError says that they are none.

        Raises:
            OSError: it cannot be opened, or another run is writing it.
        """
        self._path, self._of = path, of
        self._file = path.open("ab", buffering=0)
        try:
            _lock(self._file, path)
        except OSError:
            self._file.close()
            raise

    def groups(self) -> Iterator[Group]:
        """What is in the journal, line by line; an incomplete last line is dropped from the file.

        Raises:
            NoTableError: a line is not a row.
        """
        size = 0
        with self._path.open("rb") as lines:
            for number, line in enumerate(lines, 1):
                if not line.endswith(b"\n"):
                    break
                try:
                    yield _group(json.loads(line), self._of)
                except ValueError as error:
                    raise NoTableError(f"line {number} of its journal {self._path} is not a row ({error})") from error
                size += len(line)
        if size < os.fstat(self._file.fileno()).st_size:
            self._file.truncate(size)

    def append(self, *rows: Score, instead_of: Sequence[str] = ()) -> None:
        """Append rows, all of one source, in one line; if they cannot be written in full, none is.

        Args:
            rows: any number.
            instead_of: paths of earlier rows that these replace, beside those of the same paths.

        Raises:
            OSError: it cannot be written, for example because the disk is full.
        """
        if not rows and not instead_of:
            return
        data, written = _line(rows, instead_of).encode(), 0
        try:
            while written < len(data):
                written += self._file.write(data[written:])
        except OSError:
            if written:
                self._file.truncate(self._file.seek(-written, io.SEEK_CUR))
            raise

    def clear(self) -> None:
        """Drop all rows."""
        self._file.truncate(0)

    def __len__(self) -> int:
        """Bytes in the journal."""
        return os.fstat(self._file.fileno()).st_size

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        # Removed before the lock goes: another run would find an empty file that is about to vanish.
        if not len(self):
            with suppress(OSError):
                self._path.unlink()
        self._file.close()


def _line(rows: Sequence[Score], instead_of: Sequence[str]) -> str:
    cells = [_filled_cells(row) for row in rows]
    alone = len(rows) == 1 and not instead_of
    return json.dumps(cells[0] if alone else {"rows": cells, "instead_of": list(instead_of)}, allow_nan=False) + "\n"


def _filled_cells(row: Score) -> dict[str, Any]:
    """The cells that hold something, and those of the windows, which tell a row: most rows use few of the columns."""
    cells = row.cells()
    if not row.values:
        return cells
    return {name: cell for name, cell in cells.items() if cell is not None or name not in KINDS}


def _group(cells: Any, of: Callable[[Mapping[str, Any]], Any]) -> Group:
    rows = rows_of_line(cells)
    if not all(isinstance(one, dict) for one in rows):
        raise ValueError("it is not an object")
    instead_of = () if "path" in cells else cells["instead_of"]
    return Group(tuple(map(of, rows)), tuple(instead_of))


def _lock(file: io.FileIO, path: Path) -> None:
    try:
        import fcntl
    except ImportError:
        return
    taken = "another run is writing it"
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise OSError(error.errno, taken) from error
    except OSError:
        return  # file systems without locks
    # That run may have removed the file since it was opened, and let go of it.
    if not (path.exists() and os.path.samestat(path.stat(), os.fstat(file.fileno()))):
        raise OSError(0, taken)
