"""The policy system (2+s) v(x) - v(up) - v(down) = 1, solved exactly in one pass over its chains.

Where up(x) = y and down(y) = x, the two pixels are linked. A maximal chain of links is a tridiagonal system with
constant coefficients, and depends on at most two pixels outside it: the down neighbour of its head (lowest pixel) and
the up neighbour of its last (highest). Under an optimal policy nothing depends on itself but through links, so that
following what is missing from pixel to pixel, and solving on the way back, is all. Where a wrong policy ties chains
into a cycle, `tangles.solve_tangle` solves that.

Unsolved values are negative: so one look at a neighbour tells whether its value is known, and which it is.
"""

import math

import numpy as np

from torchlinf.kernels._compile import kernel
from torchlinf.kernels.grid import Grid
from torchlinf.kernels.tangles import ROWS, solve_tangle
from torchlinf.kernels.thomas import solve_chain, thomas_factors

_SOLVED = -1
_ON_PATH = -1


class PolicySystem:
    """The policies of one shape and the memory to solve for them: some 52 bytes a pixel, rarely all of them used."""

    def __init__(self, grid: Grid, screening: float) -> None:
        """Allocate for a grid."""
        self.grid = grid
        size = math.prod(grid.shape)
        # One piece of memory, which the system is slow to give: a C library that gets back so large a one keeps as much
        # for the next shape.
        memory = np.empty(3 * size + (ROWS + 1) * grid.pixels, np.int32)
        memory[: 3 * size] = 0
        self.up, self.down, self._owner = memory[: 3 * size].reshape(3, size)
        # chain by chain, since few are open at a time: the rest of this memory is never touched
        self._chains = memory[3 * size : -grid.pixels].reshape(grid.pixels, ROWS).T
        self._path = memory[-grid.pixels :]
        self._screening = screening
        self._factors = thomas_factors(grid.pixels, screening)

    def solve(self, v: np.ndarray, tol: float) -> int:
        """Overwrite v by the solution for the present policies; see `solve_policies`."""
        return int(
            solve_policies(
                v, self.grid.starts, self.grid.ends, self.up, self.down, self._factors, self._screening, tol,
                self._owner, self._chains, self._path,
            )
        )  # fmt: skip


@kernel
def solve_policies(v, starts, ends, up, down, factors, screening, tol, owner, chains, path):  # type: ignore[no-untyped-def]
    """Overwrite v with the solution of the policy system; components that are no chain are solved to `tol`.

    `up` and `down` are the pixels' neighbours. `owner` (int32, like v) is to be 0 and is so on return; `chains`
    (ROWS, pixels) and `path` (pixels,), both int32, are scratch. Returns the number of unknowns in components that were
    no chain.
    """
    for run in range(starts.size):
        values = v[starts[run] : ends[run]]
        for j in range(values.size):
            values[j] = -values[j]
    unknowns = 0
    for run in range(starts.size):
        for root in range(starts[run], ends[run]):
            if v[root] >= 0.0:
                continue
            above = v[up[root]]
            below = v[down[root]]
            if above >= 0.0 and below >= 0.0:
                v[root] = (1.0 + above + below) * factors[2, 0]
            else:
                unknowns += _follow(v, root, up, down, factors, screening, tol, owner, chains, path)
    return unknowns


@kernel
def _follow(v, root, up, down, factors, screening, tol, owner, chains, path):  # type: ignore[no-untyped-def]
    """Solve a pixel and all it depends on, which are kept in `path` from the root to the present one.

    Where the path meets itself, the present pixel is part of a cycle, and is solved as such.
    """
    unknowns = 0
    path[0] = root
    owner[root] = _ON_PATH
    height = 1
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
            unknowns += solve_tangle(v, x, up, down, factors, screening, tol, owner, chains)
            while height > 0 and v[path[height - 1]] >= 0.0:
                height -= 1
        else:
            path[height] = missing
            owner[missing] = _ON_PATH
            height += 1
    return unknowns


@kernel
def _try_chain(v, x, up, down, factors, screening):  # type: ignore[no-untyped-def]
    """Solve the chain through x, or return a pixel that it depends on and that is not yet solved."""
    length = 1
    last = x
    y = up[x]
    while y != last and down[y] == last:
        last = y
        y = up[y]
        length += 1
    if v[y] < 0.0 and y != last:
        return y
    head = x
    y = down[x]
    while y != head and up[y] == head:
        head = y
        y = down[y]
        length += 1
    if v[y] < 0.0 and y != head:
        return y
    solve_chain(v, head, last, length, up, down, factors, screening)
    return _SOLVED
