"""Chains of pixels: each is solved by Thomas' algorithm, and what it depends on before it.

The coefficients are constant, so all of the elimination is in a table. Unsolved values are negative, as in
`policy_system`.
"""

import math

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel

# Places of the `state` of `follow_chains`: the present run, and how many pixels are on the path.
RUN, PATH_HEIGHT = range(2)
BEGIN = -1  # height before the first call
_SOLVED = -1
_ON_PATH = -1
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
def solve_chain_affine(length, peak, factors, constants, belows, aboves):  # type: ignore[no-untyped-def]
    """v = a + b v(below) + c v(above) at every pixel of a chain, head first, into the last three."""
    a, b, c = factors[0], factors[1], factors[2]
    end = c.size - 1
    i = min(length - 1, end)
    scale = 1.0 / (1.0 - c[i]) if peak else 1.0
    constant, below, above = a[i] * scale, b[i] * scale, 0.0 if peak else c[i]
    constants[length - 1], belows[length - 1], aboves[length - 1] = constant, below, above
    for place in range(length - 2, -1, -1):
        i = min(place, end)
        constant = a[i] + c[i] * constant
        below = b[i] + c[i] * below
        above *= c[i]
        constants[place], belows[place], aboves[place] = constant, below, above


@kernel
def unsolve(v, starts, ends):  # type: ignore[no-untyped-def]
    """Make all values negative: none is solved."""
    for run in range(starts.size):
        values = v[starts[run] : ends[run]]
        for j in range(values.size):
            values[j] = -values[j]


@inlined
def follow_chains(v, starts, ends, up, down, factors, screening, owner, path, state):  # type: ignore[no-untyped-def]
    """Solve chain by chain; returns whether this stopped at a cycle, which the last pixel of `path` is part of.

    When that pixel is solved, this is to be called again. `up` and `down` are the pixels' neighbours. `owner` (int32,
    like v) is to be 0 and is so in the end; `path` (pixels,), int32, is scratch.
    """
    height = state[PATH_HEIGHT]
    if height == BEGIN:
        height = 0
        unsolve(v, starts, ends)
    while height > 0 and v[path[height - 1]] >= 0.0:
        height -= 1
    for run in range(state[RUN], starts.size):
        for root in range(starts[run], ends[run]):
            if v[root] >= 0.0:
                continue
            if height == 0:
                above = v[up[root]]
                below = v[down[root]]
                if above >= 0.0 and below >= 0.0:
                    v[root] = (1.0 + above + below) * factors[2, 0]
                    continue
                path[0] = root
                owner[root] = _ON_PATH
                height = 1
            height = _follow_path(v, height, up, down, factors, screening, owner, path)
            if height > 0:
                state[RUN], state[PATH_HEIGHT] = run, height
                return True
    return False


@inlined
def _follow_path(v, height, up, down, factors, screening, owner, path):  # type: ignore[no-untyped-def]
    """Solve the pixels of the path and all they depend on, from the last to the first.

    Returns 0, or the height of the path where it meets itself.
    """
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
            return height
        else:
            path[height] = missing
            owner[missing] = _ON_PATH
            height += 1
    return 0


@inlined
def _try_chain(v, x, up, down, factors, screening):  # type: ignore[no-untyped-def]
    """Solve the chain through x, or return a pixel that it depends on and that is not yet solved."""
    missing = _SOLVED
    length = 1
    last = x
    above = up[x]
    while above != last and down[above] == last:
        last = above
        above = up[above]
        length += 1
    if v[above] < 0.0 and above != last:
        missing = above
    else:
        head = x
        below = down[x]
        while below != head and up[below] == head:
            head = below
            below = down[below]
            length += 1
        if v[below] < 0.0 and below != head:
            missing = below
        else:
            solve_chain(v, head, last, length, up, down, factors, screening)
    return missing
