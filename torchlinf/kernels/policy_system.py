"""The policy system (2+s) v(x) - v(up) - v(down) = 1, solved exactly in one pass over its chains.

Where up(x) = y and down(y) = x, the two pixels are linked. A maximal chain of links is a tridiagonal system with
constant coefficients, and depends on at most two pixels outside it: the down neighbour of its head (lowest pixel) and
the up neighbour of its last (highest). Under an optimal policy nothing depends on itself but through links, so that
following what is missing from pixel to pixel, and solving on the way back, is all. Where a wrong policy ties chains
into a cycle, `strong_components` solves that.

Unsolved values are negative: so one look at a neighbour tells whether its value is known, and which it is.
"""

import math
from collections.abc import Callable

import numpy as np

from torchlinf.kernels import stencil
from torchlinf.kernels.chains import PATH_HEIGHT, RUN, chain_factors, unsolve
from torchlinf.kernels.grid import Grid
from torchlinf.kernels.strong_components import MEMBERS, ROWS, SEARCHED, solve_left_over, solve_runs

_PART = 2**22  # pixels that are solved, in fractions of a second, before Ctrl-C is looked for


class PolicySystem:
    """The policies of one shape and the memory to solve for them: some 52 bytes a pixel, rarely all of them used."""

    def __init__(self, grid: Grid, screening: float) -> None:
        """Allocate for a grid."""
        self.grid = grid
        size = math.prod(grid.shape)
        # zeroed by the system page by page, and only where pages are used: rows without inside pixels cost nothing
        self.up, self.down, self._owner = np.zeros((3, size), np.int32)
        # chain by chain, since few are open at a time: the rest of this memory is never touched
        memory = np.empty((ROWS + 1) * grid.pixels, np.int32)
        self._chains = memory[: -grid.pixels].reshape(grid.pixels, ROWS).T
        self._path = memory[-grid.pixels :]
        self._screening = screening
        self._factors = chain_factors(grid.pixels, screening)
        self._stops = [grid.starts.size]  # runs before which to look for Ctrl-C
        if grid.pixels > _PART:
            before = np.cumsum(grid.ends - grid.starts)
            self._stops[:0] = np.searchsorted(before, np.arange(_PART, before[-1], _PART)).tolist()

    def choose(self, v: np.ndarray, tie: float, buffer: np.ndarray, check: Callable[[], None]) -> None:
        """Set the policies that v chooses, where neighbours within `tie` are equal; `check` as in `solve`."""
        first = 0
        for stop in self._stops:
            check()
            starts, ends = self.grid.starts[first:stop], self.grid.ends[first:stop]
            stencil.choose_policies(v, starts, ends, self.grid.rows, tie, self.up, self.down, buffer)
            first = stop

    def solve(self, v: np.ndarray, tol: float, check: Callable[[], None]) -> int:
        """Overwrite v with the solution for the present policies.

        Components that elimination has no room for are solved to `tol`, all else exactly. `check` is called every now
        and then; if it raises, v and the system are left unfinished. Returns the number of unknowns in components that
        were no chain.
        """
        unknowns = 0
        starts, ends = self.grid.starts, self.grid.ends
        unsolve(v, starts, ends)
        state, search = np.zeros(2, np.int64), np.zeros(SEARCHED, np.int64)
        policies = (self.up, self.down, self._factors, self._screening)
        for stop in self._stops:
            check()
            while True:
                unknowns += solve_runs(
                    v, starts[:stop], ends[:stop], *policies, self._owner, self._path, self._chains, state, search
                )
                if search[MEMBERS] == 0:
                    break
                unknowns += solve_left_over(v, tol, *policies, self._owner, self._chains, search)
            state[RUN], state[PATH_HEIGHT] = stop, 0
        return unknowns

    @property
    def scratch(self) -> tuple[np.ndarray, ...]:
        """What `solve_runs` works on: policies up and down, the factors of chains, and three arrays of scratch."""
        return self.up, self.down, self._factors, self._owner, self._path, self._chains
