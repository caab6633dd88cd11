"""What the commands that write a picture share: its name, the names in it, and how it is drawn."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from torchlinf._helpers.extras import require
from torchlinf._helpers.terminal import printable
from torchlinf.cli.outputs import fail, folder_problem
from torchlinf.scoring import Source

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextmanager
def pictures(command: str) -> Iterator[None]:
    """Draw without a screen, and close the figures at the end; what was chosen before is chosen again.

    Raises:
        ImportError: matplotlib is not installed.
    """
    require("matplotlib", command, "plot")
    from matplotlib import get_backend, pyplot

    before, open_before = get_backend(), set(pyplot.get_fignums())
    pyplot.switch_backend("agg")
    try:
        yield
    finally:
        for number in set(pyplot.get_fignums()) - open_before:
            pyplot.close(number)
        pyplot.switch_backend(before)


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
    short = _short(source)
    return short if sum(_short(other) == short for other in sources) == 1 else printable(source.name)


def _short(source: Source) -> str:
    """The name of a source without its folder and suffix, for one line of a picture or a terminal."""
    return printable(source.path.stem if source.member is None else f"{source.path.stem}:{source.member}")
