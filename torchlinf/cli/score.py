"""`torchlinf score`: a table of masks."""

import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator
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
from torchlinf.cli.outputs import STATUS, check_out, end_if_failed, endings, is_standard_output, refuse_source, say
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
    """Score masks: one row of numbers a mask.

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
        with endings(None):
            score_on_ray(paths, out, ray, workers or _cores(), options, _progress)
        return
    check_out(out, as_json, overwrite, retry)
    failed = 0
    with endings(out):
        sources = find_sources(paths, members)
        refuse_source(out, sources)
        with open_table(out, as_json=as_json, resume=not overwrite, retry=retry, **options.measuring) as put:
            names = {source.name for source in sources}
            held, failures = _by_source(put.done, names), _by_source(put.failed, names)
            done = held.keys() - failures.keys()
            new = [source for source in sources if source.name not in done]
            failed += sum(any(put.done[path] is not None for path in held[name]) for name in done & names)
            if before := len(sources) - len(new):
                say(f"{before} of {len(sources)} masks are in {out} already.")
            groups = score_groups(new, options, workers=workers or _cores())
            streams = is_standard_output(out) and (as_json or out is not None) and sys.stdout.isatty()
            with closing(groups), _progress(before, len(sources), shown=not streams) as advance:
                for source, rows in zip(new, groups, strict=True):
                    replaced = {*held.get(source.name, ()), *failures.get(source.name, ())}
                    put(*rows, instead_of=sorted(replaced - {row.path for row in rows}))
                    failed += any(row.error is not None for row in rows)
                    advance()
    end_if_failed(failed, len(sources), "" if is_standard_output(out) or retry else " --retry scores them again.")


def _by_source(paths: Iterable[str], names: Collection[str]) -> dict[str, list[str]]:
    """Paths of rows by their source; --stack and --labels add a page and a label to its name, as stack.npy[3]#15."""
    sources: dict[str, list[str]] = {}
    for path in paths:
        shorter = re.sub(r"#\d+$", "", path)
        shortest = re.sub(r"\[\d+\]$", "", shorter)
        name = next((name for name in (path, shorter, shortest) if name in names), shortest)
        sources.setdefault(name, []).append(path)
    return sources


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
