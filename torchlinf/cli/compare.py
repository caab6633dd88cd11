"""`torchlinf compare`: two tables side by side."""

from pathlib import Path
from statistics import median
from typing import Annotated

import typer

from torchlinf._helpers.terminal import names_table, printable
from torchlinf.cli.outputs import endings, fail, folder_problem, is_standard_output, load_table, say
from torchlinf.scoring import (
    COMPARED,
    Comparison,
    Join,
    Score,
    compare_scores,
    numeric_columns,
    table_format,
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
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="Write both numbers of every mask here: .csv or .tsv, also with .gz behind; - for standard output.",
        ),
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
        say("The rows were not all measured with the same options; see their column 'measure'.")
    _print(comparison, largest, to_stderr=out is not None and is_standard_output(out))
    if out is not None:
        try:
            write_pairs(out, comparison.pairs)
        except OSError as error:
            fail(f"{out} cannot be written ({error.strerror or error}).")
    if comparison.counts[COMPARED] < len(comparison.pairs):
        raise typer.Exit(1)


def _problem(out: Path, tables: tuple[Path, Path]) -> str | None:
    """Why the changes cannot, or should not, be written to a file."""
    if is_standard_output(out):
        return None
    if problem := folder_problem(out):
        return problem
    if any(out.exists() and table.exists() and out.samefile(table) for table in tables):
        return f"{out} is one of the tables"
    try:
        is_text = table_format(out).kind in ("csv", "tsv")
    except ValueError:
        is_text = False
    return (
        None
        if is_text or (out.exists() and not out.is_file())
        else f"{out} would hold CSV; pass for example changes.csv"
    )


def _print(comparison: Comparison, largest: int, to_stderr: bool) -> None:
    """Print what changed from one table to another, and the masks that changed most."""
    from rich.console import Console

    console = Console(highlight=False, markup=False, stderr=to_stderr)
    for status, count in comparison.counts.most_common():
        console.print(f"{count:>9,} {status}")
    changes = comparison.changes
    if changes.size:
        old, new = comparison.numbers.mean(axis=1)
        rose, fell = int((changes > 0).sum()), int((changes < 0).sum())
        column = printable(comparison.column, console.encoding)
        lines = (
            f"mean {column} {old:.3f} before, {new:.3f} after: {new - old:+.3f}, median {median(changes):+.3f}",
            f"{rose:,} rose, {fell:,} fell, {changes.size - rose - fell:,} stayed",
            f"rank correlation {comparison.rank_correlation:.3f}",
        )
        console.print("\n".join(lines), soft_wrap=True)
    if pairs := comparison.largest(largest):
        numbers = {
            "old": [f"{pair.old:.3f}" for pair in pairs],
            "new": [f"{pair.new:.3f}" for pair in pairs],
            "change": [f"{pair.change:+.3f}" for pair in pairs],
        }
        names = [printable(pair.mask, console.encoding) for pair in pairs]
        important = ("change", "new")
        console.print(names_table(names, numbers, width=console.width, important=important, title="largest changes"))
