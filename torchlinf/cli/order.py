"""`torchlinf order`: which of the masks are simpler in every respect, as a table and as a picture."""

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from torchlinf._helpers.terminal import encodable
from torchlinf.cli.inputs import find_sources, reading_options
from torchlinf.cli.measure_options import takes_measure
from torchlinf.cli.options import AsJson, Ignore, Invert, Label, MaxPixels, Nonzero, Paths, Threshold, Volume
from torchlinf.cli.outputs import endings, say
from torchlinf.cli.pictures import check_picture, pictures, save_picture, title
from torchlinf.scoring import MAX_PIXELS, RULE, Source

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from networkx import DiGraph
    from numpy.typing import NDArray

    from torchlinf.measure import ComplexityProfile, Measure
    from torchlinf.scoring import ScoreOptions

# More shapes than this make a picture that nobody follows.
MAX_DRAWN = 40

# The paper's pair: detail near the boundary, and all of the shape.
WINDOWS = {"complexity_low": (0.0, 0.25), "complexity": (0.0, 1.0)}

EPILOG = f"""{RULE}

Columns: path, rank, the mean over each window, equal, above (the next steps up), incomparable, radius, error_bound,
field_error_bound, seconds, version, measure. Without --window, --low and --high the windows are complexity_low=0-0.25
and complexity=0-1.

Exit status: 0 all fine, 1 some masks failed, 2 wrong usage or a picture that cannot be written, 130 stopped by
Ctrl-C."""


@takes_measure(WINDOWS)
def order(
    paths: Paths,
    *,
    plot: Annotated[
        Path | None, typer.Option("--plot", "-p", metavar="FILE", help="Draw the Hasse diagram: PNG, SVG or PDF.")
    ] = None,
    every_scale: Annotated[
        bool, typer.Option("--every-scale", help="Compare the values at every scale, not the means over windows.")
    ] = False,
    as_json: AsJson = False,
    threshold: Threshold = None,
    label: Label = None,
    nonzero: Nonzero = False,
    ignore: Ignore = None,
    volume: Volume = False,
    invert: Invert = False,
    max_pixels: MaxPixels = MAX_PIXELS,
    measure: "Measure",
) -> None:
    """Order masks: one is above another if some window says so, and none says the contrary.

    Prints one row a mask: a table on a terminal, CSV into a pipe. A file that cannot be used is named on standard
    error, and the rest go on. Values whose proven intervals meet count as equal.
    """
    with endings(None), nullcontext() if plot is None else pictures("torchlinf order --plot"):
        from torchlinf.order import dominance
        from torchlinf.scoring import ScoreOptions

        with reading_options():
            options = ScoreOptions(threshold, invert, max_pixels, None, measure, label, nonzero, ignore or (), volume)
        sources = find_sources(paths)
        if plot is not None:
            check_picture(plot, sources, MAX_DRAWN)
        masks: dict[str, NDArray[np.bool_]] = {}  # stays empty without a picture: many masks need much memory
        profiles = _solve(sources, options, None if plot is None else masks)
        if profiles:
            graph = dominance(profiles, windows=measure.named_windows(), every_scale=every_scale)
            titles = {source.name: title(source, sources) for source in sources if source.name in profiles}
            _print(graph, profiles, titles, as_json)
            if plot is not None:
                _draw(plot, graph, titles, masks)
    if len(profiles) < len(sources):
        raise typer.Exit(1)


def _solve(
    sources: list[Source], options: "ScoreOptions", masks: "dict[str, NDArray[np.bool_]] | None"
) -> "dict[str, ComplexityProfile]":
    """Profiles by the names of the sources; what is wrong with one goes to standard error. Masks go to `masks`."""
    from rich.console import Console

    from torchlinf.scoring import error_text, profile_source

    profiles = {}
    with Console(stderr=True).status(f"solving {len(sources)} masks"):
        for source in sources:
            try:
                profiles[source.name], inside = profile_source(source, options)
                if masks is not None:
                    masks[source.name] = inside
            except Exception as error:
                # The others go on, whatever this one met: a field that does not converge, memory that runs out.
                say(f"{source.name}: {error_text(error)}")
    return profiles


def _print(graph: "DiGraph", profiles: "dict[str, ComplexityProfile]", titles: dict[str, str], as_json: bool) -> None:
    from torchlinf.cli.order_table import as_csv, as_json_lines, print_order

    if sys.stdout.isatty() and not as_json:
        print_order(_renamed(graph, titles), {titles[name]: profile for name, profile in profiles.items()})
        return
    text = as_json_lines(graph, profiles) if as_json else as_csv(graph, profiles)
    sys.stdout.write(encodable(text, sys.stdout.encoding))
    sys.stdout.flush()


def _draw(picture: Path, graph: "DiGraph", titles: dict[str, str], masks: "dict[str, NDArray[np.bool_]]") -> None:
    import torch

    from torchlinf.plot import hasse

    renamed = {titles[name]: torch.from_numpy(mask) for name, mask in masks.items()}
    save_picture(cast("Figure", hasse(renamed, order=_renamed(graph, titles)).figure), picture)


def _renamed(graph: "DiGraph", titles: dict[str, str]) -> "DiGraph":
    import networkx as nx

    return nx.relabel_nodes(graph, {node: tuple(titles[name] for name in node) for node in graph})
