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
from torchlinf.kernels.chains import chain_factors, solve_chain
from torchlinf.kernels.compiler import inlined, kernel
from torchlinf.kernels.grid import Grid
from torchlinf.kernels.strong_components import MEMBERS, ROWS, SEARCHED, search_components, solve_left_over

_SOLVED = -1
_ON_PATH = -1
_RUN, _HEIGHT = range(2)  # places of `state`: the run that is being solved, and how many pixels are on the path
_BEGIN = -1  # height before the first call
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
                unknowns += follow_all(
                    v, starts[:stop], ends[:stop], *policies, self._owner, self._path, self._chains, state, search
                )
                if search[MEMBERS] == 0:
                    break
                unknowns += solve_left_over(v, tol, *policies, self._owner, self._chains, search)
            state[_RUN], state[_HEIGHT] = stop, 0
        return unknowns

    @property
    def scratch(self) -> tuple[np.ndarray, ...]:
        """What `follow_all` works on: policies up and down, the factors of chains, and three arrays of scratch."""
        return self.up, self.down, self._factors, self._owner, self._path, self._chains


@kernel
def follow_all(v, starts, ends, up, down, factors, screening, owner, path, chains, state, search):  # type: ignore[no-untyped-def]
    """Solve chain by chain and cycle by cycle, until one is left over, as `search` says; returns the cycles' unknowns.

    When that one is solved, this is to be called again. Cycles are many and mostly small, so that a return to Python at
    each would cost as much as they do.
    """
    unknowns = 0
    while search[MEMBERS] > 0 or follow_chains(v, starts, ends, up, down, factors, screening, owner, path, state):
        unknowns += search_components(
            v, np.int64(path[state[_HEIGHT] - 1]), up, down, factors, screening, owner, chains, search
        )
        if search[MEMBERS] > 0:
            break
    return unknowns


@kernel
def unsolve(v, starts, ends):  # type: ignore[no-untyped-def]
    """Make all values negative: none is solved."""
    for run in range(starts.size):
        values = v[starts[run] : ends[run]]
        for j in range(values.size):
            values[j] = -values[j]


@kernel
def follow_chains(v, starts, ends, up, down, factors, screening, owner, path, state):  # type: ignore[no-untyped-def]
    """Solve chain by chain; returns whether this stopped at a cycle, which the last pixel of `path` is part of.

    When that pixel is solved, this is to be called again. `up` and `down` are the pixels' neighbours. `owner` (int32,
    like v) is to be 0 and is so in the end; `path` (pixels,), int32, is scratch.
    """
    height = state[_HEIGHT]
    if height == _BEGIN:
        height = 0
        unsolve(v, starts, ends)
    while height > 0 and v[path[height - 1]] >= 0.0:
        height -= 1
    for run in range(state[_RUN], starts.size):
        for root in range(starts[run], ends[run]):
            if v[root] >= 0.0:
                continue
            if height == 0:
                above = v[up[root]]
                below = v[down[root]]
                if above >= 0.0 and below >= 0.0:
                    v[root] = (1.0 + above + below) * factors[2, 0]
                    continue
                path[0] = root
                owner[root] = _ON_PATH
                height = 1
            height = _follow(v, height, up, down, factors, screening, owner, path)
            if height > 0:
                state[_RUN], state[_HEIGHT] = run, height
                return True
    return False


@kernel
def _follow(v, height, up, down, factors, screening, owner, path):  # type: ignore[no-untyped-def]
    """Solve the pixels of the path and all they depend on, from the last to the first.

    Returns 0, or the height of the path where it meets itself.
    """
    while height > 0:
        x = path[height - 1]
        above = up[x]
        below = down[x]
        if v[above] >= 0.0 and v[below] >= 0.0:
            v[x] = (1.0 + v[above] + v[below]) * factors[2, 0]
            missing = _SOLVED
        elif v[below] < 0.0 and below != x and up[below] != x:
            missing = below
        elif v[above] < 0.0 and above != x and down[above] != x:
            missing = above
        else:
            missing = _try_chain(v, x, up, down, factors, screening)
        if missing == _SOLVED:
            owner[x] = 0
            height -= 1
        elif owner[missing] == _ON_PATH:
            return height
        else:
            path[height] = missing
            owner[missing] = _ON_PATH
            height += 1
    return 0


@inlined
def _try_chain(v, x, up, down, factors, screening):  # type: ignore[no-untyped-def]
    """Solve the chain through x, or return a pixel that it depends on and that is not yet solved."""
    missing = _SOLVED
    length = 1
    last = x
    above = up[x]
    while above != last and down[above] == last:
        last = above
        above = up[above]
        length += 1
    if v[above] < 0.0 and above != last:
        missing = above
    else:
        head = x
        below = down[x]
        while below != head and up[below] == head:
            head = below
            below = down[below]
            length += 1
        if v[below] < 0.0 and below != head:
            missing = below
        else:
            solve_chain(v, head, last, length, up, down, factors, screening)
    return missing
