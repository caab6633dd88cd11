"""Repeat the paper's noisy squares: `python -m benchmarks.paper_noise [--sets 50] [--out FOLDER]`.

Prints three Markdown tables, and writes them to `FOLDER/paper_noise_tables.inc`.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.paper_noise.agreement import PAPER_SETS, SCALES, Fit, Numbers, fit, paper_means, redrawn_stds, taus
from benchmarks.paper_noise.squares import Assumptions
from benchmarks.results import Cell, Table, markdown

FILE = "paper_noise_tables.inc"
DOCS = Path(__file__).parents[2] / "docs"

# What the paper says of its standard deviations: the largest, and where.
PAPER_STD, PAPER_ROW, PAPER_COLUMN = 0.28, "factor 4", 3

BASE = "side 200, lines to both sides, closed in the end, each square made afresh, complexity at t"

TEXT = (50, 100, 200, 400)

VARIATIONS: dict[str, tuple[Assumptions, str]] = {
    BASE: (Assumptions(), "at"),
    "mean complexity over (0, t]": (Assumptions(), "up to"),
    "mean complexity over (0, t], side 150": (Assumptions(side=150), "up to"),
    **{f"side {side}": (Assumptions(side=side), "at") for side in (128, 160, 180, 220, 256)},
    "lines outwards only": (Assumptions(lines="outwards"), "at"),
    "lines outwards only, side 150": (Assumptions(lines="outwards", side=150), "at"),
    "lines outwards only, side 128": (Assumptions(lines="outwards", side=128), "at"),
    "lines of that length in all": (Assumptions(lines="half"), "at"),
    "lines of that length in all, side 100": (Assumptions(lines="half", side=100), "at"),
    "counts 50, 100, 200, 400 (the paper's text)": (Assumptions(counts=TEXT), "at"),
    "counts 50, 100, 200, 400, side 150": (Assumptions(counts=TEXT, side=150), "at"),
    "squares that grow from 50 additions to 200": (Assumptions(growing=True), "at"),
    "squares that grow, side 150": (Assumptions(growing=True, side=150), "at"),
    "squares that grow, side 128": (Assumptions(growing=True, side=128), "at"),
    "closed after every addition": (Assumptions(closing="always"), "at"),
    "closed after every addition, side 220": (Assumptions(closing="always", side=220), "at"),
    "additions on the first square's boundary": (Assumptions(boundary="first"), "at"),
    "additions on the first square's boundary, side 256": (Assumptions(boundary="first", side=256), "at"),
}


def main(arguments: list[str] | None = None) -> None:
    """Print and write the tables."""
    options = _parser().parse_args(arguments)
    paper = paper_means()
    rows, means = list(paper), np.array(list(paper.values()))
    tables, comparison = [], []
    for name, (assumptions, measure) in VARIATIONS.items():
        tau = taus(assumptions, measure, options.sets)
        if name == BASE:
            tables = [*_tau_tables(tau[:PAPER_SETS], rows, means), _std_table(tau, rows)]
        comparison.append(_comparison(name, fit(tau, means), tau.std(axis=0, ddof=1), rows))
        print(*comparison[-1], sep=" | ", flush=True)
    columns = ["assumptions", "mean", "largest", "by chance", "95 % below", "fits", "largest std", "its place"]
    note = (
        f"Absolute difference to the paper's 90 means: its mean and largest, from {options.sets} data sets each. By "
        f"chance: what the mean would be if the paper's {PAPER_SETS} data sets had been made so. All but the first row "
        "change only what they name."
    )
    tables.append(Table("Assumptions", columns, comparison, note))
    text = "\n".join(map(markdown, tables))
    print(f"\n{text}")
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / FILE).write_text(text, encoding="utf-8")


def _tau_tables(tau: Numbers, rows: list[str], paper: Numbers) -> list[Table]:
    """Means beside the paper's, and standard deviations."""
    columns = ["at t =", *map(str, SCALES)]
    beside, spread = [], []
    for name, ours, theirs, std in zip(rows, tau.mean(axis=0), paper, tau.std(axis=0, ddof=1), strict=True):
        beside += [_shown(name, ours), _shown("the paper's", theirs)]
        spread.append(_shown(name, std))
    found = fit(tau, paper)
    note = f"Mean |difference| {found.mean:.3f}, largest {found.largest:.2f}."
    return [
        Table(f"Mean tau of {len(tau)} data sets, and the paper's", columns, beside, note),
        Table(f"Standard deviation of tau, {len(tau)} data sets", columns, spread),
    ]


def _shown(title: str, values: Numbers) -> list[Cell]:
    return [title, *(f"{value:.2f}" for value in values)]


def _std_table(tau: Numbers, rows: list[str]) -> Table:
    """How often papers drawn from our data sets would report the paper's standard deviations."""
    drawn = redrawn_stds(tau)
    there, largest = drawn[:, rows.index(PAPER_ROW), PAPER_COLUMN], drawn.reshape(len(drawn), -1).max(axis=1)
    rounded = PAPER_STD - 0.005
    share: list[list[Cell]] = [
        [f"largest of the table at {PAPER_ROW}, t = {SCALES[PAPER_COLUMN]}", f"{np.mean(there == largest):.1%}"],
        [f"{PAPER_STD} or more there", f"{np.mean(there >= rounded):.1%}"],
        [f"{PAPER_STD} or more anywhere", f"{np.mean(largest >= rounded):.1%}"],
    ]
    title = f"Standard deviations of {PAPER_SETS} data sets drawn from {len(tau)}"
    return Table(title, ["", "share of draws"], share)


def _comparison(name: str, found: Fit, std: Numbers, rows: list[str]) -> list[Cell]:
    row, column = np.unravel_index(std.argmax(), std.shape)
    numbers = [f"{value:.4f}" for value in (found.expected, found.limit)]
    verdict = "yes" if found.fits else "no"
    place = f"{rows[row]}, t = {SCALES[column]}"
    return [name, f"{found.mean:.4f}", f"{found.largest:.2f}", *numbers, verdict, f"{std.max():.2f}", place]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper_noise", description=__doc__)
    parser.add_argument(
        "--sets", type=int, default=100, help=f"data sets; the tables of tau use the first {PAPER_SETS}"
    )
    parser.add_argument("--out", type=Path, default=DOCS, help="folder for the tables")
    return parser


if __name__ == "__main__":
    main()
