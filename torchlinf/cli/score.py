"""`torchlinf score`: a table of masks."""

import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING

import typer

from torchlinf.cli.inputs import find_sources, reading_options
from torchlinf.cli.measure_options import takes_measure
from torchlinf.cli.options import (
    AsJson,
    Ignore,
    Invert,
    Label,
    Labels,
    MaxPixels,
    Members,
    Nonzero,
    Out,
    Overwrite,
    Paths,
    Ray,
    Retry,
    Stack,
    Threshold,
    Volume,
    Workers,
)  # fmt: skip
from torchlinf.cli.outputs import STATUS, check_out, end_if_failed, endings, refuse_source
from torchlinf.scoring import COLUMNS, MAX_PIXELS, RULE, WINDOWS

if TYPE_CHECKING:
    from torchlinf.measure import Measure

EPILOG = f"""{RULE}

Columns: {", ".join(COLUMNS)}. Instead of the three columns of complexity there is one for each --window, and with --low
or --high the one column complexity.

{STATUS}"""


@takes_measure(WINDOWS)
def score(
    paths: Paths,
    *,
    out: Out = None,
    as_json: AsJson = False,
    overwrite: Overwrite = False,
    retry: Retry = False,
    threshold: Threshold = None,
    label: Label = None,
    labels: Labels = False,
    nonzero: Nonzero = False,
    ignore: Ignore = None,
    stack: Stack = False,
    volume: Volume = False,
    invert: Invert = False,
    members: Members = None,
    workers: Workers = None,
    max_pixels: MaxPixels = MAX_PIXELS,
    ray: Ray = None,
    measure: "Measure",
) -> None:
    """Score masks: one row of numbers a mask, or an object with --per object.

    Without --out the table goes to the terminal, or as CSV into a pipe. A mask that cannot be scored gives a row that
    says why, and the rest go on. With --out the rows are kept in a journal, FILE.part, until all are there: stopped by
    Ctrl-C, a kill or a full disk, the same command goes on where it was. Masks whose rows are in the table already are
    not scored again.
    """
    from torchlinf.scoring import ScoreOptions, open_table, score_groups

    with reading_options():
        options = ScoreOptions(
            threshold, invert, max_pixels, members, measure, label, nonzero, ignore or (), volume, labels, stack
        )
    if ray is not None:
        from torchlinf.cli.score_on_ray import score_on_ray

        if as_json or overwrite or retry:
            raise typer.BadParameter("it always goes on in its folder, of Parquet files", param_hint="--ray")
        score_on_ray(paths, out, ray, workers or _cores(), options, _progress)
        return
    check_out(out, as_json, overwrite, retry)
    failed = 0
    with endings(out):
        sources = find_sources(paths, members)
        refuse_source(out, sources)
        with open_table(out, as_json=as_json, resume=not overwrite, retry=retry, **options.measuring) as put:
            done = _sources_of(put.done) if labels or stack or measure.per == "object" else put.done
            new = [source for source in sources if source.name not in done]
            failed += sum(done.get(source.name) is not None for source in sources)
            if before := len(sources) - len(new):
                typer.echo(f"{before} of {len(sources)} masks are in {out} already.", err=True)
            groups = score_groups(new, options, workers=workers or _cores())
            with closing(groups), _progress(before, len(sources), shown=out is not None or not as_json) as advance:
                for rows in groups:
                    put(*rows)
                    failed += any(row.error is not None for row in rows)
                    advance()
    end_if_failed(failed, len(sources), "" if out is None or retry else " --retry scores them again.")


def _sources_of(done: Mapping[str, str | None]) -> dict[str, str | None]:
    """The sources of rows named by a page, a label and an object, as stack.npy[3]#15@2, and the last error of each."""
    names: dict[str, str | None] = {}
    for name, error in done.items():
        source = re.sub(r"(\[\d+\])?(#\d+)?(@\d+)?$", "", name, count=1)
        names[source] = names.get(source) or error
    return names


def _cores() -> int:
    # In a container or a batch job the machine may have more cores than this process may use.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _progress(done: int, total: int, shown: bool) -> Iterator[Callable[[], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("scoring"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    if not (shown and console.is_terminal):  # a disabled Progress of rich before 14.3 prints an empty line
        yield lambda: None
        return
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("scoring", total=total, completed=done)
        yield lambda: progress.advance(task)
