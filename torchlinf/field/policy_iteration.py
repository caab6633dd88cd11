"""Policy iteration, method="compiled": coarse to fine; some sweeps, then one exact linear solve, until certified.

Sweeps correct the policies nearby, the solve carries their values across the whole shape. They run only where the
field still changes. A start from half the resolution has the values right to O(1/D), so that the number of solves
hardly grows with D.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.parallel import for_each, tell
from torchlinf._helpers.ties import equal_within
from torchlinf.field.certificate import RESOLUTION
from torchlinf.field.problem import Problem
from torchlinf.field.solution import FieldSolution, Status
from torchlinf.kernels import coarse_grid, distance, grid, stencil
from torchlinf.kernels.active_set import ActiveSet
from torchlinf.kernels.chains import look_up, square_profile
from torchlinf.kernels.policy_system import PolicySystem

SWEEPS = 40  # a sweep costs 3^(n-1) rows, a solve the same in all dimensions: so many sweeps by n between two solves,
# or D / 8 if that is more; doubled where progress stalls, since sweeps alone converge
WARM = (12, 5, 5, 5, 5, 5)  # sweeps before each of the first solves where the field of much the same shape is known
LARGE = 60_000  # pixels from which on it pays to find out where sweeps are needed
BURST = 5  # sweeps after which it is decided anew where to sweep
AT_REST = 1e-3  # share of the largest residual below which a tile rests
WORK = 10  # sweeps of the whole shape whose cost is always spent between two solves: a solve costs several times that
PATIENCE = 3  # solves without half the residual after which progress counts as stalled
COARSEST = 24  # radius up to which no coarser grid is worth its while
COARSE_TOL = 0.1  # residual beyond which a coarse field would be no better a start
TIE = 1e-11  # share of max f within which neighbours are equal: rounding, not geometry
NOISE = 1e-7  # share of the residual down to which linear solves go, and within which neighbours are equal meanwhile


def solve_compiled(problem: Problem, tol: float, max_sweeps: int | None) -> FieldSolution:
    """Solve shape by shape on the CPU, shapes in parallel on torch's number of threads."""
    masks = problem.mask.numpy()
    count = len(masks)
    value = np.zeros(masks.shape)
    bound = np.zeros(count)
    work = np.zeros((2, count), dtype=np.int64)
    status = np.full(count, int(Status.EMPTY), dtype=np.int64)

    def solve(i: int, check: Callable[[], None]) -> None:
        box = bounding_box(masks[i])
        if masks[i][box].size:
            known = problem.distance[i].numpy()[box]
            shape = Shape.from_mask(masks[i][box], float(problem.screening[i]), known)
            field = PolicyIteration(shape, tol, max_sweeps, check)
            value[i][box] = field.run()
            bound[i], work[:, i], status[i] = field.bound, (field.sweeps(), field.num_solves), field.status

    for_each(solve, count)
    tensors = (torch.from_numpy(array) for array in (value, bound, work[0], work[1], status))
    return FieldSolution(*tensors)


def solve_shape(mask: np.ndarray, rho: float | None, tol: float, check: Callable[[], None]) -> "PolicyIteration":
    """Solve one shape that is not empty, from its mask to its field, without any tensor.

    Args:
        mask: bool, any box that holds the shape; the smallest one is the quickest.
        rho: screening length in pixels; None means the radius.
        tol: relative error to certify.
        check: called every now and then, on large shapes at least each second, so that it can end the solve by an
            exception.

    Returns:
        The finished solve. `v` and `shape.distance` are flat, on the padded grid.
    """
    solve = PolicyIteration(Shape.from_mask(mask, None if rho is None else rho**-2), tol, None, check)
    solve.run()
    return solve


