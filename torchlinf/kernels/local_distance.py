"""The chessboard distance after some pixels were flipped, changed only where it does change.

What was overwritten goes to a trail, the pixel and its old distance, so that all of it can be undone, the last first.
"""

from torchlinf.kernels.compiler import inlined, kernel

_UNKNOWN = 2**30  # more than any distance


@kernel
def flip(distance, removed, filled, block, counts, trail, old):  # type: ignore[no-untyped-def]
    """Set the distance after inside pixels were removed and outside ones filled.

    Returns the length of the trail and the new radius. `counts`, the number of pixels of each distance, is kept right.
    """
    count = _remove(distance, removed, block, counts, trail, old)
    count = _fill(distance, filled, block, counts, trail, old, count)
    radius = counts.size - 1
    while radius > 0 and counts[radius] == 0:
        radius -= 1
    return count, radius


@inlined
def _remove(distance, pixels, block, counts, trail, old):  # type: ignore[no-untyped-def]
    """The new distance is the least of the old one and that to the removed pixels.

    It spreads from them as a wave: on a shortest way back from a pixel that changes, all pixels change.
    """
    count = 0
    for x in pixels:
        trail[count], old[count] = x, distance[x]
        distance[x] = 0
        count += 1
    first = 0
    while first < count:
        x = trail[first]
        counts[old[first]] -= 1
        counts[distance[x]] += 1
        first += 1
        beyond = distance[x] + 1
        for offset in block:
            y = x + offset
            if distance[y] > beyond:
                trail[count], old[count] = y, distance[y]
                distance[y] = beyond
                count += 1
    return count


@inlined
def _fill(distance, pixels, block, counts, trail, old, count):  # type: ignore[no-untyped-def]
    """A pixel keeps its distance while a pixel of one less beside it does.

    From the filled pixels outwards, distance by distance, those that no longer have one are found. Their distances are
    then relaxed from all around them.
    """
    begin = first = count
    for x in pixels:
        trail[count], old[count] = x, 0
        distance[x] = _UNKNOWN
        count += 1
    while first < count:
        x = trail[first]
        before = old[first]
        first += 1
        for offset in block:
            y = x + offset
            if distance[y] == before + 1 and not _is_held(distance, y, block, before):
                trail[count], old[count] = y, distance[y]
                distance[y] = _UNKNOWN
                count += 1
    changed = True
    backward = False
    while changed:
        changed = False
        for k in range(begin, count):
            x = trail[begin + count - 1 - k] if backward else trail[k]
            nearest = distance[x]
            for offset in block:
                nearest = min(nearest, distance[x + offset] + 1)
            if nearest < distance[x]:
                distance[x] = nearest
                changed = True
        backward = not backward
    for k in range(begin, count):
        counts[old[k]] -= 1
        counts[distance[trail[k]]] += 1
    return count


@kernel
def _is_held(distance, x, block, before):  # type: ignore[no-untyped-def]
    k = 0
    while k < block.size and distance[x + block[k]] != before:
        k += 1
    return k < block.size


@kernel
def undo(distance, counts, trail, old, count):  # type: ignore[no-untyped-def]
    """Put back what was overwritten."""
    for k in range(count - 1, -1, -1):
        counts[distance[trail[k]]] -= 1
        counts[old[k]] += 1
        distance[trail[k]] = old[k]
