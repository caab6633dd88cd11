"""One shape on its own grid: cropped to its box, padded by one outside pixel, seen as flat arrays."""

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Grid:
    """Geometry of a padded grid, and the runs (row segments) of inside pixels on it.

    Attributes:
        shape: padded sizes.
        strides: of the flat view, per axis.
        starts: flat index at which each run starts.
        ends: flat index after each run.
        block: flat offsets of the 3^n block, ascending.
        rows: flat offsets of the 3^(n-1) rows that the block touches, ascending, in threes: the kernels fuse three
            rows at a time, and in 1-D the only row is given three times.
        pixels: number of inside pixels.
    """

    shape: tuple[int, ...]
    strides: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    block: np.ndarray
    rows: np.ndarray
    pixels: int


def make_grid(padded: np.ndarray) -> Grid:
    """The grid of a padded mask."""
    strides = row_strides(padded.shape)
    rows = block_offsets(strides[:-1]) if padded.ndim > 1 else np.zeros(3, np.int64)
    inside = padded.reshape(-1)
    edges = np.flatnonzero(inside[1:] != inside[:-1]) + 1  # the ring is outside, so these are in pairs
    starts, ends = np.ascontiguousarray(edges.reshape(-1, 2).T)
    pixels = int(np.count_nonzero(inside))
    return Grid(padded.shape, np.array(strides), starts, ends, block_offsets(strides), rows, pixels)


def block_offsets(strides: list[int]) -> np.ndarray:
    """Flat offsets of the 3^n block along axes of these strides, ascending."""
    offsets = [0]  # a list: a shape in a label map is solved in the time of a few dozen calls of numpy
    for stride in strides:
        offsets = [offset + step * stride for offset in offsets for step in (-1, 0, 1)]
    return np.array(sorted(offsets))


def row_strides(shape: tuple[int, ...]) -> list[int]:
    """Strides of a contiguous array, in elements."""
    return [math.prod(shape[axis + 1 :]) for axis in range(len(shape))]


def pad(values: np.ndarray) -> np.ndarray:
    """A copy with one ring of zeros around it."""
    padded = np.zeros([size + 2 for size in values.shape], values.dtype)
    padded[interior(values.ndim)] = values
    return padded


def interior(ndim: int) -> tuple[slice, ...]:
    """The padded array without its ring."""
    return (slice(1, -1),) * ndim
