"""What does the profile cost beyond the field that it is made from?"""

from benchmarks import shapes
from benchmarks.questions.common import Solve, median, spread, times_as_long
from benchmarks.results import Cell, Result, Table, Target
from benchmarks.shapes import Named
from benchmarks.sizes import Size
from benchmarks.timing import Ratio, Times, alternate, ratio
from torchlinf import complexity_profile
from torchlinf._helpers.parallel import threads


def run(size: Size) -> Result:
    """Profile and field of the same silhouettes, on one core."""
    with threads(1):
        found = [_measure(shape, size) for shape in shapes.silhouettes(size.silhouettes, size.silhouette_side)]
    middle = median([quotient.median for *_, quotient in found])
    return Result(
        name="profile",
        title="The profile against the field alone",
        targets=[Target("profile against the field alone", "<=", 1.3, 1.1, middle, "x")],
        tables=[_table(found)],
        raw={shape.name: {name: vars(entry) for name, entry in times.items()} for shape, times, _ in found},
    )


def _measure(shape: Named, size: Size) -> tuple[Named, dict[str, Times], Ratio]:
    mask = shape.mask
    times = alternate(
        {"field": Solve(mask), "profile": lambda: complexity_profile(mask, spatial_ndim=2)},
        rounds=size.rounds,
        budget=size.patience,
    )
    return shape, times, ratio(times["profile"], times["field"])


def _table(found: list[tuple[Named, dict[str, Times], Ratio]]) -> Table:
    rows: list[list[Cell]] = [
        [shape.name, shape.pixels, spread(times["field"]), spread(times["profile"]), times_as_long(quotient)]
        for shape, times, quotient in found
    ]
    columns = ["shape", "pixels", "`solve_field`, ms (least to most)", "`complexity_profile`, ms", "profile / field"]
    return Table(f"One shape on one core ({shapes.origin()})", columns, rows)
