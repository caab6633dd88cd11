"""How much faster is the certified field of a volume than the best simple scheme?"""

import torch

from benchmarks import shapes
from benchmarks.questions.common import Policy, Solve, median, spread, times_as_long
from benchmarks.results import Cell, Result, Table, Target
from benchmarks.sizes import Size
from benchmarks.timing import alternate, ratio
from torchlinf import chessboard_distance
from torchlinf._helpers.parallel import threads

PATIENCE = 5  # times as much as for a silhouette


def run(size: Size) -> Result:
    """Volumes on one core against policy iteration with D/2 sweeps before each solve."""
    side = size.volume_side
    rows: list[list[Cell]] = []
    quotients, raw = [], {}
    stopped = 0
    with threads(1):
        Policy(torch.ones(6, 6, 6, dtype=torch.bool), 1.0, sweeping=True)()  # compiles its kernels
        for shape in shapes.volumes(side):
            mask = shape.mask
            policy = Policy(mask, PATIENCE * size.patience, sweeping=True)
            ours = Solve(mask)
            times = alternate({"torchlinf": ours, "policy": policy}, rounds=size.rounds, budget=size.patience)
            solution = ours.solution
            policy.check(solution.value)
            quotient = ratio(times["policy"], times["torchlinf"])
            stopped += not policy.outcome.converged
            quotients.append(quotient.median)
            raw[shape.name] = {name: vars(entry) for name, entry in times.items()}
            radius = int(chessboard_distance(mask, spatial_ndim=3).max())
            counts = [int(solution.num_sweeps), int(solution.num_solves), policy.outcome.solves]
            slower = times_as_long(quotient, not policy.outcome.converged)
            rows.append([shape.name, shape.pixels, radius, spread(times["torchlinf"]), *counts, slower, quotient.cpu])
    columns = ["shape", "pixels", "D", "ms (least to most)", "sweeps", "solves"]
    columns += ["(b'): solves", "(b'): times as long", "by CPU time"]
    note = f"at least: (b') was stopped on {stopped} of {len(rows)}" if stopped else ""
    return Result(
        name="volume",
        title="Volumes",
        targets=[Target(f"3-D, {side}³, field against (b')", ">=", 15, 50, median(quotients), "x", note)],
        tables=[Table(f"`solve_field` in {side} x {side} x {side}, one core", columns, rows)],
        raw=raw,
    )
