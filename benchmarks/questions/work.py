"""How many full sweeps of the shape does a whole solve cost, and does that grow with the radius?"""

import numpy as np
from torch import Tensor

import torchlinf
from benchmarks import shapes
from benchmarks.questions.common import Solve, median
from benchmarks.results import Cell, Result, Table, Target
from benchmarks.shapes import Named
from benchmarks.sizes import Size
from benchmarks.timing import Ratio, Times, alternate, ratio
from torchlinf import FieldSolution
from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.parallel import threads
from torchlinf.kernels import grid, stencil

SWEEPS = 10


class LibrarySweep:
    """The library's own sweep of one shape: the fastest known here, so the unit that makes a solve look dearest."""

    def __init__(self, mask: Tensor) -> None:
        """Set up the shape on its grid with its distance as values."""
        array = mask.numpy()
        box = bounding_box(array)
        self.grid = grid.make_grid(grid.pad(array[box]))
        self.v = grid.pad(torchlinf.chessboard_distance(mask, spatial_ndim=mask.ndim).numpy()[box].astype(float))
        self.radius = int(self.v.max())
        self.buffer = np.empty((4, self.grid.shape[-1]))

    def __call__(self) -> None:
        """Sweep `SWEEPS` times, with no screening: the time does not depend on it."""
        flat = self.v.reshape(-1)
        stencil.sweep(flat, self.grid.starts, self.grid.ends, self.grid.rows, 1.0 / 3.0, None, SWEEPS, self.buffer)


def run(size: Size) -> Result:
    """Measure solve and sweep on the same shapes, on one core."""
    with threads(1):
        real = [_measure(shape, size) for shape in shapes.silhouettes(size.silhouettes, size.silhouette_side)]
        others = [_measure(shape, size) for shape in shapes.documented(size.documented)]
    by_radius = median([entry.share for entry in real])
    total = median([entry.equivalent.median for entry in real])
    return Result(
        name="work",
        title="Work of a solve in full sweeps",
        targets=[
            Target("work in equivalent sweeps, divided by D", "<=", 4, None, by_radius, " D"),
            Target("work in equivalent sweeps, whatever D", "<=", 250, 40, total, " sweeps"),
        ],
        tables=[_table(f"Silhouettes ({shapes.origin()})", real), _table("Shapes of the method page", others)],
        series={
            "names": [entry.shape.name for entry in real + others],
            "radius": [entry.radius for entry in real + others],
            "equivalent": [entry.equivalent.median for entry in real + others],
            "real": len(real),
        },
        raw={entry.shape.name: {name: vars(times) for name, times in entry.times.items()} for entry in real + others},
    )


class _Measured:
    """Times of one shape, and what follows from them."""

    def __init__(self, shape: Named, radius: int, times: dict[str, Times], solution: FieldSolution) -> None:
        self.shape = shape
        self.radius = radius
        self.times = times
        self.solution = solution

    @property
    def equivalent(self) -> Ratio:
        """The solve in sweeps."""
        return Ratio(*(SWEEPS * value for value in vars(ratio(self.times["solve"], self.times["sweeps"])).values()))

    @property
    def share(self) -> float:
        """The same as a multiple of D."""
        return self.equivalent.median / self.radius

    @property
    def distance(self) -> float:
        """The part of it that is the distance, in sweeps."""
        return SWEEPS * ratio(self.times["distance"], self.times["sweeps"]).median


def _measure(shape: Named, size: Size) -> _Measured:
    mask = shape.mask
    sweep, ours = LibrarySweep(mask), Solve(mask)
    times = alternate(
        {
            "solve": ours,
            "sweeps": sweep,
            "distance": lambda: torchlinf.chessboard_distance(mask, spatial_ndim=mask.ndim),
        },
        rounds=size.rounds,
        budget=size.patience,
    )
    return _Measured(shape, sweep.radius, times, ours.solution)


def _table(title: str, found: list[_Measured]) -> Table:
    columns = ["shape", "pixels", "D", "one sweep, µs", "ns a pixel", "solve, ms", "equivalent sweeps"]
    columns += ["in D", "of these distance", "sweeps done", "solves done"]
    rows: list[list[Cell]] = []
    for entry in found:
        sweep = entry.times["sweeps"].median / SWEEPS
        rows.append(
            [
                entry.shape.name,
                entry.shape.pixels,
                entry.radius,
                1e6 * sweep,
                1e9 * sweep / entry.shape.pixels,
                1e3 * entry.times["solve"].median,
                entry.equivalent.median,
                entry.share,
                entry.distance,
                int(entry.solution.num_sweeps),
                int(entry.solution.num_solves),
            ]
        )
    note = (
        "Equivalent sweeps are the time of the whole `solve_field` call divided by the time of one sweep of the "
        "library's compiled kernel over the same shape. Sweeps done are what the solver counts, coarse grids by their "
        "share of the pixels."
    )
    return Table(title, columns, rows, note)
