"""Cycles in the policy graph: Tarjan's algorithm on chains, from one pixel, components taken dependencies first.

A chain is named by its place on Tarjan's stack, so that what is known of it lives in the few arrays that are in cache.
What is solved has v >= 0, as in `chains`.
"""

from torchlinf.kernels._compile import kernel
from torchlinf.kernels.components import ABOVE, BELOW, HEAD, LAST, LENGTH, solve_component
from torchlinf.kernels.thomas import solve_chain

# Rows of `chains`: low link, dependencies looked at, the chain that asked for it; and the chains that the search has
# left and that are not yet solved, in that order.
LOW, VISITED, CALLER, LEFT = range(5, 9)
ROWS = 9
_LOOP = 4  # added to VISITED for every dependency of a chain on itself


@kernel
def solve_tangle(v, root, up, down, factors, screening, tol, owner, chains):  # type: ignore[no-untyped-def]
    """Solve a pixel and all it depends on; see `chains.solve_policies`, also for what is returned.

    `owner` is 0 or less at what is unsolved, and 0 at what this has solved.
    """
    unknowns = 0
    height = 1
    left = 0
    _open_chain(root, 0, chains, owner, up, down)
    chain = 0
    chains[CALLER, 0] = -1
    while chain >= 0:
        side = chains[VISITED, chain] % _LOOP
        if side < 2:
            chains[VISITED, chain] += 1
            target = chains[BELOW + side, chain]
            if v[target] >= 0.0 or target == chains[side, chain]:
                continue
            state = owner[target]
            if state <= 0:
                _open_chain(target, height, chains, owner, up, down)
                chains[CALLER, height] = chain
                chain = height
                height += 1
            elif state - 1 == chain:
                chains[VISITED, chain] += _LOOP
            else:
                chains[LOW, chain] = min(chains[LOW, chain], state - 1)
            continue
        chains[LEFT, left] = chain
        left += 1
        caller = chains[CALLER, chain]
        low = chains[LOW, chain]
        if low != chain:
            chains[LOW, caller] = min(chains[LOW, caller], low)
        else:
            if height == chain + 1 and chains[VISITED, chain] < _LOOP:
                head, last, length = chains[HEAD, chain], chains[LAST, chain], chains[LENGTH, chain]
                solve_chain(v, head, last, length, up, down, factors, screening)
            else:
                order = chains[LEFT, left - (height - chain) : left]
                unknowns += solve_component(v, order, chains, owner, up, down, factors, screening, tol)
            for done in range(chain, height):
                _close_chain(done, chains, owner, up)
            left -= height - chain
            height = chain
        chain = caller
    return unknowns


@kernel
def _open_chain(x, number, chains, owner, up, down):  # type: ignore[no-untyped-def]
    """Find the chain through x and write 1 + its number on all its pixels."""
    y = down[x]
    while y != x and up[y] == x:
        x = y
        y = down[y]
    chains[HEAD, number] = x
    chains[BELOW, number] = y
    owner[x] = number + 1
    length = 1
    y = up[x]
    while y != x and down[y] == x:
        x = y
        owner[x] = number + 1
        y = up[y]
        length += 1
    chains[LAST, number] = x
    chains[ABOVE, number] = y
    chains[LENGTH, number] = length
    chains[LOW, number] = number
    chains[VISITED, number] = 0


@kernel
def _close_chain(number, chains, owner, up):  # type: ignore[no-untyped-def]
    """Erase the number from the chain's pixels."""
    x = chains[HEAD, number]
    owner[x] = 0
    while x != chains[LAST, number]:
        x = up[x]
        owner[x] = 0
