"""One row of the table, and rows as text: to CSV and JSON lines, and back."""

import csv
import io
import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, astuple, dataclass, fields
from itertools import chain
from typing import Any, get_args, get_type_hints


class NoTableError(ValueError):
    """A file is no table that `torchlinf score` has written; the message says why, in words."""


@dataclass(frozen=True)
class Score:
    """One row of the table: what is known of one mask. The fields are the columns, in this order.

    A field is None where there is nothing to say: `depth` of a 2-D mask, and of a failed one all that was not reached.

    Attributes:
        path: the file as it was found, and of a file that holds several masks which one, as in "shard.tar:a/1.png".
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


COLUMNS = tuple(field.name for field in fields(Score))

# int, float or str, by column.
KINDS: dict[str, Any] = {name: (get_args(kind) or (kind,))[0] for name, kind in get_type_hints(Score).items()}


def csv_header() -> str:
    """First line of the table: the columns."""
    return ",".join(COLUMNS) + "\n"


def csv_line(row: Score) -> str:
    r"""One row as CSV: an empty cell for None, numbers in full precision.

    >>> csv_line(Score("a,b.png", height=3, error="no foreground"))
    '"a,b.png",3,,,,,,,,,,,,,no foreground\n'
    """
    text = io.StringIO()
    # Before Python 3.13 a carriage return in a cell is quoted only if it ends lines too.
    csv.writer(text, lineterminator="\r\n").writerow(astuple(row))
    return text.getvalue().removesuffix("\r\n") + "\n"


def json_line(row: Score) -> str:
    r"""One row as a JSON object on a line of its own: null for None.

    >>> json_line(Score("a.png", height=3))[:32]
    '{"path": "a.png", "height": 3, "'
    """
    return json.dumps(asdict(row), allow_nan=False) + "\n"


def parse(lines: Iterable[bytes]) -> Iterator[tuple[Score, int]]:
    r"""Read a table back, CSV or JSON lines.

    Args:
        lines: of the file, each with its line break, such as the file itself.

    Yields:
        Rows, and how many bytes from the start each ends. What was being written when the program was killed, a row
        without an end, is left out.

    Raises:
        NoTableError: the columns are others, or a row is none.

    Example:
        >>> line = csv_line(Score("a.png", height=3)).encode()
        >>> [(row.path, row.height, end) for row, end in parse([csv_header().encode(), line, line[:5]])]
        [('a.png', 3, 154)]
    """
    lines, header = iter(lines), csv_header().encode()
    first = next(lines, b"")
    as_json = first.startswith(b"{")
    if not as_json and not header.startswith(first):
        raise NoTableError("its first line does not name the columns of this version")
    position = 0 if as_json else len(first)
    for record in _records(chain([first], lines) if as_json else lines, as_json):
        position += len(record)
        try:
            row = _from_json(record.decode()) if as_json else _from_csv(record.decode())
        except (ValueError, TypeError, csv.Error) as error:
            raise NoTableError(f"the row that ends at byte {position} is none ({error})") from error
        yield row, position


def _records(lines: Iterable[bytes], as_json: bool) -> Iterator[bytes]:
    """Lines, joined where a line break stands within quotes; the last one only if it is whole."""
    parts: list[bytes] = []
    quotes = 0
    for line in lines:
        parts.append(line)
        quotes += line.count(b'"')
        # In JSON lines a line break is always an end; quotes there are escaped with backslashes, and may be odd.
        if line.endswith(b"\n") and (as_json or quotes % 2 == 0):
            yield b"".join(parts)
            parts, quotes = [], 0


def _from_csv(record: str) -> Score:
    (cells,) = csv.reader(io.StringIO(record, newline=""))
    named = zip(COLUMNS, cells, strict=True)
    values: dict[str, Any] = {name: None if cell == "" else KINDS[name](cell) for name, cell in named}
    return Score(**values)


def _from_json(record: str) -> Score:
    row = Score(**json.loads(record))
    if not isinstance(row.path, str):
        raise TypeError(f"its path is {row.path!r}")
    return row
