"""The histograms of the levels after a change of some pixels: counts are moved from cell to cell.

A cell is one bin of one level, number (level - 1) * bins + bin, or -1 for a pixel that is on no level. What was
overwritten goes to a trail, so that all of it can be undone.
"""

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel

MANY = 64  # pixels of a cell from which on it is looked at alone; cells of fewer are counted by their number of pixels
_UNIT = 2.0**55  # as in `histograms`, so that the same counts give the same entropy to the last bit


def empty(size: int, radius: int, bins: int, num_faces: int) -> tuple[np.ndarray, ...]:
    """Histograms without a pixel on a grid of this size: what `place` calls cell, doubtful, tally, ..., trail, old."""
    cell, doubtful = np.full(size, -1, np.int32), np.zeros(size, np.uint8)
    tally, sizes = np.zeros(radius * bins, np.int32), np.zeros(radius + 1, np.int64)
    kinds, touched = np.zeros((radius + 1, MANY), np.int32), np.zeros(radius + 1, np.uint8)
    return cell, doubtful, tally, sizes, kinds, touched, *np.empty((2, (3 + 2 * num_faces) * size), np.int32)


@inlined
def _level(distance, x, faces):  # type: ignore[no-untyped-def]
    """The level of a pixel; with faces only where one of these neighbours has a smaller distance, else 0."""
    level = distance[x]
    if faces.size > 0:
        at_rim = False
        for offset in faces:
            at_rim = at_rim or distance[x + offset] < level
        level = level if at_rim else 0
    return level


@kernel
def place(  # type: ignore[no-untyped-def]
    pixels, around, field, distance, faces, peak, bins, slack, error, cell, doubtful, tally, sizes, kinds, touched,
    trail, old, count,
):  # fmt: skip
    """Put pixels, and those `around` them, into their cells; returns the largest field there and the trail's length.

    `around` are offsets, among them 0. `faces` are the offsets to the neighbours through faces if levels are rims, else
    there are none. Values of the field are divided by `peak`, and known to the relative `error` then: a pixel is
    `doubtful` if another bin is as near. `tally` is the number of pixels of each cell, `sizes` that of each level, from
    1, and at 0 that of the doubtful ones; `kinds`, (levels + 1, MANY), is how many cells of each level have 1, 2, ...
    pixels, and at 0 MANY or more; `touched` is set where a level changed. `trail` is to hold the pixels that
    moved, and `old` 2 cell + doubtful before.
    """
    largest = 0.0
    for x0 in pixels:
        for offset in around:
            x = x0 + offset
            level = _level(distance, x, faces)
            now = np.int64(-1)
            doubt = np.int64(0)
            if level > 0:
                value = field[x]
                largest = max(largest, value)
                place = value / peak * bins + slack
                lower = np.int64(place)
                if lower < bins:
                    doubt = np.int64(place - lower < place * error or lower + 1 - place < place * error)
                now = (level - 1) * bins + min(lower, bins - 1)
            before = np.int64(cell[x])
            if now == before and doubt == doubtful[x]:
                continue
            trail[count], old[count] = x, 2 * before + doubtful[x]
            count += 1
            _move(x, before, now, doubt, bins, cell, doubtful, tally, sizes, kinds)
            if before >= 0:
                touched[before // bins + 1] = 1
            if now >= 0:
                touched[now // bins + 1] = 1
    return largest, count


@inlined
def _move(x, before, now, doubt, bins, cell, doubtful, tally, sizes, kinds):  # type: ignore[no-untyped-def]
    """`sizes` also counts, at 0, the pixels in doubt."""
    if before >= 0:
        level, number = before // bins + 1, tally[before]
        tally[before] = number - 1
        sizes[level] -= 1
        kinds[level, number if number < MANY else 0] -= 1
        if number > 1:
            kinds[level, number - 1 if number - 1 < MANY else 0] += 1
    if now >= 0:
        level, number = now // bins + 1, tally[now]
        tally[now] = number + 1
        sizes[level] += 1
        if number > 0:
            kinds[level, number if number < MANY else 0] -= 1
        kinds[level, number + 1 if number + 1 < MANY else 0] += 1
    sizes[0] += doubt - doubtful[x]
    cell[x] = now
    doubtful[x] = doubt


@kernel
def undo(bins, cell, doubtful, tally, sizes, kinds, trail, old, count):  # type: ignore[no-untyped-def]
    """Put all moved pixels back, the last first."""
    for k in range(count - 1, -1, -1):
        x, before, doubt = trail[k], np.int64(old[k] >> 1), np.int64(old[k] & 1)
        _move(x, np.int64(cell[x]), before, doubt, bins, cell, doubtful, tally, sizes, kinds)


@kernel
def update_entropies(tally, sizes, kinds, touched, bins, found):  # type: ignore[no-untyped-def]
    """The entropy in bits of every touched level; the terms are those of `histograms`."""
    for level in range(1, sizes.size):
        if touched[level]:
            touched[level] = 0
            size = sizes[level]
            total = np.int64(0)
            left = size
            number = 1
            while left > 0 and number < MANY:
                cells = np.int64(kinds[level, number])
                if cells > 0:
                    total += cells * _term(number, size)
                    left -= cells * number
                number += 1
            cell = (level - 1) * bins
            while left > 0:
                if tally[cell] >= MANY:
                    total += _term(tally[cell], size)
                    left -= tally[cell]
                cell += 1
            found[level - 1] = total / _UNIT


@inlined
def _term(number, size):  # type: ignore[no-untyped-def]
    share = number / size
    return -np.int64(np.rint(share * np.log2(share) * _UNIT))


@kernel
def largest_on_levels(field, cell):  # type: ignore[no-untyped-def]
    """The largest field of the pixels that are on a level."""
    largest = 0.0
    for x in range(cell.size):
        if cell[x] >= 0:
            largest = max(largest, field[x])
    return largest
