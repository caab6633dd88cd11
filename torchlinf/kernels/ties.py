"""The neighbours that hold the block's maximum and minimum, with ties split evenly among the nearest.

Of several neighbours that are equal the nearest count, in equal parts: the pixel itself, else those across a face,
else across an edge, and so on. That commutes with flips and axis swaps, as a derivative should. Taking all of them
would too, but where the field runs straight into a shape the influence of a pixel would then spread sideways like
heat, and the linear system would be as hard as a heat equation.
"""

import numpy as np

from torchlinf.kernels._compile import kernel
from torchlinf.kernels.grid import Grid


def nearest_first(grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Flat offsets of the block, nearest first, and along how many axes each of them steps."""
    steps = [(0, 0)]
    for stride in grid.strides.tolist():
        steps = [(axes + abs(step), offset + step * stride) for axes, offset in steps for step in (-1, 0, 1)]
    axes, offsets = zip(*sorted(steps), strict=True)
    return np.array(offsets), np.array(axes)


@kernel
def find_ties(v, order, offsets, axes, tie):  # type: ignore[no-untyped-def]
    """Rows of neighbours: `target[begin[i] : begin[i + 1]]` are flat pixels, and `weight` their shares, at order[i].

    A row holds first the neighbours within `tie` of the maximum, then those within `tie` of the minimum.
    """
    begin = np.zeros(order.size + 1, np.int64)
    target = np.empty(3 * order.size + 2 * offsets.size, np.int32)
    weight = np.empty(target.size)
    count = 0
    for i in range(order.size):
        x = order[i]
        if count + 2 * offsets.size > target.size:
            target, weight = _grown(target), _grown(weight)
        high = low = v[x]
        for offset in offsets:
            high = max(high, v[x + offset])
            low = min(low, v[x + offset])
        count = _add_nearest(v, x, offsets, axes, high - tie, 1.0, target, weight, count)
        count = _add_nearest(v, x, offsets, axes, -low - tie, -1.0, target, weight, count)
        begin[i + 1] = count
    return begin, target[:count], weight[:count]


@kernel
def _add_nearest(v, x, offsets, axes, bound, sign, target, weight, count):  # type: ignore[no-untyped-def]
    """Append the nearest neighbours with sign v >= bound; returns the new count."""
    stop = count
    for k in range(offsets.size):
        if stop > count and axes[k] > axes[k - 1]:
            break
        if sign * v[x + offsets[k]] >= bound:
            target[stop] = x + offsets[k]
            stop += 1
    for k in range(count, stop):
        weight[k] = 1.0 / (stop - count)
    return stop


@kernel
def _grown(array):  # type: ignore[no-untyped-def]
    larger = np.empty(2 * array.size, array.dtype)
    larger[: array.size] = array
    return larger
