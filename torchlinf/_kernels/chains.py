"""The policy system (2+s) v(x) - v(up) - v(down) = 1, solved exactly in one pass over its chains.

Where up(x) = y and down(y) = x, the two pixels are linked. A maximal chain of links is a tridiagonal system with
constant coefficients, and depends on at most two pixels outside it: the down neighbour of its head (lowest pixel) and
the up neighbour of its last (highest). Tarjan's algorithm on chains yields them dependencies first. Under an optimal
policy every strongly connected component is one chain; what a wrong policy ties into larger ones goes to
`components.solve_component`.

A chain is named by its place on Tarjan's stack, so that what is known of it lives in the few arrays that are in cache.
"""

import math

import numpy as np

from torchlinf._kernels._compile import kernel
from torchlinf._kernels.components import HEAD, LAST, dependency, solve_component
from torchlinf._kernels.grid import Grid
from torchlinf._kernels.thomas import DONE, solve_chain, thomas_factors

LOW, VISITED, CALLER = 2, 3, 4  # rows of `chains`: low link, dependencies looked at, the chain that asked for it
_LOOP = 4  # added to VISITED for every dependency of a chain on itself


class PolicySystem:
    """The policies of one shape and the memory to solve for them: some 44 bytes a pixel."""

    def __init__(self, grid: Grid, screening: float) -> None:
        """Allocate for a grid."""
        self.grid = grid
        size = math.prod(grid.shape)
        self.up = np.zeros(size, np.int32)
        self.down = np.zeros(size, np.int32)
        self._screening = screening
        self._owner = np.full(size, DONE, np.int32)
        self._chains = np.empty((5, grid.pixels), np.int32)
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
def linked(x, towards, back):  # type: ignore[no-untyped-def]
    """The pixel that x is linked to in direction `towards` (up or down), or x if there is none."""
    y = towards[x]
    return y if back[y] == x else x


@kernel
def _open_chain(x, number, chains, owner, up, down):  # type: ignore[no-untyped-def]
    """Find the chain through x and write 1 + its number on all its pixels."""
    y = linked(x, down, up)
    while y != x:
        x = y
        y = linked(x, down, up)
    chains[HEAD, number] = x
    owner[x] = number + 1
    y = linked(x, up, down)
    while y != x:
        x = y
        owner[x] = number + 1
        y = linked(x, up, down)
    chains[LAST, number] = x
    chains[LOW, number] = number
    chains[VISITED, number] = 0


@kernel
def _solve_single(v, x, up, down, owner, factors):  # type: ignore[no-untyped-def]
    """Solve the chain of x at once if that is x alone and what it depends on is known; most pixels are such."""
    above = up[x]
    below = down[x]
    if owner[above] != DONE or owner[below] != DONE or down[above] == x or up[below] == x:
        return False
    v[x] = (1.0 + v[above] + v[below]) * factors[0]
    owner[x] = DONE
    return True


@kernel
def solve_policies(v, starts, ends, up, down, factors, screening, tol, owner, chains, work):  # type: ignore[no-untyped-def]
    """Overwrite v with the solution of the policy system; components that are no chain are solved to `tol`.

    `up` and `down` are the pixels' neighbours, and 0 outside the shape. `owner` (int32, like v) is to be `DONE`
    outside the shape and is so inside on return; `chains` (5, pixels) int32 and `work` (pixels,) are scratch.
    Returns the number of unknowns in components that were no chain.
    """
    for run in range(starts.size):
        owner[starts[run] : ends[run]] = 0
    unknowns = 0
    for run in range(starts.size):
        for root in range(starts[run], ends[run]):
            if owner[root] == DONE or _solve_single(v, root, up, down, owner, factors):
                continue
            height = 1
            _open_chain(root, 0, chains, owner, up, down)
            chain = 0
            chains[CALLER, 0] = -1
            while chain >= 0:
                side = chains[VISITED, chain] % _LOOP
                if side < 2:
                    chains[VISITED, chain] += 1
                    target = dependency(chains, chain, side, up, down)
                    state = owner[target]
                    if state == DONE or target == chains[side, chain]:
                        continue
                    if state == 0:
                        if _solve_single(v, target, up, down, owner, factors):
                            continue
                        _open_chain(target, height, chains, owner, up, down)
                        chains[CALLER, height] = chain
                        chain = height
                        height += 1
                    elif state - 1 == chain:
                        chains[VISITED, chain] += _LOOP
                    else:
                        chains[LOW, chain] = min(chains[LOW, chain], state - 1)
                    continue
                caller = chains[CALLER, chain]
                low = chains[LOW, chain]
                if low != chain:
                    chains[LOW, caller] = min(chains[LOW, caller], low)
                else:
                    if height == chain + 1 and chains[VISITED, chain] < _LOOP:
                        solve_chain(
                            v, chains[HEAD, chain], chains[LAST, chain], up, down, factors, screening, work, owner
                        )
                    else:
                        unknowns += solve_component(
                            v, chain, height, chains, owner, up, down, factors, screening, tol, work
                        )
                    height = chain
                chain = caller
    return unknowns
