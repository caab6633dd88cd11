"""Policy iteration for weights that differ from pixel to pixel, compiled: f = w (M f + N f + 1).

Sweeps and exact linear solves in turn, as in `policy_iteration`, from a start at half the resolution.
"""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.parallel import for_each
from torchlinf._helpers.ties import equal_within
from torchlinf.field.solution import FieldSolution, Status
from torchlinf.kernels import grid, stencil
from torchlinf.kernels.linearised import LinearisedOperator

SWEEPS = 16  # between two solves; doubled where progress stalls
COARSEST = 8  # pixels along the shortest side below which no coarser grid is worth its while
COARSE_TOL = 0.1
TIE = 1e-11
NOISE = 1e-4
LIMIT = 50_000  # sweeps


def solve_compiled(weight: Tensor, tol: float) -> FieldSolution:
    """Solve shape by shape; `weight` is (N, *spatial) float64 on the CPU, in [0, 1/2), 0 outside."""
    weights = weight.numpy()
    count = len(weights)
    value, bound = np.zeros(weights.shape), np.zeros(count)
    work = np.zeros((2, count), dtype=np.int64)
    status = np.full(count, int(Status.EMPTY), dtype=np.int64)

    def solve(i: int, check: Callable[[], None]) -> None:
        box = bounding_box(weights[i] > 0)
        if weights[i][box].size:
            field = WeightedField(weights[i][box], tol, check)
            value[i][box] = field.run()
            done = Status.CONVERGED if field.bound <= field.tol else Status.MAX_SWEEPS
            bound[i], work[:, i], status[i] = field.bound, (field.num_sweeps, field.num_solves), done

    for_each(solve, count)
    tensors = (torch.from_numpy(array) for array in (value, bound, work[0], work[1], status))
    return FieldSolution(*tensors)


class WeightedField:
    """The solve of one shape: the present v, its certified bound, and the work so far."""

    def __init__(self, weight: np.ndarray, tol: float, check: Callable[[], None]) -> None:
        """``weight`` cropped to where it is above 0."""
        self.unpadded = weight
        self.check = check
        padded = grid.pad(weight)
        self.grid = grid.make_grid(padded > 0)
        self.weight = padded.reshape(-1)
        self.a = np.divide(1.0, self.weight, out=np.full_like(self.weight, 2.0), where=self.weight > 0)
        self.v = self.weight.copy()  # the first sweep from 0
        self.stencil = (self.v, self.grid.starts, self.grid.ends, self.grid.rows)
        self.buffer = np.empty((4, padded.shape[-1]))
        self.tol = tol
        self.num_sweeps = self.num_solves = 0

    def run(self) -> np.ndarray:
        """Solve, and return the field without its padding."""
        if min(self.unpadded.shape) > COARSEST:
            self.start_from_coarse()
        self.iterate()
        return self.v.reshape(self.grid.shape)[grid.interior(len(self.grid.shape))]

    def certify(self) -> bool:
        """Bound the error of v; True once it is within the tolerance or at the limit of rounding."""
        above, below = stencil.residual_bounds(*self.stencil, 0.0, self.a - 2.0, self.buffer)
        self.num_sweeps += 1
        self.bound = max(above, below) if above < 1 else np.inf
        self.residual = max(above, below)
        self.finest = 4 * np.finfo(np.float64).eps * float(self.v.max())
        self.tol = max(self.tol, self.finest)
        return bool(self.bound <= self.tol)

    def start_from_coarse(self) -> None:
        """Four times the field of the mean weights of 2^n pixels, which are as many times fewer pixels apart."""
        ndim = self.unpadded.ndim
        even = np.pad(self.unpadded, [(0, size % 2) for size in self.unpadded.shape])
        blocks = even.reshape([part for size in even.shape for part in (size // 2, 2)])
        mean = blocks.mean(axis=tuple(range(1, 2 * ndim, 2)))
        coarse_weight = np.divide(mean, 4 - 6 * mean, out=np.zeros_like(mean), where=mean > 0)  # s becomes 4 s
        coarse = WeightedField(coarse_weight, COARSE_TOL, self.check)
        fine = 4 * coarse.run()
        for axis in range(ndim):
            fine = np.repeat(fine, 2, axis=axis)
        trimmed = fine[tuple(slice(size) for size in self.unpadded.shape)]
        self.v.reshape(self.grid.shape)[grid.interior(ndim)] = trimmed
        self.v[self.weight == 0] = 0.0

    def iterate(self) -> None:
        """Sweep and solve in turn until certified, or the sweeps are used up."""
        count, best = SWEEPS, np.inf
        ones = np.ones_like(self.v)
        while self.num_sweeps < LIMIT:
            self.check()
            stencil.sweep(*self.stencil, 0.0, self.weight, count, self.buffer)
            self.num_sweeps += count
            if self.certify():
                break
            if self.residual > best / 2:
                count *= 2
            best = min(best, self.residual)
            tie = equal_within(TIE * float(self.v.max()), self.residual, self.finest)
            tie = max(tie, NOISE * self.residual)
            operator = LinearisedOperator(self.grid, self.v, self.a, tie)
            self.v[operator.order], _ = operator.solve(ones, 1e-12)
            self.num_solves += 1
            if self.certify():
                break
