"""`torchlinf report`: a table of scores as one page to look at in a browser."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from torchlinf.cli.options import MaxPixels
from torchlinf.cli.outputs import endings, fail, folder_problem, load_table, say
from torchlinf.scoring import MAX_PIXELS

EPILOG = (
    "Masks are read again for the pictures and profiles, by the paths in the table: run the command in the folder "
    "where they were scored, or pass --folder. A mask that is not found, or that has changed, has no picture.\n\n"
    "Exit status: 0 the page is written, 2 wrong usage, or a page that cannot be written."
)
SUFFIXES = (".html", ".htm")


def report(
    table: Annotated[Path, typer.Argument(metavar="TABLE", help="A table of torchlinf score, or a folder of them.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The page to write: .html.")],
    folder: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Where relative paths in the table begin.", show_default="here")
    ] = Path(),
    pictures: Annotated[bool, typer.Option(help="Read the masks, for pictures and profiles.")] = True,
    profiles: Annotated[
        int, typer.Option(min=0, metavar="N", help="Most masks with a profile; each takes as long as scoring it.")
    ] = 200,
    limit: Annotated[
        int, typer.Option(min=1, metavar="N", help="Most rows on the page, spread from the least to the most complex.")
    ] = 20_000,
    title: Annotated[str | None, typer.Option(metavar="TEXT", help="The heading of the page.")] = None,
    max_pixels: MaxPixels = MAX_PIXELS,
) -> None:
    """Write a table of scores as one page: a sortable table with pictures, charts, profiles, and what failed.

    The page opens in a browser without a server, and loads nothing from the network.
    """
    check_page(out, "--out")
    with endings(None):
        rows = [row.cells() for row in load_table(table)]
        if not rows:
            fail(f"{table} is without a row: there is nothing to show.")
        title = f"Complexity of shapes: {table.name}" if title is None else title
        masks = folder if pictures else None
        write_page(rows, out, title, masks, limit=limit, profiles=profiles, max_pixels=max_pixels)


def check_page(out: Path, option: str) -> None:
    """Refuse what is not the name of a page that can be written."""
    problem = f"{out} has not the name of a page; pass for example report.html"
    if out.suffix.lower() in SUFFIXES:
        problem = folder_problem(out) or ""
    if problem:
        raise typer.BadParameter(problem, param_hint=option)


def write_page(
    rows: list[dict[str, Any]],
    out: Path,
    title: str,
    folder: Path | None,
    *,
    limit: int = 20_000,
    profiles: int = 200,
    max_pixels: int = MAX_PIXELS,
) -> None:
    """Write the page of some rows, with pictures of the masks in a folder, and say what is on it."""
    from torchlinf.report import MaskReader, write_report

    mask_of = None if folder is None else MaskReader(folder, max_pixels)
    try:
        with _progress() as advance:
            page = write_report(
                rows, out, mask_of=mask_of, title=title, limit=limit, profiles=profiles, advance=advance
            )
    except ImportError as error:
        fail(str(error))
    except OSError as error:
        fail(f"The page cannot be written ({error.strerror or error}).")
    say(
        f"{out}: {page.size / 1e6:.1f} MB, {page.rows:,} of {len(rows):,} masks, {page.pictures:,} pictures, "
        f"{page.profiles:,} profiles."
    )
    for reason, count in page.missing.most_common(3):
        say(f"{count:,} without a picture: {reason}")


@contextmanager
def _progress() -> Iterator[Callable[[int, int], None]]:
    columns = (TextColumn("reading masks"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    if not console.is_terminal:  # a disabled Progress of rich before 14.3 prints an empty line
        yield lambda done, total: None
        return
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("reading masks", total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)
