"""The field near a change: relaxation, policies and residuals at a growing list of pixels.

From the field before a change the relaxation is monotone, and only pixels whose field does change are ever touched:
after pixels are removed every value falls, after pixels are filled every value rises. So the list grows where a
residual is left, and nowhere else.
"""

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel


@inlined
def _extrema(v, x, block):  # type: ignore[no-untyped-def]
    most = v[x]
    least = v[x]
    for offset in block:
        most = max(most, v[x + offset])
        least = min(least, v[x + offset])
    return most, least


@kernel
def add_around(v, distance, pixels, block, listed, active, old, count):  # type: ignore[no-untyped-def]
    """List the pixels that were flipped and the inside pixels beside them; returns how many are listed.

    `active` are the pixels, `old` their values before, `listed` tells which they are. Removed pixels become 0.
    """
    for x in pixels:
        if listed[x] == 0:
            listed[x] = 1
            active[count], old[count] = x, v[x]
            count += 1
        if distance[x] == 0:
            v[x] = 0.0
    for x in pixels:
        for offset in block:
            y = x + offset
            if listed[y] == 0 and distance[y] > 0:
                listed[y] = 1
                active[count], old[count] = y, v[y]
                count += 1
    return count


@kernel
def relax(v, distance, block, screening, threshold, passes, limit, listed, active, old, count):  # type: ignore[no-untyped-def]
    """Relax the listed pixels in place, forwards and backwards in turn; returns how many are listed.

    Neighbours of a pixel that moved, whose residual is above the threshold, join the list. It ends early where the list
    is longer than `limit`.
    """
    weight = 1.0 / (2.0 + screening)
    for number in range(passes):
        k = 0
        stop = count
        while k < (count if number % 2 == 0 else stop):
            x = active[k] if number % 2 == 0 else active[stop - 1 - k]
            k += 1
            if distance[x] == 0:
                continue
            most, least = _extrema(v, x, block)
            value = (most + least + 1.0) * weight
            move = abs(value - v[x])
            v[x] = value
            if move > threshold:
                for offset in block:
                    y = x + offset
                    if listed[y] == 0 and distance[y] > 0:
                        most, least = _extrema(v, y, block)
                        if abs((most - v[y]) - (v[y] - least) + (1.0 - screening * v[y])) > threshold:
                            listed[y] = 1
                            active[count], old[count] = y, v[y]
                            count += 1
                if count > limit:
                    return count
    return count


@kernel
def choose_policies_at(v, distance, block, tie, active, count, up, down):  # type: ignore[no-untyped-def]
    """The policies of the listed pixels, by the tie rule of `stencil.choose_policies`."""
    for k in range(count):
        x = active[k]
        if distance[x] == 0:
            continue
        most, least = _extrema(v, x, block)
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
        up[x] = above
        down[x] = below


@kernel
def measure(v, distance, block, screening, threshold, listed, active, old, count, beside):  # type: ignore[no-untyped-def]
    """The largest residual on the listed pixels and beside them, and how many are listed after that.

    Pixels beside the list with a residual above the threshold join it. `beside` is scratch.
    """
    largest = 0.0
    looked = 0
    before = count
    for k in range(before):
        x = active[k]
        for offset in block:
            y = x + offset
            if distance[y] == 0 or listed[y] == 2 or (listed[y] == 1 and offset != 0):
                continue
            most, least = _extrema(v, y, block)
            residual = abs((most - v[y]) - (v[y] - least) + (1.0 - screening * v[y]))
            largest = max(largest, residual)
            if offset != 0:
                if residual > threshold:
                    listed[y] = 1
                    active[count], old[count] = y, v[y]
                    count += 1
                else:
                    listed[y] = 2
                    beside[looked] = y
                    looked += 1
    for k in range(looked):
        listed[beside[k]] = 0
    return largest, count


@kernel
def forget(listed, up, down, active, count):  # type: ignore[no-untyped-def]
    """Unlist all pixels and their policies."""
    for k in range(count):
        x = active[k]
        listed[x] = 0
        up[x] = down[x] = 0


@kernel
def inside_of(distance, active, count, chosen):  # type: ignore[no-untyped-def]
    """Write the listed pixels that are inside into `chosen`; returns how many."""
    size = 0
    for k in range(count):
        if distance[active[k]] > 0:
            chosen[size] = active[k]
            size += 1
    return size
