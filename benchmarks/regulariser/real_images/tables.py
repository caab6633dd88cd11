"""The tables and the figure of the study, from what was measured."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.plots import COLOURS, MARKERS
from benchmarks.regulariser.real_images.methods import PLAIN, TRUTH
from benchmarks.results import Cell, Table

Found = dict[str, dict[str, dict[str, Any]]]  # by method, part and measure: the mean, or one number an image
Runs = dict[str, Found]  # of one set, by seed

SHOWN = ("IoU", "boundary F", "object, own frame", "object, grid", "mask, own frame", "mask, grid", "objects")
AIM = "object, own frame"
EXCESS = 0.1  # bits; the share of less than that says nothing
FILLS = ("full", "none")
LEAST_SHOWN = -0.05  # what costs more overlap is not in the figure


def of_seeds(runs: Runs, method: str, measure: str, part: str = "held-out") -> NDArray[np.float64]:
    """(seeds, images)."""
    found = [found[method] for found in runs.values() if method in found]
    return np.array([values[part][measure] for values in found if part in values], float)


def mean_and_error(values: Iterable[float]) -> tuple[float, float]:
    """A mean and its standard error, leaving out NaN."""
    kept = np.array([value for value in values if not np.isnan(value)])
    return float(kept.mean()), float(kept.std(ddof=1) / np.sqrt(len(kept))) if len(kept) > 1 else np.nan


def difference(runs: Runs, method: str, other: str, measure: str, part: str = "held-out") -> tuple[float, float]:
    """Mean over the images of method - other, each the mean over the seeds, and its standard error over the images."""
    common = {seed: found for seed, found in runs.items() if all(part in found.get(one, ()) for one in (method, other))}
    apart = of_seeds(common, method, measure, part) - of_seeds(common, other, measure, part)
    number = np.isfinite(apart).sum(axis=0)
    return mean_and_error(np.where(number, np.nansum(apart, axis=0) / np.maximum(number, 1), np.nan))


def tables(measured: dict[str, Runs]) -> list[Table]:
    """For each set all values, and the differences from no term."""
    return [table for name, runs in measured.items() for table in (_values(name, runs), _differences(name, runs))]


def methods_of(runs: Runs) -> list[str]:
    """In the order in which they were measured, the truth first."""
    return list(dict.fromkeys(method for found in runs.values() for method in found))


def _values(name: str, runs: Runs) -> Table:
    rows: list[list[Cell]] = []
    for method in methods_of(runs):
        row: list[Cell] = [method, len(of_seeds(runs, method, AIM))]
        for measure in SHOWN:
            by_seed = [np.nanmean(values) for values in of_seeds(runs, method, measure)]
            value, error = mean_and_error(by_seed)
            row.append(f"{value:.3f}" if method == TRUTH or np.isnan(error) else f"{value:.3f} ± {error:.3f}")
        rows.append(row)
    note = "Means over the held-out images, then over the seeds, ± standard error over the seeds. Complexity in bits."
    return Table(f"{name.capitalize()}: all numbers", ["", "seeds", *SHOWN], rows, note)


def _differences(name: str, runs: Runs) -> Table:
    """Against no term; with the share of the excess over the truth that is gone, where there is any to speak of."""
    excess = np.nanmean(of_seeds(runs, PLAIN, AIM)) - np.nanmean(of_seeds(runs, TRUTH, AIM))
    rows: list[list[Cell]] = []
    for method in methods_of(runs):
        if method in (PLAIN, TRUTH):
            continue
        value, error = difference(runs, method, PLAIN, "IoU")
        row: list[Cell] = [method, f"{value:+.4f} ± {error:.4f}"]
        for measure in ("boundary F", AIM, "mask, grid"):
            value, error = difference(runs, method, PLAIN, measure)
            row.append(f"{value:+.3f} ± {error:.3f}")
        if excess > EXCESS:
            row.append(f"{-difference(runs, method, PLAIN, AIM)[0] / excess:.0%}")
        rows.append(row)
    columns = ["", "IoU", "boundary F", AIM, "mask, grid"]
    note = (
        "Differences from no term ± standard error over the images. The complexity of objects in their own frames is "
        f"{excess:.3f} bits above the truth's"
    )
    if excess > EXCESS:
        return Table(
            f"{name.capitalize()}: against no term",
            [*columns, "share of the excess gone"],
            rows,
            note + "; where more than 100 % of that is gone, objects are simpler than the truth.",
        )
    return Table(f"{name.capitalize()}: against no term", columns, rows, note + ".")


def kinds_of(methods: Iterable[str]) -> dict[str, list[str]]:
    """Methods that differ in their numbers only, under their common name.

    >>> kinds_of(["loss 0.1", "loss 0.4", "loss 0.1, then simplify 3"])
    {'loss': ['loss 0.1', 'loss 0.4'], 'loss, then simplify': ['loss 0.1, then simplify 3']}
    """
    found: dict[str, list[str]] = {}
    for method in methods:
        if method not in (PLAIN, TRUTH):
            found.setdefault(re.sub(r" [\d.]+", "", method), []).append(method)
    return found


def draw(measured: dict[str, Runs], path: Path) -> None:
    """Complexity against overlap, a curve for each kind of method."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    kinds = list(dict.fromkeys(kind for runs in measured.values() for kind in kinds_of(methods_of(runs))))
    with mpl.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(10, 4.5), layout="constrained", dpi=150)
        panels = figure.subplots(1, len(measured), squeeze=False)[0]
        for axes, (name, runs) in zip(panels, measured.items(), strict=True):
            present = kinds_of(methods_of(runs))
            for i, kind in enumerate(kinds):
                points = [_point(runs, method) for method in present.get(kind, ())]
                x, y = zip(*points, strict=True) if points else ((), ())
                style = ("-" if i < len(COLOURS) else "--") + MARKERS[i % len(MARKERS)]
                axes.plot(x, y, style, color=COLOURS[i % len(COLOURS)], fillstyle=FILLS[i // len(COLOURS)], label=kind)
            axes.plot(*_point(runs, PLAIN), "k*", markersize=12, label=PLAIN)
            axes.axvline(np.nanmean(of_seeds(runs, TRUTH, AIM)), color="0.5", linestyle=":", label=TRUTH)
            axes.set(title=name, xlabel=f"complexity of an {AIM}, bits", ylabel="IoU, less that of no term")
            axes.set_ylim(bottom=LEAST_SHOWN)
        panels[0].legend(fontsize=7)
        figure.savefig(path, metadata={"Software": None})


def _point(runs: Runs, method: str) -> tuple[float, float]:
    """Complexity, and the overlap less that of no term, from the seeds that have both."""
    base = float(np.nanmean(of_seeds(runs, PLAIN, AIM)))
    if method == PLAIN:
        return base, 0.0
    return base + difference(runs, method, PLAIN, AIM)[0], difference(runs, method, PLAIN, "IoU")[0]
