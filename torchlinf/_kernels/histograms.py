"""Entropy and spread of the field on every level of the distance, in one pass over the levels."""

import numpy as np

from torchlinf._kernels._compile import kernel


@kernel
def by_level(field, distance, radius):  # type: ignore[no-untyped-def]
    """The field's values sorted by level (a counting sort), and where each level begins."""
    begin = np.zeros(radius + 2, np.int64)
    for x in range(distance.size):
        if distance[x] > 0:
            begin[distance[x] + 1] += 1
    for level in range(1, radius + 2):
        begin[level] += begin[level - 1]
    values = np.empty(begin[radius + 1], field.dtype)
    place = begin.copy()
    for x in range(distance.size):
        level = distance[x]
        if level > 0:
            values[place[level]] = field[x]
            place[level] += 1
    return values, begin[1:]


@kernel
def level_entropies(values, begin, bins, slack):  # type: ignore[no-untyped-def]
    """Entropy in bits of the histogram of values / max on each level; exactly 0.0 where one bin holds all."""
    scale = bins / values.max()
    tally = np.zeros(bins, np.int64)
    entropy = np.zeros(begin.size - 1)
    for level in range(begin.size - 1):
        first, stop = begin[level], begin[level + 1]
        lowest, highest = bins, -1
        for i in range(first, stop):
            cell = min(int(values[i] * scale + slack), bins - 1)
            tally[cell] += 1
            lowest = min(lowest, cell)
            highest = max(highest, cell)
        total = 0.0
        if lowest < highest:
            for cell in range(lowest, highest + 1):
                if tally[cell] > 0:
                    share = tally[cell] / (stop - first)
                    total -= share * np.log2(share)
        entropy[level] = total
        for i in range(first, stop):
            tally[min(int(values[i] * scale + slack), bins - 1)] = 0
    return entropy
