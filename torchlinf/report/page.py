"""The page itself: bokeh's parts and plain HTML, put together by a template that escapes all text."""

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from itertools import takewhile
from typing import Any

import numpy as np

from torchlinf import __version__
from torchlinf.report.figures import LINES, Column, models
from torchlinf.report.masks import STEP, Picture
from torchlinf.report.rows import OWN_PLACE, Table, text_of

GALLERY = 12  # masks in a gallery
MOST_GROUPS, MOST_NAMES = 40, 12  # groups of equal numbers; masks of one group, or of one kind of failure
DIGITS = 4  # behind the point, in the text of the page

# What the columns of a table of scores mean. Windows are described by their ends.
MEANINGS = {
    "peak": "the largest value of a single level of the profile",
    "peak_scale": "the scale at which the profile has its peak, from 0 (boundary) to 1 (centre)",
    "pixels": "how many pixels are inside",
    "radius": "the largest chessboard distance from a pixel inside to the outside",
    "components": "connected components; pixels that touch at a corner are connected",
    "error_bound": "how far any of the complexities can be from that of the exact field, proven",
    "field_error_bound": "certified relative error of the field from which complexity is measured",
    "seconds": "time to read and score the mask",
}


def render(
    table: Table,
    shown: Sequence[int],
    pictures: Mapping[int, Picture],
    least: Sequence[int],
    most: Sequence[int],
    title: str,
) -> str:
    """The page as text.

    Args:
        table: all rows.
        shown: which of them are in the table of the page.
        pictures: the pictures of these.
        least: the least complex rows, each of which is shown.
        most: the most complex rows, each of which is shown.
        title: the heading.
    """
    from bokeh.embed import components
    from bokeh.resources import Resources
    from jinja2 import Environment

    place = {row: number for number, row in enumerate(shown)}
    groups = table.equal_numbers()
    columns = _columns(table, shown, groups)
    kept = [pictures[i] for i in shown]
    thumbs, profiles = [one.small for one in kept], [one.profile for one in kept]
    borders = sorted({end for ends in table.measure.named_windows().values() for end in ends if 0 < end < 1})
    parts = models(columns, len(table.windows), borders, thumbs, profiles, "torchlinfReport(models)")
    start, divs = components(parts, wrap_script=False)
    style, script = (files(__package__).joinpath(name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    library = Resources(mode="inline", components=["bokeh", "bokeh-widgets", "bokeh-tables"], log_level="error").js_raw
    scripts = [_as_script(text) for text in (*library, script, start)]
    folder = _common_folder([text_of(table.rows[i]["path"]) for i in shown])

    def card(row: int) -> dict[str, Any]:
        path, picture = text_of(table.rows[row]["path"]), pictures.get(row, Picture())
        score = _number(table.score[row])
        return {"row": place.get(row), "name": path.removeprefix(folder), "path": path, "score": score} | {
            "picture": picture.large or picture.small
        }

    context = {
        "title": title,
        "rows": len(table.rows),
        "shown": len(shown),
        "scored": len(table.ranking),
        "failed": sum(map(bool, table.errors)),
        "profiles": sum(one.profile.size > 0 for one in kept),
        "pictures": sum(bool(one.small) for one in kept),
        "folder": folder,
        "score": table.windows[0],
        "unit": table.measure.unit,
        "median": _number(float(np.median(table.score[table.ranking]))) if len(table.ranking) else "",
        "least": [card(i) for i in least],
        "most": [card(i) for i in most],
        "groups": [
            {"cards": [card(i) for i in group[:MOST_NAMES]], "size": len(group)} for group in groups[:MOST_GROUPS]
        ],
        "group_count": len(groups),
        "failures": _failures(table, folder),
        "meanings": _meanings(table, columns),
        "versions": table.versions,
        "settings": [_settings(text) for text in table.measures],
        "written_by": __version__,
        "parts": divs,
        "scripts": scripts,
        "style": style,
        "hashes": [_hash(text) for text in scripts],
        "data": {
            "columns": [
                {"field": field, "name": one.name, "title": one.title, "isNumber": one.is_number}
                for field, one in columns.items()
            ],
            "notes": [one.note for one in kept],
            "folder": folder,
            "windows": list(table.windows),
            "unit": table.measure.unit,
            "step": STEP,
            "lines": LINES,
        },
    }
    template = files(__package__).joinpath("page.html").read_text(encoding="utf-8")
    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(template).render(context)


def _columns(table: Table, shown: Sequence[int], groups: Sequence[Sequence[int]]) -> dict[str, Column]:
    """The columns of the table of the page: names first, then windows, then all others that say something."""
    paths = [text_of(table.rows[i]["path"]) for i in shown]
    folder = _common_folder(paths)
    columns = [Column("path", "path", np.array([path.removeprefix(folder) for path in paths], dtype=object), 260)]
    others = [name for name in table.names if name not in (*OWN_PLACE, *table.windows) and not table.is_empty(name)]
    for name in (*table.windows, *sorted(others, key=lambda name: name in ("height", "width", "depth", "seconds"))):
        title = f"{name} ({table.unit[name]})" if name in table.unit else name
        width = max(84, 9 * len(title) + 18)
        if table.is_number(name):
            columns.append(Column(name, title, table.numbers(name)[list(shown)], width))
        else:
            columns.append(
                Column(name, title, np.array([text_of(table.rows[i].get(name)) for i in shown], dtype=object), width)
            )
    if groups:
        number = {row: float(n) for n, group in enumerate(groups, 1) for row in group}
        columns.append(Column("equal", "equal numbers", np.array([number.get(i, np.nan) for i in shown]), 130))
    errors = np.array([table.errors[i] for i in shown], dtype=object)
    columns.append(Column("error", "why it failed", errors, 420 if any(errors) else 120))
    return {f"c{number}": column for number, column in enumerate(columns)}


def _failures(table: Table, folder: str) -> list[dict[str, Any]]:
    """The reasons why masks failed, most frequent first, with some of the masks."""
    reasons: dict[str, list[str]] = {}
    for row, error in zip(table.rows, table.errors, strict=True):
        if error:
            reasons.setdefault(error, []).append(text_of(row["path"]).removeprefix(folder))
    ordered = sorted(reasons.items(), key=lambda item: -len(item[1]))
    return [{"reason": reason, "count": len(names), "names": names[:MOST_NAMES]} for reason, names in ordered]


def _meanings(table: Table, columns: Mapping[str, Column]) -> list[tuple[str, str]]:
    """What each column means that the page has a meaning for."""
    windows = {
        name: f"mean of the profile over scales above {low:g} and up to {high:g}"
        for name, (low, high) in table.measure.named_windows().items()
    }
    known = windows | MEANINGS | {"equal": "rows with the same entry have the same numbers, see above"}
    return [(column.title, known[column.name]) for column in columns.values() if column.name in known]


def _settings(text: str) -> list[tuple[str, str]]:
    """The settings of a measure in words."""
    try:
        settings = json.loads(text)
        windows = settings.pop("windows", None)
    except (ValueError, AttributeError):
        return [("measure", text)]
    if windows:
        settings = {name: value for name, value in settings.items() if name not in ("low", "high")}
        settings["windows"] = "; ".join(f"{name}: ({low:g}, {high:g}]" for name, (low, high) in windows.items())
    if settings.get("rho", 0) is None:
        settings["rho"] = "each shape's own radius"
    return [(name, str(value)) for name, value in settings.items()]


def _common_folder(paths: Sequence[str]) -> str:
    """What all paths begin with, up to a slash: names are shorter without it.

    >>> _common_folder(["a/b/c.png", "a/b/d.png"]), _common_folder(["a.png"]), _common_folder(["/a.png"])
    ('a/b/', '', '')
    """
    folders = [path.split("/")[:-1] for path in paths]
    pairs = zip(min(folders), max(folders), strict=False)  # what these two share, all between them share
    shared = [name for name, _ in takewhile(lambda pair: pair[0] == pair[1], pairs)]
    return "/".join([*shared, ""]) if any(shared) else ""


def _number(value: float) -> str:
    return f"{value:.{DIGITS}f}"


def _as_script(script: str) -> str:
    r"""A script as it can stand in a page: nothing in it ends the element that holds it.

    >>> print(_as_script("const end = '</script>'"))
    const end = '<\/script>'
    """
    return re.sub(r"<(?=/script|!--)", r"<\\", script.replace("\r\n", "\n"), flags=re.IGNORECASE)


def _hash(script: str) -> str:
    """What the page's policy names a script by, so that the browser runs this one and no other."""
    return base64.b64encode(hashlib.sha256(script.encode("utf-8", "backslashreplace")).digest()).decode()
