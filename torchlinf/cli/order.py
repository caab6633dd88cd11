"""`torchlinf order`: which of the masks are simpler in every respect, as a table and as a picture."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias, cast

import numpy as np
import torch
import typer
from numpy.typing import NDArray
from rich.console import Console

from torchlinf._checks import window
from torchlinf.cli.inputs import find_sources
from torchlinf.cli.options import AsJson, Invert, MaxPixels, Paths, Threshold
from torchlinf.cli.order_table import as_csv, as_json_lines, print_order
from torchlinf.cli.outputs import endings
from torchlinf.cli.pictures import check_picture, read_shape, require_matplotlib, save_picture, title
from torchlinf.measure import ComplexityProfile, Measure, ragged_profile
from torchlinf.order import WINDOWS, dominance
from torchlinf.scoring import MAX_PIXELS, RULE, Source, UnreadableMaskError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from networkx import DiGraph

# More shapes than this make a picture that nobody follows.
MAX_DRAWN = 40

BY_DEFAULT = ",".join(f"{low:g}-{high:g}" for low, high in WINDOWS.values())

EPILOG = f"""{RULE}

Columns: path, rank, the mean over each window, equal, above (the next steps up), incomparable.

Exit status: 0 all fine, 1 some masks failed, 2 wrong usage or a picture that cannot be written."""

Windows: TypeAlias = list[tuple[float, float]]


def parse_windows(text: str) -> Windows | None:
    """Windows of scales as they stand on the command line; None for "all".

    >>> parse_windows("0-0.25,0.25-1")
    [(0.0, 0.25), (0.25, 1.0)]
    """
    if text.strip().lower() == "all":
        return None
    try:
        return [window(*map(float, part.split("-"))) for part in text.split(",")]
    except (TypeError, ValueError):
        raise typer.BadParameter(
            f"pass all, or pairs LOW-HIGH with 0 <= LOW < HIGH <= 1, for example {BY_DEFAULT}; got {text}",
            param_hint="--windows",
        ) from None


def order(
    paths: Paths,
    plot: Annotated[
        Path | None, typer.Option("--plot", "-p", metavar="FILE", help="Draw the Hasse diagram: PNG, SVG or PDF.")
    ] = None,
    windows: Annotated[
        str, typer.Option(metavar="LOW-HIGH,...", help="Windows of scales to compare by, or all for every scale.")
    ] = BY_DEFAULT,
    as_json: AsJson = False,
    threshold: Threshold = None,
    invert: Invert = False,
    max_pixels: MaxPixels = MAX_PIXELS,
) -> None:
    """Order masks: one is above another if some window says so, and none says the contrary.

    Prints one row a mask: a table on a terminal, CSV into a pipe. A file that cannot be used is named on standard
    error, and the rest go on. Values that are equal within the certified error count as equal.
    """
    compared = parse_windows(windows)
    sources = find_sources(paths)
    if plot is not None:
        require_matplotlib("torchlinf order --plot")
        check_picture(plot, sources, MAX_DRAWN)
    with endings(None):
        masks: dict[str, NDArray[np.bool_]] = {}  # stays empty without a picture: many masks need much memory
        profiles = _solve(sources, threshold, invert, max_pixels, None if plot is None else masks)
        if profiles:
            named = {f"complexity_{low:g}_{high:g}": (low, high) for low, high in compared or [(0.0, 1.0)]}
            found = dominance(profiles, windows=named, every_scale=compared is None)
            titles = {source.name: title(source, sources) for source in sources if source.name in profiles}
            _print(found, titles, as_json)
            if plot is not None:
                _draw(plot, found, titles, masks)
    if len(profiles) < len(sources):
        raise typer.Exit(1)


def _solve(
    sources: list[Source],
    threshold: float | None,
    invert: bool,
    max_pixels: int,
    masks: dict[str, NDArray[np.bool_]] | None,
) -> dict[str, ComplexityProfile]:
    """Profiles by the names of the sources; what is wrong with one goes to standard error. Masks go to `masks`."""
    found = {}
    with Console(stderr=True).status(f"solving {len(sources)} masks"):
        for source in sources:
            try:
                inside = read_shape(source, threshold, invert, max_pixels)
                found[source.name] = ragged_profile([inside].__getitem__, 1, Measure())
                if masks is not None:
                    masks[source.name] = inside
            except UnreadableMaskError as error:
                typer.echo(f"{source.name}: {error}", err=True)
            except Exception as error:
                # The others go on, whatever this one met: a field that does not converge, memory that runs out.
                typer.echo(f"{source.name}: {type(error).__name__}: {error}", err=True)
    return found


def _print(found: "DiGraph", titles: dict[str, str], as_json: bool) -> None:
    if sys.stdout.isatty() and not as_json:
        print_order(_renamed(found, titles))
        return
    sys.stdout.write(as_json_lines(found) if as_json else as_csv(found))
    sys.stdout.flush()


def _draw(picture: Path, found: "DiGraph", titles: dict[str, str], masks: dict[str, NDArray[np.bool_]]) -> None:
    from torchlinf.plot import hasse

    renamed = {titles[name]: torch.from_numpy(mask) for name, mask in masks.items()}
    save_picture(cast("Figure", hasse(renamed, order=_renamed(found, titles)).figure), picture)


def _renamed(found: "DiGraph", titles: dict[str, str]) -> "DiGraph":
    import networkx as nx

    return nx.relabel_nodes(found, {node: tuple(titles[name] for name in node) for node in found})
