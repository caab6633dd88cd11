"""Entropy and spread of a field on every level of the distance, and how far they can be off: level by level."""

import numpy as np

from torchlinf.kernels._compile import kernel

_PEAK = np.log2(np.e) / np.e  # largest value of -x log2 x, at x = 1/e
_ROUNDING = 4 * 2.220446049250313e-16  # relative, of a value divided by the largest
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
def deviations(values, begin):  # type: ignore[no-untyped-def]
    """Population standard deviation of values / max on each level; exactly 0.0 where all are equal.

    The values are sorted first, so that the order of the pixels does not matter.
    """
    peak = values.max()
    found = np.zeros(begin.size - 1)
    for level in range(found.size):
        heights = np.sort(values[begin[level] : begin[level + 1]]) / peak
        heights -= heights[0]
        mean = heights.sum() / heights.size
        found[level] = np.sqrt(((heights - mean) ** 2).sum() / heights.size)
    return found


@kernel
def deviation_bounds(values, begin, error):  # type: ignore[no-untyped-def]
    """How far the standard deviation of each level can be from that of the exact field: the root mean square move."""
    peak = values.max()
    found = np.full(begin.size - 1, 0.5)
    if error < 1.0:
        move = 2.0 * error / (1.0 - error)
        for level in range(found.size):
            square = 0.0
            for i in range(begin[level], begin[level + 1]):
                square += (values[i] / peak) ** 2
            found[level] = min(0.5, move * np.sqrt(square / (begin[level + 1] - begin[level])))
    return found


@kernel
def rim(distance, strides):  # type: ignore[no-untyped-def]
    """The distance on the rims, 0 elsewhere: pixels that touch a smaller distance through a face; flat and padded."""
    found = np.zeros_like(distance)
    for x in range(distance.size):
        here = distance[x]
        if here > 0:
            for stride in strides:
                if distance[x - stride] < here or distance[x + stride] < here:
                    found[x] = here
                    break
    return found


@kernel
def entropy_bounds(values, begin, bins, slack, error, entropies):  # type: ignore[no-untyped-def]
    """Bits by which the entropy of each level can differ from that of the exact field; 0.0 where no bin is in doubt.

    The exact field is within [v / (1 + e), v / (1 - e)] at every pixel, so that v / max v is known to a factor of
    (1 + e) / (1 - e). A pixel is in doubt if that interval meets several bins.
    """
    found = np.zeros(begin.size - 1)
    if not error < 1.0:
        error = 1.0
    factor = np.inf if error == 1.0 else (1.0 + error) / (1.0 - error) * (1.0 + _ROUNDING)
    peak = values.max()
    certain = np.zeros(bins, np.int64)
    change = np.zeros(bins + 1, np.int64)  # of the number of values that may be in a bin, from one bin to the next
    count = np.zeros(bins, np.int64)
    for level in range(found.size):
        start, stop = begin[level], begin[level + 1]
        doubtful = 0
        for i in range(start, stop):
            low, high = _reach(values[i], peak, bins, slack, factor)
            if low != high:
                doubtful += 1
        if doubtful:
            certain[:] = 0
            change[:] = 0
            count[:] = 0
            for i in range(start, stop):
                low, high = _reach(values[i], peak, bins, slack, factor)
                if low == high:
                    certain[low] += 1
                change[low] += 1
                change[high + 1] -= 1
                count[_bin(values[i], peak, bins, slack)] += 1
            found[level] = _deviation(certain, change, count, stop - start, doubtful, bins, entropies[level])
    return found


@kernel
def _reach(value, peak, bins, slack, factor):  # type: ignore[no-untyped-def]
    """The lowest and the highest bin that the exact value may be in."""
    if factor == np.inf:
        return 0, bins - 1
    return _bin(value / factor, peak, bins, slack), _bin(min(value * factor, peak), peak, bins, slack)


@kernel
def _deviation(certain, change, count, size, doubtful, bins, entropy):  # type: ignore[no-untyped-def]
    """The largest difference in entropy, from how many values each bin holds at least, at most and now."""
    rise = 0.0
    fall = 0.0
    possible = 0
    for cell in range(bins):
        possible += change[cell]
        if possible > certain[cell]:
            low, high, now = certain[cell] / size, possible / size, _term(count[cell] / size)
            least, most = min(_term(low), _term(high)), max(_term(low), _term(high))
            if low * np.e < 1.0 < high * np.e:
                most = _PEAK
            rise += most - now
            fall += now - least
    # An entropy lies between 0 and the logarithm of the number of values or bins.
    rise = min(rise, np.log2(min(size, bins)) - entropy)
    fall = min(fall, entropy)
    share = doubtful / size
    bound = max(rise, fall)
    if bins > 1 and share <= 1.0 - 1.0 / bins:
        bound = min(bound, share * np.log2(bins - 1.0) + _term(share) + _term(1.0 - share))
    return max(bound, 0.0)


@kernel
def _term(x):  # type: ignore[no-untyped-def]
    return -x * np.log2(x) if x > 0.0 else 0.0
