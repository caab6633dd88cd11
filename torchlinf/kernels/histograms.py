"""Entropy and spread of a field on every level of the distance: a counting sort by level, then level by level."""

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel

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


def deviations(values: np.ndarray, begin: np.ndarray, bins: int, slack: float) -> np.ndarray:
    """Population standard deviation of values / max on each level; exactly 0.0 where all are equal.

    `bins` and `slack` are not used. The values are sorted first, so that the order of the pixels does not matter.
    """
    ordered = values.copy()
    for level in range(begin.size - 1):
        ordered[begin[level] : begin[level + 1]].sort()
    found = np.empty(begin.size - 1)
    _measure_deviations(ordered, begin, float(values.max()), found)
    return found


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
