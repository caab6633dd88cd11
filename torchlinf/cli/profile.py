"""`torchlinf profile`: a picture of masks and their profiles."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from torchlinf.cli.inputs import find_sources, reading_options
from torchlinf.cli.measure_options import PARTS, takes_measure
from torchlinf.cli.options import Ignore, Invert, Label, MaxPixels, Nonzero, Paths, Threshold, Volume
from torchlinf.cli.outputs import STATUS, endings, fail, say
from torchlinf.cli.pictures import check_picture, pictures, save_picture, title
from torchlinf.scoring import MAX_PIXELS, RULE

if TYPE_CHECKING:
    from torch import Tensor

    from torchlinf.measure import Measure

# More masks than this leave too little of the page for each.
MAX_DRAWN = 12

EPILOG = f"{RULE}\n\n{STATUS}"


@takes_measure({"complexity": (0.0, 1.0)}, without=PARTS)
def profile(
    paths: Paths,
    *,
    plot: Annotated[Path, typer.Option("--plot", "-p", metavar="FILE", help="The picture to write: PNG, SVG or PDF.")],
    threshold: Threshold = None,
    label: Label = None,
    nonzero: Nonzero = False,
    ignore: Ignore = None,
    volume: Volume = False,
    invert: Invert = False,
    max_pixels: MaxPixels = MAX_PIXELS,
    measure: "Measure",
) -> None:
    """Draw masks with level lines of the field f and of the scale t, and their profiles in one plot."""
    with endings(None), pictures("torchlinf profile"):
        import torch
        from rich.console import Console

        from torchlinf.plot import overview
        from torchlinf.scoring import ScoreOptions, UnreadableMaskError, read_measured

        with reading_options():
            options = ScoreOptions(threshold, invert, max_pixels, None, measure, label, nonzero, ignore or (), volume)
        sources = find_sources(paths)
        check_picture(plot, sources, MAX_DRAWN)
        masks: dict[str, Tensor] = {}
        for source in sources:
            try:
                inside = read_measured(source, options.reading)
                if not inside.any():
                    raise UnreadableMaskError("no foreground: no pixel is inside")
                masks[title(source, sources)] = torch.from_numpy(inside)
            except UnreadableMaskError as error:
                say(f"{source.name}: {error}")
        if masks:
            with Console(stderr=True).status(f"drawing {len(masks)} masks"):
                try:
                    figure = overview(masks, **measure.options())
                except RuntimeError as error:  # a field that does not converge
                    fail(str(error))
                save_picture(figure, plot)
    if len(masks) < len(sources):
        raise typer.Exit(1)
