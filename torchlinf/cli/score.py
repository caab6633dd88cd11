"""`torchlinf score`: a table of masks."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from torchlinf.cli.inputs import find_sources
from torchlinf.cli.options import (
    AsJson,
    Invert,
    MaxPixels,
    Members,
    Out,
    Overwrite,
    Paths,
    Ray,
    Retry,
    Threshold,
    Workers,
)  # fmt: skip
from torchlinf.cli.outputs import STATUS, check_out, end_if_failed, endings, refuse_source
from torchlinf.scoring import COLUMNS, MAX_PIXELS, RULE, open_table, score_masks

EPILOG = f"{RULE}\n\nColumns: {', '.join(COLUMNS)}.\n\n{STATUS}"


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
        from torchlinf.cli.score_on_ray import score_on_ray
        from torchlinf.scoring import Options

        if as_json or overwrite or retry:
            raise typer.BadParameter("it always goes on in its folder, of Parquet files", param_hint="--ray")
        score_on_ray(paths, out, ray, workers or _cores(), Options(threshold, invert, max_pixels, members), _progress)
        return
    check_out(out, as_json, overwrite, retry)
    workers = workers or _cores()
    torch.set_num_threads(max(1, _cores() // workers))
    failed = 0
    with endings(out):
        sources = find_sources(paths, members)
        refuse_source(out, sources)
        with open_table(out, as_json=as_json, resume=not overwrite, retry=retry) as put:
            new = [source for source in sources if source.name not in put.done]
            failed += sum(put.done.get(source.name) is not None for source in sources)
            if before := len(sources) - len(new):
                typer.echo(f"{before} of {len(sources)} masks are in {out} already.", err=True)
            with _progress(before, len(sources), shown=out is not None or not as_json) as advance:
                for row in score_masks(new, threshold=threshold, invert=invert, max_pixels=max_pixels, workers=workers):
                    put(row)
                    failed += row.error is not None
                    advance()
    end_if_failed(failed, len(sources), "" if out is None or retry else " --retry scores them again.")


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
