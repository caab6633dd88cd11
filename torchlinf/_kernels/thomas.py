"""Thomas' algorithm on one chain: constant coefficients, so the pivots come from a table."""

import numpy as np

from torchlinf._kernels._compile import kernel

DONE = np.iinfo(np.int32).max  # the owner of a pixel whose value is known, and of all pixels outside


@kernel
def thomas_factors(length, screening):  # type: ignore[no-untyped-def]
    """Inverse pivots c_i = 1 / (2 + s - c_(i-1)) of a chain, from its head up."""
    factors = np.empty(length)
    factors[0] = 1.0 / (2.0 + screening)
    for i in range(1, length):
        factors[i] = 1.0 / (2.0 + screening - factors[i - 1])
    return factors


@kernel
def solve_chain(v, head, last, up, down, factors, screening, work, owner):  # type: ignore[no-untyped-def]
    """Solve one chain in place, given the values at the two pixels that it depends on, and mark it as done.

    The top of a peak is its own up neighbour: its diagonal is 1 + s, and y / (1 - c_i) takes it from the table.
    A pixel that is its own down neighbour as well stands on a plateau, where v = 1/s. If it is no peak, the policy is
    wrong (f has no interior minimum), and its present value serves.
    """
    if down[head] == head and up[head] == head:
        v[head] = 1.0 / screening
        owner[head] = DONE
        return
    y = v[down[head]]
    x = head
    i = 0
    while True:
        y = (1.0 + y) * factors[i]
        work[i] = y
        if x == last:
            break
        x = up[x]
        i += 1
    value = y / (1.0 - factors[i]) if up[last] == last else y + factors[i] * v[up[last]]
    v[last] = value
    owner[last] = DONE
    while i > 0:
        i -= 1
        x = down[x]
        value = work[i] + factors[i] * value
        v[x] = value
        owner[x] = DONE


@kernel
def solve_chain_affine(head, last, up, down, factors, responses):  # type: ignore[no-untyped-def]
    """v = a + b v(below) + c v(above) at every pixel of a chain, head first, as the rows of `responses`.

    Returns the chain's length.
    """
    a, b, c = responses[0], responses[1], responses[2]
    constant = 0.0
    weight = 1.0
    x = head
    i = 0
    while True:
        constant = (1.0 + constant) * factors[i]
        weight *= factors[i]
        a[i] = constant
        b[i] = weight
        if x == last:
            break
        x = up[x]
        i += 1
    length = i + 1
    c[i] = factors[i]
    if up[last] == last:
        peak = 1.0 / (1.0 - factors[i])
        a[i] *= peak
        b[i] *= peak
        c[i] = 0.0
    while i > 0:
        i -= 1
        a[i] += factors[i] * a[i + 1]
        b[i] += factors[i] * b[i + 1]
        c[i] = factors[i] * c[i + 1]
    return length
