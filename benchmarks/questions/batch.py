"""What do batches gain, in compiled code on two cores and in torch operations?"""

import os
from collections.abc import Callable

from torch import Tensor

from benchmarks import shapes
from benchmarks.questions.common import TOL, spread, times_as_long
from benchmarks.results import Cell, Result, Table, Target
from benchmarks.sizes import Size
from benchmarks.timing import Ratio, Times, alternate, ratio
from torchlinf import complexity_profile, solve_field
from torchlinf._helpers.parallel import threads

CORES = min(2, os.cpu_count() or 1)


def run(size: Size) -> Result:
    """Batches against one by one, and batches of several sizes on the torch path; two threads throughout."""
    masks = shapes.batch(size.batches[-1], size.batch_side)
    with threads(CORES):
        pairs = {name: _pair(call, masks, size) for name, call in _calls().items()}
        growth = {count: _sizes(masks[:count], size) for count in size.batches}
    gain = ratio(pairs["solve_field"]["one by one"], pairs["solve_field"]["batch"])
    what = f"batch of {len(masks)} on {CORES} cores against one by one, throughput"
    return Result(
        name="batch",
        title="Batches",
        targets=[Target(what, ">=", 1.8, None, gain.median, "x")],
        tables=[_gain_table(pairs, masks), _size_table(growth, size)],
        series={str(count): {name: entry.median for name, entry in times.items()} for count, times in growth.items()},
        raw={
            **{name: {key: vars(entry) for key, entry in times.items()} for name, times in pairs.items()},
            **{str(count): {key: vars(entry) for key, entry in times.items()} for count, times in growth.items()},
        },
    )


def _calls() -> dict[str, Callable[[Tensor], object]]:
    return {
        "solve_field": lambda mask: solve_field(mask, spatial_ndim=2, tol=TOL),
        "complexity_profile": lambda mask: complexity_profile(mask, spatial_ndim=2, tol=TOL),
    }


def _pair(call: Callable[[Tensor], object], masks: Tensor, size: Size) -> dict[str, Times]:
    runs = {"one by one": lambda: [call(mask) for mask in masks], "batch": lambda: call(masks)}
    return alternate(runs, rounds=size.rounds, budget=size.patience)


def _sizes(masks: Tensor, size: Size) -> dict[str, Times]:
    """The first shapes as one batch, by either method that is made for speed."""
    runs = {
        method: lambda method=method: solve_field(masks, spatial_ndim=2, tol=TOL, method=method)
        for method in ("accelerated", "compiled")
    }
    return alternate(runs, rounds=size.rounds, budget=size.patience)


def _gain_table(pairs: dict[str, dict[str, Times]], masks: Tensor) -> Table:
    rows: list[list[Cell]] = []
    for name, times in pairs.items():
        gain: Ratio = ratio(times["one by one"], times["batch"])
        rows.append([f"`{name}`", spread(times["one by one"]), spread(times["batch"]), times_as_long(gain)])
    sizes = " x ".join(map(str, masks.shape))
    columns = ["call", "one by one, ms (least to most)", "batch, ms", "throughput, batch / one by one"]
    return Table(f"{sizes} silhouettes on {CORES} cores ({shapes.origin()})", columns, rows)


def _size_table(growth: dict[int, dict[str, Times]], size: Size) -> Table:
    rows: list[list[Cell]] = []
    for count, times in growth.items():
        accelerated, compiled = times["accelerated"], times["compiled"]
        quotient = ratio(accelerated, compiled)
        rows.append(
            [count, 1e3 * accelerated.median / count, 1e3 * compiled.median / count, times_as_long(quotient)]
        )  # fmt: skip
    columns = ["batch", '"accelerated", ms a shape', '"compiled", ms a shape', "accelerated / compiled"]
    title = f"Batches of {size.batch_side} x {size.batch_side} silhouettes by method, {CORES} cores"
    return Table(title, columns, rows)
