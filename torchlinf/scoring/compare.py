"""Two tables of scores, of the old and the new masks of one data set: which masks are in both, and what changed."""

import os
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path, PurePath
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from torchlinf.scoring.rows import KINDS, WINDOWS, Score, columns
from torchlinf.scoring.summary import common_folder
from torchlinf.scoring.table_files import write_lines

Join = Literal["path", "folder", "name", "stem"]
COMPARED = "compared"
ROUNDING = 1e-12  # bits: sums of the same terms in another order differ by less


@dataclass(frozen=True)
class Pair:
    """One mask of either table.

    Attributes:
        mask: what the two tables were joined by.
        status: "compared", or why it was not: "only in old", "only in new", "failed in old", "failed in new" or
            "failed in both".
        old: the number in the old table; None if there is none.
        new: the number in the new table; None if there is none.
        error_bound: how far their difference can be from the exact one: the proven bounds of both rows.
    """

    mask: str
    status: str
    old: float | None
    new: float | None
    error_bound: float = 0.0

    @property
    def change(self) -> float | None:
        """New minus old; 0.0 if the intervals of both numbers meet; None if the mask was not compared."""
        if self.old is None or self.new is None:
            return None
        change = self.new - self.old
        return change if abs(change) > self.error_bound + ROUNDING else 0.0


@dataclass(frozen=True)
class Comparison:
    """What changed from one table to another. The statistics are those of the masks that were compared.

    Attributes:
        column: which column was compared.
        pairs: every mask of both tables once, in the order of the old one; then those that are in the new one only.
    """

    column: str
    pairs: tuple[Pair, ...]

    @property
    def counts(self) -> Counter[str]:
        """How many masks there are of each status."""
        return Counter(pair.status for pair in self.pairs)

    @cached_property
    def numbers(self) -> NDArray[np.float64]:
        """Old and new numbers, (2, N)."""
        numbers = [(pair.old, pair.new) for pair in self.pairs if pair.status == COMPARED]
        return np.array(numbers, dtype=np.float64).reshape(-1, 2).T

    @property
    def changes(self) -> NDArray[np.float64]:
        """New minus old, (N,); 0.0 where the intervals of both numbers meet."""
        return np.array([pair.change for pair in self.pairs if pair.status == COMPARED], dtype=np.float64)

    @property
    def rank_correlation(self) -> float:
        """Spearman's correlation, in [-1, 1]; equal numbers share a rank.

        NaN for fewer than two masks, or if all numbers of a table are equal.
        """
        from scipy.stats import spearmanr

        if any(len(np.unique(values)) < 2 for values in self.numbers):
            return np.nan
        return float(spearmanr(*self.numbers).statistic)

    def largest(self, count: int) -> list[Pair]:
        """The masks that changed most, the largest change first; masks that did not change are left out."""
        changed = [pair for pair in self.pairs if pair.change]
        return sorted(changed, key=lambda pair: -abs(pair.change or 0.0))[:count]


def compare_scores(
    old: Iterable[Score], new: Iterable[Score], *, column: str = "complexity", join: Join = "path"
) -> Comparison:
    """Compare two tables.

    Args:
        old: rows of a table, such as `scoring.read_table` gives.
        new: rows of another.
        column: what to compare: a column with numbers that both tables have, such as the name of a window.
        join: which rows are the same mask: those with the same "path"; with the same path below the folder that all
            masks of their own table share ("folder"); with the same "name", which is the file's, or the member's in an
            archive and the id in a COCO file; with the same name without its suffix ("stem"),
            which in a tar archive begins at the first dot, as in WebDataset's layout.

    Returns:
        The masks of both tables, side by side.

    Raises:
        ValueError: `column` or `join` is unknown, or does not tell the masks of a table apart.

    Example:
        >>> before = [Score("old/a.png", pixels=20), Score("old/b.png", error="empty")]
        >>> after = [Score("new/a.png", pixels=25), Score("new/b.png", pixels=10)]
        >>> comparison = compare_scores(before, after, column="pixels", join="folder")
        >>> comparison.changes, dict(comparison.counts)
        (array([5.]), {'compared': 1, 'failed in old': 1})
    """
    old, new = list(old), list(new)
    known = numeric_columns([*old, *new])
    if column not in known:
        raise ValueError(f"column must be one of {', '.join(known)}; got {column!r}")
    if join not in get_args(Join):
        raise ValueError(f"join must be one of {', '.join(get_args(Join))}; got {join!r}")
    before, after = _by_key(old, join, "old"), _by_key(new, join, "new")
    pairs = (_pair(key, before.get(key), after.get(key), column) for key in before | after)
    return Comparison(column, tuple(pairs))


def write_pairs(path: Path, pairs: Iterable[Pair]) -> None:
    """Write pairs as CSV: mask, status, old, new, change.

    Args:
        path: the file: .csv or .tsv, also with .gz behind; "-" for standard output.
        pairs: those of a `Comparison`.

    Raises:
        OSError: the file cannot be written; what was there before still is.
    """
    cells = chain(
        [("mask", "status", "old", "new", "change")],
        ((pair.mask, pair.status, pair.old, pair.new, pair.change) for pair in pairs),
    )
    write_lines(path, cells)


def numeric_columns(rows: Iterable[Score]) -> list[str]:
    """The columns with numbers that all rows have, in the order of the first row; without rows the usual ones."""
    windows = dict.fromkeys(tuple(row.values) for row in rows) or [tuple(WINDOWS)]
    shared = [name for name in next(iter(windows)) if all(name in names for names in windows)]
    return [name for name in columns(shared) if KINDS.get(name, float) is not str]


def _pair(key: str, old: Score | None, new: Score | None, column: str) -> Pair:
    failed = [side for side, row in (("old", old), ("new", new)) if row is not None and row.error is not None]
    if old is None or new is None:
        status = "only in new" if old is None else "only in old"
    else:
        status = COMPARED if not failed else f"failed in {'both' if len(failed) == 2 else failed[0]}"
    before, after = (row[column] if row and not row.error else None for row in (old, new))
    return Pair(key, status, before, after, _error_bound(old, new, column))


def _error_bound(old: Score | None, new: Score | None, column: str) -> float:
    """How far a difference of complexities can be off; no other column has an error."""
    if old is None or new is None or column not in (*old.values, *new.values):
        return 0.0
    return (old.error_bound or 0.0) + (new.error_bound or 0.0)


def _by_key(rows: list[Score], join: str, table: str) -> dict[str, Score]:
    folder = common_folder(rows) if join == "folder" else ""
    keyed: dict[str, Score] = {}
    for row in rows:
        key = _key(row.path, join, folder)
        if key in keyed:
            raise ValueError(
                f"join must tell masks apart; by {join} the {table} table holds {key} more than once "
                f"({keyed[key].path}, {row.path}). Join by another of {', '.join(get_args(Join))}"
            )
        keyed[key] = row
    return keyed


def _key(path: str, join: str, folder: str) -> str:
    if join == "path":
        return path
    if join == "folder":
        return os.path.relpath(path, folder) if folder else path
    *archive, member = re.split(r"\.(tar|npz|json):", path, flags=re.IGNORECASE)
    name = PurePath(member)
    if join == "name":
        return name.name
    # In WebDataset's layout the parts of a sample share what stands before the first dot: a.jpg, a.mask.png.
    in_tar = bool(archive) and archive[-1].lower() == "tar"
    return name.name.split(".")[0] or name.stem if in_tar else name.stem
