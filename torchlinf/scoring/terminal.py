"""Tables for people: on a terminal, with short names and few digits."""

import os
from collections.abc import Sequence

from torchlinf.scoring.rows import Score

CAPTION = (
    "D: radius in pixels. fine: scales up to 1/4. coarse: all others. at: scale of the peak. Complexities in bits."
)


def print_table(rows: Sequence[Score]) -> None:
    """Print rows for people: short names, few digits, and below the table what failed and why."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console, folder = Console(highlight=False), common_folder(rows)
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


def common_folder(rows: Sequence[Score]) -> str:
    """Return the folder that the names can be cut by; empty if there is none but the root."""
    try:
        folder = os.path.commonpath([os.path.dirname(row.path) for row in rows])
    except ValueError:  # no rows, or absolute paths beside relative ones
        return ""
    return "" if folder == os.path.dirname(folder) else folder