@dataclass(frozen=True)
class Shape:
    """A shape on its grid, with its distance (flat, int32) and the profile g_D that starts it."""

    grid: grid.Grid
    distance: np.ndarray
    screening: float
    profile: np.ndarray

    @classmethod
    def from_mask(cls, mask: np.ndarray, screening: float | None, known: np.ndarray | None = None) -> "Shape":
        """A shape from its cropped mask; `screening` None means 1 / D^2; `known` is its distance if that is known."""
        return cls.from_padded(grid.pad(mask), screening, None if known is None else grid.pad(known).reshape(-1))

    @classmethod
    def from_padded(cls, padded: np.ndarray, screening: float | None, known: np.ndarray | None = None) -> "Shape":
        """The same from a mask with its ring of outside pixels."""
        geometry = grid.make_grid(padded)
        flat = distance.chessboard_of(geometry) if known is None else known
        radius = int(flat.max())
        screening = 1.0 / radius**2 if screening is None else screening
        return cls(geometry, flat, screening, square_profile(radius, screening))

    @property
    def radius(self) -> int:
        """D in pixels."""
        return len(self.profile) - 1

    def coarse(self) -> "Shape":
        """The shape at half the side: a pixel of it is inside if any of the 2^n pixels under it is."""
        padded = coarse_grid.half_of((self.distance > 0).reshape(self.grid.shape))
        return Shape.from_padded(padded, 4 * self.screening)


