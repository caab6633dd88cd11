"""`torchlinf compare`: two tables side by side."""

from pathlib import Path
from statistics import median
from typing import Annotated

import typer

from torchlinf.cli.outputs import endings, fail, folder_problem, load_table
from torchlinf.scoring import (
    COMPARED,
    SUFFIXES,
    TAR_SUFFIXES,
    Comparison,
    Join,
    Score,
    compare_scores,
    numeric_columns,
    write_pairs,
)

EPILOG = "Exit status: 0 all masks are compared, 1 some are in one table only or failed, 2 nothing to compare."


def compare(
    old: Annotated[Path, typer.Argument(metavar="OLD", help="A table of torchlinf score, or a folder of them.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="Another, of other masks of the same things.")],
    join: Annotated[Join, typer.Option(help="Which rows are the same mask.")] = "path",
    column: Annotated[
        str,
        typer.Option(
            metavar="NAME", help=f"What to compare: {', '.join(numeric_columns([]))}, or a window of both tables."
        ),
    ] = "complexity",
    largest: Annotated[int, typer.Option(min=0, metavar="N", help="How many of the largest changes to show.")] = 10,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write both numbers of every mask here, as CSV.")
    ] = None,
) -> None:
    """Compare two tables of scores: old and new masks of one data set."""
    if out is not None and (problem := _problem(out, (old, new))):
        raise typer.BadParameter(problem, param_hint="--out")
    with endings(None):
        before, after = load_table(old), load_table(new)
        _compare(before, after, (old, new), column, join, largest, out)


def _compare(
    before: list[Score],
    after: list[Score],
    tables: tuple[Path, Path],
    column: str,
    join: Join,
    largest: int,
    out: Path | None,
) -> None:
    if empty := [path for path, rows in zip(tables, (before, after), strict=True) if not rows]:
        fail(f"{' and '.join(map(str, empty))} without a row: nothing to compare.")
    try:
        comparison = compare_scores(before, after, column=column, join=join)
    except ValueError as error:
        fail(f"{error}.")
    if not comparison.counts[COMPARED] and not any("failed" in status for status in comparison.counts):
        same = "path below its table's folder" if join == "folder" else join
        others = [other for other in ("folder", "name", "stem") if other != join]
        fail(
            f"no mask of the two tables has the same {same}: {before[0].path} in old, {after[0].path} in new, for "
            f"example. Pass --join {', '.join(others[:-1])} or {others[-1]}."
        )
    if len({row.measure for row in (*before, *after)}) > 1:
        typer.echo("The rows were not all measured with the same options; see their column 'measure'.", err=True)
    _print(comparison, largest)
    if out is not None:
        try:
            write_pairs(out, comparison.pairs)
        except OSError as error:
            fail(f"{out} cannot be written ({error.strerror or error}).")
    if comparison.counts[COMPARED] < len(comparison.pairs):
        raise typer.Exit(1)


def _problem(out: Path, tables: tuple[Path, Path]) -> str | None:
    """Why the changes cannot, or should not, be written to a file."""
    if problem := folder_problem(out):
        return problem
    if any(out.exists() and table.exists() and out.samefile(table) for table in tables):
        return f"{out} is one of the tables"
    if out.name.lower().endswith((*SUFFIXES, *TAR_SUFFIXES, ".json", ".jsonl", ".parquet")):
        return f"{out} would hold CSV; pass for example changes.csv"
    return None


def _print(comparison: Comparison, largest: int) -> None:
    """Print what changed from one table to another, and the masks that changed most."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False)
    for status, count in comparison.counts.most_common():
        console.print(f"{count:>9,} {status}")
    changes = comparison.changes
    if changes.size:
        old, new = comparison.numbers.mean(axis=1)
        rose, fell = int((changes > 0).sum()), int((changes < 0).sum())
        lines = (
            f"mean {comparison.column} {old:.3f} before, {new:.3f} after: {new - old:+.3f}, "
            f"median {median(changes):+.3f}",
            f"{rose:,} rose, {fell:,} fell, {changes.size - rose - fell:,} stayed",
            f"rank correlation {comparison.rank_correlation:.3f}",
        )
        console.print("\n".join(lines), soft_wrap=True)
    if pairs := comparison.largest(largest):
        table = Table(title="largest changes", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        table.add_column("mask", overflow="fold")
        for title in ("old", "new", "change"):
            table.add_column(title, justify="right", no_wrap=True)
        for pair in pairs:
            table.add_row(escape(pair.mask), f"{pair.old:.3f}", f"{pair.new:.3f}", f"{pair.change:+.3f}")
        console.print(table)
