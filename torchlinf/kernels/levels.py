"""From one resolution to the next: a shape at half the side, and its field as a start for the full one."""

import numpy as np

from torchlinf.kernels._compile import kernel


@kernel
def _parent_row(x, strides, parent_strides):  # type: ignore[no-untyped-def]
    """Flat index of the parent of pixel x, both grids padded by one: coordinate c becomes (c - 1) // 2 + 1."""
    parent = 0
    for axis in range(strides.size):
        c = x // strides[axis]
        x -= c * strides[axis]
        parent += ((c - 1) // 2 + 1) * parent_strides[axis]
    return parent


@kernel
def coarsen(starts, ends, strides, parents, parent_strides):  # type: ignore[no-untyped-def]
    """Mark every parent that has an inside child, so that no part of a shape is lost."""
    for run in range(starts.size):
        first = _parent_row(starts[run], strides, parent_strides)
        last = _parent_row(ends[run] - 1, strides, parent_strides)
        parents[first : last + 1] = True


@kernel
def square_profile(radius, screening):  # type: ignore[no-untyped-def]
    """g_D(k), k = 0 .. D: the field of a square of radius D on its levels, a chain that ends in a peak."""
    pivots = np.empty(radius + 1)
    profile = np.zeros(radius + 1)
    pivots[0] = 0.0
    for k in range(1, radius + 1):
        pivots[k] = 1.0 / (2.0 + screening - pivots[k - 1])
        profile[k] = (1.0 + profile[k - 1]) * pivots[k]
    profile[radius] /= 1.0 - pivots[radius]
    for k in range(radius - 1, 0, -1):
        profile[k] += pivots[k] * profile[k + 1]
    return profile


@kernel
def set_profile(v, distance, starts, ends, profile):  # type: ignore[no-untyped-def]
    """v(x) = g(d(x)), the field if the shape were a square."""
    for run in range(starts.size):
        for x in range(starts[run], ends[run]):
            v[x] = profile[distance[x]]


@kernel
def scale_by_parents(v, starts, ends, strides, parent_v, parent_distance, parent_profile, parent_strides):  # type: ignore[no-untyped-def]
    """Multiply v by the parents' ratio of field to profile.

    The ratio is 1 where the shape looks like a square, up to its boundary, where the field itself is steep: it carries
    over from half the resolution far better than the field does.
    """
    width = strides[strides.size - 2] if strides.size > 1 else 0
    for run in range(starts.size):
        start = starts[run]
        parent = _parent_row(start, strides, parent_strides)
        column = start % width if width > 0 else start
        odd = (column - 1) % 2
        for j in range(ends[run] - start):
            x = parent + (j + odd) // 2
            v[start + j] *= parent_v[x] / parent_profile[parent_distance[x]]
