"""The tables and the figure of the study, from what was measured."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.regulariser.real_images.methods import PLAIN, TRUTH
from benchmarks.results import Cell, Table

Found = dict[str, dict[str, dict[str, Any]]]  # by method, part and measure: the mean, or one number an image
Runs = dict[str, Found]  # of one set, by seed

SHOWN = ("IoU", "boundary F", "object, own frame", "object, grid", "mask, own frame", "mask, grid", "objects")
AIM = "object, own frame"


def of_seeds(runs: Runs, method: str, measure: str) -> NDArray[np.float64]:
    """(seeds, images)."""
    return np.array([found[method]["held-out"][measure] for found in runs.values() if method in found], float)


def mean_and_error(values: Iterable[float]) -> tuple[float, float]:
    """A mean and its standard error, leaving out NaN."""
    kept = np.array([value for value in values if not np.isnan(value)])
    return float(kept.mean()), float(kept.std(ddof=1) / np.sqrt(len(kept))) if len(kept) > 1 else np.nan


def difference(runs: Runs, method: str, other: str, measure: str) -> tuple[float, float]:
    """Mean over the images of method - other, each the mean over the seeds, and its standard error over the images."""
    apart = of_seeds(runs, method, measure) - of_seeds(runs, other, measure)
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
        row: list[Cell] = [method]
        for measure in SHOWN:
            by_seed = [np.nanmean(values) for values in of_seeds(runs, method, measure)]
            value, error = mean_and_error(by_seed)
            row.append(f"{value:.3f}" if method == TRUTH or np.isnan(error) else f"{value:.3f} ± {error:.3f}")
        rows.append(row)
    note = "Means over the held-out images and the seeds ± standard error over the seeds; complexity in bits."
    return Table(f"{name.capitalize()}: all numbers", ["", *SHOWN], rows, note)


def _differences(name: str, runs: Runs) -> Table:
    excess = np.nanmean(of_seeds(runs, PLAIN, AIM)) - np.nanmean(of_seeds(runs, TRUTH, AIM))
    rows: list[list[Cell]] = []
    for method in methods_of(runs):
        if method in (PLAIN, TRUTH):
            continue
        found = [difference(runs, method, PLAIN, measure) for measure in ("IoU", "boundary F", AIM, "mask, grid")]
        rows.append(
            [
                method,
                *(f"{value:+.3f} ± {error:.3f}" for value, error in found),
                f"{-found[2][0] / excess:.0%}",
            ]
        )
    columns = ["", "IoU", "boundary F", AIM, "mask, grid", "share of the excess gone"]
    note = (
        "Differences from no term ± standard error over the images. The excess is that of the complexity of objects in "
        f"their own frames over the truth's, {excess:.3f} bits; more than 100 % is simpler than the truth."
    )
    return Table(f"{name.capitalize()}: against no term", columns, rows, note)


def draw(measured: dict[str, Runs], curves: dict[str, list[str]], path: Path) -> None:
    """Complexity against overlap, a curve for each kind of method."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    from benchmarks.plots import COLOURS, MARKERS

    with mpl.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(9, 4), layout="constrained", dpi=150)
        for axes, (name, runs) in zip(
            figure.subplots(1, len(measured), squeeze=False)[0], measured.items(), strict=True
        ):
            present = methods_of(runs)

            def at(method: str, runs: Runs = runs) -> tuple[float, float]:
                return tuple(float(np.nanmean(of_seeds(runs, method, of))) for of in (AIM, "IoU"))  # type: ignore[return-value]

            for i, (label, methods) in enumerate(curves.items()):
                points = [at(method) for method in methods if method in present]
                if points:
                    x, y = zip(*points, strict=True)
                    axes.plot(
                        x,
                        y,
                        "-" + MARKERS[i % len(MARKERS)],
                        color=COLOURS[i % len(COLOURS)],
                        label=label,
                        markerfacecolor="white" if i >= len(COLOURS) else None,
                        markersize=5,
                    )
            axes.plot(*at(PLAIN), "k*", markersize=10, label=PLAIN)
            axes.axvline(at(TRUTH)[0], color="0.5", linestyle=":", label="complexity of the truth")
            axes.set_title(name)
            axes.set_xlabel("complexity of objects in their own frames, bits")
            axes.set_ylabel("IoU")
        axes.legend(fontsize=7)
        figure.savefig(path, metadata={"Software": None})
