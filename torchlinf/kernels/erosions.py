"""Erosion of one grey mask, and the way a gradient takes back through it, axis by axis.

An array is seen as (outer, size, inner) with `size` along the axis in question. Beyond its ends the mask is 0, so that
an erosion is 0 on the outermost places: they are left out, and erosions are smaller than what they are erosions of.
"""

import math

import numpy as np

from torchlinf.kernels.compiler import kernel


def erode(x: np.ndarray) -> np.ndarray:
    """Minimum over the 3^n block of every pixel but the outermost."""
    return erosion_stages(x)[-1]


def erosion_stages(x: np.ndarray) -> list[np.ndarray]:
    """x, its erosion along the first axis, along the first two, and so on."""
    stages = [x]
    for axis in range(x.ndim):
        stages.append(np.empty(_with_size(stages[-1].shape, axis, max(0, x.shape[axis] - 2))))
        erode_axis(_along(stages[-2], axis), _along(stages[-1], axis))
    return stages


def through_erosion(flow: np.ndarray, before: np.ndarray) -> np.ndarray:
    """The gradient by `before` from the one by its erosion."""
    stages = erosion_stages(before)
    for axis in range(before.ndim - 1, -1, -1):
        after, found = stages.pop(), np.zeros(stages[-1].shape)
        pull_axis(_along(flow, axis), _along(stages[-1], axis), _along(after, axis), _along(found, axis))
        flow = found
    return flow


def _with_size(shape: tuple[int, ...], axis: int, size: int) -> tuple[int, ...]:
    return (*shape[:axis], size, *shape[axis + 1 :])


def _along(x: np.ndarray, axis: int) -> np.ndarray:
    return x.reshape(math.prod(x.shape[:axis]), x.shape[axis], math.prod(x.shape[axis + 1 :]))


@kernel
def erode_axis(x, out):  # type: ignore[no-untyped-def]
    """out[:, i] = minimum of x[:, i], x[:, i + 1] and x[:, i + 2]."""
    outer, size, inner = out.shape
    for a in range(outer):
        for i in range(size):
            for b in range(inner):
                out[a, i, b] = min(min(x[a, i, b], x[a, i + 2, b]), x[a, i + 1, b])


@kernel
def pull_axis(flow, before, after, out):  # type: ignore[no-untyped-def]
    """Add to `out` the gradient by `before` from the one by `after`, its erosion along the middle axis.

    A place that holds its minimum itself keeps the gradient; else the sides that hold it share.
    """
    outer, size, inner = after.shape
    for a in range(outer):
        for i in range(size):
            for b in range(inner):
                least, part = after[a, i, b], flow[a, i, b]
                if before[a, i + 1, b] == least:
                    out[a, i + 1, b] += part
                elif part != 0.0:
                    left = before[a, i, b] == least
                    right = before[a, i + 2, b] == least
                    if left and right:
                        part *= 0.5
                    if left:
                        out[a, i, b] += part
                    if right:
                        out[a, i + 2, b] += part
