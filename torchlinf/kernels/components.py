"""Strongly connected components of the policy graph that are more than one chain.

Each chain's pixels are affine in the two pixels it depends on. Only those that are depended upon inside the component
are unknowns, with rows x = a + b x(below) + c x(above). Taken in the order in which the depth-first search left their
chains, nearly all rows depend on rows before them; what does not is named feedback. For given values of the feedback
one pass gives all unknowns, and with them the feedback anew, z -> P z + q: so the feedback alone is left to be solved
for, a few where the unknowns are thousands.
"""

import numpy as np

from torchlinf.kernels._compile import kernel
from torchlinf.kernels.krylov import bicgstab, substitute
from torchlinf.kernels.thomas import solve_chain, solve_chain_affine

# Rows of `chains`: the chain's lowest and highest pixel; the pixels beyond these, or these themselves where they are
# their own neighbours; how many pixels it has.
HEAD, LAST, BELOW, ABOVE, LENGTH = range(5)

_DENSE = 48  # feedback up to which elimination beats the Krylov iteration


@kernel
def solve_component(v, order, chains, owner, up, down, factors, screening, tol):  # type: ignore[no-untyped-def]
    """Solve the chains named in `order` together and in place. Returns the number of unknowns.

    `order` is that of the depth-first search; `owner` is above 0 on the component and of no use afterwards.
    """
    size, longest = _mark_targets(order, chains, owner)
    target, constant, weight, index = _affine_rows(v, order, size, longest, chains, owner, up, factors)
    feedback = _find_feedback(index)
    z = np.abs(v[target[feedback]])
    x = np.empty(feedback.size + size)
    if feedback.size <= _DENSE:
        _eliminate(constant, weight, index, feedback, z, x)
    else:
        bicgstab(constant, weight, index, feedback, z, x, tol)
    substitute(1.0, constant, weight, index, z, x)
    for j in range(size):
        v[target[j]] = max(x[feedback.size + j], 0.0)  # as the solution is: below 0 would say that it is unsolved
    for chain in order:
        head, last, length = chains[HEAD, chain], chains[LAST, chain], chains[LENGTH, chain]
        solve_chain(v, head, last, length, up, down, factors, screening)
    return size


@kernel
def _mark_targets(order, chains, owner):  # type: ignore[no-untyped-def]
    """Make `owner` negative where a chain depends on it. Returns how many these are, and the longest chain's length."""
    size = 0
    longest = 0
    for chain in order:
        longest = max(longest, chains[LENGTH, chain])
        for side in range(2):
            target = chains[BELOW + side, chain]
            if owner[target] > 0 and target != chains[side, chain]:
                owner[target] = -owner[target]
                size += 1
    return size, longest


@kernel
def _affine_rows(v, order, size, longest, chains, owner, up, factors):  # type: ignore[no-untyped-def]
    """Pixels and rows x_j = constant_j + weight_j0 x_index_j0 + weight_j1 x_index_j1 of the unknowns, in order.

    What comes from solved pixels is in the constant. A row's index is -1 where it has none, and `owner` -1 - j.
    """
    target = np.empty(size, np.int64)
    constant = np.empty(size)
    weight = np.zeros((size, 2))
    index = np.empty((size, 2), np.int64)
    responses = np.empty((3, longest))
    end = 0
    for chain in order:
        begin = end
        x = chains[HEAD, chain]
        for place in range(chains[LENGTH, chain]):
            if owner[x] < 0:
                target[end] = x
                owner[x] = -1 - end
                index[end, 0] = place
                end += 1
            x = up[x]
        if end > begin:
            peak = chains[ABOVE, chain] == chains[LAST, chain]
            solve_chain_affine(chains[LENGTH, chain], peak, factors, responses)
        for j in range(begin, end):
            place = index[j, 0]
            constant[j] = responses[0, place]
            for side in range(2):
                y = chains[BELOW + side, chain]
                if owner[y] < 0 and y != chains[side, chain]:
                    weight[j, side] = responses[1 + side, place]
                    index[j, side] = y
                else:
                    constant[j] += responses[1 + side, place] * abs(v[y])
                    index[j, side] = -1
    for j in range(size):
        for side in range(2):
            if index[j, side] >= 0:
                index[j, side] = -1 - owner[index[j, side]]
    return target, constant, weight, index


@kernel
def _find_feedback(index):  # type: ignore[no-untyped-def]
    """The rows that rows before them, or they themselves, depend on.

    In `index` a feedback row becomes its place among the feedback, and any other row its number behind all of these.
    """
    size = len(index)
    place = np.full(size, -1)
    count = 0
    for j in range(size):
        for side in range(2):
            i = index[j, side]
            if i >= j and place[i] < 0:
                place[i] = count
                count += 1
    feedback = np.empty(count, np.int64)
    for j in range(size):
        if place[j] >= 0:
            feedback[place[j]] = j
        for side in range(2):
            i = index[j, side]
            if i >= j:
                index[j, side] = place[i]
            else:
                index[j, side] = count + i if i >= 0 else 0  # with a weight of 0
    return feedback


@kernel
def _eliminate(constant, weight, index, feedback, z, x):  # type: ignore[no-untyped-def]
    """Gaussian elimination of (I - P) z = q, set up by one pass a column. An M-matrix needs no pivoting."""
    size = z.size
    matrix = np.empty((size, size + 1))
    for column in range(size + 1):
        z[:] = 0.0
        if column < size:
            z[column] = 1.0
        substitute(1.0 if column == size else 0.0, constant, weight, index, z, x)
        for j in range(size):
            moved = x[size + feedback[j]]
            matrix[j, column] = moved if column == size else z[j] - moved
    for pivot in range(size):
        for j in range(pivot + 1, size):
            if matrix[j, pivot] != 0.0:
                factor = matrix[j, pivot] / matrix[pivot, pivot]
                for column in range(pivot + 1, size + 1):
                    matrix[j, column] -= factor * matrix[pivot, column]
    for j in range(size - 1, -1, -1):
        total = matrix[j, size]
        for column in range(j + 1, size):
            total -= matrix[j, column] * z[column]
        z[j] = total / matrix[j, j]
