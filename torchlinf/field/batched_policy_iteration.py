"""Policy iteration in torch operations, method="batched": all shapes at once, coarse to fine, on any device.

Some sweeps, then the values that the policies lead to, in turn, as the compiled method does it.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from torchlinf.field.certificate import certify
from torchlinf.field.distance import distance_of
from torchlinf.field.iterate import NEVER, ended, groups, unsolved
from torchlinf.field.policy_graph import Pixels, solve_policies
from torchlinf.field.problem import Problem
from torchlinf.field.solution import FieldSolution
from torchlinf.field.start import start
from torchlinf.field.stencil import Layout, System

SWEEPS = 24  # before each linear solve, doubled after every ROUNDS of these
ROUNDS = 6
COARSEST = 12  # radius up to which no coarser grid is worth its while
COARSE_TOL = 0.01
TIE = 1e-11  # share of the start's maximum within which neighbours are equal: rounding, not geometry
GROUP_PIXELS = 1 << 20


def solve_batched(problem: Problem, tol: float, max_sweeps: int | None) -> FieldSolution:
    """Solve all shapes, on a CPU in groups of bounded memory."""
    answer = unsolved(problem.radius, problem.screening.new_zeros(problem.mask.shape))
    for group in groups(problem, GROUP_PIXELS // max(1, problem.mask[:1].numel())):
        _Rounds(problem.select(group), group, max_sweeps).solve(tol, answer)
    return answer


class _Rounds:
    """The shapes that are not solved yet. All have the same rounds behind them, each goes its own way."""

    def __init__(self, problem: Problem, shape: Tensor, max_sweeps: int | None) -> None:
        self.problem, self.shape = problem, shape
        self.max_sweeps = max_sweeps
        self.limit = 20_000 + 200 * problem.radius.long()
        if max_sweeps is not None:
            self.limit = torch.full_like(self.limit, max_sweeps)
        self.done = torch.zeros_like(problem.screening)
        self.solves = torch.zeros_like(self.limit)
        values = start(problem)
        self.largest = values.flatten(1).amax(dim=1)
        self.bound = torch.full_like(self.largest, torch.inf)
        self._lay_out(values)
        self.best = values

    def _lay_out(self, values: Tensor) -> None:
        """Put the values of all shapes on a line."""
        mask, screening = self.problem.mask, self.problem.screening
        self.layout = Layout(mask)
        self.line = self.layout.pack(values)
        inside = self.layout.rows(self.layout.pack(mask.to(values)))
        self.system = System(self.layout, inside, screening[:, None], self.problem.radius.long(), self.problem.compile)
        self.next = self.line.clone()
        place = self.layout.line(inside).nonzero()[:, 0]
        shape = (place - self.layout.guard) // self.layout.pixels
        index = torch.full_like(self.line, len(place), dtype=torch.int64)
        index[place] = torch.arange(len(place), device=place.device)
        count = torch.zeros_like(self.solves).index_add_(0, shape, torch.ones_like(shape))
        rank = torch.arange(len(place), device=place.device) - (count.cumsum(0) - count)[shape]
        self.pixels = Pixels(place, shape, rank, index, screening)
        self.count = count

    def solve(self, tol: float, answer: FieldSolution) -> None:
        """Work until no shape is left; write each into `answer` when it leaves."""
        self._certify(tol, answer, 0)
        if len(self.shape) and self.max_sweeps is None:
            self._start_from_coarse()
        number = 0
        while len(self.shape):
            sweeps = SWEEPS * 2 ** (number // ROUNDS)
            if self.max_sweeps is not None:
                sweeps = min(sweeps, max(0, self.max_sweeps - int(self.done.max()) - 1))
            for _ in range(sweeps):
                self.system.sweep(self.line, out=self.layout.rows(self.next))
                self.line, self.next = self.next, self.line
            self._certify(tol, answer, sweeps)
            if len(self.shape):
                self._solve_policies()
                self._certify(tol, answer, 0)
            number += 1

    def _certify(self, tol: float, answer: FieldSolution, sweeps: int) -> None:
        """Keep what is better than the best, and let go of the shapes that are solved or have used up their sweeps."""
        bound = certify(self.system.residual(self.line))
        self.done += sweeps + 1
        better = bound < self.bound
        self.bound = torch.where(better, bound, self.bound)
        values = self.layout.unpack(self.layout.rows(self.line))
        self.best = torch.where(better.view(-1, *[1] * (values.ndim - 1)), values, self.best)
        status = ended(bound, self.bound, self.best.flatten(1).amax(dim=1), self.done + 2 > self.limit, tol)
        leave = status != NEVER
        if not leave.any():
            return
        gone = self.shape[leave]
        answer.value[gone] = self.best[leave]
        answer.error_bound[gone] = self.bound[leave]
        answer.num_sweeps[gone] = self.done[leave].ceil().long()
        answer.num_solves[gone] = self.solves[leave]
        answer.status[gone] = status[leave]
        keep = (~leave).nonzero()[:, 0]
        self.problem, self.shape = self.problem.select(keep), self.shape[keep]
        self.limit, self.done, self.solves = self.limit[keep], self.done[keep], self.solves[keep]
        self.largest, self.bound, self.best = self.largest[keep], self.bound[keep], self.best[keep]
        if len(keep):
            self._lay_out(values[keep])

    def _solve_policies(self) -> None:
        highs, lows = self._extrema(torch.maximum), self._extrema(torch.minimum)
        tie = self.largest * max(TIE, 32 * torch.finfo(self.line.dtype).eps)
        found = solve_policies(self.pixels, tie, highs, lows, self.layout.strides)
        # without screening to speak of, wrong policies may have no values: sweeps go on from those that are there
        self.line[self.pixels.place] = torch.where(found.isfinite(), found, self.line[self.pixels.place])
        self.solves += 1

    def _extrema(self, extremum: Callable[..., Tensor]) -> list[Tensor]:
        """The field, and its extrema over the block along the last axis, the last two ..., all."""
        lines = [self.line]
        for stride in reversed(self.layout.strides):
            source, target = lines[-1], torch.zeros_like(self.line)
            pairs = extremum(source[:-stride], source[stride:])
            extremum(pairs[:-stride], pairs[stride:], out=target[stride:-stride])
            lines.append(target)
        return lines

    def _start_from_coarse(self) -> None:
        """Scale the start of large shapes by the ratio of field to start at half the side."""
        large = (self.problem.radius > COARSEST).nonzero()[:, 0]
        if not len(large):
            return
        fine = self.problem.select(large)
        mask = _half(fine.mask)
        distance = distance_of(mask)
        radius = distance.flatten(1).amax(dim=1)
        coarse = Problem(mask, distance, radius, 4 * fine.screening, fine.compile)
        solution = solve_batched(coarse, COARSE_TOL, None)
        ratio = torch.where(mask, solution.value / start(coarse), 0)
        for dim in range(1, ratio.ndim):
            ratio = ratio.repeat_interleave(2, dim).narrow(dim, 0, fine.mask.shape[dim])
        values = start(self.problem)
        values[large] *= ratio
        share = mask.flatten(1).sum(dim=1) / self.count[large]
        self.done[large] += share * solution.num_sweeps
        self.line = self.layout.pack(values)


def _half(mask: Tensor) -> Tensor:
    """The shapes at half the side: a pixel is inside if any of the 2^n under it is, so no part is lost."""
    for dim in range(1, mask.ndim):
        across = (slice(None),) * dim
        joined, second = mask[(*across, slice(0, None, 2))].clone(), mask[(*across, slice(1, None, 2))]
        joined.narrow(dim, 0, second.shape[dim]).logical_or_(second)
        mask = joined
    return mask
