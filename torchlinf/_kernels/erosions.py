"""Erosion of one grey mask, and the way a gradient takes back through it, axis by axis.

An array is seen as (outer, size, inner) with `size` along the axis in question; beyond its ends the mask is 0.
"""

import math

import numpy as np

from torchlinf._kernels._compile import kernel


def erode(x: np.ndarray) -> np.ndarray:
    """Minimum over the 3^n block of every pixel."""
    return erosion_stages(x)[-1]


def erosion_stages(x: np.ndarray) -> list[np.ndarray]:
    """x, its erosion along the first axis, along the first two, and so on."""
    stages = [x]
    for axis in range(x.ndim):
        stages.append(np.empty_like(x))
        erode_axis(_along(stages[-2], axis), _along(stages[-1], axis))
    return stages


def through_erosion(flow: np.ndarray, before: np.ndarray) -> np.ndarray:
    """The gradient by `before` from the one by its erosion."""
    stages = erosion_stages(before)
    for axis in range(before.ndim - 1, -1, -1):
        after, found = stages.pop(), np.empty_like(flow)
        pull_axis(_along(flow, axis), _along(stages[-1], axis), _along(after, axis), _along(found, axis))
        flow = found
    return flow


def _along(x: np.ndarray, axis: int) -> np.ndarray:
    return x.reshape(math.prod(x.shape[:axis]), x.shape[axis], -1)


@kernel
def erode_axis(x, out):  # type: ignore[no-untyped-def]
    """out = minimum of x over three adjacent places along the middle axis."""
    outer, size, inner = x.shape
    for a in range(outer):
        for b in range(inner):
            out[a, 0, b] = 0.0
            out[a, size - 1, b] = 0.0
        for i in range(1, size - 1):
            for b in range(inner):
                out[a, i, b] = min(min(x[a, i - 1, b], x[a, i + 1, b]), x[a, i, b])


@kernel
def pull_axis(flow, before, after, out):  # type: ignore[no-untyped-def]
    """Write to `out` the gradient by `before` from the one by `after`, its erosion along the middle axis.

    A place that holds its minimum itself keeps the gradient; else the sides that hold it share.
    """
    outer, size, inner = before.shape
    for a in range(outer):
        for i in range(size):
            for b in range(inner):
                out[a, i, b] = flow[a, i, b] if before[a, i, b] == after[a, i, b] else 0.0
        for i in range(1, size - 1):
            for b in range(inner):
                least = after[a, i, b]
                if before[a, i, b] != least and flow[a, i, b] != 0.0:
                    left = before[a, i - 1, b] == least
                    right = before[a, i + 1, b] == least
                    part = 0.5 * flow[a, i, b] if left and right else flow[a, i, b]
                    if left:
                        out[a, i - 1, b] += part
                    if right:
                        out[a, i + 1, b] += part
