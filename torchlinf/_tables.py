"""The table: its row, its forms as text, and files that hold whole rows only, whenever the writing ends."""

import csv
import io
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import asdict, astuple, dataclass, fields
from pathlib import Path
from typing import Self


@dataclass(frozen=True)
class Score:
    """One row of the table: what is known of one mask. The fields are the columns, in this order.

    A field is None where there is nothing to say: `depth` of a 2-D mask, and of a failed one all that was not reached.

    Attributes:
        path: the file as it was found; of an .npz archive with several arrays "file.npz:array".
        height: rows of the image, pixels.
        width: columns of the image, pixels.
        depth: pages of the volume, pixels; None in 2-D.
        pixels: how many pixels are inside.
        radius: largest chessboard distance D to the outside, pixels.
        components: connected components; pixels that touch at a corner are connected, as they are for the field.
        complexity: mean over all scales (0, 1], bits.
        complexity_low: mean over (0, 0.25], bits: small features at the boundary.
        complexity_high: mean over (0.25, 1], bits: the coarse form.
        peak: largest value of a level, bits.
        peak_scale: scale k/D of the first level that reaches it, in (0, 1].
        error_bound: certified relative error of the field.
        seconds: time taken to read and score the mask.
        error: what went wrong, in words; None if nothing did.
    """

    path: str
    height: int | None = None
    width: int | None = None
    depth: int | None = None
    pixels: int | None = None
    radius: int | None = None
    components: int | None = None
    complexity: float | None = None
    complexity_low: float | None = None
    complexity_high: float | None = None
    peak: float | None = None
    peak_scale: float | None = None
    error_bound: float | None = None
    seconds: float | None = None
    error: str | None = None


CAPTION = (
    "D: radius in pixels. fine: scales up to 1/4. coarse: all others. at: scale of the peak. Complexities in bits."
)

COLUMNS = tuple(field.name for field in fields(Score))


def csv_header() -> str:
    """First line of the table: the columns."""
    return ",".join(COLUMNS) + "\n"


def csv_line(row: Score) -> str:
    r"""One row as CSV: an empty cell for None, numbers in full precision.

    >>> csv_line(Score("a,b.png", height=3, error="no foreground"))
    '"a,b.png",3,,,,,,,,,,,,,no foreground\n'
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(astuple(row))
    return text.getvalue()


def json_line(row: Score) -> str:
    r"""One row as a JSON object on a line of its own: null for None.

    >>> json_line(Score("a.png", height=3))[:32]
    '{"path": "a.png", "height": 3, "'
    """
    return json.dumps(asdict(row), allow_nan=False) + "\n"


@contextmanager
def open_table(path: str | os.PathLike[str] | None, as_json: bool = False) -> Iterator[Callable[[Score], None]]:
    """Open what takes the rows: a file, standard output, or a terminal, which gets the table when all rows are there.

    Args:
        path: the file; None for standard output.
        as_json: JSON lines instead of CSV, also on a terminal.

    Yields:
        The function that writes one row, in full or not at all.

    Raises:
        OSError: the table cannot be opened or written.
    """
    if path is None and not as_json and sys.stdout.isatty():
        rows: list[Score] = []
        try:
            yield rows.append
        finally:
            print_table(rows)
        return
    line = json_line if as_json else csv_line
    with LineFile(Path(path)) if path else nullcontext(StandardOutput()) as file:
        if not as_json:
            file.write(csv_header())
        yield lambda row: file.write(line(row))


def print_table(rows: Sequence[Score]) -> None:
    """Print rows for people: short names, few digits, and below the table what failed and why."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console, folder = Console(highlight=False), _common_folder(rows)
    names = [os.path.relpath(row.path, folder) if folder else row.path for row in rows]
    table = Table(title=escape(folder), caption=CAPTION, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("mask", overflow="fold")
    for title in ("pixels", "D", "parts", "complexity", "fine", "coarse", "peak", "at"):
        table.add_column(title, justify="right", no_wrap=True)
    for name, row in zip(names, rows, strict=True):
        if row.error is None:
            counts = (row.pixels, row.radius, row.components)
            bits = (row.complexity, row.complexity_low, row.complexity_high, row.peak)
            table.add_row(escape(name), *map(str, counts), *(f"{x:.3f}" for x in bits), f"{row.peak_scale:.2f}")
    if table.row_count:
        console.print(table)
    for name, row in zip(names, rows, strict=True):
        if row.error is not None:
            console.print(f"[red]failed[/] {escape(name)}: {escape(row.error)}", soft_wrap=True)


def _common_folder(rows: Sequence[Score]) -> str:
    """The folder that the names can be cut by; empty if there is none but the root."""
    try:
        folder = os.path.commonpath([os.path.dirname(row.path) for row in rows])
    except ValueError:  # no rows, or absolute paths beside relative ones
        return ""
    return "" if folder == os.path.dirname(folder) else folder


class StandardOutput:
    """Standard output, line by line, for a reader who waits for them."""

    def write(self, line: str) -> None:
        """Write a line, which ends with a line break."""
        sys.stdout.write(line)
        sys.stdout.flush()


class LineFile:
    """A text file of whole lines.

    Each line goes to the system in one unbuffered write: a program that is interrupted or killed leaves no half line,
    and what was written can be read while the program still runs.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=0)

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