class PolicyIteration:
    """The solve of one shape: the present v, its certified bound, and the work so far."""

    def __init__(self, shape: Shape, tol: float, max_sweeps: int | None, check: Callable[[], None]) -> None:
        """Prepare the start g_D(d), which is the field itself on shapes of complexity zero."""
        self.shape = shape
        self.check = check
        self.limit = 20_000 + 200 * shape.radius if max_sweeps is None else max_sweeps
        self.v = np.zeros(shape.distance.size)
        look_up(shape.profile, shape.distance, shape.grid.starts, shape.grid.ends, self.v)
        self.buffer = np.empty((4, shape.grid.shape[-1]))
        self.active_set = ActiveSet(shape.grid) if shape.grid.pixels >= LARGE else None
        self.finest = RESOLUTION * np.finfo(np.float64).eps * float(shape.profile[-1])
        self.tol = max(tol, self.finest)
        self.stencil = (self.v, shape.grid.starts, shape.grid.ends, shape.grid.rows)
        self.bound = np.inf
        self.num_sweeps = 0.0
        self.num_solves = 0

    def sweeps(self) -> int:
        """Sweeps so far, those on coarse grids counted by their share of the pixels."""
        return int(np.ceil(self.num_sweeps))

    @property
    def solvable(self) -> bool:
        """Whether 1 / rho^2 is a number that this equation can be solved for: neither overflown nor underflown."""
        return 0.0 < self.shape.screening < np.inf

    @property
    def status(self) -> Status:
        """How the solve ended."""
        if not self.solvable or np.isnan(self.bound):
            return Status.NONFINITE
        return Status.CONVERGED if self.bound <= self.tol else Status.MAX_SWEEPS

    def run(self) -> np.ndarray:
        """Solve, and return the field without its padding."""
        if self.solvable and not self.certify():
            if self.shape.radius > COARSEST and self.limit >= SWEEPS:
                self.start_from_coarse()
            self.iterate()
        return self.v.reshape(self.shape.grid.shape)[grid.interior(len(self.shape.grid.shape))]

    def run_from(self, v: np.ndarray) -> None:
        """Solve from the field of a shape that is much the same, flat and padded; 0 where nothing is known."""
        if not self.solvable:
            return
        self.v[:] = np.where((v > 0) & (self.shape.distance > 0), v, self.v)
        system = PolicySystem(self.shape.grid, self.shape.screening)
        for count in WARM:
            stencil.sweep(*self.stencil, 1.0 / (2.0 + self.shape.screening), None, count, self.buffer)
            self.num_sweeps += count
            if self.certify():
                return
            self.solve_policies(system)
            if self.certify():
                return
        self.iterate()

    def refine(self, tol: float) -> bool:
        """Solve on, to a smaller tolerance as far as floating point goes; True if the bound became smaller."""
        wanted, before, kept = self.tol, self.bound, self.v.copy()
        self.tol = max(tol, self.finest)
        if self.bound > self.tol:
            self.iterate()
        self.tol = wanted
        if self.bound < before:
            return True
        self.v[:], self.bound = kept, before
        return False

    def certify(self) -> bool:
        """Bound the error of v; True once it is within the tolerance."""
        self.num_sweeps += 1
        if self.active_set is not None:
            above, below = self.active_set.update_bound(self.v, self.shape.screening, self.buffer)
        else:
            above, below = stencil.residual_bounds(*self.stencil, self.shape.screening, None, self.buffer)
        self.bound = max(above, below) if above < 1 else np.inf
        self.residual = max(above, below)
        self.check()
        if self.active_set is not None:
            tell(f"{self.shape.grid.pixels:,} pixels, residual {self.residual:.0e}, to be {self.tol:.0e}")
        return bool(self.bound <= self.tol)

    def start_from_coarse(self) -> None:
        """Scale the start by the ratio of field to start at half the resolution."""
        fine = self.shape.grid
        smaller = self.shape.coarse()
        share = smaller.grid.pixels / fine.pixels
        # at most half of what is allowed, so that the values scaled below are always swept and certified
        coarse = PolicyIteration(smaller, COARSE_TOL, int((self.limit - self.num_sweeps) / 2 / share), self.check)
        coarse.run()
        coarse_grid.scale_by_parents(
            self.v, fine.starts, fine.ends, fine.strides, coarse.v, coarse.shape.distance, coarse.shape.profile,
            coarse.shape.grid.strides,
        )  # fmt: skip
        self.num_sweeps += coarse.num_sweeps * share

    def iterate(self) -> None:
        """Sweep and solve in turn until certified, or the sweeps are used up."""
        system = PolicySystem(self.shape.grid, self.shape.screening)
        count, idle = max(SWEEPS // len(self.shape.grid.shape), self.shape.radius // 8), 0
        best = np.inf
        while self.sweeps() + 2 <= self.limit:
            count = min(count, self.limit - self.sweeps() - 1)
            if self.relax(count) or self.sweeps() + 1 > self.limit:
                break
            idle = 0 if self.residual <= best / 2 else idle + 1
            best = min(best, self.residual)
            if idle == PATIENCE:
                idle, count = 0, 2 * count
            self.solve_policies(system)
            if self.certify():
                break

    def solve_policies(self, system: PolicySystem) -> None:
        """One linear solve of the policies that v chooses."""
        tie = equal_within(TIE * float(self.shape.profile[-1]), self.residual, self.finest)
        tie = max(tie, NOISE * self.residual)
        system.choose(self.v, tie, self.buffer, self.check)
        system.solve(self.v, max(NOISE * self.residual, 1e-13 * float(self.shape.profile[-1])), self.check)
        self.num_solves += 1

    def relax(self, count: int) -> bool:
        """Sweep `count` times, on large shapes only where v changes, and oftener if cheap; True once certified."""
        active_set, weight = self.active_set, 1.0 / (2.0 + self.shape.screening)
        if active_set is None:
            stencil.sweep(*self.stencil, weight, None, count, self.buffer)
            self.num_sweeps += count
            return self.certify()
        done, before = 0, self.num_sweeps
        while (done < count or self.num_sweeps - before < WORK) and self.num_sweeps + 3 <= self.limit:
            active_set.select(AT_REST * self.residual)
            burst = min(BURST, int((self.limit - self.num_sweeps - 2) / active_set.share))
            self.check()
            self.residual = active_set.sweep(self.v, weight, burst, self.buffer, self.check)
            done += burst
            self.num_sweeps += burst * active_set.share
            if self.residual <= self.tol and self.certify():
                return True
        return False
