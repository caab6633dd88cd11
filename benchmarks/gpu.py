"""Where is a mask on a GPU solved sooner: there, or by a trip to the host? `python -m benchmarks.gpu`.

Prints a table of times, the row of `torchlinf.field.methods.STAYS` that follows from it, a batch on the GPU against the
cores of the CPU, and steps of the loss. It stores nothing.
"""

import argparse
import itertools
import math
import os
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from benchmarks import shapes
from benchmarks.questions.common import TOL, spread, times_as_long
from benchmarks.results import Cell, Table, markdown
from benchmarks.timing import Times, alternate, ratio
from torchlinf import solve_field
from torchlinf._helpers.parallel import threads
from torchlinf.field import METHODS
from torchlinf.losses import ShapeComplexityLoss

COUNTS = (1, 16, 64)
SIDES = (128, 256, 512, 1024)
TRIP = "compiled"
ON_DEVICE = tuple(name for name in METHODS if name not in (TRIP, "monotone"))
CORES = 16

Key = tuple[int, int]  # side and number of shapes


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    options = _parser().parse_args(arguments)
    device = torch.device(options.device)
    print(f"{_name_of(device)}; host: {torch.get_num_threads()} threads; shapes: {shapes.origin()}\n")
    times: dict[Key, dict[str, Times]] = {}
    for side, count in itertools.product(options.sides, options.counts):
        times[side, count] = _solves(shapes.batch(count, side).to(device), options.rounds, options.patience)
        found = {method: round(1e3 * entry.median, 1) for method, entry in times[side, count].items()}
        print(f"{count} x {side} x {side}, ms: {found}", flush=True)
    print("\n" + markdown(_table(times)))
    pairs = str(row(times)).replace("inf", "math.inf")
    print(f'The row of torchlinf/field/methods.py that follows:\nSTAYS["{device.type}"] = {pairs}\n')
    print(markdown(_against_cores(shapes.batch(options.counts[-1], options.batch_side), device, options)))
    print(markdown(_steps(device, options)))


def _solves(found: Tensor, rounds: int, patience: float) -> dict[str, Times]:
    """Times of each method on the masks, wherever they are; the fields must agree as far as they are certified."""
    fields: dict[str, Tensor] = {}

    def run(method: str) -> Callable[[], None]:
        def solve() -> None:
            fields[method] = solve_field(found, method=method, tol=TOL, spatial_ndim=2).value
            _wait(found.device)

        return solve

    times = alternate({method: run(method) for method in (*ON_DEVICE, TRIP)}, rounds=rounds, budget=patience)
    for method in ON_DEVICE:
        apart = float(((fields[method] - fields[TRIP]).abs() / fields[TRIP].clamp(min=1)).max())
        if apart > 2.1 * TOL:
            raise AssertionError(f"certified fields must agree to 2e-9; {method} differs by {apart:.1e}")
    return times


def row(times: dict[Key, dict[str, Times]]) -> tuple[tuple[float, float], ...]:
    """From how many shapes on a batch stays on the device, by the pixels of a mask: see `methods.STAYS`.

    Of the numbers of shapes that were measured it is the least from which on the device was always sooner; infinite if
    there is none. Larger masks than the largest are treated as those.
    """
    sides, counts = sorted({side for side, _ in times}), sorted({count for _, count in times})
    found: list[tuple[float, float]] = []
    for side in sides:
        fewest = math.inf
        for count in reversed(counts):
            if _soonest(times[side, count]) == TRIP:
                break
            fewest = count
        found.append((math.inf if side == sides[-1] else side**2, fewest))
    return tuple(found)


def _soonest(times: dict[str, Times]) -> str:
    return min(times, key=lambda method: times[method].median)


def _table(times: dict[Key, dict[str, Times]]) -> Table:
    rows: list[list[Cell]] = []
    for (side, count), of_methods in times.items():
        device = min(ON_DEVICE, key=lambda method, found=of_methods: found[method].median)
        cells = [spread(of_methods[method]) for method in (*ON_DEVICE, TRIP)]
        rows.append([f"{count} x {side} x {side}", *cells, times_as_long(ratio(of_methods[TRIP], of_methods[device]))])
    columns = ["masks", *(f"`{method}` there, ms" for method in ON_DEVICE), "trip, ms", "trip / there"]
    return Table("On the device, or by a trip to the host", columns, rows)


def _against_cores(found: Tensor, device: torch.device, options: argparse.Namespace) -> Table:
    """A batch on the device against masks that are on the CPU, on at most `CORES` of its cores."""
    there, cores = found.to(device), min(CORES, os.cpu_count() or 1)

    def on_device(method: str) -> Callable[[], None]:
        def solve() -> None:
            solve_field(there, method=method, tol=TOL, spatial_ndim=2)
            _wait(device)

        return solve

    runs: dict[str, Callable[[], object]] = {method: on_device(method) for method in ON_DEVICE}
    with threads(cores):
        runs["cores"] = lambda: solve_field(found, method=TRIP, tol=TOL, spatial_ndim=2)
        times = alternate(runs, rounds=options.rounds, budget=options.patience)
    best = min(ON_DEVICE, key=lambda method: times[method].median)
    size = " x ".join(map(str, found.shape))
    cells: list[Cell] = [size, best, spread(times[best]), spread(times["cores"])]
    columns = ["masks", "method", "on the device, ms", f"on {cores} cores of the CPU, ms", "CPU / device"]
    return Table("Against the CPU", columns, [[*cells, times_as_long(ratio(times["cores"], times[best]))]])


def _steps(device: torch.device, options: argparse.Namespace) -> Table:
    """Forward and backward pass of the loss, of predictions on the device and of the same on the CPU."""
    side = options.sides[0]
    here = 4.0 * shapes.batch(options.counts[-1], side)[:16, None].float() - 2.0
    rows: list[list[Cell]] = []
    for name, kwargs in {"plain": {}, "per object": {"per": "object"}}.items():
        loss = ShapeComplexityLoss(activation="sigmoid", max_flips=options.flips, **kwargs)

        def run(logits: Tensor, loss: ShapeComplexityLoss = loss) -> None:
            loss(logits.detach().requires_grad_()).backward()
            _wait(logits.device)

        there = here.to(device)
        times = alternate(
            {"device": lambda: run(there), "host": lambda: run(here)},  # noqa: B023
            rounds=options.rounds,
            budget=options.patience,
        )
        cells = [spread(times["device"]), spread(times["host"])]
        size = " x ".join(map(str, here.shape))
        rows.append([name, size, *cells, times_as_long(ratio(times["device"], times["host"]))])
    columns = ["loss", "logits", "on the device, ms", "on the CPU, ms", "device / CPU"]
    return Table("A step of the loss", columns, rows)


def _wait(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def _name_of(device: torch.device) -> str:
    return f"device: {torch.cuda.get_device_name(device) if device.type == 'cuda' else device.type}"


def _numbers(text: str) -> Sequence[int]:
    return tuple(int(number) for number in text.split(","))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gpu", description=__doc__)
    parser.add_argument("--device", default="cuda", help="cuda (default); cpu only shows that the benchmark runs")
    parser.add_argument("--counts", type=_numbers, default=COUNTS, help="numbers of shapes, ascending")
    parser.add_argument("--sides", type=_numbers, default=SIDES, help="sides of the masks, ascending")
    parser.add_argument("--batch-side", type=int, default=256, help="side of the batch that the CPU solves too")
    parser.add_argument("--flips", type=int, default=16, help="flips a shape of the loss")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--patience", type=float, default=10.0, help="seconds after which no more rounds are begun")
    return parser


if __name__ == "__main__":
    main()
