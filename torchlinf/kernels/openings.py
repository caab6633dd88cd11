"""How far each marked pixel of a mask can be reached: by squares of several sides, and by bars along the axes."""

import math

import numpy as np

from torchlinf.kernels.compiler import kernel
from torchlinf.kernels.regions import FAR


def square_sizes(marked: np.ndarray, around: int, sides: tuple[int, ...]) -> np.ndarray:
    """For each marked pixel one less than the least side of which no square in what is marked holds it; else `FAR`.

    Args:
        marked: bool, 2-D.
        around: how many pixels beyond the array count as marked, all others beyond it do not; 0, or as many as the
            largest side.
        sides: ascending, below 256.

    >>> square_sizes(np.array([[1, 1, 0, 1], [1, 1, 0, 0]], bool), 0, (2, 3))
    array([[   2,    2, 9999,    1],
           [   2,    2, 9999, 9999]], dtype=int16)
    """
    padded = [size + 2 * around for size in marked.shape]
    room = np.ones([size + 1 for size in padded], np.int16 if max(padded) < 2**15 else np.int32)
    room[-1] = room[:, -1] = 0
    room[tuple(slice(around, around + size) for size in marked.shape)] = marked
    found = np.where(marked, np.int16(FAR - 1), np.int16(FAR))
    _find_room(room)
    largest = int(room.max())
    sides = sides[: sum(side <= largest for side in sides) + 1]  # all that is left is of the next one
    _find_sizes(room, around, np.array(sides), np.empty((2, padded[1]), np.uint8), np.empty(padded[1], np.uint8), found)
    return found


def run_lengths(marked: np.ndarray, axis: int, endless: bool) -> np.ndarray:
    """The length of the run of marked pixels along an axis that each is in, at most `FAR`; `FAR` for all others.

    So it is, if the array is `endless`, for a run that reaches its end.

    >>> run_lengths(np.array([[True, True, False, True]]), 1, False)
    array([[   2,    2, 9999,    1]], dtype=int16)
    """
    found = np.empty(marked.shape, np.int16)
    lines = math.prod(marked.shape[:axis]), marked.shape[axis], math.prod(marked.shape[axis + 1 :])
    _find_runs(marked.reshape(lines), endless, found.reshape(lines))
    return found


@kernel
def _find_room(room):  # type: ignore[no-untyped-def]
    """The largest square with its lowest corner at a pixel is one larger than the least of those beside it."""
    for i in range(room.shape[0] - 2, -1, -1):
        for j in range(room.shape[1] - 2, -1, -1):
            if room[i, j]:
                room[i, j] = min(room[i + 1, j], room[i, j + 1], room[i + 1, j + 1]) + 1


@kernel
def _find_sizes(room, around, sides, lines, left, found):  # type: ignore[no-untyped-def]
    """Set what `square_sizes` returns where `found` is FAR - 1; `room` is from `_find_room`, the rest is scratch."""
    height, width = found.shape
    for side in sides:
        ring = min(around, side)
        first = around - ring
        left[:] = 0
        for i in range(ring + height):
            line = _spread(room[first + i, first : first + width + 2 * ring], side, lines)
            for j in range(line.size):
                left[j] = side if line[j] else max(left[j], 1) - 1
            if i >= ring:
                row, rest = found[i - ring], left[ring : ring + width]
                for j in range(width):
                    row[j] = side - 1 if (row[j] == FAR - 1) & (rest[j] == 0) else row[j]
    for i in range(height):
        for j in range(width):
            if found[i, j] == FAR - 1:
                found[i, j] = FAR


@kernel
def _spread(room, side, lines):  # type: ignore[no-untyped-def]
    """Mark `side` places from each on that has room for it."""
    line, other = lines[0, : room.size], lines[1, : room.size]
    for j in range(room.size):
        line[j] = room[j] >= side
    width = 1
    while width < side:
        step = min(width, side - width)
        other[:step] = line[:step]
        near, far, behind = line[step:], line[: line.size - step], other[step:]
        for j in range(near.size):
            behind[j] = near[j] | far[j]
        line, other = other, line
        width += step
    return line


@kernel
def _find_runs(lines, endless, found):  # type: ignore[no-untyped-def]
    """The runs along the middle axis."""
    for a in range(lines.shape[0]):
        for b in range(lines.shape[2]):
            first = 0
            for i in range(lines.shape[1] + 1):
                if i < lines.shape[1] and lines[a, i, b]:
                    continue
                at_end = endless and (first == 0 or i == lines.shape[1])
                length = FAR if at_end else min(i - first, FAR)
                for k in range(first, i):
                    found[a, k, b] = length
                if i < lines.shape[1]:
                    found[a, i, b] = FAR
                first = i + 1
