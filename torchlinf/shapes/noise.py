"""Noise on the outline of a shape, as in the paper: ragged patches at random places of the boundary."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from torchlinf import _checks
from torchlinf._boxes import bounding_box

ROOM = 32  # outside pixels that the canvas gains on every side when a patch would leave it
BLOCK = np.ones((3, 3), dtype=np.bool_)

Mask = NDArray[np.bool_]


class Patch(NamedTuple):
    """One addition.

    Attributes:
        place: in [0, 1), which of the boundary pixels is its centre.
        lengths: (2, width) int64, how far each line reaches to both sides: lines in x, lines in y.
    """

    place: float
    lengths: NDArray[np.int64]


def add_noise(shape: Tensor, factor: int, count: int, *, seed: int = 0) -> Tensor:
    """Grow ragged patches onto the boundary of a shape, one after the other.

    Each addition draws a width from the normal distribution N(factor, factor / 3) and rounds it. It draws as many
    line lengths from the same distribution, once for lines in x and once for lines in y, and rounds them. The lines
    lie side by side, centred on a random pixel of the present boundary. Each line reaches its length to both sides.
    After the last addition, a closing with a square of side `factor` fills the gaps that are narrower than that.

    Args:
        shape: (H, W) on any device, values 0 or 1, nonzero is inside, not empty.
        factor: noise factor in pixels, 1 or more: the mean width of a patch, and the mean reach of its lines.
        count: number of additions, 1 or more.
        seed: of the random numbers, 0 or more. The same arguments give the same noise; torch's own random numbers are
            neither used nor changed.

    Returns:
        bool tensor on the CPU: the bounding box of the noisy shape, which contains the shape that was passed. A full
        mask is a shape like any other. Not differentiable.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: `factor`, `count` or `seed` is too small, or the shape is empty, not binary, or not one image.

    Source: the noise of Arslan and Tari (2020) on squares. Their text does not say how a line lies to its pixel, on
    which boundary, and when the closing is done; docs/paper compares the possibilities.

    Example:
        >>> noisy = add_noise(torch.ones(40, 40), factor=3, count=50, seed=0)
        >>> int(noisy.sum()) > 1600
        True
    """
    patches = random_patches(factor, count, seed)
    inside, lead = _checks.as_mask(shape, 2, "shape")
    if lead or not inside.any():
        raise ValueError(
            f"shape must be one shape (H, W) with pixels inside; got {tuple(shape.shape)} with {int(inside.sum())}. "
            "Add noise to one shape at a time."
        )
    canvas = np.pad(inside[0].numpy(force=True), ROOM)
    boundary = boundary_of(canvas)
    for place, lengths in patches:
        patch = _drawn(lengths)
        candidates = np.flatnonzero(boundary)
        row, column = divmod(int(candidates[int(place * len(candidates))]), canvas.shape[1])
        # The boundary may change one pixel around the patch, and it takes the pixels beyond to see that.
        reach = len(patch) // 2 + 2
        if min(row, column, len(canvas) - 1 - row, canvas.shape[1] - 1 - column) < reach:
            room = max(ROOM, reach)
            canvas, boundary, row, column = np.pad(canvas, room), np.pad(boundary, room), row + room, column + room
        near = slice(row - reach, row + reach + 1), slice(column - reach, column + reach + 1)
        canvas[near][2:-2, 2:-2] |= patch
        boundary[near][1:-1, 1:-1] = boundary_of(canvas[near])[1:-1, 1:-1]
    return torch.from_numpy(closed(canvas[bounding_box(canvas)], factor))


def random_patches(factor: int, count: int, seed: int) -> list[Patch]:
    """The random numbers of `add_noise`: all widths first, then all lengths, then all places.

    >>> [patch.lengths.shape[1] for patch in random_patches(3, 4, seed=0)]
    [5, 3, 1, 4]
    """
    factor, count = _checks.count(factor, "factor"), _checks.count(count, "count")
    generator = torch.Generator("cpu").manual_seed(_checks.integer(seed, "seed", 0))

    def normal(size: int) -> NDArray[np.int64]:
        drawn = torch.randn(size, generator=generator, dtype=torch.float64, device="cpu")
        return (factor + factor / 3 * drawn).round().long().numpy()

    widths = normal(count).clip(min=0)
    lengths = np.split(normal(2 * int(widths.sum())), 2 * widths.cumsum()[:-1])
    places = torch.rand(count, generator=generator, dtype=torch.float64, device="cpu").tolist()
    return [Patch(place, each.reshape(2, -1)) for place, each in zip(places, lengths, strict=True)]


def boundary_of(mask: Mask) -> Mask:
    """Inside pixels whose 3 x 3 block is not all inside; beyond the array is outside.

    >>> boundary_of(np.ones((3, 4), dtype=bool)).astype(int)
    array([[1, 1, 1, 1],
           [1, 0, 0, 1],
           [1, 1, 1, 1]])
    """
    boundary: Mask = mask & ~ndimage.binary_erosion(mask, BLOCK)
    return boundary


def closed(mask: Mask, side: int) -> Mask:
    """Closing by a square of that side; beyond the array is outside.

    >>> closed(np.array([[True, False, True, False, False, True]]), 2).astype(int)
    array([[1, 1, 1, 0, 0, 1]])
    """
    # On bytes the filter of grey values takes a third of the time of the binary one, whatever the side.
    padded = np.pad(mask, side).view(np.uint8)
    whole: Mask = ndimage.grey_closing(padded, (side, side)).view(np.bool_)
    return whole[side:-side, side:-side]


def _drawn(lengths: NDArray[np.int64]) -> Mask:
    """Lines of lengths (2, width), in x and in y, side by side around the middle of a square of odd side."""
    width = lengths.shape[1]
    reach = max(width // 2, int(lengths.max(initial=0)))
    away = np.abs(np.arange(-reach, reach + 1))
    start = reach - max(width - 1, 0) // 2
    patch = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.bool_)
    patch[start : start + width] |= away <= lengths[0, :, None]
    patch[:, start : start + width] |= away[:, None] <= lengths[1]
    return patch
