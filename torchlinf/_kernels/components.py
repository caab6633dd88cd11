"""Strongly connected components of the policy graph that are more than one chain.

Each chain's pixels are affine in the two pixels it depends on. Only those that are depended upon inside the component
are unknowns: x = a + B x with at most two entries a row, and I - B an M-matrix, so elimination needs no pivoting.
"""

import numpy as np

from torchlinf._kernels._compile import kernel
from torchlinf._kernels.krylov import bicgstab
from torchlinf._kernels.thomas import solve_chain, solve_chain_affine

HEAD, LAST = 0, 1  # rows of `chains`: the chain's lowest and its highest pixel

_DENSE = 48  # unknowns up to which elimination beats the Krylov iteration


@kernel
def dependency(chains, chain, side, up, down):  # type: ignore[no-untyped-def]
    """The pixel beyond the head (side 0) or the last pixel (side 1); that pixel itself where it is its own."""
    return down[chains[HEAD, chain]] if side == 0 else up[chains[LAST, chain]]


@kernel
def solve_component(v, first, stop, chains, owner, up, down, factors, screening, tol, work):  # type: ignore[no-untyped-def]
    """Solve the chains first .. stop on the stack together and in place. Returns the number of unknowns."""
    targets = _mark_targets(first, stop, chains, owner, up, down)
    constant, weight, index = _affine_system(v, targets, first, stop, chains, owner, up, down, factors)
    x = v[targets]
    if targets.size <= _DENSE:
        _eliminate(constant, weight, index, x)
    else:
        bicgstab(constant, weight, index, x, tol)
    for j in range(targets.size):
        v[targets[j]] = x[j]
        owner[targets[j]] = -owner[targets[j]]
    for chain in range(first, stop):
        solve_chain(v, chains[HEAD, chain], chains[LAST, chain], up, down, factors, screening, work, owner)
    return targets.size


@kernel
def _mark_targets(first, stop, chains, owner, up, down):  # type: ignore[no-untyped-def]
    """Pixels of the component that its chains depend on, sorted; `owner` is made negative there."""
    targets = np.empty(2 * (stop - first), np.int64)
    count = 0
    for chain in range(first, stop):
        for side in range(2):
            target = dependency(chains, chain, side, up, down)
            name = owner[target]
            if first < name <= stop and target != chains[side, chain]:
                targets[count] = target
                owner[target] = -name
                count += 1
    return np.sort(targets[:count])


@kernel
def _affine_system(v, targets, first, stop, chains, owner, up, down, factors):  # type: ignore[no-untyped-def]
    """Rows x_j = constant_j + weight_j0 x_index_j0 + weight_j1 x_index_j1 of the unknowns."""
    constant = np.empty(targets.size)
    weight = np.zeros((targets.size, 2))
    index = np.zeros((targets.size, 2), np.int64)
    responses = np.empty((3, _longest(first, stop, chains, up)))
    for chain in range(first, stop):
        solved = False
        x = chains[HEAD, chain]
        i = 0
        while True:
            if owner[x] < 0:
                if not solved:
                    solve_chain_affine(chains[HEAD, chain], chains[LAST, chain], up, down, factors, responses)
                    solved = True
                j = np.searchsorted(targets, x)
                constant[j] = responses[0, i]
                for side in range(2):
                    target = dependency(chains, chain, side, up, down)
                    if owner[target] < 0 and target != chains[side, chain]:
                        weight[j, side] = responses[1 + side, i]
                        index[j, side] = np.searchsorted(targets, target)
                    else:
                        constant[j] += responses[1 + side, i] * v[target]
            if x == chains[LAST, chain]:
                break
            x = up[x]
            i += 1
    return constant, weight, index


@kernel
def _longest(first, stop, chains, up):  # type: ignore[no-untyped-def]
    longest = 0
    for chain in range(first, stop):
        length = 1
        x = chains[HEAD, chain]
        while x != chains[LAST, chain]:
            x = up[x]
            length += 1
        longest = max(longest, length)
    return longest


@kernel
def _eliminate(constant, weight, index, x):  # type: ignore[no-untyped-def]
    """Gaussian elimination of (I - B) x = a, dense."""
    size = x.size
    matrix = np.zeros((size, size + 1))
    for j in range(size):
        matrix[j, j] = 1.0
        matrix[j, size] = constant[j]
        for side in range(2):
            matrix[j, index[j, side]] -= weight[j, side]
    for pivot in range(size):
        for j in range(pivot + 1, size):
            if matrix[j, pivot] != 0.0:
                factor = matrix[j, pivot] / matrix[pivot, pivot]
                for column in range(pivot + 1, size + 1):
                    matrix[j, column] -= factor * matrix[pivot, column]
    for j in range(size - 1, -1, -1):
        total = matrix[j, size]
        for column in range(j + 1, size):
            total -= matrix[j, column] * x[column]
        x[j] = total / matrix[j, j]
