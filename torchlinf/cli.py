"""The command `torchlinf`: scores of mask files as a table, and profiles as a picture."""

import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated

import torch
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from torchlinf import __version__, _order_command
from torchlinf._pictures import check_picture, read_shape, require_matplotlib, title
from torchlinf._readers import SUFFIXES
from torchlinf.scoring import (
    COLUMNS,
    MAX_PIXELS,
    RULE,
    Source,
    UnreadableMaskError,
    find_masks,
    open_table,
    score_masks,
)

# 128 + the number of the signal, as a shell reports a program that SIGINT (Ctrl-C) or SIGPIPE (`| head`) ended.
INTERRUPTED, PIPE_CLOSED = 130, 141

# More masks than this leave too little of the page for each.
MAX_DRAWN = 12

STATUS = "Exit status: 0 all fine, 1 some masks failed, 2 wrong usage or an output that cannot be written."

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)

Paths = Annotated[
    list[Path],
    typer.Argument(metavar="PATH", help="Masks (PNG, GIF, TIFF, BMP, JPEG, .npy, .npz), or folders of them."),
]
Out = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write the table here, each row when it is done.")
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object a line instead of CSV.")]
Workers = Annotated[
    int | None,
    typer.Option("--workers", "-w", min=1, metavar="N", help="Masks worked on at a time.", show_default="all cores"),
]
Threshold = Annotated[
    float | None,
    typer.Option("--threshold", "-t", metavar="T", help="Inside is what is greater, in the file's own units."),
]
Invert = Annotated[bool, typer.Option("--invert", "-i", help="Swap inside and outside, for dark shapes.")]
Ray = Annotated[
    str | None,
    typer.Option("--ray", metavar="ADDRESS", help="Score on Ray into a folder: local, auto, or where a cluster is."),
]
MaxPixels = Annotated[int, typer.Option(min=1, metavar="N", help="Refuse larger masks; each pixel takes 130 bytes.")]


def main() -> None:
    """Run the command; the entry point of the package."""
    # What is odd about a file is said in its row, if it matters.
    warnings.filterwarnings("ignore", module=r"PIL\.")
    logging.getLogger("tifffile").disabled = True
    # After a kill, multiprocessing's helper removes what is left of the workers' queues. It need not report that.
    sys.warnoptions.append("ignore::UserWarning:multiprocessing.resource_tracker")
    try:
        app()
    except SystemExit as stop:
        if stop.code in (INTERRUPTED, PIPE_CLOSED):
            # An ordinary exit would first wait for the masks that other threads are still solving.
            with suppress(OSError):
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(int(stop.code))
        raise


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"torchlinf {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version and exit.")
    ] = False,
) -> None:
    """Multi-scale complexity of shapes, with a certified error."""


@app.command(epilog=f"{RULE}\n\nColumns: {', '.join(COLUMNS)}.\n\n{STATUS}")
def score(
    paths: Paths,
    out: Out = None,
    as_json: AsJson = False,
    threshold: Threshold = None,
    invert: Invert = False,
    workers: Workers = None,
    max_pixels: MaxPixels = MAX_PIXELS,
    ray: Ray = None,
) -> None:
    """Score masks: one row of numbers a mask.

    Without --out the table goes to the terminal, or as CSV into a pipe. A file that cannot be scored gives a row that
    says why, and the rest go on. Ctrl-C leaves a table of whole rows.
    """
    if ray is not None:
        from torchlinf._ray_command import score_on_ray

        score_on_ray(paths, out, ray, workers or _cores(), (threshold, invert, max_pixels), _progress)
        return
    sources = _find(paths)
    if out is not None and out.suffix.lower() in SUFFIXES:
        raise typer.BadParameter(f"{out} has the name of a mask; pass for example scores.csv", param_hint="--out")
    workers = workers or _cores()
    torch.set_num_threads(max(1, _cores() // workers))
    done = failed = 0
    try:
        with open_table(out, as_json) as put, _progress(len(sources), shown=out is not None or not as_json) as advance:
            rows = score_masks(sources, threshold=threshold, invert=invert, max_pixels=max_pixels, workers=workers)
            for row in rows:
                put(row)
                done, failed = done + 1, failed + (row.error is not None)
                advance()
    except KeyboardInterrupt:
        raise typer.Exit(INTERRUPTED) from None
    except BrokenPipeError:
        raise typer.Exit(PIPE_CLOSED) from None
    except OSError as error:
        typer.echo(f"The table cannot be written ({error.strerror}); it ends after {done} rows.", err=True)
        raise typer.Exit(2) from None
    if failed:
        typer.echo(f"{failed} of {done} masks failed; the column 'error' says why.", err=True)
        raise typer.Exit(1)


@app.command(epilog=f"{RULE}\n\n{STATUS}")
def profile(
    paths: Paths,
    plot: Annotated[Path, typer.Option("--plot", "-p", metavar="FILE", help="The picture to write: PNG, SVG or PDF.")],
    threshold: Threshold = None,
    invert: Invert = False,
    max_pixels: MaxPixels = MAX_PIXELS,
) -> None:
    """Draw masks with level lines of the field f and of the scale t, and their profiles in one plot."""
    require_matplotlib("torchlinf profile")
    sources = _find(paths)
    check_picture(plot, sources, MAX_DRAWN)
    masks: dict[str, torch.Tensor] = {}
    for source in sources:
        try:
            inside = read_shape(source, threshold, invert, max_pixels)
            masks[title(source, sources)] = torch.from_numpy(inside)
        except UnreadableMaskError as error:
            typer.echo(f"{source.name}: {error}", err=True)
    if masks:
        _draw(plot, masks)
    if len(masks) < len(sources):
        raise typer.Exit(1)


app.command(epilog=_order_command.EPILOG)(_order_command.order)


def _find(paths: list[Path]) -> list[Source]:
    sources = find_masks(paths)
    if not sources:
        known = " ".join(SUFFIXES)
        raise typer.BadParameter(f"no masks found in {', '.join(map(str, paths))}; looked for {known}")
    return sources


def _cores() -> int:
    # In a container or a batch job the machine may have more cores than this process may use.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _progress(total: int, shown: bool) -> Iterator[Callable[[], None]]:
    columns = (TextColumn("scoring"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not (shown and console.is_terminal)) as progress:
        task = progress.add_task("scoring", total=total)
        yield lambda: progress.advance(task)


def _draw(picture: Path, masks: dict[str, torch.Tensor]) -> None:
    from torchlinf.plot import overview

    try:
        with Console(stderr=True).status(f"drawing {len(masks)} masks"):
            overview(masks).savefig(picture, dpi=150)
    except OSError as error:
        typer.echo(f"The picture cannot be written ({error.strerror}).", err=True)
        raise typer.Exit(2) from None
