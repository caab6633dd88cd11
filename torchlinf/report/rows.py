"""The rows of a report by column: which columns there are, which rows are shown, which rows have the same numbers."""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchlinf.measure import Measure

Row = Mapping[str, Any]

# Columns that are not shown in the table: they have a place of their own on the page.
OWN_PLACE = ("path", "error", "version", "measure")
COUNTS = ("height", "width", "depth", "pixels", "radius", "components")
PLAIN_NUMBERS = ("peak_scale", "error_bound", "field_error_bound", "seconds")


@dataclass(frozen=True)
class Table:
    """Rows of a table of scores, any number of them, with what the page has to know of them.

    Attributes:
        rows: the cells of each row by the name of the column; None, NaN and "" stand for nothing.
    """

    rows: Sequence[Row]

    @cached_property
    def measures(self) -> list[str]:
        """The settings that the rows were measured with, as they stand in the column `measure`, most frequent first."""
        return [
            text for text, _ in Counter(filter(None, (text_of(row.get("measure")) for row in self.rows))).most_common()
        ]

    @cached_property
    def versions(self) -> list[str]:
        """The versions of torchlinf that scored the rows."""
        return sorted({text_of(row.get("version")) for row in self.rows} - {""})

    @cached_property
    def measure(self) -> Measure:
        """How most rows were measured; the defaults, with the windows that the columns name, if no row says it."""
        if self.measures:
            return measure_of(self.measures[0])
        known = {"complexity": (0.0, 1.0), "complexity_low": (0.0, 0.25), "complexity_high": (0.25, 1.0)}
        return Measure(windows={name: ends for name, ends in known.items() if name in self.names} or None)

    @cached_property
    def names(self) -> list[str]:
        """All columns of all rows, in the order in which they come."""
        return list(dict.fromkeys(name for row in self.rows for name in row))

    @cached_property
    def windows(self) -> list[str]:
        """The columns that are means over windows of scales. The first one is what the page is about."""
        named = list(self.measure.named_windows())
        return [name for name in named if name in self.names] or named[:1]

    @cached_property
    def unit(self) -> dict[str, str]:
        """The unit of every column that has one."""
        bits = dict.fromkeys([*self.windows, "peak"], self.measure.unit)
        lengths = dict.fromkeys(("height", "width", "depth", "radius"), "px")
        return bits | lengths | {"seconds": "s"}

    @cached_property
    def errors(self) -> list[str]:
        """What went wrong with each row; "" if nothing did."""
        return [text_of(row.get("error")) for row in self.rows]

    @cached_property
    def score(self) -> NDArray[np.float64]:
        """The values of the first window; NaN where there is none."""
        return self.numbers(self.windows[0])

    @cached_property
    def ranking(self) -> NDArray[np.int64]:
        """The rows that have a value, from the least to the most complex."""
        order = np.argsort(self.score, kind="stable")
        return order[: np.count_nonzero(np.isfinite(self.score))]

    def numbers(self, name: str) -> NDArray[np.float64]:
        """A column as numbers; NaN for what is none."""
        return np.array([number_of(row.get(name)) for row in self.rows], dtype=np.float64)

    def is_number(self, name: str) -> bool:
        """Whether a column holds numbers. Text that could be read as a number, such as an id, stays text."""
        if name in (*self.windows, "peak", *COUNTS, *PLAIN_NUMBERS):
            return True
        cells = [row.get(name) for row in self.rows]
        kept = [cell for cell in cells if text_of(cell)]
        return bool(kept) and all(isinstance(cell, Real) and not isinstance(cell, bool) for cell in kept)

    def is_empty(self, name: str) -> bool:
        """Whether a column says nothing on any row."""
        return not any(text_of(row.get(name)) for row in self.rows)

    def equal_numbers(self) -> list[list[int]]:
        """Groups of rows that have the same numbers: the same shape, perhaps moved, flipped or turned, most likely.

        Means and peak are compared to 9 digits; pixels, radius and components have to be the same. Boxes are left out:
        all of them have complexity 0.
        """
        names = [*self.windows, "peak", "peak_scale", "pixels", "radius", "components"]
        columns = np.column_stack([self.numbers(name) for name in names])
        groups: dict[tuple[str, ...], list[int]] = {}
        for i in self.ranking.tolist():
            if self.score[i] > 0:
                groups.setdefault(tuple(f"{value:.9g}" for value in columns[i]), []).append(i)
        return [sorted(group) for group in groups.values() if len(group) > 1]

    def ends(self, count: int) -> tuple[list[int], list[int]]:
        """The least complex rows and the most complex ones, the extreme ones first; no row is in both."""
        least = self.ranking[: min(count, (len(self.ranking) + 1) // 2)]
        most = self.ranking[len(least) :][::-1][:count]
        return least.tolist(), most.tolist()

    def spread(self, among: Sequence[int], limit: int, *, keep: Sequence[int] = ()) -> list[int]:
        """At most `limit` of some rows, in the order of the table: spread evenly over the ranking by complexity.

        Failed rows stand behind the ranking. Those to `keep` come first.
        """
        if len(among) <= limit:
            return sorted(among)
        kept = list(keep)[:limit]
        chosen, place = set(kept), {int(row): rank for rank, row in enumerate(self.ranking)}
        others = sorted((row for row in among if row not in chosen), key=lambda row: (place.get(row, len(place)), row))
        steps = np.linspace(0, len(others) - 1, limit - len(kept)).round().astype(int).tolist()
        return sorted({*kept, *(others[step] for step in steps)})


def measure_of(settings: str) -> Measure:
    """The measure that a cell of the column `measure` describes; the defaults if it cannot be read.

    >>> measure_of(Measure(high=0.25, tol_bits=math.inf).settings()).options()
    {'high': 0.25, 'tol_bits': inf}
    """
    try:
        options = json.loads(settings)
        if options.get("tol_bits") == "inf":  # JSON has no infinity
            options["tol_bits"] = math.inf
        return Measure(**options)
    except (AttributeError, TypeError, ValueError):
        return Measure()


def number_of(cell: Any) -> float:
    """A cell as a number; NaN if it is none.

    >>> number_of("0.5"), number_of(""), number_of(None)
    (0.5, nan, nan)
    """
    try:
        return float(cell)
    except (TypeError, ValueError):
        return math.nan


def text_of(cell: Any) -> str:
    """A cell as text; "" for None and NaN. What no file could hold, half of a pair of surrogates, becomes an escape.

    >>> text_of(None), text_of(float("nan")), text_of(3)
    ('', '', '3')
    """
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return ""
    return str(cell).encode("utf-8", "backslashreplace").decode()
