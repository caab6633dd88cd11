"""The loop that knows no method: some sweeps, then a certificate, in turn; finished shapes leave the batch."""

from collections.abc import Iterator
from typing import Protocol

import torch
from torch import Tensor

from torchlinf.field.certificate import RESOLUTION, certify
from torchlinf.field.cuda_graphs import GRAPH_SWEEPS, Replay
from torchlinf.field.problem import Problem
from torchlinf.field.solution import FieldSolution, Status
from torchlinf.field.start import start
from torchlinf.field.stencil import Layout, System

GROUP_PIXELS = 1 << 17
NEVER = 1 << 60


class Method(Protocol):
    """One way to sweep, for all shapes of a system at once; each shape goes its own way."""

    step_sweeps: int
    line: Tensor
    system: System

    def __init__(self, system: System, line: Tensor) -> None:
        """Begin at the values on `line`, which the method may overwrite."""

    @staticmethod
    def limit(radius: Tensor) -> Tensor:
        """Sweeps allowed by default to shapes of these radii."""

    def step(self) -> None:
        """Apply the stencil `step_sweeps` times to every shape; leaves the values on `line`."""

    def select(self, keep: Tensor) -> None:
        """Go on with the shapes of these indices only."""

    def fall_back(self, stalled: Tensor, best: Tensor) -> None:
        """Go on more carefully, from the values `best`, on the shapes marked in `stalled`."""


def iterate(kind: type[Method], problem: Problem, tol: float, max_sweeps: int | None) -> FieldSolution:
    """Sweep until each shape is certified to `tol` or has used up its sweeps.

    A bound below `RESOLUTION` ulps of the largest value is not asked for: rounding is in the way.
    """
    layout = Layout(problem.mask)
    answer = unsolved(problem.radius, problem.screening.new_zeros(problem.mask.shape))
    for group in groups(problem.radius > 0, GROUP_PIXELS // layout.pixels):
        chosen = problem.select(group)
        inside = layout.rows(layout.pack(chosen.mask.to(chosen.screening.dtype)))
        values = layout.pack(start(chosen))
        system = System(layout, inside, chosen.screening[:, None], chosen.radius.long(), problem.compile)
        Batch(kind, system, values, group, max_sweeps).solve(tol, answer)
    return answer


def unsolved(radius: Tensor, value: Tensor) -> FieldSolution:
    """A solution to be filled in, of the values 0: right for the empty shapes."""
    return FieldSolution(
        value=value,
        error_bound=value.new_zeros(len(value)),
        num_sweeps=torch.zeros_like(radius, dtype=torch.int64),
        num_solves=torch.zeros_like(radius, dtype=torch.int64),
        status=torch.full_like(radius, int(Status.EMPTY), dtype=torch.int64),
    )


def groups(chosen: Tensor, size: int) -> Iterator[Tensor]:
    """Indices of the chosen shapes, (N,) bool, on a CPU in groups of that size, so that their storage is bounded."""
    index = chosen.nonzero()[:, 0]
    size = size if index.device.type == "cpu" else len(index)
    yield from (group for group in index.split(max(1, size)) if len(group))


def ended(bound: Tensor, best: Tensor, largest: Tensor, used_up: Tensor, tol: float) -> Tensor:
    """The status (N,) of the shapes that are to leave, NEVER for the others.

    Args:
        bound: what was certified last.
        best: the least bound of each shape so far.
        largest: the largest of the values that belong to it.
        used_up: which shapes have no sweeps left.
        tol: the bound to reach.
    """
    floor = RESOLUTION * torch.finfo(largest.dtype).eps * largest
    status = torch.where(used_up, int(Status.MAX_SWEEPS), NEVER)
    status = torch.where(bound.isnan(), int(Status.NONFINITE), status)
    return torch.where(best <= floor.clamp(min=tol), int(Status.CONVERGED), status)


class Batch:
    """The shapes of one group that are not solved yet, and the best certified values of each.

    All of them have the same sweeps behind them. How many sweeps follow before the next certificate depends on that
    number alone, so it is the same for a shape in every batch.
    """

    def __init__(
        self, kind: type[Method], system: System, values: Tensor, shape: Tensor, max_sweeps: int | None
    ) -> None:
        """Begin at `values`, a line of the system's layout; `shape` are the numbers of the shapes in the answer."""
        self.layout = system.layout
        self.shape = shape
        self.max_sweeps = max_sweeps
        self.limit = kind.limit(system.radius) if max_sweeps is None else torch.full_like(system.radius, max_sweeps)
        self.best = self.layout.rows(values).clone()
        self.bound = torch.full_like(self.best[:, 0], torch.inf)
        # the last bound that was half of the one before, and when it was reached
        self.mark, self.marked = self.bound, torch.zeros_like(system.radius)
        self.done = 0
        self.method = kind(system, values)
        self.replay = Replay(self.method)

    def solve(self, tol: float, answer: FieldSolution) -> None:
        """Work until no shape is left; write each into `answer` when it leaves."""
        while len(self.shape):
            status = self._certify(tol)
            leave = status != NEVER
            if leave.any():
                self._finish(leave, status, answer)
            if len(self.shape):
                self._restart_stalled()
                self._sweep()

    def _certify(self, tol: float) -> Tensor:
        """Keep what is better than the best; the status of the shapes that are to leave, NEVER for the others."""
        values = self.layout.rows(self.method.line)
        bound = certify(self.method.system.residual(self.method.line))
        self.done += 1
        better = bound < self.bound
        self.bound = torch.where(better, bound, self.bound)
        torch.where(better[:, None], values, self.best, out=self.best)
        # at least one step and its certificate have to fit in
        used_up = self.done + self.method.step_sweeps + 1 > self.limit
        return ended(bound, self.bound, self.best.amax(dim=1), used_up, tol)

    def _finish(self, leave: Tensor, status: Tensor, answer: FieldSolution) -> None:
        gone = self.shape[leave]
        answer.value[gone] = self.layout.unpack(self.best[leave])
        answer.error_bound[gone] = self.bound[leave]
        answer.num_sweeps[gone] = self.done
        answer.status[gone] = status[leave]
        keep = (~leave).nonzero()[:, 0]
        self.shape, self.limit, self.best = self.shape[keep], self.limit[keep], self.best[keep]
        self.bound, self.mark, self.marked = self.bound[keep], self.mark[keep], self.marked[keep]
        self.method.select(keep)
        self.replay = Replay(self.method)

    def _restart_stalled(self) -> None:
        """Have the shapes fall back whose best bound has not halved in 6 D + 96 sweeps."""
        halved = self.bound <= self.mark / 2
        self.mark = torch.where(halved, self.bound, self.mark)
        self.marked = torch.where(halved, self.done, self.marked)
        stalled = self.done - self.marked > 6 * self.method.system.radius + 96
        self.method.fall_back(stalled, self.best)
        self.marked = torch.where(stalled, self.done, self.marked)

    def _sweep(self) -> None:
        """Sweep for a sixteenth of all sweeps before, so that neither certificates nor sweeps too many cost much."""
        sweeps = GRAPH_SWEEPS * max(1, self.done // GRAPH_SWEEPS**2)
        if self.max_sweeps is not None:
            sweeps = min(sweeps, self.max_sweeps - self.done - 1)
        self.done += self.replay.run(sweeps)
