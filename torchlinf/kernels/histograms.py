"""Entropy and spread of a field on every level of the distance: a counting sort by level, then level by level."""

import numpy as np

from torchlinf.kernels._compile import kernel

_UNIT = 2.0**55  # an entropy is at most log2(bins) <= 20, so its terms fit into int64 in steps of 1 / _UNIT


@kernel
def sort_by_level(field, distance, radius):  # type: ignore[no-untyped-def]
    """The inside values, level by level, and the position at which each level begins (and the last one ends)."""
    begin = np.zeros(radius + 2, np.int64)
    for d in distance:
        if d > 0:
            begin[d + 1] += 1
    for level in range(1, radius + 2):
        begin[level] += begin[level - 1]
    begin = begin[1:].copy()
    place = begin.copy()
    values = np.empty(begin[radius], field.dtype)
    for x in range(distance.size):
        level = distance[x] - 1
        if level >= 0:
            values[place[level]] = field[x]
            place[level] += 1
    return values, begin


@kernel
def entropies(values, begin, bins, slack):  # type: ignore[no-untyped-def]
    """Entropy in bits of the histogram of values / max on each level; exactly 0.0 where one bin holds all.

    The terms are added as integers, so that the order of the pixels does not matter, and only bins that are hit cost.
    """
    peak = values.max()
    tally = np.zeros(bins, np.int64)
    found = np.zeros(begin.size - 1)
    for level in range(found.size):
        members = values[begin[level] : begin[level + 1]]
        for value in members:
            tally[_bin(value, peak, bins, slack)] += 1
        total = 0
        for value in members:
            cell = _bin(value, peak, bins, slack)
            if 0 < tally[cell] < members.size:
                share = tally[cell] / members.size
                total -= int(np.rint(share * np.log2(share) * _UNIT))
            tally[cell] = 0
        found[level] = total / _UNIT
    return found


@kernel
def _bin(value, peak, bins, slack):  # type: ignore[no-untyped-def]
    return min(int(value / peak * bins + slack), bins - 1)


@kernel
def deviations(values, begin, bins, slack):  # type: ignore[no-untyped-def]
    """Population standard deviation of values / max on each level; exactly 0.0 where all are equal.

    `bins` and `slack` are not used. The values are sorted first, so that the order of the pixels does not matter.
    """
    peak = values.max()
    found = np.zeros(begin.size - 1)
    for level in range(found.size):
        heights = np.sort(values[begin[level] : begin[level + 1]]) / peak
        heights -= heights[0]
        mean = heights.sum() / heights.size
        found[level] = np.sqrt(((heights - mean) ** 2).sum() / heights.size)
    return found
