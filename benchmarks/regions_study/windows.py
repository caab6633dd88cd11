"""Which part of the input space should a turned grid see? `python -m benchmarks.regions_study.windows`.

A turned grid cannot see the box within the bounds and nothing else, unless the slanted edges of that box become a part
of the boundary of every region, which even a constant classifier would have. So the window itself has to turn. Four are
compared, all around the centre of the box and with the same steps:

- "same side": a square of the side of the box. The library has it.
- "in every one": the side divided by the square root of 2: the largest that never leaves the box.
- "largest within": the largest that does not leave the box at each angle; the side depends on the angle.
- "around": the side times the square root of 2: the smallest that holds the box at every angle.
"""

import argparse
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from benchmarks.regions_study.classifiers import classifiers
from benchmarks.regions_study.correlations import mean_of, spearman
from benchmarks.regions_study.data import SYNTHETIC, VIEWS, Array, Split, split
from benchmarks.regions_study.measures import EPS, ROTATIONS, targets
from benchmarks.results import Cell, Table, markdown
from torchlinf.regions import bounds_around, decision_region_complexity

DOCS = Path(__file__).parents[2] / "docs"
FILE = "regions_study_windows.inc"
REAL = [name for name in VIEWS if name not in SYNTHETIC]
ANGLES = [i * 90 / ROTATIONS for i in range(ROTATIONS)]
SIDES = {
    "same side": lambda angle: 1.0,
    "in every one": lambda angle: math.sqrt(0.5),
    "largest within": lambda angle: 1 / (math.cos(math.radians(angle)) + math.sin(math.radians(angle))),
    "around": lambda angle: math.sqrt(2),
}


def main(arguments: list[str] | None = None) -> None:
    """Print and write the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.regions_study.windows", description=__doc__)
    parser.add_argument("--only", action="append", choices=REAL, metavar="NAME", help="a data set; several times")
    parser.add_argument("--resolution", type=int, default=64, help="points along each side of the box")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder for the table")
    options = parser.parse_args(arguments)
    found = {name: compared(split(VIEWS[name], 0), options.resolution) for name in options.only or REAL}
    text = markdown(table(found))
    print(text)
    (options.out / FILE).write_text(text, encoding="utf-8")


def compared(halves: Split, resolution: int) -> dict[str, dict[str, float]]:
    """For each window how much of the data it sees, and the correlations of the mean of rotations."""
    bounds = bounds_around(halves.train, eps=EPS)
    means: dict[str, list[float]] = {window: [] for window in SIDES}
    foretold: dict[str, list[float]] = {"gap": [], "flips": []}
    for classifier in classifiers(0).values():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            classifier.fit(halves.train, halves.train_classes)
        for what, values in foretold.items():
            values.append(targets(classifier, halves, 0)[what])
        for window, values in means.items():
            values.append(_mean(classifier, bounds, resolution, window))
    return {
        window: {
            "seen": seen(halves.train, bounds, window),
            "bits": float(np.mean(values)),
            **{what: spearman(values, of_target) for what, of_target in foretold.items()},
        }
        for window, values in means.items()
    }


def _mean(classifier: Any, bounds: list[tuple[float, float]], resolution: int, window: str) -> float:
    values = []
    for angle in ANGLES:
        side = SIDES[window](angle)
        ends = [((low + high) / 2, side * (high - low) / 2) for low, high in bounds]
        smaller = [(centre - reach, centre + reach) for centre, reach in ends]
        points = round(side * (resolution - 1)) + 1
        values.append(decision_region_complexity(classifier, smaller, resolution=points, orientation=angle).overall())
    return float(np.mean(values))


def seen(points: Array, bounds: list[tuple[float, float]], window: str) -> float:
    """The share of points that is within the window, a mean over the angles."""
    low, high = np.array(bounds).T
    place = (points - (low + high) / 2) / (high - low)  # in sides of the box
    shares = []
    for angle in ANGLES:
        cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        turned = place @ np.array([[cosine, sine], [-sine, cosine]])
        shares.append((np.abs(turned).max(axis=1) <= SIDES[window](angle) / 2).mean())
    return float(np.mean(shares))


def table(found: dict[str, dict[str, dict[str, float]]]) -> Table:
    """Means over the data sets."""
    real = list(found.values())
    rows: list[list[Cell]] = []
    for window in SIDES:
        seen_, bits, *correlations = (mean_of([of_set[window][what] for of_set in real]) for what in real[0][window])
        shown = [f"{mean.value:.2f} ± {mean.error:.2f}" for mean in correlations]
        rows.append([window, f"{seen_.value:.0%}", f"{bits.value:.2f}", *shown])
    columns = ["window", "training points within", "complexity, bits", "correlation with the gap", "with the flips"]
    note = f"One split of each of {len(real)} real sets, mean ± standard error over the sets."
    return Table("Windows of turned grids", columns, rows, note)


if __name__ == "__main__":
    main()
