"""Openings of one mask by cubes of several sides: where the cubes fit is found once for all of them."""

import itertools
import math

import numpy as np

from torchlinf.kernels.compiler import kernel
from torchlinf.kernels.grid import row_strides
from torchlinf.kernels.regions import FAR


class CubeOpenings:
    """A mask, for its openings by cubes.

    Args:
        mask: bool.
        around: how many pixels beyond the array count as marked; all others beyond it do not.

    >>> mask = np.array([[1, 1, 0, 1], [1, 1, 0, 0]], bool)
    >>> CubeOpenings(mask, 0).opened(2).astype(int).tolist(), CubeOpenings(mask, 2).opened(2).astype(int).tolist()
    ([[1, 1, 0, 0], [1, 1, 0, 0]], [[1, 1, 0, 1], [1, 1, 0, 0]])
    """

    def __init__(self, mask: np.ndarray, around: int) -> None:
        self._around, self._sizes, self._mask = around, mask.shape, mask.astype(np.bool_)
        padded = tuple(size + 2 * around + 1 for size in mask.shape)
        room = np.zeros(padded, np.int16 if max(padded) < 2**15 else np.int32)
        self._room = room[(slice(0, -1),) * mask.ndim]
        self._room[:] = 1
        self._room[tuple(slice(around, around + size) for size in mask.shape)] = mask
        # The largest cube with its lowest corner at a pixel is one larger than the least of those beside it.
        steps = np.array(list(itertools.product((0, 1), repeat=mask.ndim))[1:]) @ np.array(row_strides(padded))
        _find_room(room.reshape(-1), steps)
        self._largest = int(room.max())

    def sizes(self, sides: tuple[int, ...]) -> np.ndarray:
        """For each marked pixel the least of the ascending `sides` whose opening does not hold it, less 1; else 9999.

        >>> CubeOpenings(np.array([[1, 1, 0, 1], [1, 1, 0, 0]], bool), 0).sizes((2, 3))
        array([[   2,    2, 9999,    1],
               [   2,    2, 9999, 9999]], dtype=int16)
        """
        found = np.full(self._sizes, FAR, np.int16)
        left = self._mask.copy()
        for side in sides:
            opened = self.opened(side)
            found[left & ~opened] = side - 1
            left &= opened
        return found

    def opened(self, side: int) -> np.ndarray:
        """The union of all cubes of this side that lie in the mask; `around` is to be as large, or 0."""
        ring = min(self._around, side)
        if side > self._largest:
            return np.zeros(self._sizes, np.bool_)
        near = tuple(slice(self._around - ring, self._around + size + ring) for size in self._sizes)
        covered = (self._room[near] >= side).view(np.uint8)
        for axis in range(covered.ndim):
            sizes = covered.shape
            lines = covered.reshape(math.prod(sizes[:axis]), sizes[axis], math.prod(sizes[axis + 1 :]))
            _spread(lines, side, np.empty(lines.shape[2], np.int32))
        return covered[tuple(slice(ring, ring + size) for size in self._sizes)].view(np.bool_)


@kernel
def _find_room(room, steps):  # type: ignore[no-untyped-def]
    for x in range(room.size - 1, -1, -1):
        if room[x]:
            least = room[x + steps[0]]
            for k in range(1, steps.size):
                least = min(least, room[x + steps[k]])
            room[x] = least + 1


@kernel
def _spread(lines, side, left):  # type: ignore[no-untyped-def]
    """Mark `side` places from each marked one on, along the middle axis; `left` is scratch."""
    for a in range(lines.shape[0]):
        if lines.shape[2] == 1:
            open_places = 0
            for i in range(lines.shape[1]):
                open_places = side if lines[a, i, 0] else open_places - 1
                lines[a, i, 0] = open_places > 0
            continue
        left[:] = 0
        for i in range(lines.shape[1]):
            for b in range(lines.shape[2]):
                left[b] = side if lines[a, i, b] else left[b] - 1
                lines[a, i, b] = left[b] > 0
