"""Policy iteration in torch operations, method="batched": all shapes at once, coarse to fine, on any device.

Some sweeps, then the values that the policies lead to, in turn, as the compiled method does it. Sweeps have momentum,
and are in float32 where the field is still rough: on coarse grids, and before the first solve on a fine one.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from torchlinf._helpers.ties import equal_within_each
from torchlinf.field.certificate import RESOLUTION, certify
from torchlinf.field.distance import distance_of
from torchlinf.field.iterate import NEVER, ended, groups, unsolved
from torchlinf.field.policy_graph import Pixels, solve_policies
from torchlinf.field.problem import Problem
from torchlinf.field.smooth import smooth
from torchlinf.field.solution import FieldSolution
from torchlinf.field.start import start
from torchlinf.field.stencil import Layout, System

SWEEPS = 24  # before each linear solve, doubled after every ROUNDS of these
FIRST_SWEEPS = 128  # before the first one where that is known from half the side: in float32, at 0.4 times the cost
ROUNDS = 6
CAREFUL = 12  # rounds after which sweeps have no momentum: then they converge from anywhere
CERTIFIED = 3  # rounds after which sweeps are certified too: where linear solves fail or round more, sweeps converge
ROUGH = 1e-3  # a tolerance that sweeps may reach before any linear solve
COARSEST = 12  # radius up to which no coarser grid is worth its while
COARSE_TOL = 0.1  # residual beyond which a coarse field would be no better a start
TIE = 1e-11  # share of the start's maximum within which neighbours are equal: rounding, not geometry
FIRST_TIE = 1e-6  # the same in the first solve on a fine grid, whose field is rough: it has a third fewer unknowns so
GROUP_PIXELS = 1 << 18  # on a CPU: calls are worth their while, and storage comes from the heap


def solve_batched(problem: Problem, tol: float, max_sweeps: int | None) -> FieldSolution:
    """Solve all shapes, on a CPU in groups of bounded memory."""
    answer = unsolved(problem.radius, problem.screening.new_zeros(problem.mask.shape))
    size = GROUP_PIXELS // max(1, problem.mask[:1].numel())
    large = problem.radius > COARSEST
    for group in groups((problem.radius > 0) & ~large, size):
        _Rounds(problem.select(group), group, max_sweeps).solve(tol, answer, None)
    index = large.nonzero()[:, 0]
    if len(index):
        coarse = _coarse(problem.select(index)) if max_sweeps is None else None
        for group in groups(large, size):
            found = None if coarse is None else coarse.select(torch.searchsorted(index, group))
            _Rounds(problem.select(group), group, max_sweeps).solve(tol, answer, found)
    return answer


@dataclass(frozen=True)
class _Coarse:
    """What is known from half the side: the ratio of field to start, 0 outside, and the sweeps that this took."""

    ratio: Tensor
    sweeps: Tensor

    def select(self, keep: Tensor) -> "_Coarse":
        """That of the shapes with these indices."""
        return _Coarse(self.ratio[keep], self.sweeps[keep])


def _coarse(fine: Problem) -> _Coarse:
    """Solve at half the side, in float32: it is no more than a start."""
    mask = _half(fine.mask)
    distance = distance_of(mask)
    radius = distance.flatten(1).amax(dim=1)
    screening = (4 * fine.screening).clamp(1e-30, 1e30).float()  # beyond these it is as if it were 0 or infinite
    coarse = Problem(mask, distance, radius, screening, fine.compile)
    solution = solve_batched(coarse, COARSE_TOL, None)
    share = mask.flatten(1).sum(dim=1) / fine.mask.flatten(1).sum(dim=1)
    return _Coarse(torch.where(mask, solution.value / start(coarse), 0), share * solution.num_sweeps)


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
        self.layout = Layout(problem.mask)
        inside = self.layout.rows(self.layout.pack(problem.mask.to(problem.screening)))
        self.system = System(self.layout, inside, problem.screening[:, None], problem.radius.long(), problem.compile)
        values = self.layout.rows(self.layout.pack(start(problem)))
        self.largest = values.amax(dim=1)
        self.bound = self.last = torch.full_like(self.largest, torch.inf)
        self.line = self.layout.line(values)
        self.pixels: Pixels | None = None  # numbered when they are first asked for
        self.best = values

    def _numbered(self) -> Pixels:
        """The pixels of all shapes on the line."""
        shape, pixel = self.system.inside.nonzero(as_tuple=True)
        place = shape * self.layout.pixels + pixel + self.layout.guard
        own = torch.arange(len(place), device=place.device)
        index = torch.full_like(self.line, len(place), dtype=torch.int64).scatter_(0, place, own)
        count = torch.zeros_like(self.solves).index_add_(0, shape, torch.ones_like(shape))
        rank = own - (count.cumsum(0) - count).index_select(0, shape)
        return Pixels(place, shape, rank, index, self.problem.screening)

    def solve(self, tol: float, answer: FieldSolution, coarse: _Coarse | None) -> None:
        """Work until no shape is left; write each into `answer` when it leaves."""
        group = self.shape
        self._certify(tol, answer, 0)
        if len(self.shape) and coarse is not None:
            self._start_from(coarse.select(torch.searchsorted(group, self.shape)))
        number = 0
        while len(self.shape):
            sweeps = SWEEPS * 2 ** (number // ROUNDS)
            if self.max_sweeps is not None:
                sweeps = min(sweeps, max(0, self.max_sweeps - int(self.done.max()) - 1))
            if number == 0 and coarse is not None:
                sweeps = 0  # they are done
            else:
                momentum = number < CAREFUL and (number > 0 or tol >= ROUGH)  # to noise the first sweeps are enough
                self.line = smooth(self.system, self.line, sweeps, momentum=momentum)
            if tol >= ROUGH or number >= CERTIFIED:
                self._certify(tol, answer, sweeps)
                sweeps = 0
            if len(self.shape):
                self._solve_policies(first=number == 0 and coarse is not None)
                self._certify(tol, answer, sweeps)
            number += 1

    def _certify(self, tol: float, answer: FieldSolution, sweeps: int) -> None:
        """Keep what is better than the best, and let go of the shapes that are solved or have used up their sweeps."""
        self.last = bound = certify(self.system.residual(self.line))
        self.done += sweeps + 1
        better = bound < self.bound
        self.bound = torch.where(better, bound, self.bound)
        values = self.layout.rows(self.line)
        torch.where(better[:, None], values, self.best, out=self.best)
        status = ended(bound, self.bound, self.best.amax(dim=1), self.done + 2 > self.limit, tol)
        leave = status != NEVER
        if not leave.any():
            return
        gone = self.shape[leave]
        answer.value[gone] = self.layout.unpack(self.best[leave])
        answer.error_bound[gone] = self.bound[leave]
        answer.num_sweeps[gone] = self.done[leave].ceil().long()
        answer.num_solves[gone] = self.solves[leave]
        answer.status[gone] = status[leave]
        keep = (~leave).nonzero()[:, 0]
        self.problem, self.shape = self.problem.select(keep), self.shape[keep]
        self.limit, self.done, self.solves = self.limit[keep], self.done[keep], self.solves[keep]
        self.largest, self.bound, self.best = self.largest[keep], self.bound[keep], self.best[keep]
        self.last = bound[keep]
        if len(keep):
            self.system = self.system.select(keep)
            self.line, self.pixels = self.layout.line(values.index_select(0, keep)), None

    def _solve_policies(self, first: bool) -> None:
        highs, lows = self.system.partial_extrema(self.line)
        eps = torch.finfo(self.line.dtype).eps
        tie = equal_within_each(self.largest * max(TIE, 32 * eps), self.last, self.largest * RESOLUTION * eps)
        if first:
            tie = tie.clamp(min=FIRST_TIE * self.largest)
        self.pixels = self.pixels or self._numbered()
        found = solve_policies(self.pixels, tie, highs, lows, self.layout.strides)
        # without screening to speak of, wrong policies may have no values: sweeps go on from those that are there
        found = torch.where(found.isfinite(), found, self.line.index_select(0, self.pixels.place))
        self.line.scatter_(0, self.pixels.place, found)
        self.solves += 1

    def _start_from(self, coarse: _Coarse) -> None:
        """Scale the start by the ratio at half the side, and sweep for the first time, in float32."""
        ratio = coarse.ratio
        for dim in range(1, ratio.ndim):
            ratio = ratio.repeat_interleave(2, dim).narrow(dim, 0, self.problem.mask.shape[dim])
        self.done += coarse.sweeps + FIRST_SWEEPS
        system = self.system.float()
        line = self.layout.pack(start(self.problem).float().mul_(ratio))
        self.line = smooth(system, line, FIRST_SWEEPS, momentum=True).to(self.line)


def _half(mask: Tensor) -> Tensor:
    """The shapes at half the side: a pixel is inside if any of the 2^n under it is, so no part is lost."""
    for dim in range(1, mask.ndim):
        across = (slice(None),) * dim
        joined, second = mask[(*across, slice(0, None, 2))].clone(), mask[(*across, slice(1, None, 2))]
        joined.narrow(dim, 0, second.shape[dim]).logical_or_(second)
        mask = joined
    return mask
