"""Cells of tables as text and back: safe in spreadsheets, and read whichever program has saved the table since."""

import math
import re
from typing import Any

# What a spreadsheet takes for the beginning of a formula (OWASP, "CSV injection"), also in full width.
FORMULA = re.compile(r"'*[=+\-@\t\r\n\uff1d\uff0b\uff0d\uff20]")

# How pandas, R and SQL write that there is nothing; no error and no version is called so.
NOTHING = frozenset({"", "nan", "na", "n/a", "#n/a", "<na>", "none", "null"})
VERBATIM = frozenset({"inside", "category", "image"})  # columns of the user's own words, such as a class called "none"


class CellError(ValueError):
    """A cell holds what its column cannot; the message says what."""


def guarded(text: str) -> str:
    r"""A text as it stands in CSV: with an apostrophe in front where a spreadsheet would see a formula.

    A text that has apostrophes there already gets one more, so that `unguarded` gives back every text.

    >>> guarded("=1+1"), guarded("'=1+1"), guarded("a-1"), guarded("'a'")
    ("'=1+1", "''=1+1", 'a-1', "'a'")
    """
    return f"'{text}" if FORMULA.match(text) else text


def unguarded(cell: str) -> str:
    """The text that `guarded` was given.

    >>> unguarded("'=1+1"), unguarded("''=1+1"), unguarded("=1+1"), unguarded("'a'")
    ('=1+1', "'=1+1", '=1+1', "'a'")
    """
    return cell[1:] if cell.startswith("'") and FORMULA.match(cell, 1) else cell


def text_value(name: str, cell: Any) -> str | None:
    """The value of a cell in a column of text, of CSV once it is unguarded; None if there is nothing.

    Raises:
        CellError: the cell is no text.
    """
    if isinstance(cell, str):
        # A file may have any name, "NA" too.
        is_nothing = cell == "" if name in VERBATIM else cell.strip().lower() in NOTHING
        return None if is_nothing and name != "path" else cell
    if name == "path" or isinstance(cell, list | dict | bool):
        raise CellError(f"column {name}: {cell!r} is not a text")
    # A program that has read the table may have made numbers of the classes "1" and "2".
    return None if cell is None or cell != cell else str(cell)


def number_value(name: str, kind: type, cell: Any) -> int | float | None:
    """The value of a cell in a column of `int` or `float`; None if there is nothing. 31.0 is a whole number.

    Raises:
        CellError: the cell is no such number.

    >>> number_value("height", int, "31.0"), number_value("peak", float, "1e-3"), number_value("peak", float, "NaN")
    (31, 0.001, None)
    """
    if cell is None or (isinstance(cell, str) and cell.strip().lower() in NOTHING):
        return None
    if isinstance(cell, bool | list | dict):
        raise CellError(f"column {name}: {cell!r} is not a number")
    try:
        if kind is int:
            return int(cell) if isinstance(cell, int | str) else _whole(name, float(cell))
        number = float(cell)
    except ValueError:
        if kind is int and re.fullmatch(r"\s*[-+]?\d+(\.\d*)?([eE][-+]?\d+)?\s*", str(cell)):
            return _whole(name, float(cell))
        raise CellError(_no_number(name, str(cell))) from None
    return None if math.isnan(number) else number


def _whole(name: str, number: float) -> int | None:
    if math.isnan(number):
        return None
    if not number.is_integer():
        raise CellError(f"column {name}: {number!r} is not a whole number")
    return int(number)


def _no_number(name: str, cell: str) -> str:
    if re.fullmatch(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*", cell):
        return (
            f"column {name}: {cell} has a decimal comma; save the table with decimal points, in pandas by "
            "to_csv(decimal='.')"
        )
    return f"column {name}: {cell!r} is not a number"
