"""One row of a table of scores: which columns it has, and the row as text."""

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any, get_args, get_type_hints

from torchlinf.scoring.cells import guarded, number_value, text_value

# The windows of scales that a table of scores has if the caller names none: all scales, fine ones, coarse ones.
WINDOWS: Mapping[str, tuple[float, float]] = {
    "complexity": (0.0, 1.0),
    "complexity_low": (0.0, 0.25),
    "complexity_high": (0.25, 1.0),
}


class NoTableError(ValueError):
    """A file is not a table that `torchlinf score` has written, or not one of these settings; the message says why."""


@dataclass(frozen=True)
class Score:
    """One row of a table: what is known of one mask. `row["pixels"]` is the value of a column, by its name.

    A value is None where there is nothing to say: `depth` of a 2-D mask, the complexity of a mask without a pixel
    inside, and of a mask that failed all that was not reached. In CSV it is an empty cell, in JSON null; pandas reads
    both as NaN.

    Attributes:
        path: the file as it was found, and of a file that holds several masks which one, as in "shard.tar:a/1.png".
        height: rows of the image, pixels.
        width: columns of the image, pixels.
        depth: pages of the volume, pixels; None in 2-D.
        pixels: how many pixels are inside.
        radius: largest chessboard distance D to the outside, pixels.
        components: connected components; pixels that touch at a corner are connected, as they are for the field.
        values: the mean complexity over each window of scales, by the name of the window, in bits (a share of the
            field's maximum for the estimator "std"). Each name is a column of its own.
        peak: largest value of a level, in the same unit.
        peak_scale: scale k/D of the first level that reaches it, in (0, 1].
        error_bound: how far any of `values` can be from that of the exact field, proven, in their unit.
        field_error_bound: certified relative error of the field.
        seconds: time taken to read and score the mask.
        inside: which rule says what is inside: "nonzero", a threshold such as "> 127", "label 3", or "outline"; of an
            inverted mask with "not " before it, and with what was ignored, as in "nonzero except 255".
        spacing: the size of a pixel along each axis, and of the cubes that the mask was brought to before it was
            measured, as "3 x 0.9 x 0.9 in cubes of 0.9"; None if the pixels were measured as they are. `radius`,
            `peak_scale` and the complexity are then those of the cubes.
        label: the label that the mask is of, if every label of a map has a row.
        object: the number of the object in its mask, from 1, if every object has a row; then all other numbers of the
            row but `height`, `width` and `depth` are those of the object.
        objects: how many objects the mask has, if its numbers are pooled from those of its objects.
        top: first row of the object in the image; this and the next five are None where a row is not one of an object.
        bottom: the row behind its last one.
        left: its first column.
        right: the column behind its last one.
        front: its first page; None in 2-D.
        back: the page behind its last one; None in 2-D.
        angle: degrees by which the shape was turned before it was measured, counter-clockwise; None where it was
            measured along the axes of the image, turned by a matrix, or has several parts.
        standard_error: how far any of `values` would vary if other rotations were taken, the largest standard error;
            None unless `orientation="mean"`.
        category: of an annotation in a COCO file, its category: the name if the file has one, else the id; the label in
            a labelme file.
        image: of an annotation in a COCO file, its image: the file name if the file has one, else the id.
        error: what went wrong, in words; None if nothing did.
        version: the version of torchlinf that scored the mask.
        measure: how complexity was measured, all options as JSON; see `torchlinf.Measure.settings`.
    """

    path: str
    height: int | None = None
    width: int | None = None
    depth: int | None = None
    pixels: int | None = None
    radius: int | None = None
    components: int | None = None
    values: Mapping[str, float | None] = field(default_factory=dict)
    peak: float | None = None
    peak_scale: float | None = None
    error_bound: float | None = None
    field_error_bound: float | None = None
    seconds: float | None = None
    inside: str | None = None
    spacing: str | None = None
    label: int | None = None
    object: int | None = None
    objects: int | None = None
    top: int | None = None
    bottom: int | None = None
    left: int | None = None
    right: int | None = None
    front: int | None = None
    back: int | None = None
    angle: float | None = None
    standard_error: float | None = None
    category: str | None = None
    image: str | None = None
    error: str | None = None
    version: str | None = None
    measure: str | None = None

    def cells(self) -> dict[str, Any]:
        """The values of all columns by name, in the order of the columns.

        >>> list(Score("a.png", pixels=3, values={"fine": 0.5}).cells())[4:8]
        ['pixels', 'radius', 'components', 'fine']
        """
        return dict(_named(self))

    def __getitem__(self, column: str) -> Any:
        """The value of a column."""
        return self.values[column] if column in self.values else self.cells()[column]

    @classmethod
    def of(cls, cells: Mapping[str, Any]) -> "Score":
        """The row that `cells` returns these values for.

        >>> Score.of(Score("a.png", pixels=3, values={"fine": 0.5}).cells()).values
        {'fine': 0.5}
        """
        own = {name: value for name, value in cells.items() if name in KINDS}
        return cls(**own, values={name: value for name, value in cells.items() if name not in KINDS})


