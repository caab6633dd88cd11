"""The tables of the study, from what was measured."""

from typing import Any

import numpy as np

from benchmarks.regions_study.correlations import Columns, Mean, mean_of, over_seeds
from benchmarks.regions_study.data import SYNTHETIC, VIEWS
from benchmarks.results import Cell, Table

Runs = dict[str, list[Columns]]  # by data set, one entry a seed

MEASURES = {
    "grid": "complexity on the grid",
    "mean": "complexity, mean of rotations",
    "least": "complexity, least of rotations",
    "fine, grid": "complexity on the grid, scales up to 1/4",
    "fine, mean": "complexity, mean of rotations, scales up to 1/4",
    "length": "length of the boundary",
    "regions": "number of regions",
    "N1": "N1 of the predictions",
}
TARGETS = {"gap": "gap", "flips": "flips", "error": "test error"}
RIVALS = ("length", "regions", "N1")


def tables(runs: Runs, described: dict[str, Any]) -> list[Table]:
    """All of them; `described` has the sizes of the sets."""
    real = {name: found for name, found in runs.items() if name not in SYNTHETIC}
    return [
        _sets(runs, described),
        _averages(real),
        *(_of_each(runs, target) for target in ("gap", "flips")),
        _differences(real),
        _partials(real),
        _directions(runs),
    ]


def _sets(runs: Runs, described: dict[str, Any]) -> Table:
    rows: list[list[Cell]] = [
        [name, described[name]["samples"], described[name]["classes"], VIEWS[name].shown, VIEWS[name].origin]
        for name in runs
    ]
    return Table("Data sets", ["set", "samples", "classes", "the two axes", "from"], rows)


def of_sets(runs: Runs, first: str, second: str, given: tuple[str, ...] = ()) -> list[float]:
    """The correlation in each set: the mean over its seeds."""
    return [mean_of(over_seeds(found, first, second, given)).value for found in runs.values()]


def _averages(real: Runs) -> Table:
    rows: list[list[Cell]] = [
        [words, *(_shown(mean_of(of_sets(real, name, target))) for target in TARGETS)]
        for name, words in MEASURES.items()
    ]
    note = f"Mean over {len(real)} real sets ± standard error over the sets; in each set the mean over its seeds."
    return Table("Rank correlation over the classifiers", ["", *TARGETS.values()], rows, note)


def _of_each(runs: Runs, target: str) -> Table:
    shown = ("grid", "mean", "least", *RIVALS)
    rows: list[list[Cell]] = []
    for name, found in runs.items():
        rows.append([name, *(_shown(mean_of(over_seeds(found, measure, target))) for measure in shown)])
    title = f"Rank correlation with the {TARGETS[target]} in each set"
    return Table(title, ["set", *shown], rows, "Mean over the seeds ± standard error over the seeds.")


def _differences(real: Runs) -> Table:
    pairs = [("mean", "grid"), ("least", "grid"), ("mean", "least"), *(("mean", rival) for rival in RIVALS)]
    pairs += [("fine, mean", "mean"), ("fine, mean", "length")]
    rows: list[list[Cell]] = []
    for first, second in pairs:
        row: list[Cell] = [f"{first} - {second}"]
        for target in TARGETS:
            apart = np.subtract(of_sets(real, first, target), of_sets(real, second, target))
            row.append(_shown(mean_of(apart), counted=True))
        rows.append(row)
    note = "Differences of the rank correlations set by set, mean ± standard error; in how many sets it is above 0."
    return Table("Paired differences", ["", *TARGETS.values()], rows, note)


def _partials(real: Runs) -> Table:
    cases: list[tuple[str, tuple[str, ...]]] = [
        (name, given)
        for name in ("grid", "mean", "fine, mean")
        for given in (("length",), ("regions",), ("N1",), RIVALS)
    ]
    cases += [("length", ("mean",)), ("length", ("fine, mean",))]
    rows: list[list[Cell]] = [
        [
            f"{name} given {', '.join(given)}",
            *(_shown(mean_of(of_sets(real, name, target, given)), counted=True) for target in TARGETS),
        ]
        for name, given in cases
    ]
    note = "What is left of a rank correlation when the ranks of other numbers are held fixed."
    return Table("Partial rank correlations", ["", *TARGETS.values()], rows, note)


def _directions(runs: Runs) -> Table:
    """How much the choice of the grid alone changes the order of classifiers."""
    rows: list[list[Cell]] = []
    for name, found in runs.items():
        errors = np.mean([np.mean(run["standard error"]) for run in found])
        apart = np.mean([np.mean(np.abs(np.subtract(run["grid"], run["mean"]))) for run in found])
        same = mean_of(over_seeds(found, "grid", "mean"))
        rows.append([name, f"{errors:.2f}", f"{apart:.2f}", _shown(same)])
    columns = ["set", "standard error of the mean, bits", "grid less mean, absolute, bits", "rank correlation of both"]
    return Table("Grid and mean of rotations", columns, rows, "Means over the classifiers and seeds.")


def _shown(found: Mean, *, counted: bool = False) -> str:
    text = f"{found.value:.2f} ± {found.error:.2f}"
    return f"{text} ({found.above} of {found.count})" if counted else text
