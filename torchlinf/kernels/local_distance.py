"""The chessboard distance after some pixels were removed or filled, changed only where it does change.

What was overwritten goes to a trail, the pixel and its old distance, so that all of it can be undone in reverse order.
"""

from torchlinf.kernels.compiler import kernel

_UNKNOWN = 2**30  # more than any distance


@kernel
def remove(distance, pixels, block, trail, old, count):  # type: ignore[no-untyped-def]
    """Set the distance after inside `pixels` became outside; returns the length of the trail, which was `count`.

    The new distance is the least of the old one and that to the removed pixels, which spreads from them as a wave: all
    pixels of a shortest way back change as well.
    """
    first = count
    for x in pixels:
        trail[count], old[count] = x, distance[x]
        distance[x] = 0
        count += 1
    while first < count:
        x = trail[first]
        beyond = distance[x] + 1
        for offset in block:
            y = x + offset
            if distance[y] > beyond:
                trail[count], old[count] = y, distance[y]
                distance[y] = beyond
                count += 1
        first += 1
    return count


@kernel
def fill(distance, pixels, block, trail, old, count):  # type: ignore[no-untyped-def]
    """Set the distance after outside `pixels` became inside; returns the length of the trail, which was `count`.

    A pixel keeps its distance while a pixel of one less beside it does. From the filled pixels outwards, distance by
    distance, those that no longer have one are found. Their distances are then relaxed from all around them.
    """
    begin = first = count
    for x in pixels:
        trail[count], old[count] = x, 0
        distance[x] = _UNKNOWN
        count += 1
    while first < count:
        x = trail[first]
        before = old[first]
        for offset in block:
            y = x + offset
            if distance[y] == before + 1:
                held = False
                for second in block:
                    held = held or distance[y + second] == before
                if not held:
                    trail[count], old[count] = y, distance[y]
                    distance[y] = _UNKNOWN
                    count += 1
        first += 1
    changed = True
    backward = False
    while changed:
        changed = False
        for k in range(begin, count):
            x = trail[begin + count - 1 - k] if backward else trail[k]
            nearest = _UNKNOWN
            for offset in block:
                nearest = min(nearest, distance[x + offset])
            if nearest + 1 < distance[x]:
                distance[x] = nearest + 1
                changed = True
        backward = not backward
    return count


@kernel
def undo(values, trail, old, count):  # type: ignore[no-untyped-def]
    """Put back what was overwritten, the last first."""
    for k in range(count - 1, -1, -1):
        values[trail[k]] = old[k]


@kernel
def change_counts(counts, distance, trail, old, count):  # type: ignore[no-untyped-def]
    """How many pixels each distance has, of which `counts` tells before; returns the radius.

    A pixel that is on the trail twice has its new distance counted twice, and the one in between taken off.
    """
    for k in range(count):
        counts[old[k]] -= 1
        counts[distance[trail[k]]] += 1
    radius = counts.size - 1
    while radius > 0 and counts[radius] <= 0:
        radius -= 1
    return radius
