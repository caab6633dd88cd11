"""Noise on the outline of a shape, as the paper adds it: ragged patches at random places of the boundary."""

from functools import reduce

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf import _checks

# Outside pixels that the canvas gains on every side when a patch would leave it.
ROOM = 32

Mask = NDArray[np.bool_]


def add_noise(shape: Tensor, factor: int, count: int, generator: torch.Generator | None = None) -> Tensor:
    """Grow ragged patches onto the boundary of a shape, one after the other.

    One addition draws a width from the normal distribution N(factor, factor / 3), and as many line lengths from the
    same distribution as the rounded width, for lines in x and again for lines in y. The lines lie side by side around
    a random pixel of the boundary as it is by then, and each reaches by its rounded length to both sides. In the end a
    closing with a square of side `factor` fills what is narrower than that.

    Args:
        shape: (H, W), values 0 or 1, nonzero is inside, not empty.
        factor: noise factor in pixels, 1 or more: the mean width of a patch, and the mean reach of its lines.
        count: number of additions, 1 or more.
        generator: where the random numbers come from, on the CPU; None means torch's own. The same state gives the
            same noise.

    Returns:
        bool tensor on the CPU, the bounding box of what has become of the shape, which it contains.

    Raises:
        TypeError, ValueError: an argument is of the wrong type or too small, or the shape is empty or not binary.

    Source: the noise of Arslan and Tari (2020) on squares. Their text leaves open how a line lies to its pixel, on
    which boundary, and when the closing is done.

    Example:
        >>> noisy = add_noise(torch.ones(40, 40), factor=3, count=50, generator=torch.Generator().manual_seed(0))
        >>> int(noisy.sum()) > 1600
        True
    """
    factor, count = _checks.count(factor, "factor"), _checks.count(count, "count")
    inside, lead = _checks.as_mask(shape, 2, "shape")
    if lead or not inside.any():
        raise ValueError(
            f"shape must be one shape (H, W) with pixels inside; got {tuple(shape.shape)} with {int(inside.sum())}. "
            "Add noise to one shape at a time."
        )
    widths = _normal(factor, count, generator).clip(min=0)
    lengths = np.split(_normal(factor, 2 * widths.sum(), generator), 2 * widths.cumsum()[:-1])
    places = torch.rand(count, generator=generator, dtype=torch.float64).tolist()
    canvas = np.pad(inside[0].numpy(force=True), ROOM)
    boundary = canvas & ~_eroded(canvas)
    for place, of_patch in zip(places, lengths, strict=True):
        patch = _patch(of_patch.reshape(2, -1))
        candidates = np.flatnonzero(boundary)
        row, column = divmod(int(candidates[int(place * len(candidates))]), canvas.shape[1])
        # One pixel around the patch may leave the boundary, and it takes one more to tell.
        reach = len(patch) // 2 + 2
        if min(row, column, len(canvas) - 1 - row, canvas.shape[1] - 1 - column) < reach:
            room = max(ROOM, reach)
            canvas, boundary, row, column = np.pad(canvas, room), np.pad(boundary, room), row + room, column + room
        near = slice(row - reach, row + reach + 1), slice(column - reach, column + reach + 1)
        canvas[near][2:-2, 2:-2] |= patch
        boundary[near][1:-1, 1:-1] = (canvas[near] & ~_eroded(canvas[near]))[1:-1, 1:-1]
    return _boxed(torch.from_numpy(_closed(canvas, factor)))


def _normal(factor: int, size: int, generator: torch.Generator | None) -> NDArray[np.int64]:
    drawn = torch.randn(int(size), generator=generator, dtype=torch.float64)
    return (factor + factor / 3 * drawn).round().long().numpy()


def _patch(lengths: NDArray[np.int64]) -> Mask:
    """Lines of lengths (2, width), in x and in y, side by side around the middle of a square of odd side."""
    width = lengths.shape[1]
    reach = max(width // 2, int(lengths.max(initial=0)))
    away = np.abs(np.arange(-reach, reach + 1))
    start = reach - max(width - 1, 0) // 2
    patch = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.bool_)
    patch[start : start + width] |= away <= lengths[0, :, None]
    patch[:, start : start + width] |= away[:, None] <= lengths[1]
    return patch


def _eroded(mask: Mask) -> Mask:
    """Pixels whose 3 x 3 block is inside; none at the border of the array."""
    eroded = np.zeros_like(mask)
    rows = mask[:-2] & mask[1:-1] & mask[2:]
    eroded[1:-1, 1:-1] = rows[:, :-2] & rows[:, 1:-1] & rows[:, 2:]
    return eroded


def _closed(mask: Mask, side: int) -> Mask:
    """Closing by a square: dilation, then erosion by its mirror image, which for an even side is another square."""
    return ~_dilated(~_dilated(np.pad(mask, side - 1), side), side)


def _dilated(mask: Mask, side: int) -> Mask:
    """Whether any pixel of each square within the array is inside, by rows and then by columns."""
    height, width = mask.shape[0] - side + 1, mask.shape[1] - side + 1
    rows = reduce(np.logical_or, (mask[i : i + height] for i in range(side)))
    return reduce(np.logical_or, (rows[:, i : i + width] for i in range(side)))


def _boxed(mask: Tensor) -> Tensor:
    rows, columns = mask.any(dim=1).nonzero(), mask.any(dim=0).nonzero()
    return mask[int(rows[0]) : int(rows[-1]) + 1, int(columns[0]) : int(columns[-1]) + 1]
