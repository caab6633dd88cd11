"""The field near a change: relaxation, policies and residuals at a growing list of pixels.

From the field before a change the relaxation is monotone, and only pixels whose field does change are ever touched:
after pixels are removed every value falls, after pixels are filled every value rises. So the list grows where a
residual is left, and nowhere else.
"""

from torchlinf._helpers.ties import equal_within
from torchlinf.kernels.compiler import inlined, kernel
from torchlinf.kernels.strong_components import MEMBERS, solve_runs

# Places of `state`: how many pixels are listed, whether `advance` solved for them, and from CHAINS on what
# `chains.follow_chains` keeps.
LISTED, SOLVED, CHAINS = range(3)
STATES = 4
UNLISTED, PRESENT, LOOKED_AT = range(3)  # values of `listed`

_equal_within = inlined(equal_within)


@inlined
def _extrema(v, x, rows):  # type: ignore[no-untyped-def]
    most = v[x]
    least = v[x]
    for row in rows:
        y = x + row
        a, b, c = v[y - 1], v[y], v[y + 1]
        most = max(max(most, a), max(b, c))
        least = min(min(least, a), min(b, c))
    return most, least


@kernel
def _residual(v, x, rows, screening):  # type: ignore[no-untyped-def]
    most, least = _extrema(v, x, rows)
    return abs((most - v[x]) - (v[x] - least) + (1.0 - screening * v[x]))


@kernel
def begin(v, distance, removed, filled, block, listed, active, old, state):  # type: ignore[no-untyped-def]
    """List the pixels that were flipped, which become 0, and the inside pixels beside them.

    `active` are the listed pixels, `old` their values before, `listed` tells which they are.
    """
    count = 0
    for pixels in (removed, filled):
        for x in pixels:
            listed[x] = PRESENT
            active[count], old[count] = x, v[x]
            v[x] = 0.0
            count += 1
    for k in range(count):
        for offset in block:
            y = active[k] + offset
            if listed[y] == UNLISTED and distance[y] > 0:
                listed[y] = PRESENT
                active[count], old[count] = y, v[y]
                count += 1
    state[:] = 0
    state[LISTED] = count


@kernel
def advance(  # type: ignore[no-untyped-def]
    v, distance, block, rows, screening, tol, passes, rounds, limit, tie, finest, noise, up, down, factors, owner, path,
    chains, search, listed, active, old, beside, starts, ends, state,
):  # fmt: skip
    """Relax and solve in turn until every residual on and beside the list is at most `tol`; returns the largest one.

    It gives up after `rounds` solves, where more than `limit` pixels are listed, or at a cycle of policies that
    elimination has no room for; among 54,040 flips there was none. What neighbours are equal within is
    `equal_within(tie, residual, finest)`, or the share `noise` of the residual. `up`, `down`, `owner` and `search` are
    0 outside the list. The rest is scratch.
    """
    count = state[LISTED]
    solves = 0
    while True:
        residual, count = _relax(v, distance, block, rows, screening, tol, passes, limit, listed, active, old, count)
        if residual <= tol:
            residual, count = _measure(v, distance, block, rows, screening, tol, listed, active, old, count, beside)
        if residual <= tol or count > limit or solves == rounds:
            break
        near = max(_equal_within(tie, residual, finest), noise * residual)
        size = _choose(v, distance, block, rows, near, active, count, up, down, starts, ends)
        state[CHAINS], state[CHAINS + 1] = 0, -1
        solves += 1
        solve_runs(
            v, starts[:size], ends[:size], up, down, factors, screening, owner, path, chains, state[CHAINS:], search
        )
        if search[MEMBERS] > 0:
            search[:] = 0
            for k in range(count):
                owner[active[k]] = 0
            break
        residual, count = _measure(v, distance, block, rows, screening, tol, listed, active, old, count, beside)
        if residual <= tol:
            break
    state[LISTED], state[SOLVED] = count, residual <= tol
    return residual


@kernel
def _relax(v, distance, block, rows, screening, tol, passes, limit, listed, active, old, count):  # type: ignore[no-untyped-def]
    """Relax the listed pixels in place, forwards and backwards in turn.

    Neighbours of a pixel that moved join the list if their residual is above `tol`. It ends early where nothing moves,
    or where the list is longer than `limit`. Returns the largest residual that the last pass met, and how many pixels
    are listed.
    """
    weight = 1.0 / (2.0 + screening)
    largest = 0.0
    for number in range(passes):
        largest = 0.0
        k = 0
        stop = count
        while k < stop:
            x = active[k] if number % 2 == 0 else active[stop - 1 - k]
            k += 1
            if distance[x] == 0:
                continue
            most, least = _extrema(v, x, rows)
            value = (most + least + 1.0) * weight
            residual = abs(value - v[x]) / weight
            v[x] = value
            if residual > tol:
                largest = max(largest, residual)
                for offset in block:
                    y = x + offset
                    if listed[y] == UNLISTED and distance[y] > 0 and _residual(v, y, rows, screening) > tol:
                        listed[y] = PRESENT
                        active[count], old[count] = y, v[y]
                        count += 1
                if count > limit:
                    return largest, count
            if number % 2 == 0:
                stop = count  # forwards also those that have just joined: so news goes as far as it goes
        if largest == 0.0:
            break
    return largest, count


@kernel
def _choose(v, distance, block, rows, tie, active, count, up, down, starts, ends):  # type: ignore[no-untyped-def]
    """The policies of the listed pixels that are inside, by the tie rule of `stencil.choose_policies`.

    Each of these pixels becomes a run from `starts` to `ends`; returns how many they are.
    """
    size = 0
    for k in range(count):
        x = active[k]
        if distance[x] == 0:
            continue
        most, least = _extrema(v, x, rows)
        most -= tie
        least += tie
        above = below = x
        if v[x] < most:
            for offset in block:
                if v[x + offset] >= most:
                    above = x + offset
                    break
        if v[x] > least:
            for offset in block:
                if v[x + offset] <= least:
                    below = x + offset
                    break
        up[x], down[x] = above, below
        starts[size], ends[size] = x, x + 1
        size += 1
    return size


@kernel
def _measure(v, distance, block, rows, screening, tol, listed, active, old, count, beside):  # type: ignore[no-untyped-def]
    """The largest residual on the listed pixels and beside them, and how many are listed after that.

    Pixels beside the list with a residual above `tol` join it.
    """
    largest = 0.0
    looked = 0
    for k in range(count):
        x = active[k]
        if distance[x] > 0:
            largest = max(largest, _residual(v, x, rows, screening))
        if v[x] == old[k]:
            continue  # beside it nothing has changed
        for offset in block:
            y = x + offset
            if listed[y] == UNLISTED and distance[y] > 0:
                residual = _residual(v, y, rows, screening)
                largest = max(largest, residual)
                if residual > tol:
                    listed[y] = PRESENT
                    active[count], old[count] = y, v[y]
                    count += 1
                else:
                    listed[y] = LOOKED_AT
                    beside[looked] = y
                    looked += 1
    for k in range(looked):
        listed[beside[k]] = UNLISTED
    return largest, count


@kernel
def end(v, undo, listed, up, down, active, old, count):  # type: ignore[no-untyped-def]
    """Unlist all pixels and their policies, and with `undo` put their values back."""
    for k in range(count):
        x = active[k]
        listed[x] = UNLISTED
        up[x] = down[x] = 0
        if undo:
            v[x] = old[k]