def _named(row: Score) -> Iterator[tuple[str, Any]]:
    for one in fields(row):
        if one.name == "values":
            yield from row.values.items()
        else:
            yield one.name, getattr(row, one.name)


def columns(windows: Iterable[str]) -> tuple[str, ...]:
    """The columns of a table with windows of these names.

    >>> columns(["fine"])[6:9]
    ('components', 'fine', 'peak')
    """
    return tuple(Score("", values=dict.fromkeys(windows)).cells())


COLUMNS = columns(WINDOWS)

# int, float or str, by column; the windows, which are float, are not in it.
KINDS: Mapping[str, Any] = {
    name: (get_args(kind) or (kind,))[0] for name, kind in get_type_hints(Score).items() if name != "values"
}


def window_columns(names: tuple[str, ...], settings: str | None = None) -> tuple[str, ...]:
    """Which columns of a table are windows of scales. The table may have columns that others have added, or lack some.

    Args:
        names: of all columns.
        settings: the row's cell of the column `measure`, which names the windows.

    Raises:
        NoTableError: there is no column of paths, or none of complexity.

    >>> window_columns(COLUMNS)
    ('complexity', 'complexity_low', 'complexity_high')
    >>> window_columns(("path", "note", "complexity"))
    ('complexity',)
    """
    if "path" not in names:
        raise NoTableError("it has no column path")
    others = [name for name in names if name not in KINDS]
    found = tuple(name for name in _windows_in(settings) if name in others)
    if not found and columns(others) == names:  # as it was written
        return tuple(others)
    found = found or tuple(name for name in WINDOWS if name in others)
    if not found:
        raise NoTableError("its columns are not those of a table of scores: none of them is a complexity")
    return found


@lru_cache
def _windows_in(settings: str | None) -> tuple[str, ...]:
    """The names of the windows in a cell of the column `measure`; empty if the cell is not as it was written."""
    try:
        windows = json.loads(settings or "")["windows"]
    except (ValueError, KeyError, TypeError):
        return ()
    return ("complexity",) if windows is None else tuple(windows) if isinstance(windows, dict) else ()


def csv_line(cells: Iterable[Any], *, delimiter: str = ",") -> str:
    r"""Cells as a line of CSV: an empty cell for None, numbers in full precision, texts safe in a spreadsheet.

    >>> csv_line(["a,b.png", 3, None, -0.1, "-a"])
    '"a,b.png",3,,-0.1,\'-a\n'
    """
    text = io.StringIO()
    # Before Python 3.13 a carriage return in a cell is quoted only if it ends lines too.
    writer = csv.writer(text, delimiter=delimiter, lineterminator="\r\n")
    writer.writerow([guarded(cell) if isinstance(cell, str) else cell for cell in cells])
    return text.getvalue().removesuffix("\r\n") + "\n"


def json_line(row: Score) -> str:
    r"""One row as a JSON object on a line of its own: null for None.

    >>> json_line(Score("a.png", height=3))[:32]
    '{"path": "a.png", "height": 3, "'
    """
    return json.dumps(row.cells(), allow_nan=False) + "\n"


def from_cells(cells: Mapping[str, Any]) -> Score:
    """The row of cells by the names of their columns. Columns that others have added are passed over.

    Raises:
        NoTableError: the columns are not those of a table of scores.
        ValueError: a cell is not of the kind of its column.

    >>> from_cells({"path": "a.png", "height": 31.0, "complexity": float("nan"), "note": "mine"}).height
    31
    """
    settings = cells.get("measure")
    windows = window_columns(tuple(cells), settings if isinstance(settings, str) else None)
    own: dict[str, Any] = {
        name: text_value(name, cells[name]) if kind is str else number_value(name, kind, cells[name])
        for name, kind in KINDS.items()
        if name in cells
    }
    return Score(**own, values={name: number_value(name, float, cells[name]) for name in windows})
