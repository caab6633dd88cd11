"""One chain of pixels, solved by Thomas' algorithm: constant coefficients, so all of the elimination is in a table."""

import math

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel

_LENGTHS = 40.0  # screening lengths after which the table changes no more: what is missing has shrunk by exp(-40)


def chain_factors(length: int, screening: float) -> np.ndarray:
    """Rows a, b, c: v_i = a_i + b_i v(below) + c_i v_(i+1) in a chain of up to `length` pixels, from its head up.

    The table ends where it changes no more; from there on its last column holds.
    """
    enough = _LENGTHS / math.sqrt(screening) + 1.0 if screening > 0 else math.inf
    factors = np.empty((3, length if enough > length else int(enough)))
    _fill_factors(factors, screening)
    return factors


def square_profile(radius: int, screening: float) -> np.ndarray:
    """g_D(k), k = 0 .. D: the field of a square of radius D at distance k from its outside.

    It is a chain of D pixels that ends in a peak and begins beside the outside, where g is 0.
    """
    profile = np.zeros(radius + 1)
    _fill_profile(profile, chain_factors(radius, screening))
    return profile


@kernel
def _fill_factors(factors, screening):  # type: ignore[no-untyped-def]
    a, b, c = factors[0], factors[1], factors[2]
    a[0] = b[0] = c[0] = 1.0 / (2.0 + screening)
    for i in range(1, c.size):
        c[i] = 1.0 / (2.0 + screening - c[i - 1])
        a[i] = (1.0 + a[i - 1]) * c[i]
        b[i] = b[i - 1] * c[i]


@kernel
def _fill_profile(profile, factors):  # type: ignore[no-untyped-def]
    last = factors.shape[1] - 1
    length = profile.size - 1
    i = min(length - 1, last)
    value = factors[0, i] / (1.0 - factors[2, i])
    profile[length] = value
    for k in range(length - 1, 0, -1):
        i = min(k - 1, last)
        value = factors[0, i] + factors[2, i] * value
        profile[k] = value


@kernel
def look_up(profile, distance, starts, ends, v):  # type: ignore[no-untyped-def]
    """v = profile[distance] on the runs; pages of v without any stay untouched."""
    for run in range(starts.size):
        for x in range(starts[run], ends[run]):
            v[x] = profile[distance[x]]


@inlined
def solve_chain(v, head, last, length, up, down, factors, screening):  # type: ignore[no-untyped-def]
    """Solve one chain in place, given the values at the two pixels that it depends on.

    The top of a peak is its own up neighbour: its diagonal is 1 + s, and dividing by 1 - c takes it from the table.
    A pixel that is its own down neighbour as well stands on a plateau, where v = 1/s. If it is no peak, the policy is
    wrong (f has no interior minimum), and its present value serves. That may bear the sign of the unsolved.
    """
    if down[head] == head and up[head] == head:
        v[head] = 1.0 / screening
    else:
        end = factors.shape[1] - 1
        below = abs(v[down[head]])
        i = min(length - 1, end)
        value = factors[0, i] + factors[1, i] * below
        value = value / (1.0 - factors[2, i]) if up[last] == last else value + factors[2, i] * v[up[last]]
        x = last
        v[x] = value
        for place in range(length - 2, -1, -1):
            i = min(place, end)
            x = down[x]
            value = (factors[0, i] + factors[1, i] * below) + factors[2, i] * value
            v[x] = value


@inlined
def solve_chain_affine(length, peak, factors, responses):  # type: ignore[no-untyped-def]
    """v = a + b v(below) + c v(above) at every pixel of a chain, head first, as the rows of `responses`."""
    a, b, c = factors[0], factors[1], factors[2]
    end = c.size - 1
    i = min(length - 1, end)
    scale = 1.0 / (1.0 - c[i]) if peak else 1.0
    constant, below, above = a[i] * scale, b[i] * scale, 0.0 if peak else c[i]
    responses[0, length - 1], responses[1, length - 1], responses[2, length - 1] = constant, below, above
    for place in range(length - 2, -1, -1):
        i = min(place, end)
        constant = a[i] + c[i] * constant
        below = b[i] + c[i] * below
        above *= c[i]
        responses[0, place], responses[1, place], responses[2, place] = constant, below, above
