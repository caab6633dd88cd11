"""How much slower than compiled code are the methods in torch operations, how does their work grow, are they exact?"""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from benchmarks import shapes
from benchmarks.questions.common import TOL, Solve, times_as_long
from benchmarks.results import Cell, Result, Table, Target
from benchmarks.sizes import Size
from benchmarks.timing import Times, alternate, ratio
from torchlinf import solve_field
from torchlinf._helpers.parallel import threads
from torchlinf.field import Layout, System, pose

METHODS = ("accelerated", "batched")
SWEEPS = 10


class TorchSweep:
    """The sweep in torch operations of one shape: the unit in which the work of these methods is counted."""

    def __init__(self, mask: Tensor) -> None:
        """Set up the shape on its layout with its distance as values."""
        problem = pose(mask[None], None, (1,))
        layout = Layout(problem.mask)
        inside = layout.rows(layout.pack(problem.mask.double()))
        self.radius = int(problem.radius)
        self.system = System(layout, inside, problem.screening[:, None], problem.radius.long())
        self.line = layout.pack(problem.distance.double())
        self.out = self.line.clone()

    def __call__(self) -> None:
        """Sweep `SWEEPS` times; the values do not matter to the time."""
        for _ in range(SWEEPS):
            self.system.sweep(self.line, out=self.system.layout.rows(self.out))


def run(size: Size) -> Result:
    """One core: batches by every method, and the work of single silhouettes enlarged to 1, 2, 4 times the side."""
    masks = shapes.batch(size.batches[-1], size.batch_side)
    with threads(1):
        sizes = {count: _batch(masks[:count], size) for count in size.batches}
        others = {name: _alternate(masks, size, METHODS) for name, masks in _others(size).items()}
        growth = {shape.name: _growth(shape.mask, size) for shape in shapes.silhouettes(2, size.batch_side)}
    certified, asked = _certified(size)
    targets, tables = [], [_batch_table(sizes, size), _others_table(others)]
    targets.append(Target(f'"batched" certified to {TOL:g}, of {asked} masks', ">=", asked, None, certified, ""))
    last = sizes[size.batches[-1]]
    for method in METHODS:
        quotient = ratio(last[method], last["compiled"])
        what = f'"{method}" over "compiled", batch of {size.batches[-1]}, processor time'
        targets.append(Target(what, "<=", 8, 4, quotient.cpu, "x"))
        work = [_work(entry, method) for entries in growth.values() for entry in entries]
        targets.append(Target(f'work of "{method}", most', "<=", 5, None, max(share for share, _ in work), " D"))
        exponent = max(_exponent(entries, method) for entries in growth.values())
        targets.append(Target(f'growth of the work of "{method}" with D, exponent', "<=", None, 0.3, exponent))
    tables += [_growth_table(name, entries) for name, entries in growth.items()]
    return Result(
        name="torch_path",
        title="Methods in torch operations",
        targets=targets,
        tables=tables,
        series={},
        raw={str(count): {key: vars(entry) for key, entry in times.items()} for count, times in sizes.items()},
    )


def _batch(masks: Tensor, size: Size) -> dict[str, Times]:
    return _alternate(masks, size, (*METHODS, "compiled"))


def _alternate(masks: Tensor, size: Size, methods: tuple[str, ...]) -> dict[str, Times]:
    runs = {
        method: lambda method=method: solve_field(masks, spatial_ndim=masks.ndim - 1, tol=TOL, method=method)
        for method in methods
    }
    return alternate(runs, rounds=size.rounds, budget=size.patience)


def _others(size: Size) -> dict[str, Tensor]:
    """Batches in other dimensions, and noise, whose radii are small."""
    random = np.random.default_rng(0)
    side, edge = size.batch_side, size.batch_side // 6
    sizes = {"1-D": (4, 3 * side), "noise": (16, side, side), "3-D": (2, *[edge] * 3), "4-D": (2, *[edge // 2] * 4)}
    filled = {"1-D": 0.99, "noise": 0.6, "3-D": 0.999, "4-D": 0.999}
    return {
        f"{name}, {' x '.join(map(str, shape))}": torch.from_numpy(random.random(shape) < filled[name])
        for name, shape in sizes.items()
    }


def _certified(size: Size) -> tuple[int, int]:
    """How many silhouettes at 1, 2 and 4 times the side are certified, and of how many."""
    found = [
        solve_field(shapes.repeat(shape.mask, factor), tol=TOL, method="batched", spatial_ndim=2, throw=False)
        for shape in shapes.silhouettes(40 if size.batch_side >= 192 else 2, size.batch_side)
        for factor in (1, 2, 4)
    ]
    return sum(bool(field.error_bound <= TOL) for field in found), len(found)


def _others_table(others: dict[str, dict[str, Times]]) -> Table:
    rows: list[list[Cell]] = [
        [name, *(1e3 * times[method].median for method in METHODS), ratio(times["batched"], times["accelerated"]).cpu]
        for name, times in others.items()
    ]
    columns = ["batch", *(f'"{method}", ms' for method in METHODS), "batched / accelerated"]
    return Table("Random pixels, one core", columns, rows)


def _growth(mask: Tensor, size: Size) -> list[tuple[int, Mapping[str, Times]]]:
    """Radius and times of the enlarged shapes, up to four times the side."""
    entries = []
    for factor in (factor for factor in size.factors if factor <= 4):
        enlarged = shapes.repeat(mask, factor)
        sweep = TorchSweep(enlarged)
        runs = {"sweep": sweep, **{method: Solve(enlarged, method) for method in METHODS}}
        entries.append((sweep.radius, alternate(runs, rounds=size.rounds, budget=size.patience)))
    return entries


def _work(entry: tuple[int, Mapping[str, Times]], method: str) -> tuple[float, float]:
    """The solve in sweeps of its shape by processor time: as a multiple of D, and as it is."""
    radius, times = entry
    sweeps = SWEEPS * ratio(times[method], times["sweep"]).cpu
    return sweeps / radius, sweeps


def _exponent(entries: list[tuple[int, Mapping[str, Times]]], method: str) -> float:
    radii = [radius for radius, _ in entries]
    return float(np.polyfit(np.log(radii), np.log([_work(entry, method)[1] for entry in entries]), 1)[0])


def _batch_table(sizes: dict[int, dict[str, Times]], size: Size) -> Table:
    rows: list[list[Cell]] = [
        [count, *(1e3 * times[name].median / count for name in (*METHODS, "compiled")), *_quotients(times)]
        for count, times in sizes.items()
    ]
    columns = ["batch", *(f'"{name}", ms a shape' for name in (*METHODS, "compiled"))]
    columns += [f"{name} / compiled" for name in METHODS]
    return Table(f"Batches of {size.batch_side} x {size.batch_side} silhouettes, one core", columns, rows)


def _quotients(times: dict[str, Times]) -> list[Cell]:
    return [times_as_long(ratio(times[method], times["compiled"])) for method in METHODS]


def _growth_table(name: str, entries: list[tuple[int, Mapping[str, Times]]]) -> Table:
    rows: list[list[Cell]] = [
        [entry[0], *(part for method in METHODS for part in reversed(_work(entry, method)))] for entry in entries
    ]
    columns = ["D", *(part for method in METHODS for part in (f'"{method}", sweeps', "sweeps / D"))]
    return Table(f"Work of {name}, enlarged, in sweeps in torch operations", columns, rows)
