"""The policy system (2+s) v(x) - v(up) - v(down) = 1, solved exactly in one pass over its chains.

Where up(x) = y and down(y) = x, the two pixels are linked. A maximal chain of links is a tridiagonal system with
constant coefficients, and depends on at most two pixels outside it: the down neighbour of its head (lowest pixel) and
the up neighbour of its last (highest). Under an optimal policy nothing depends on itself but through links, so that
following what is missing from pixel to pixel, and solving on the way back, is all. Where a wrong policy ties chains
into a cycle, `tangles.solve_tangle` takes over.

Unsolved values are negative: so one look at a neighbour tells whether its value is known, and which it is.
"""

import math

import numpy as np

from torchlinf._kernels._compile import kernel
from torchlinf._kernels.grid import Grid
from torchlinf._kernels.tangles import solve_tangle
from torchlinf._kernels.thomas import solve_chain, thomas_factors

_SOLVED, _CYCLE = -1, -2


class PolicySystem:
    """The policies of one shape and the memory to solve for them: some 44 bytes a pixel."""

    def __init__(self, grid: Grid, screening: float) -> None:
        """Allocate for a grid."""
        self.grid = grid
        size = math.prod(grid.shape)
        self.up = np.zeros(size, np.int32)
        self.down = np.zeros(size, np.int32)
        self._screening = screening
        self._owner = np.zeros(size, np.int32)
        self._chains = np.empty((6, grid.pixels), np.int32)
        self._factors = thomas_factors(grid.pixels, screening)
        self._work = np.empty(grid.pixels)

    def solve(self, v: np.ndarray, tol: float) -> int:
        """Overwrite v by the solution for the present policies; see `solve_policies`."""
        return int(
            solve_policies(
                v, self.grid.starts, self.grid.ends, self.up, self.down, self._factors, self._screening, tol,
                self._owner, self._chains, self._work,
            )
        )  # fmt: skip


@kernel
def solve_policies(v, starts, ends, up, down, factors, screening, tol, owner, chains, work):  # type: ignore[no-untyped-def]
    """Overwrite v with the solution of the policy system; components that are no chain are solved to `tol`.

    `up` and `down` are the pixels' neighbours. `owner` (int32, like v) is to be 0 and is so on return; `chains`
    (6, pixels) int32 and `work` (pixels,) are scratch. Returns the number of unknowns in components that were no chain.
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
                v[root] = (1.0 + above + below) * factors[0]
            elif not _follow(v, root, up, down, factors, screening, chains[0], work):
                unknowns += solve_tangle(v, root, up, down, factors, screening, tol, owner, chains, work)
    return unknowns


@kernel
def _follow(v, root, up, down, factors, screening, path, work):  # type: ignore[no-untyped-def]
    """Solve a pixel and all it depends on; False, with that left unsolved, if it depends on a cycle.

    The pixels from the root to the present one are kept in `path`, and marked by ~up in place of up.
    """
    path[0] = root
    up[root] = ~up[root]
    height = 1
    while height > 0:
        x = path[height - 1]
        above = ~up[x]
        below = down[x]
        if v[above] >= 0.0 and v[below] >= 0.0:
            v[x] = (1.0 + v[above] + v[below]) * factors[0]
            up[x] = above
            height -= 1
            continue
        if v[below] < 0.0 and below != x and up[below] != x:
            missing = below
        elif v[above] < 0.0 and above != x and down[above] != x:
            missing = above
        else:
            up[x] = above
            missing = _try_chain(v, x, up, down, factors, screening, work)
            if missing == _SOLVED:
                height -= 1
                continue
            up[x] = ~above
        if missing == _CYCLE or up[missing] < 0:
            for i in range(height):
                up[path[i]] = ~up[path[i]]
            return False
        path[height] = missing
        up[missing] = ~up[missing]
        height += 1
    return True


@kernel
def _try_chain(v, x, up, down, factors, screening, work):  # type: ignore[no-untyped-def]
    """Solve the chain through x, or return a pixel that it depends on and that is not yet solved."""
    last = x
    while up[last] != last and down[up[last]] == last:
        last = up[last]
        if up[last] < 0:  # the path has been on this chain before
            return _CYCLE
    if v[up[last]] < 0.0 and up[last] != last:
        return up[last]
    head = x
    while down[head] != head and up[down[head]] == head:
        head = down[head]
    if v[down[head]] < 0.0 and down[head] != head:
        return down[head]
    solve_chain(v, head, last, up, down, factors, screening, work)
    return _SOLVED
