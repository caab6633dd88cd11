"""Where the field still changes: the residual of every tile of the grid, and the runs in the tiles that need sweeps.

After a linear solve the residual is zero to rounding but for a few places whose policies were wrong. To sweep those
alone costs what they are worth. How far the last of some sweeps has moved a tile says, well enough to choose where to
sweep next, what is left there; only the certificate needs the residual itself, of the whole shape.
"""

import math
from collections.abc import Callable

import numpy as np

from torchlinf.kernels import stencil
from torchlinf.kernels.compiler import inlined, kernel
from torchlinf.kernels.grid import Grid, block_offsets, row_strides

COLUMNS = 32  # a tile's side along the rows: long enough for vector instructions
ROWS = 8  # and along the other axes
PART = 2**22  # pixels whose sweeps take long enough to look for Ctrl-C between them


class ActiveSet:
    """The residual by tile, and the present selection of runs, which begins as the whole shape.

    Attributes:
        starts: flat index at which each selected piece of a run starts.
        ends: flat index after each.
        share: of the shape's pixels that are selected.
    """

    def __init__(self, grid: Grid) -> None:
        """Lay tiles over a grid, with a ring of tiles around them as the grid has one of pixels."""
        self._grid = grid
        sides = np.array([ROWS] * (len(grid.shape) - 1) + [COLUMNS])
        counts = [-(-size // side) + 2 for size, side in zip(grid.shape, sides.tolist(), strict=True)]
        strides = row_strides(tuple(counts))
        self._block = block_offsets(strides)
        self._residual = np.zeros((2, math.prod(counts)))
        self._chosen = np.zeros(math.prod(counts), np.bool_)
        self._whole = np.empty((4, grid.starts.size), np.int64)
        capacity = _place_runs(grid.starts, grid.ends, grid.strides, sides, np.array(strides), self._whole)
        self._pieces = np.empty((4, capacity), np.int64)
        self._select(self._whole, 1.0)

    def select(self, threshold: float) -> None:
        """Select the tiles with a residual above the threshold, and those beside them."""
        _choose(self._residual, threshold, self._block, self._chosen)
        count, pixels = _collect(self._chosen, self._whole, self._pieces)
        self._select(self._pieces[:, :count], pixels / self._grid.pixels)

    def sweep(self, v: np.ndarray, weight: float, count: int, buffer: np.ndarray, check: Callable[[], None]) -> float:
        """Sweep the selection `count` times; returns the largest residual of all tiles, here taken from the last sweep.

        `check` is called between sweeps of large selections, so that it can end them by an exception.
        v <- v + w R(v): so the last move of each pixel, divided by w, stands for the residual.
        """
        pairs = 1 if self.share * self._grid.pixels > PART else count  # of sweeps, down and up, at a time
        for first in range(0, count - 1, 2 * pairs):
            check()
            sweeps = min(2 * pairs, count - 1 - first)
            stencil.sweep(v, self.starts, self.ends, self._grid.rows, weight, None, sweeps, buffer)
        _sweep_and_measure(v, *self._runs, self._grid.rows, weight, buffer, self._residual)
        return float(self._residual.max())

    def update_bound(self, v: np.ndarray, screening: float, buffer: np.ndarray) -> tuple[float, float]:
        """Measure the residual of v in the whole shape; returns its largest positive and negative part."""
        _measure(v, *self._whole, self._grid.rows, screening, buffer, self._residual)
        return float(self._residual[0].max()), float(self._residual[1].max())

    def _select(self, runs: np.ndarray, share: float) -> None:
        self._runs = tuple(runs)
        self.starts, self.ends = self._runs[:2]
        self.share = share


@kernel
def _place_runs(starts, ends, strides, sides, tile_strides, whole):  # type: ignore[no-untyped-def]
    """Rows of `whole`: starts, ends, tile of the first pixel, its column in that tile; returns the number of pieces."""
    pieces = 0
    for run in range(starts.size):
        x = starts[run]
        tile = 0
        column = 0
        for axis in range(strides.size):
            c = x // strides[axis]
            x -= c * strides[axis]
            tile += (c // sides[axis] + 1) * tile_strides[axis]
            column = c % sides[axis]
        whole[0, run] = starts[run]
        whole[1, run] = ends[run]
        whole[2, run] = tile
        whole[3, run] = column
        pieces += (column + ends[run] - starts[run] - 1) // COLUMNS + 1
    return pieces


@kernel
def _choose(residual, threshold, block, chosen):  # type: ignore[no-untyped-def]
    """Mark the tiles whose residual is above the threshold, and their neighbours."""
    for tile in range(chosen.size):
        chosen[tile] = False
    for tile in range(chosen.size):
        if max(residual[0, tile], residual[1, tile]) > threshold:
            for offset in block:
                chosen[tile + offset] = True


@kernel
def _collect(chosen, whole, pieces):  # type: ignore[no-untyped-def]
    """Cut the runs to the marked tiles; returns how many pieces and pixels are left."""
    count = 0
    pixels = 0
    for run in range(whole.shape[1]):
        x = whole[0, run]
        end = whole[1, run]
        tile = whole[2, run]
        column = whole[3, run]
        joined = False
        while x < end:
            stop = min(end, x + COLUMNS - column)
            if chosen[tile]:
                if not joined:
                    pieces[0, count] = x
                    pieces[2, count] = tile
                    pieces[3, count] = column
                    count += 1
                pieces[1, count - 1] = stop
                pixels += stop - x
            joined = chosen[tile]
            x = stop
            column = 0
            tile += 1
    return count, pixels


@kernel
def _measure(v, starts, ends, tiles, columns, rows, screening, buffer, residual):  # type: ignore[no-untyped-def]
    """Set the largest positive and negative part of R(v) of all tiles that the runs touch."""
    _clear(starts, ends, tiles, columns, residual)
    for run in range(starts.size):
        stencil.row_residuals(v, starts[run], ends[run] - starts[run], rows, screening, None, buffer)
        _raise(buffer[2], ends[run] - starts[run], tiles[run], columns[run], residual)


@kernel
def _sweep_and_measure(v, starts, ends, tiles, columns, rows, weight, buffer, residual):  # type: ignore[no-untyped-def]
    """Sweep the runs once, and set what it moves v by, divided by the weight, as the residual of their tiles."""
    _clear(starts, ends, tiles, columns, residual)
    moved = buffer[2]
    for run in range(starts.size):
        length = ends[run] - starts[run]
        values = v[starts[run] : ends[run]]
        stencil.row_update(v, starts[run], length, rows, weight, buffer)
        for j in range(length):
            value = moved[j]
            moved[j] = (value - values[j]) / weight
            values[j] = value
        _raise(moved, length, tiles[run], columns[run], residual)


@inlined
def _clear(starts, ends, tiles, columns, residual):  # type: ignore[no-untyped-def]
    """Set the residual of all tiles that the runs touch to 0."""
    for run in range(starts.size):
        last = tiles[run] + (columns[run] + ends[run] - starts[run] - 1) // COLUMNS
        for tile in range(tiles[run], last + 1):
            residual[0, tile] = residual[1, tile] = 0.0


@inlined
def _raise(values, length, tile, column, residual):  # type: ignore[no-untyped-def]
    """Raise the residual of the tiles along a run, which begins in that column of the first, to these values."""
    first = 0
    stop = min(length, COLUMNS - column)
    while first < length:
        a = b = c = d = residual[0, tile]  # four at a time, which do not wait for each other
        p = q = r = s = -residual[1, tile]
        whole = first + (stop - first) // 4 * 4
        for j in range(first, whole, 4):
            a, b, c, d = max(a, values[j]), max(b, values[j + 1]), max(c, values[j + 2]), max(d, values[j + 3])
            p, q, r, s = min(p, values[j]), min(q, values[j + 1]), min(r, values[j + 2]), min(s, values[j + 3])
        for j in range(whole, stop):
            a, p = max(a, values[j]), min(p, values[j])
        residual[0, tile] = max(max(a, b), max(c, d))
        residual[1, tile] = -min(min(p, q), min(r, s))
        tile += 1
        first = stop
        stop = min(length, stop + COLUMNS)
