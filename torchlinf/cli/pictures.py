"""What the commands that write a picture share: its name, the names in it, and the masks."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer
from numpy.typing import NDArray

from torchlinf.cli.outputs import fail, folder_problem
from torchlinf.scoring import Source, UnreadableMaskError, read_source

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def require_matplotlib(command: str) -> None:
    """End the command with advice if matplotlib is not installed."""
    try:
        import matplotlib
    except ImportError:
        fail(f"{command} needs matplotlib. Run: pip install 'torchlinf[plot]'")
    matplotlib.use("Agg")  # a picture for a file needs no screen


def check_picture(picture: Path, sources: list[Source], most: int) -> None:
    """Refuse what would fail, or be regretted, after the masks have been solved."""
    from matplotlib.backend_bases import FigureCanvasBase

    problem = None
    if picture.suffix[1:].lower() not in FigureCanvasBase.get_supported_filetypes():
        problem = f"{picture} has no suffix of a picture; pass for example profiles.png"
    elif picture.exists() and any(source.path.exists() and picture.samefile(source.path) for source in sources):
        problem = f"{picture} is one of the masks"
    else:
        problem = folder_problem(picture)
    if problem:
        raise typer.BadParameter(problem, param_hint="--plot")
    if len(sources) > most:
        raise typer.BadParameter(f"one picture holds {most} masks; got {len(sources)}. Name fewer")


def save_picture(figure: "Figure", picture: Path) -> None:
    """Write the picture, or end the command with the reason why it cannot be written."""
    try:
        figure.savefig(picture, dpi=150)
    except OSError as error:
        fail(f"The picture cannot be written ({error.strerror}).")


def title(source: Source, sources: list[Source]) -> str:
    """The shortest name that tells the source from the others."""
    short = source.path.stem if source.member is None else f"{source.path.stem}:{source.member}"
    same = [other for other in sources if (other.path.stem, other.member) == (source.path.stem, source.member)]
    return short if len(same) == 1 else source.name


def read_shape(source: Source, threshold: float | None, invert: bool, max_pixels: int) -> NDArray[np.bool_]:
    """Read a mask that has a pixel inside."""
    inside = read_source(source, threshold=threshold, invert=invert, max_pixels=max_pixels)
    if not inside.any():
        raise UnreadableMaskError("no foreground: no pixel is inside")
    return inside
