"""How does the time of a solve grow with the pixels of one silhouette?"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from benchmarks import shapes
from benchmarks.questions.common import Policy, Solve, median
from benchmarks.results import Cell, Result, Table, Target
from benchmarks.shapes import Named
from benchmarks.sizes import Size
from benchmarks.timing import alternate
from torchlinf import chessboard_distance
from torchlinf._helpers.parallel import threads

KINDS = {"smooth": shapes.smooth, "repeat": shapes.repeat}
MOST_FOR_LU = 500_000  # pixels


@dataclass(frozen=True)
class Curve:
    """Seconds of processor time against pixels; the exponent is the slope of the line through their logarithms."""

    label: str
    pixels: list[int]
    seconds: list[float]
    exponent: float | None = None


def run(size: Size) -> Result:
    """Enlarge a thin and a bulky silhouette in two ways; one core."""
    chosen = shapes.silhouettes(4, size.silhouette_side)[1::2]
    curves, tables, exponents, raw = [], [], [], {}
    with threads(1):
        for shape in chosen:
            for kind, enlarge in KINDS.items():
                label = f"{shape.name}, {kind}"
                ours = _affordable(shape.mask, enlarge, size)
                times = alternate(ours, rounds=size.rounds, budget=size.patience)
                pixels = [int(contender.mask.sum()) for contender in ours.values()]
                seconds = [median(entry.cpu) for entry in times.values()]
                exponent = float(np.polyfit(np.log(pixels), np.log(seconds), 1)[0])
                tables.append(_table(f"{label}: time grows like pixels to the {exponent:.2f}", ours, seconds, size))
                curves.append(Curve(label, pixels, seconds, exponent))
                exponents.append(exponent)
                raw[label] = {name: vars(entry) for name, entry in times.items()}
        curves.append(_lu_curve(chosen[0], size))
    return Result(
        name="growth",
        title="Growth of the time with the size of one silhouette",
        targets=[Target("growth of time with pixels, exponent", "<=", 1.2, 1.05, max(exponents), note="worst curve")],
        tables=tables,
        series={"curves": [vars(curve) for curve in curves]},
        raw=raw,
    )


def _affordable(mask: Tensor, enlarge: Callable[[Tensor, int], Tensor], size: Size) -> dict[str, Solve]:
    """The enlargements, solved once each, up to the first that takes longer than a baseline would be given."""
    ours: dict[str, Solve] = {}
    for factor in size.factors:
        ours[f"{factor}x"] = contender = Solve(enlarge(mask, factor))
        began = time.process_time()
        contender()
        if time.process_time() - began > size.patience:
            break
    return ours


def _lu_curve(shape: Named, size: Size) -> Curve:
    """The best simple baseline on the smaller ones, for the plot."""
    pixels, seconds = [], []
    for factor in size.factors:
        mask = shapes.smooth(shape.mask, factor)
        if int(mask.sum()) <= MOST_FOR_LU:
            policy = Policy(mask, size.patience, sweeping=True)
            seconds.append(alternate({"policy": policy}, rounds=1)["policy"].cpu[0])
            pixels.append(int(mask.sum()))
    return Curve(f"(b'), {shape.name}, smooth", pixels, seconds)


def _table(title: str, ours: dict[str, Solve], seconds: list[float], size: Size) -> Table:
    rows: list[list[Cell]] = []
    for (name, contender), spent in zip(ours.items(), seconds, strict=True):
        pixels = int(contender.mask.sum())
        rows.append(
            [
                name,
                " x ".join(map(str, contender.mask.shape)),
                pixels,
                int(chessboard_distance(contender.mask, spatial_ndim=2).max()),
                1e3 * spent,
                1e9 * spent / pixels,
                int(contender.solution.num_sweeps),
                int(contender.solution.num_solves),
            ]
        )
    columns = ["side", "mask", "pixels", "D", "ms", "ns a pixel", "sweeps", "solves"]
    left_out = ", ".join(f"{factor}x" for factor in size.factors[len(ours) :])
    note = f"Not tried, as the last one took over {size.patience:g} s: {left_out}." if left_out else ""
    return Table(title, columns, rows, note)
