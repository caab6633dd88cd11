"""Thomas' algorithm on one chain: constant coefficients, so the pivots come from a table."""

import numpy as np

from torchlinf._kernels._compile import kernel

_SETTLED = 20.0  # screening lengths after which the pivots change no more: their error has shrunk by exp(-40)


@kernel
def thomas_factors(length, screening):  # type: ignore[no-untyped-def]
    """Inverse pivots c_i = 1 / (2 + s - c_(i-1)) of a chain of up to `length` pixels, from its head up.

    The table ends where they have settled; from there on the last one holds.
    """
    settled = _SETTLED / np.sqrt(screening) + 1.0
    factors = np.empty(length if settled > length else int(settled))
    factors[0] = 1.0 / (2.0 + screening)
    for i in range(1, factors.size):
        factors[i] = 1.0 / (2.0 + screening - factors[i - 1])
    return factors


@kernel
def solve_chain(v, head, last, up, down, factors, screening, work):  # type: ignore[no-untyped-def]
    """Solve one chain in place, given the values at the two pixels that it depends on.

    The top of a peak is its own up neighbour: its diagonal is 1 + s, and y / (1 - c_i) takes it from the table.
    A pixel that is its own down neighbour as well stands on a plateau, where v = 1/s. If it is no peak, the policy is
    wrong (f has no interior minimum), and its present value serves. That may bear the sign of the unsolved.
    """
    if down[head] == head and up[head] == head:
        v[head] = 1.0 / screening
        return
    y = abs(v[down[head]])
    x = head
    i = 0
    settled = factors.size - 1
    while True:
        y = (1.0 + y) * factors[min(i, settled)]
        work[i] = y
        if x == last:
            break
        x = up[x]
        i += 1
    factor = factors[min(i, settled)]
    value = y / (1.0 - factor) if up[last] == last else y + factor * v[up[last]]
    v[last] = value
    while i > 0:
        i -= 1
        x = down[x]
        value = work[i] + factors[min(i, settled)] * value
        v[x] = value


@kernel
def solve_chain_affine(head, last, up, down, factors, responses):  # type: ignore[no-untyped-def]
    """v = a + b v(below) + c v(above) at every pixel of a chain, head first, as the rows of `responses`."""
    a, b, c = responses[0], responses[1], responses[2]
    constant = 0.0
    weight = 1.0
    x = head
    i = 0
    settled = factors.size - 1
    while True:
        factor = factors[min(i, settled)]
        constant = (1.0 + constant) * factor
        weight *= factor
        a[i] = constant
        b[i] = weight
        if x == last:
            break
        x = up[x]
        i += 1
    c[i] = factor
    if up[last] == last:
        peak = 1.0 / (1.0 - factor)
        a[i] *= peak
        b[i] *= peak
        c[i] = 0.0
    while i > 0:
        i -= 1
        factor = factors[min(i, settled)]
        a[i] += factor * a[i + 1]
        b[i] += factor * b[i + 1]
        c[i] = factor * c[i + 1]
