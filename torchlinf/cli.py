"""The command `torchlinf`: scores of masks as a table, two tables compared, and profiles as a picture."""

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
from torchlinf._outputs import INTERRUPTED, PIPE_CLOSED, WRONG, check_out, endings, fail, load_table, refuse_source
from torchlinf._pictures import check_picture, read_shape, require_matplotlib, title
from torchlinf._readers import SUFFIXES
from torchlinf._terminal import print_comparison
from torchlinf.comparison import COMPARED, Column, Join, compare_scores, write_pairs
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

# More masks than this leave too little of the page for each.
MAX_DRAWN = 12

STATUS = "Exit status: 0 all fine, 1 some masks failed, 2 wrong usage or an output that cannot be written."
COMPARED_STATUS = "Exit status: 0 all masks are compared, 1 some are in one table only or failed, 2 nothing to compare."

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)

Paths = Annotated[
    list[Path],
    typer.Argument(
        metavar="PATH",
        help="Masks (PNG, GIF, TIFF, BMP, JPEG, .npy, .npz), folders of them, patterns in quotes, tar archives, and "
        "COCO files (.json).",
    ),
]
Out = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="FILE", help="Write the table here: .csv, .jsonl or .parquet. It is resumed."),
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object a line instead of CSV.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Begin the table anew instead of resuming it.")]
Retry = Annotated[bool, typer.Option("--retry", help="Of what is in the table, score anew what failed.")]
Members = Annotated[
    str | None, typer.Option("--members", metavar="PATTERN", help="Which members of tar archives are masks.")
]
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
        if stop.code in (WRONG, INTERRUPTED, PIPE_CLOSED):
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
    overwrite: Overwrite = False,
    retry: Retry = False,
    threshold: Threshold = None,
    invert: Invert = False,
    members: Members = None,
    workers: Workers = None,
    max_pixels: MaxPixels = MAX_PIXELS,
    ray: Ray = None,
) -> None:
    """Score masks: one row of numbers a mask.

    Without --out the table goes to the terminal, or as CSV into a pipe. A mask that cannot be scored gives a row that
    says why, and the rest go on. Masks whose rows are in the table already are not scored again: stopped by Ctrl-C, a
    kill or a full disk, the same command goes on where it was.
    """
    if ray is not None:
        from torchlinf._ray_command import score_on_ray

        if as_json or overwrite or retry:
            raise typer.BadParameter("it always goes on in its folder, of Parquet files", param_hint="--ray")
        score_on_ray(paths, out, ray, workers or _cores(), (threshold, invert, max_pixels, members), _progress)
        return
    check_out(out, as_json, overwrite, retry)
    workers = workers or _cores()
    torch.set_num_threads(max(1, _cores() // workers))
    failed = 0
    with endings(out):
        sources = _find(paths, members)
        refuse_source(out, sources)
        with open_table(out, as_json, resume=not overwrite, retry=retry) as put:
            new = [source for source in sources if source.name not in put.done]
            failed += sum(put.done.get(source.name) is not None for source in sources)
            if before := len(sources) - len(new):
                typer.echo(f"{before} of {len(sources)} masks are in {out} already.", err=True)
            with _progress(before, len(sources), shown=out is not None or not as_json) as advance:
                for row in score_masks(new, threshold=threshold, invert=invert, max_pixels=max_pixels, workers=workers):
                    put(row)
                    failed += row.error is not None
                    advance()
    if failed:
        advice = "" if out is None else " --retry scores them again."
        typer.echo(f"{failed} of {len(sources)} masks failed; the column 'error' says why.{advice}", err=True)
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


@app.command(epilog=COMPARED_STATUS)
def compare(
    old: Annotated[Path, typer.Argument(metavar="OLD", help="A table of torchlinf score, or a folder of them.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="Another, of other masks of the same things.")],
    join: Annotated[Join, typer.Option(help="Which rows are the same mask.")] = "path",
    column: Annotated[Column, typer.Option(help="What to compare.")] = "complexity",
    largest: Annotated[int, typer.Option(min=0, metavar="N", help="How many of the largest changes to show.")] = 10,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write both numbers of every mask here, as CSV.")
    ] = None,
) -> None:
    """Compare two tables of scores: old and new masks of one data set."""
    if out is not None and any(out.exists() and table.exists() and out.samefile(table) for table in (old, new)):
        raise typer.BadParameter(f"{out} is one of the tables", param_hint="--out")
    try:
        found = compare_scores(load_table(old), load_table(new), column=column, join=join)
    except ValueError as error:
        fail(f"{error}.")
    if not found.counts[COMPARED] and not any("failed" in status for status in found.counts):
        fail(f"no mask of the two tables has the same {join}. Pass --join folder, name or stem.")
    print_comparison(found, largest)
    if out is not None:
        with endings(out):
            write_pairs(out, found.pairs)
    if found.counts[COMPARED] < len(found.pairs):
        raise typer.Exit(1)


def _find(paths: list[Path], members: str | None = None) -> list[Source]:
    try:
        with Console(stderr=True).status("looking for masks"):
            sources = find_masks(paths, members=members)
    except ImportError as error:
        fail(str(error))
    if not sources:
        known = " ".join((*SUFFIXES, ".tar"))
        raise typer.BadParameter(f"no masks found in {', '.join(map(str, paths))}; looked for {known}")
    return sources


def _cores() -> int:
    # In a container or a batch job the machine may have more cores than this process may use.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _progress(done: int, total: int, shown: bool) -> Iterator[Callable[[], None]]:
    columns = (TextColumn("scoring"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not (shown and console.is_terminal)) as progress:
        task = progress.add_task("scoring", total=total, completed=done)
        yield lambda: progress.advance(task)


def _draw(picture: Path, masks: dict[str, torch.Tensor]) -> None:
    from torchlinf.plot import overview

    try:
        with Console(stderr=True).status(f"drawing {len(masks)} masks"):
            overview(masks).savefig(picture, dpi=150)
    except OSError as error:
        typer.echo(f"The picture cannot be written ({error.strerror}).", err=True)
        raise typer.Exit(2) from None
