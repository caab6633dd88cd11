"""The report on a terminal: a table for people, with short names and few digits."""

import json
import os
from collections.abc import Sequence

from torchlinf.scoring.rows import Score


def print_table(rows: Sequence[Score]) -> None:
    """Print rows for people: short names, few digits, and below the table what failed and why."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console, folder = Console(highlight=False), common_folder(rows)
    names = [os.path.relpath(row.path, folder) if folder else row.path for row in rows]
    windows = list(dict.fromkeys(name for row in rows for name in row.values))
    table = Table(
        title=escape(folder), caption=_caption(rows, windows), box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False
    )
    table.add_column("mask", overflow="fold")
    for title in ("pixels", "D", "parts", *map(_short, windows), "peak", "at"):
        table.add_column(title, justify="right", no_wrap=True)
    for name, row in zip(names, rows, strict=True):
        if row.error is None:
            counts = (row.pixels, row.radius, row.components)
            bits = (*(row.values.get(window) for window in windows), row.peak)
            numbers = ("" if x is None else f"{x:.3f}" for x in bits)
            table.add_row(escape(name), *map(str, counts), *numbers, f"{row.peak_scale:.2f}")
    if table.row_count:
        console.print(table)
    for name, row in zip(names, rows, strict=True):
        if row.error is not None:
            console.print(f"[red]failed[/] {escape(name)}: {escape(row.error)}", soft_wrap=True)


def _short(window: str) -> str:
    """The title of a window's column.

    >>> _short("complexity_low"), _short("complexity")
    ('low', 'complexity')
    """
    return window.removeprefix("complexity_")


def _caption(rows: Sequence[Score], windows: Sequence[str]) -> str:
    """What the short titles mean."""
    settings = next((json.loads(row.measure) for row in rows if row.measure), None)
    ends = {} if settings is None else settings["windows"] or {"complexity": (settings["low"], settings["high"])}
    scales = [f"{_short(name)}: scales in ({ends[name][0]:g}, {ends[name][1]:g}]." for name in windows if name in ends]
    unit = "bits" if settings is None or settings["estimator"] == "entropy" else "shares of the field's maximum"
    return " ".join(["D: radius in pixels.", *scales, f"at: scale of the peak. Complexities in {unit}."])


def common_folder(rows: Sequence[Score]) -> str:
    """Return the folder that the names can be cut by; empty if there is none but the root."""
    try:
        folder = os.path.commonpath([os.path.dirname(row.path) for row in rows])
    except ValueError:  # no rows, or absolute paths beside relative ones
        return ""
    return "" if folder == os.path.dirname(folder) else folder
