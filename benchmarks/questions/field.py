"""How much faster is the certified field than the schemes of the paper, and than what a torch user would write?"""

from dataclasses import dataclass

import numpy as np
import torch

import torchlinf
from benchmarks import shapes
from benchmarks.baselines.domain import Domain
from benchmarks.baselines.explicit import Compiled, Pooling, Vectorised, sweeps_from_zero
from benchmarks.questions.common import TOL, Policy, Solve, median, spread, times_as_long
from benchmarks.results import Cell, Result, Table, Target
from benchmarks.shapes import Named
from benchmarks.sizes import Size
from benchmarks.timing import Ratio, Times, alternate, ratio
from torchlinf._helpers.parallel import threads

SWEEPS = 10  # of an explicit scheme in one timed run
LARGE = 64  # radius from which on the explicit schemes are judged


@dataclass(frozen=True)
class Compared:
    """One silhouette: the library's times and counts, and the baselines'."""

    shape: Named
    radius: int
    ours: Times
    solution: torchlinf.FieldSolution
    plain: Policy
    mixed: Policy
    ratios: dict[str, Ratio]
    sweeps: int
    extrapolated: bool
    raw: dict[str, Times]


def run(size: Size) -> Result:
    """Compare on every silhouette, one core for each contender."""
    with threads(1):
        _warm_up()
        found = [_compare(shape, size) for shape in shapes.silhouettes(size.silhouettes, size.silhouette_side)]
    return Result(
        name="field",
        title="The certified field against other ways to solve it",
        targets=_targets(found),
        tables=[_times(found), _policies(found), _explicit(found)],
        series={
            "names": [entry.shape.name for entry in found],
            "converged": [entry.plain.outcome.converged for entry in found],
            "ratios": {name: [entry.ratios[name].median for entry in found] for name in found[0].ratios},
        },
        raw={entry.shape.name: {name: vars(times) for name, times in entry.raw.items()} for entry in found},
    )


def _warm_up() -> None:
    """Compile the baselines' kernels, so that no compilation is timed."""
    mask = torch.ones(12, 12, dtype=torch.bool)
    Policy(mask, np.inf, sweeping=True)()
    Solve(shapes.noisy_square(64))()


def _compare(shape: Named, size: Size) -> Compared:
    mask = shape.mask
    mixed = Policy(mask, size.patience, sweeping=True)
    plain = Policy(mask, size.patience, sweeping=False)
    ours = Solve(mask)
    first = alternate({"torchlinf": ours, "mixed": mixed}, rounds=size.rounds, budget=size.patience)
    second = alternate({"torchlinf": ours, "plain": plain}, rounds=size.rounds, budget=size.patience)
    for policy in (mixed, plain):
        policy.check(ours.solution.value)

    domain = Domain.of(mask)
    count = sweeps_from_zero(domain, TOL, size.patience / 4)
    schemes = {
        "vectorised": (Vectorised(domain), torch.from_numpy(count.value.copy())),
        "compiled": (Compiled(domain), count.value.copy()),
        "pooling": (Pooling(domain), torch.from_numpy(count.value.copy())[None, None]),
    }
    runs = {name: lambda scheme=scheme, v=v: scheme.sweep(v, SWEEPS) for name, (scheme, v) in schemes.items()}
    third = alternate({"torchlinf": ours, **runs}, rounds=size.rounds, budget=size.patience)
    ratios = {"plain": ratio(second["plain"], second["torchlinf"]), "mixed": ratio(first["mixed"], first["torchlinf"])}
    for name in runs:
        once = ratio(third[name], third["torchlinf"])
        times = count.sweeps / SWEEPS
        ratios[name] = Ratio(*(times * value for value in vars(once).values()))
    raw = {**third, "mixed": first["mixed"], "plain": second["plain"], "torchlinf": first["torchlinf"]}
    return Compared(
        shape,
        domain.radius,
        first["torchlinf"],
        ours.solution,
        plain,
        mixed,
        ratios,
        count.sweeps,
        count.extrapolated,
        raw,
    )


def _targets(found: list[Compared]) -> list[Target]:
    large = [entry for entry in found if entry.radius >= LARGE]
    note = f"D ≥ {LARGE}" if large else f"no shape of D ≥ {LARGE} in this run"
    stopped = sum(not entry.plain.outcome.converged for entry in found)
    gave_up = f"at least: in {stopped} of {len(found)} (b) was stopped before it converged" if stopped else ""
    explicit = [
        ("(a), whole-array operations", "vectorised"),
        ("(a), compiled loops", "compiled"),
        ("(c), `max_pool2d`", "pooling"),
    ]
    return [
        Target("field against (b)", ">=", 100, 500, _middle(found, "plain"), "x", gave_up),
        Target("field against (b')", ">=", 15, 50, _middle(found, "mixed"), "x"),
        *(
            Target(f"field against {what}", ">=", 2000, 10_000, _middle(large or found, name), "x", note)
            for what, name in explicit
        ),
    ]


def _middle(found: list[Compared], name: str) -> float:
    return median([entry.ratios[name].median for entry in found])


def _times(found: list[Compared]) -> Table:
    columns = ["shape", "pixels", "D", "ms, median (least to most)", "sweeps", "solves", "error bound"]
    rows: list[list[Cell]] = [
        [
            entry.shape.name,
            entry.shape.pixels,
            entry.radius,
            spread(entry.ours),
            int(entry.solution.num_sweeps),
            int(entry.solution.num_solves),
            f"{float(entry.solution.error_bound):.0e}",
        ]
        for entry in found
    ]
    return Table(f"`solve_field`, one shape on one core ({shapes.origin()})", columns, rows)


def _policies(found: list[Compared]) -> Table:
    columns = ["shape", "(b): solves", "(b): times as long", "by CPU time"]
    columns += ["(b'): solves", "(b'): times as long", "by CPU time "]
    rows: list[list[Cell]] = []
    for entry in found:
        row: list[Cell] = [entry.shape.name]
        for policy, name in ((entry.plain, "plain"), (entry.mixed, "mixed")):
            stopped = not policy.outcome.converged
            solves = f"{policy.outcome.solves}{', not converged' if stopped else ''}"
            row += [solves, times_as_long(entry.ratios[name], stopped), entry.ratios[name].cpu]
        rows.append(row)
    return Table("Policy iteration with sparse LU (b), and with D/2 sweeps before each solve (b')", columns, rows)


def _explicit(found: list[Compared]) -> Table:
    columns = ["shape", "D", "sweeps from zero", "sweeps / D²", "(a) whole-array", "(a) compiled", "(c) `max_pool2d`"]
    rows: list[list[Cell]] = [
        [
            entry.shape.name,
            entry.radius,
            f"{entry.sweeps:,}{' (extrapolated)' if entry.extrapolated else ''}",
            entry.sweeps / entry.radius**2,
            *(times_as_long(entry.ratios[name]) for name in ("vectorised", "compiled", "pooling")),
        ]
        for entry in found
    ]
    note = (
        "All three make the same iterates, so the sweeps to a certified 1e-9 are counted once, in compiled loops, and "
        "the times are this count times the time of one sweep. Where the count was stopped, the rest follows from "
        "the factor by which the residual fell in the last third of the run."
    )
    return Table("The explicit scheme from zero, times as long at equal certified error", columns, rows, note)
