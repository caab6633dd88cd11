"""What `torchlinf profile` needs: masks as tensors with titles, and a picture that is refused before, not after."""

import os
from pathlib import Path

import torch
import typer
from rich.console import Console

from torchlinf.scoring import Source, UnreadableMaskError, read_source

# More masks than this leave too little of the page for each.
MAX_DRAWN = 12


def require_matplotlib() -> None:
    """End the command with what to install, if it must be."""
    try:
        import matplotlib
    except ImportError:
        typer.echo("torchlinf profile needs matplotlib. Run: pip install 'torchlinf[plot]'", err=True)
        raise typer.Exit(2) from None
    matplotlib.use("Agg")  # a picture for a file needs no screen


def draw(picture: Path, masks: dict[str, torch.Tensor]) -> None:
    """Write the picture, or end the command with the reason why it cannot be written."""
    from torchlinf.plot import overview

    try:
        with Console(stderr=True).status(f"drawing {len(masks)} masks"):
            overview(masks).savefig(picture, dpi=150)
    except OSError as error:
        typer.echo(f"The picture cannot be written ({error.strerror}).", err=True)
        raise typer.Exit(2) from None


def check_picture(picture: Path, sources: list[Source]) -> None:
    """Refuse what would fail, or be regretted, after the masks have been solved."""
    from matplotlib.backend_bases import FigureCanvasBase

    problem = None
    if picture.suffix[1:].lower() not in FigureCanvasBase.get_supported_filetypes():
        problem = f"{picture} has no suffix of a picture; pass for example profiles.png"
    elif not os.access(picture.parent, os.W_OK):
        problem = f"the folder {picture.parent} cannot be written to"
    elif picture.exists() and any(source.path.exists() and picture.samefile(source.path) for source in sources):
        problem = f"{picture} is one of the masks"
    if problem:
        raise typer.BadParameter(problem, param_hint="--plot")
    if len(sources) > MAX_DRAWN:
        raise typer.BadParameter(f"one picture holds {MAX_DRAWN} masks; got {len(sources)}. Name fewer")


def title(source: Source, sources: list[Source]) -> str:
    """The shortest name that tells the source from the others."""
    short = source.path.stem if source.member is None else f"{source.path.stem}:{source.member}"
    same = [other for other in sources if (other.path.stem, other.member) == (source.path.stem, source.member)]
    return short if len(same) == 1 else source.name


def shape(source: Source, threshold: float | None, invert: bool, max_pixels: int) -> torch.Tensor:
    """Read a mask that has something inside.

    Raises:
        UnreadableMaskError: there is none; the message says why.
    """
    inside = read_source(source, threshold=threshold, invert=invert, max_pixels=max_pixels)
    if not inside.any():
        raise UnreadableMaskError("no foreground: no pixel is inside")
    return torch.from_numpy(inside)
