"""Thomas' algorithm on one chain: constant coefficients, so that all of the elimination comes from a table."""

import numpy as np

from torchlinf.kernels._compile import kernel

_SETTLED = 40.0  # screening lengths after which the table changes no more: what is missing has shrunk by exp(-40)


@kernel
def thomas_factors(length, screening):  # type: ignore[no-untyped-def]
    """Rows a, b, c: v_i = a_i + b_i v(below) + c_i v_(i+1) in a chain of up to `length` pixels, from its head up.

    The table ends where it has settled; from there on its last column holds.
    """
    settled = _SETTLED / np.sqrt(screening) + 1.0
    factors = np.empty((3, length if settled > length else int(settled)))
    a, b, c = factors[0], factors[1], factors[2]
    a[0] = b[0] = c[0] = 1.0 / (2.0 + screening)
    for i in range(1, c.size):
        c[i] = 1.0 / (2.0 + screening - c[i - 1])
        a[i] = (1.0 + a[i - 1]) * c[i]
        b[i] = b[i - 1] * c[i]
    return factors


@kernel
def solve_chain(v, head, last, length, up, down, factors, screening):  # type: ignore[no-untyped-def]
    """Solve one chain in place, given the values at the two pixels that it depends on.

    The top of a peak is its own up neighbour: its diagonal is 1 + s, and dividing by 1 - c takes it from the table.
    A pixel that is its own down neighbour as well stands on a plateau, where v = 1/s. If it is no peak, the policy is
    wrong (f has no interior minimum), and its present value serves. That may bear the sign of the unsolved.
    """
    if down[head] == head and up[head] == head:
        v[head] = 1.0 / screening
        return
    settled = factors.shape[1] - 1
    below = abs(v[down[head]])
    i = min(length - 1, settled)
    value = factors[0, i] + factors[1, i] * below
    value = value / (1.0 - factors[2, i]) if up[last] == last else value + factors[2, i] * v[up[last]]
    x = last
    v[x] = value
    for place in range(length - 2, -1, -1):
        i = min(place, settled)
        x = down[x]
        value = (factors[0, i] + factors[1, i] * below) + factors[2, i] * value
        v[x] = value


@kernel
def solve_chain_affine(length, peak, factors, responses):  # type: ignore[no-untyped-def]
    """v = a + b v(below) + c v(above) at every pixel of a chain, head first, as the rows of `responses`."""
    a, b, c = factors[0], factors[1], factors[2]
    settled = c.size - 1
    i = min(length - 1, settled)
    scale = 1.0 / (1.0 - c[i]) if peak else 1.0
    constant, below, above = a[i] * scale, b[i] * scale, 0.0 if peak else c[i]
    responses[0, length - 1], responses[1, length - 1], responses[2, length - 1] = constant, below, above
    for place in range(length - 2, -1, -1):
        i = min(place, settled)
        constant = a[i] + c[i] * constant
        below = b[i] + c[i] * below
        above *= c[i]
        responses[0, place], responses[1, place], responses[2, place] = constant, below, above
