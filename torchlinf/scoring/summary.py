"""The report on a terminal: a table for people, with short names and few digits."""

import json
import os
from collections.abc import Sequence

from torchlinf._helpers.terminal import names_table, printable
from torchlinf.scoring.rows import Score


def print_table(rows: Sequence[Score]) -> None:
    """Print rows for people: short names, few digits, and below the table what failed and why."""
    from rich.console import Console
    from rich.text import Text

    console, folder = Console(highlight=False), common_folder(rows)
    names = [printable(os.path.relpath(row.path, folder) if folder else row.path, console.encoding) for row in rows]
    scored = [(name, row) for name, row in zip(names, rows, strict=True) if row.error is None]
    windows = list(dict.fromkeys(name for row in rows for name in row.values))
    numbers: dict[str, list[str]] = {
        "pixels": [_digits(row.pixels) for _, row in scored],
        "D": [_digits(row.radius) for _, row in scored],
        "parts": [_digits(row.components) for _, row in scored],
    }
    numbers |= {_short(name): [_digits(row.values.get(name)) for _, row in scored] for name in windows}
    numbers["peak"] = [_digits(row.peak) for _, row in scored]
    numbers["at"] = [_digits(row.peak_scale, 2) for _, row in scored]
    if scored:
        table = names_table(
            [name for name, _ in scored],
            numbers,
            width=console.width,
            important=[*map(_short, windows), "pixels"],
            title=printable(folder, console.encoding),
            caption=_caption(rows, windows),
        )
        console.print(table)
    for name, row in zip(names, rows, strict=True):
        if row.error is not None:
            reason = printable(row.error, console.encoding)
            console.print(Text.assemble(("failed", "red"), f" {name}: {reason}"), soft_wrap=True)


def _digits(value: float | None, digits: int = 3) -> str:
    return "" if value is None else f"{value:.{digits}f}" if isinstance(value, float) else str(value)


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
