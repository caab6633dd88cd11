"""From one resolution to the next: a shape at half the side, and its field as a start for the full one."""

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel
from torchlinf.kernels.grid import interior


def half_of(padded: np.ndarray) -> np.ndarray:
    """The padded mask at half the side: a pixel is inside if any of the 2^n pixels under it is, so no part is lost."""
    fine = padded
    for axis, size in enumerate(padded.shape):
        first = (slice(None),) * axis
        # pixels 1 and 2 are under pixel 1 of the coarse mask, 3 and 4 under pixel 2; the ring may stand in for a pixel
        fine = fine[(*first, slice(1, size - 1, 2))] | fine[(*first, slice(2, size, 2))]
    coarse = np.zeros([size + 2 for size in fine.shape], dtype=np.bool_)
    coarse[interior(fine.ndim)] = fine
    return coarse


@inlined
def _parent(x, strides, parent_strides):  # type: ignore[no-untyped-def]
    """Flat index of the parent of pixel x, both grids padded by one: coordinate c becomes (c - 1) // 2 + 1."""
    parent = 0
    for axis in range(strides.size):
        c = x // strides[axis]
        x -= c * strides[axis]
        parent += ((c - 1) // 2 + 1) * parent_strides[axis]
    return parent


@kernel
def scale_by_parents(v, starts, ends, strides, parent_v, parent_distance, parent_profile, parent_strides):  # type: ignore[no-untyped-def]
    """Multiply v by the parents' ratio of field to profile.

    The ratio is 1 where the shape looks like a square, up to its boundary, where the field itself is steep: it carries
    over from half the resolution far better than the field does.
    """
    width = strides[strides.size - 2] if strides.size > 1 else 0
    for run in range(starts.size):
        start = starts[run]
        parent = _parent(start, strides, parent_strides)
        column = start % width if width > 0 else start
        odd = (column - 1) % 2
        for j in range(ends[run] - start):
            x = parent + (j + odd) // 2
            v[start + j] *= parent_v[x] / parent_profile[parent_distance[x]]
