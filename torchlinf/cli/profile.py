"""`torchlinf profile`: a picture of masks and their profiles."""

from pathlib import Path
from typing import Annotated

import torch
import typer
from rich.console import Console

from torchlinf.cli.inputs import find_sources
from torchlinf.cli.options import Invert, MaxPixels, Paths, Threshold
from torchlinf.cli.outputs import STATUS, fail
from torchlinf.cli.pictures import check_picture, read_shape, require_matplotlib, save_picture, title
from torchlinf.scoring import MAX_PIXELS, RULE, UnreadableMaskError

# More masks than this leave too little of the page for each.
MAX_DRAWN = 12

EPILOG = f"{RULE}\n\n{STATUS}"


def profile(
    paths: Paths,
    plot: Annotated[Path, typer.Option("--plot", "-p", metavar="FILE", help="The picture to write: PNG, SVG or PDF.")],
    threshold: Threshold = None,
    invert: Invert = False,
    max_pixels: MaxPixels = MAX_PIXELS,
) -> None:
    """Draw masks with level lines of the field f and of the scale t, and their profiles in one plot."""
    require_matplotlib("torchlinf profile")
    sources = find_sources(paths)
    check_picture(plot, sources, MAX_DRAWN)
    masks: dict[str, torch.Tensor] = {}
    for source in sources:
        try:
            inside = read_shape(source, threshold, invert, max_pixels)
            masks[title(source, sources)] = torch.from_numpy(inside)
        except UnreadableMaskError as error:
            typer.echo(f"{source.name}: {error}", err=True)
    if masks:
        from torchlinf.plot import overview

        with Console(stderr=True).status(f"drawing {len(masks)} masks"):
            try:
                save_picture(overview(masks), plot)
            except RuntimeError as error:  # a field that does not converge
                fail(str(error))
    if len(masks) < len(sources):
        raise typer.Exit(1)
