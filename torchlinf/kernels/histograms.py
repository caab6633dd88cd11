"""Entropy and spread of a field on every level of the distance, and how far they can be off: level by level."""

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel

_ROUNDING = 4 * 2.0**-52  # relative, of a value divided by the largest
_UNIT = 2.0**55  # an entropy is at most log2(bins) <= 20, so its terms fit into int64 in steps of 1 / _UNIT


def sort_by_level(field: np.ndarray, distance: np.ndarray, radius: int) -> tuple[np.ndarray, np.ndarray]:
    """The inside values, level by level, and the position at which each level begins (and the last one ends)."""
    begin, values = np.zeros(radius + 2, np.int64), np.empty(np.count_nonzero(distance))
    _sort(field, distance, begin, values)
    return values, begin[: radius + 1]


def entropies(values: np.ndarray, begin: np.ndarray, bins: int, slack: float) -> np.ndarray:
    """Entropy in bits of the histogram of values / max on each level; exactly 0.0 where one bin holds all."""
    found = np.empty(begin.size - 1)
    _count_entropies(values, begin, float(values.max()), bins, slack, np.zeros(bins, np.int64), found)
    return found


def deviations(values: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Population standard deviation of values / max on each level; exactly 0.0 where all are equal.

    The values are sorted first, so that the order of the pixels does not matter.
    """
    ordered = values.copy()
    for level in range(begin.size - 1):
        ordered[begin[level] : begin[level + 1]].sort()
    found = np.empty(begin.size - 1)
    _measure_deviations(ordered, begin, float(values.max()), found)
    return found


def entropy_bounds(
    values: np.ndarray, begin: np.ndarray, bins: int, slack: float, error: float, entropies: np.ndarray
) -> np.ndarray:
    """Bits by which the entropy of each level can differ from that of the exact field; 0.0 where no bin is in doubt.

    The exact field is within [v / (1 + e), v / (1 - e)] at every pixel, so that v / max v is known to a factor of
    (1 + e) / (1 - e). A pixel is in doubt if that interval meets several bins.
    """
    error = error if error < 1.0 else 1.0
    factor = 1e200 if error == 1.0 else (1.0 + error) / (1.0 - error) * (1.0 + _ROUNDING)
    peak = float(values.max())
    doubtful = np.zeros(begin.size - 1, np.int64)
    _count_doubtful(values, begin, peak, bins, slack, factor, doubtful)
    found = np.zeros(begin.size - 1)
    for level in np.flatnonzero(doubtful):
        members = values[begin[level] : begin[level + 1]]
        low, now, high = (
            np.minimum((x / peak * bins + slack).astype(np.int64), bins - 1)
            for x in (members / factor, members, np.minimum(members * factor, peak))
        )
        found[level] = _deviation(low, now, high, bins, float(entropies[level]))
    return found


def _deviation(low: np.ndarray, now: np.ndarray, high: np.ndarray, bins: int, entropy: float) -> float:
    """The largest difference in entropy, from how many values each bin holds at least, at most and now."""
    size = len(now)
    moves = np.bincount(low, minlength=bins + 1) - np.bincount(high + 1, minlength=bins + 1)
    least = np.bincount(low[low == high], minlength=bins) / size
    most = np.cumsum(moves)[:bins] / size
    ends, present = (_terms(least), _terms(most)), _terms(np.bincount(now, minlength=bins) / size)
    top = np.where((least * np.e < 1) & (most * np.e > 1), np.log2(np.e) / np.e, np.maximum(*ends))
    in_doubt = most > least
    rise = float((top - present)[in_doubt].sum())
    fall = float((present - np.minimum(*ends))[in_doubt].sum())
    # An entropy lies between 0 and the logarithm of the number of values or bins.
    bound = max(min(rise, np.log2(min(size, bins)) - entropy), min(fall, entropy))
    share = float((low != high).mean())
    if bins > 1 and share <= 1 - 1 / bins:
        bound = min(bound, share * np.log2(bins - 1) + float(_terms(np.array([share, 1 - share])).sum()))
    return max(bound, 0.0)


def _terms(shares: np.ndarray) -> np.ndarray:
    """-x log2 x, 0 at 0."""
    return -shares * np.log2(shares, out=np.zeros_like(shares), where=shares > 0)


def deviation_bounds(values: np.ndarray, begin: np.ndarray, error: float) -> np.ndarray:
    """How far the standard deviation of each level can be from that of the exact field: the root mean square move."""
    if not error < 1.0:
        return np.full(begin.size - 1, 0.5)
    square = np.add.reduceat((values / values.max()) ** 2, begin[:-1]) / np.diff(begin)
    return np.minimum(0.5, 2.0 * error / (1.0 - error) * np.sqrt(square))


def rim(distance: np.ndarray, strides: np.ndarray) -> np.ndarray:
    """The distance on the rims, 0 elsewhere: pixels that touch a smaller distance through a face; flat and padded."""
    lowest = distance.copy()
    for stride in strides.tolist():
        beside = np.minimum(distance[: -2 * stride], distance[2 * stride :])
        np.minimum(lowest[stride:-stride], beside, out=lowest[stride:-stride])
    return np.where(lowest < distance, distance, 0).astype(distance.dtype)


@kernel
def _sort(field, distance, begin, values):  # type: ignore[no-untyped-def]
    for x in range(distance.size):
        if distance[x] > 0:
            begin[distance[x] + 1] += 1
    for level in range(1, begin.size):
        begin[level] += begin[level - 1]
    for x in range(distance.size):  # begin[d] moves from the place of level d - 1's end to that of level d's
        d = distance[x]
        if d > 0:
            values[begin[d]] = field[x]
            begin[d] += 1


@kernel
def _count_entropies(values, begin, peak, bins, slack, tally, found):  # type: ignore[no-untyped-def]
    """The terms are added as integers, so that the order of the pixels does not matter; only bins hit cost time."""
    for level in range(found.size):
        size = begin[level + 1] - begin[level]
        for x in range(begin[level], begin[level + 1]):
            tally[_bin(values[x], peak, bins, slack)] += 1
        total = np.int64(0)
        for x in range(begin[level], begin[level + 1]):
            cell = _bin(values[x], peak, bins, slack)
            if 0 < tally[cell] < size:
                share = tally[cell] / size
                total -= np.int64(np.rint(share * np.log2(share) * _UNIT))
            tally[cell] = 0
        found[level] = total / _UNIT


@kernel
def _count_doubtful(values, begin, peak, bins, slack, factor, doubtful):  # type: ignore[no-untyped-def]
    for level in range(doubtful.size):
        for x in range(begin[level], begin[level + 1]):
            value = values[x]
            above = min(value * factor, peak)
            if _bin(value / factor, peak, bins, slack) != _bin(above, peak, bins, slack):
                doubtful[level] += 1


@kernel
def _measure_deviations(ordered, begin, peak, found):  # type: ignore[no-untyped-def]
    for level in range(found.size):
        first, stop = begin[level], begin[level + 1]
        least = ordered[first] / peak
        total = 0.0
        for x in range(first, stop):
            total += ordered[x] / peak - least
        mean = total / (stop - first)
        total = 0.0
        for x in range(first, stop):
            step = ordered[x] / peak - least - mean
            total += step * step
        found[level] = np.sqrt(total / (stop - first))


@inlined
def _bin(value, peak, bins, slack):  # type: ignore[no-untyped-def]
    cell = np.int64(value / peak * bins + slack)
    return cell if cell < bins else bins - 1
