"""Repeat the paper's noisy squares: `python -m benchmarks.paper_noise [--sets 50] [--out FOLDER]`.

Prints three Markdown tables, and writes them to `FOLDER/paper_noise_tables.inc`.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.paper_noise.agreement import (
    PAPER_SETS,
    SCALES,
    Fit,
    Numbers,
    fit_means,
    fit_stds,
    paper_table,
    redrawn_stds,
    taus,
)
from benchmarks.paper_noise.squares import Assumptions
from benchmarks.results import Cell, Table, markdown

FILE = "paper_noise_tables.inc"
DOCS = Path(__file__).parents[2] / "docs"

# The largest standard deviation of the paper, and the two places where it stands.
PAPER_STD, PAPER_CELLS = 0.28, (("factor 4", 3), ("factor 5", 6))

BASE = "Algorithm 1: side 160, lines outwards, closed after every addition, each square made afresh, complexity at t"

TEXT = (50, 100, 200, 400)

VARIATIONS: dict[str, tuple[Assumptions, str]] = {
    BASE: (Assumptions(), "at"),
    **{f"side {side}": (Assumptions(side=side), "at") for side in (150, 170, 200)},
    "lines to the nearer end of their run": (Assumptions(lines="to the nearer end"), "at"),
    "lines to both sides, side 200": (Assumptions(lines="both", side=200), "at"),
    "closed once, in the end": (Assumptions(closing="last"), "at"),
    "lines to both sides, closed once, side 200": (Assumptions(lines="both", closing="last", side=200), "at"),
    "additions on the first square's boundary": (Assumptions(boundary="first"), "at"),
    "counts 50, 100, 200, 400 (the paper's text)": (Assumptions(counts=TEXT), "at"),
    "squares that grow from 50 additions to 200": (Assumptions(growing=True), "at"),
    "mean complexity over (0, t]": (Assumptions(), "up to"),
}


def main(arguments: list[str] | None = None) -> None:
    """Print and write the tables."""
    options = _parser().parse_args(arguments)
    papers = paper_table("PAPER_MEANS"), paper_table("PAPER_STDS")
    rows, (means, stds) = list(papers[0]), (np.array(list(paper.values())) for paper in papers)
    tables, comparison = [], []
    for name, (assumptions, measure) in VARIATIONS.items():
        sets = options.sets if name == BASE else min(options.sets, options.other_sets)
        tau = taus(assumptions, measure, sets)
        if name == BASE:
            tables = [*_tau_tables(tau[:PAPER_SETS], rows, means, stds), _std_table(tau, rows)]
        comparison.append([name, sets, *_fitted(fit_means(tau, means)), *_fitted(fit_stds(tau, stds))])
        print(*comparison[-1], sep=" | ", flush=True)
    columns = ["assumptions", "sets", *(f"{of}: {what}" for of in ("means", "stds") for what in FITTED)]
    note = (
        "Mean absolute difference to the paper's 90 means, and to its 90 standard deviations. By chance: what that "
        f"would be if the paper's {PAPER_SETS} data sets had been made so. All but the first row change only what they "
        "name."
    )
    tables.append(Table("Assumptions", columns, comparison, note))
    text = "\n".join(map(markdown, tables))
    print(f"\n{text}")
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / FILE).write_text(text, encoding="utf-8")


def _tau_tables(tau: Numbers, rows: list[str], means: Numbers, stds: Numbers) -> list[Table]:
    """Means and standard deviations, beside the paper's."""
    columns = ["at t =", *map(str, SCALES)]
    found = (
        ("Mean", tau.mean(axis=0), means, fit_means(tau, means)),
        ("Standard deviation", tau.std(axis=0, ddof=1), stds, fit_stds(tau, stds)),
    )
    tables = []
    for name, ours, paper, fit in found:
        beside = []
        for row, mine, theirs in zip(rows, ours, paper, strict=True):
            beside += [_shown(row, mine), _shown("the paper's", theirs)]
        note = f"Mean |difference| {fit.mean:.3f}, largest {fit.largest:.2f}."
        tables.append(Table(f"{name} of tau, {len(tau)} data sets, and the paper's", columns, beside, note))
    return tables


def _shown(title: str, values: Numbers) -> list[Cell]:
    return [title, *(f"{value:.2f}" for value in values)]


def _std_table(tau: Numbers, rows: list[str]) -> Table:
    """How often papers drawn from our data sets would report the paper's largest standard deviations."""
    drawn = redrawn_stds(tau)
    rounded = PAPER_STD - 0.005
    share: list[list[Cell]] = [
        [
            f"{PAPER_STD} or more at {row}, t = {SCALES[column]}",
            f"{np.mean(drawn[:, rows.index(row), column] >= rounded):.1%}",
        ]
        for row, column in PAPER_CELLS
    ]
    share.append([f"{PAPER_STD} or more anywhere", f"{np.mean(drawn.max(axis=(1, 2)) >= rounded):.1%}"])
    title = f"Standard deviations of {PAPER_SETS} data sets drawn from {len(tau)}"
    return Table(title, ["", "share of draws"], share)


FITTED = ("difference", "by chance", "95 % below", "fits")


def _fitted(found: Fit) -> list[Cell]:
    numbers = [f"{value:.4f}" for value in (found.mean, found.expected, found.limit)]
    return [*numbers, "yes" if found.fits else "no"]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper_noise", description=__doc__)
    parser.add_argument(
        "--sets", type=int, default=100, help=f"data sets; the tables of tau use the first {PAPER_SETS}"
    )
    parser.add_argument("--other-sets", type=int, default=20, help="data sets of every assumption but the first")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder for the tables")
    return parser


if __name__ == "__main__":
    main()
