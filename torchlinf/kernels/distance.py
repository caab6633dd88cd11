"""Exact chessboard distance in two raster passes."""

import math

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel
from torchlinf.kernels.grid import Grid


def chessboard_of(grid: Grid) -> np.ndarray:
    """Distance of every pixel of a padded grid to the nearest outside pixel, flat int32."""
    distance = np.zeros(math.prod(grid.shape), dtype=np.int32)
    scratch = np.empty(grid.shape[-1], dtype=np.int32)
    chessboard(distance, grid.starts, grid.ends, grid.rows, scratch)
    return distance


@kernel
def chessboard(distance, starts, ends, rows, scratch):  # type: ignore[no-untyped-def]
    """Fill `distance` (flat, padded, 0 outside the runs) with the distance to the nearest outside pixel.

    The first pass sees the half of the block that comes before a pixel, the second the half that comes after; for the
    chessboard metric that is exact in any dimension. `rows` are the offsets of the block's rows, ascending; the least
    of the rows before (after) is taken column by column first, which vectorises, then along the run.
    """
    for backward in range(2):
        for k in range(starts.size):
            run = starts.size - 1 - k if backward else k
            start = starts[run]
            length = ends[run] - start
            _nearest(distance, start, length, rows, backward, scratch)
            values = distance[start : start + length]
            previous = 0
            if backward:
                for j in range(length - 1, -1, -1):
                    previous = min(min(previous + 1, scratch[j]), values[j])
                    values[j] = previous
            else:
                for j in range(length):
                    previous = min(previous + 1, scratch[j])
                    values[j] = previous


@inlined
def _nearest(distance, start, length, rows, backward, scratch):  # type: ignore[no-untyped-def]
    """1 + the least distance among the block's rows before (or after) the run, column by column."""
    far = 2**30
    for j in range(length + 2):
        scratch[j] = far
    for row in rows:
        if (row > 0) if backward else (row < 0):
            values = distance[start - 1 + row : start + 1 + row + length]
            for j in range(length + 2):
                scratch[j] = min(scratch[j], values[j])
    for j in range(length):
        scratch[j] = min(min(scratch[j], scratch[j + 1]), scratch[j + 2]) + 1
