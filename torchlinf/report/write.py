"""One page of a table of scores: what goes onto it, and the file."""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchlinf._helpers.extras import require
from torchlinf.report.masks import MaskOf, read_pictures
from torchlinf.report.page import GALLERY, render
from torchlinf.report.rows import Table, text_of

LIMIT, PROFILES = 20_000, 200


@dataclass(frozen=True)
class Report:
    """What a page holds.

    Attributes:
        path: the file.
        size: of the file, bytes.
        rows: rows in its table.
        pictures: rows with a picture of the mask.
        profiles: rows with a profile.
        missing: why scored masks have no picture, and how many for each reason.
    """

    path: Path
    size: int
    rows: int
    pictures: int
    profiles: int
    missing: Counter[str]


def write_report(
    rows: Iterable[Mapping[str, Any]],
    out: str | os.PathLike[str],
    *,
    mask_of: MaskOf | None = None,
    title: str = "Complexity of shapes",
    limit: int = LIMIT,
    profiles: int = PROFILES,
    advance: Callable[[int, int], None] = lambda done, total: None,
) -> Report:
    """Write a table of scores as one page that opens in a browser without a server or a network.

    The page has a table that can be sorted and filtered, with a picture of every mask; a histogram; a scatter plot of
    fine against coarse complexity; the profiles of selected rows; the least and the most complex masks; masks with the
    same numbers; and the masks that failed, with the reasons.

    Args:
        rows: the cells of each row by the name of the column. "path" is needed; all other columns of a table of scores
            are used where they are there, and further columns are shown as they are.
        out: the file to write, which is replaced if it exists.
        mask_of: reads the mask of a row, for the pictures and profiles, and may raise any exception, whose text stands
            on the page; see `MaskReader`. None leaves out pictures and profiles.
        title: the heading of the page.
        limit: most rows in the table. Of a longer table the page holds rows spread evenly over the ranking by
            complexity, and says so; galleries, failures and rows with equal numbers are those of the whole table.
        profiles: most rows with a profile. A profile is measured anew, which takes as long as scoring the mask. The
            least and the most complex rows come first, then others spread evenly over the ranking.
        advance: called with the number of rows that are done, and of all, while masks are read.

    Returns:
        What the page holds.

    Raises:
        ImportError: bokeh is not installed.
        ValueError: there are no rows, or one without a path.
        OSError: the file cannot be written.
    """
    require("bokeh", "a report", "report")
    whole, out = Table(list(rows)), Path(out)
    if not whole.rows:
        raise ValueError("rows must hold at least one row; got none. Pass the rows of a table of scores.")
    if not all(text_of(row.get("path")) for row in whole.rows):
        raise ValueError("rows must have a path each; got a row without. Pass the rows of a table of scores.")
    least, most = whole.ends(GALLERY)
    shown = whole.spread(range(len(whole.rows)), limit, keep=[*least, *most])
    profiled = set(whole.spread(whole.ranking.tolist(), profiles, keep=[*least, *most]))
    pictures = read_pictures(whole, shown, mask_of, profiled=profiled, large={*least, *most}, advance=advance)
    page = render(whole, shown, pictures, least, most, title)
    out.write_text(page, encoding="utf-8", errors="backslashreplace", newline="\n")
    missing = (pictures[i].note for i in shown if pictures[i].note and not pictures[i].small and not whole.errors[i])
    return Report(
        path=out,
        size=out.stat().st_size,
        rows=len(shown),
        pictures=sum(bool(pictures[i].small) for i in shown),
        profiles=sum(pictures[i].profile.size > 0 for i in shown),
        missing=Counter(missing),
    )
