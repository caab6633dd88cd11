"""The paper's system-based solution: fix at every pixel the neighbours that hold max and min, solve, choose anew."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from benchmarks.baselines.domain import Array, Domain
from benchmarks.baselines.explicit import Compiled

MOST_SOLVES = 150


@dataclass(frozen=True)
class Outcome:
    """What policy iteration came to; `converged` is False where solves or patience ran out first."""

    value: Array
    bound: float
    solves: int
    converged: bool


def policy_iteration(domain: Domain, *, sweeps: int, tol: float, patience: float = np.inf) -> Outcome:
    """Solve from the distance transform as the first guess, with `sweeps` sweeps of T before each solve.

    Args:
        domain: the shape.
        sweeps: 0 is the paper's scheme. With D/2 a scheme that rarely fails.
        tol: certified relative error to stop at.
        patience: seconds after which to give up.
    """
    began = time.perf_counter()
    scheme = Compiled(domain)
    system = _System(domain)
    v = domain.distance.astype(np.float64)
    found = np.inf
    for solves in range(MOST_SOLVES + 1):
        if sweeps:
            v = scheme.sweep(v, sweeps)
        found = scheme.bound(v)
        if found <= tol or solves == MOST_SOLVES or time.perf_counter() - began > patience:
            break
        system.solve(v)
    return Outcome(v, found, solves, found <= tol)


class _System:
    """(2 + s) v(x) - v(up) - v(down) = 1 as a sparse matrix over the inside pixels."""

    def __init__(self, domain: Domain) -> None:
        sizes = domain.inside.shape
        strides = [int(np.prod(sizes[axis + 1 :])) for axis in range(len(sizes))]
        block = [0]
        for stride in strides:
            block = [offset + sign * stride for offset in block for sign in (0, -1, 1)]
        # The pixel itself comes first, so that it is chosen where it ties with others.
        self.block = np.array(block)
        self.pixels = np.flatnonzero(domain.inside)
        self.number = np.full(domain.inside.size, -1)
        self.number[self.pixels] = np.arange(len(self.pixels))
        self.diagonal = 2 + domain.screening

    def solve(self, v: Array) -> None:
        """Overwrite v by the solution for its own policies."""
        flat = v.reshape(-1)
        up, down = self._policies(flat)
        count = len(self.pixels)
        own = np.arange(count)
        columns = np.concatenate([own, self.number[up], self.number[down]])
        values = np.concatenate([np.full(count, self.diagonal), np.full(2 * count, -1.0)])
        known = columns >= 0  # outside the shape v is 0
        places = (np.tile(own, 3)[known], columns[known])
        matrix = sparse.csc_matrix((values[known], places), shape=(count, count))
        # COLAMD, the default ordering, was the fastest of SuperLU's four here.
        flat[self.pixels] = linalg.splu(matrix, permc_spec="COLAMD").solve(np.ones(count))

    def _policies(self, flat: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        up, down = self.pixels.copy(), self.pixels.copy()
        most, least = flat[self.pixels], flat[self.pixels]
        for offset in self.block[1:]:
            values = flat[self.pixels + offset]
            higher, lower = values > most, values < least
            up[higher] = self.pixels[higher] + offset
            down[lower] = self.pixels[lower] + offset
            most, least = np.maximum(most, values), np.minimum(least, values)
        return up, down
