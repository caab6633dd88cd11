"""Noise on the outline of a shape, as in the paper: ragged patches at random places of the boundary."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from torchlinf._helpers import checks
from torchlinf._helpers.boxes import bounding_box

ROOM = 32  # outside pixels that the canvas gains on every side when a patch would leave it
BLOCK = np.ones((3, 3), dtype=np.bool_)

Mask = NDArray[np.bool_]


class Patch(NamedTuple):
    """One addition.

    Attributes:
        place: in [0, 1), which of the boundary pixels is its centre.
        lengths: (2, width) int64, how far each line reaches beyond its pixel: lines in x, lines in y.
    """

    place: float
    lengths: NDArray[np.int64]


def add_noise(shape: Tensor, factor: int, count: int, *, seed: int = 0) -> Tensor:
    """Grow ragged patches onto the boundary of a shape, one after the other.

    Each addition draws a width from the normal distribution N(factor, factor / 3) and rounds it. It draws as many
    line lengths from the same distribution, once for lines in x and once for lines in y, and rounds them. It draws a
    pixel P of the boundary of the shape as it is by then. The lines lie side by side around P. Each line begins beside
    P and reaches its length outwards. Then a closing with a square of side `factor` fills the gaps that are narrower
    than that, and the next addition begins.

    Outwards is away from the middle of the bounding box of the shape that is passed: along each axis to the side on
    which P lies, and to both sides in the very middle. On an outline that faces the middle, as in a hole, lines lead
    into the shape; there only their places side by side make noise.

    Args:
        shape: (H, W) on any device, values 0 or 1, nonzero is inside, not empty.
        factor: noise factor in pixels, 1 or more: the mean width of a patch, and the mean length of its lines.
        count: number of additions, 1 or more.
        seed: of the random numbers, 0 or more. The same arguments give the same noise; torch's own random numbers are
            neither used nor changed.

    Returns:
        bool tensor on the CPU: the bounding box of the noisy shape, which contains the shape that was passed. A full
        mask is a shape like any other. Not differentiable.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: `factor`, `count` or `seed` is too small, or the shape is empty, not binary, or not one image.

    Source: Algorithm 1 of Arslan and Tari (2020), who apply it to squares. It says "to the outside" and no more of the
    direction; docs/paper compares what it may mean.

    Example:
        >>> noisy = add_noise(torch.ones(40, 40), factor=3, count=50, seed=0)
        >>> int(noisy.sum()) > 1600
        True
    """
    patches = random_patches(factor, count, seed)
    inside, lead = checks.as_mask(shape, 2, "shape")
    if lead or not inside.any():
        raise ValueError(
            f"shape must be one shape (H, W) with pixels inside; got {tuple(shape.shape)} with {int(inside.sum())}. "
            "Add noise to one shape at a time."
        )
    canvas = np.pad(inside[0].numpy(force=True), ROOM)
    boundary, middle = boundary_of(canvas), [(s.start + s.stop - 1) / 2 for s in bounding_box(canvas)]
    for number, (place, lengths) in enumerate(patches):
        candidates = np.flatnonzero(boundary)
        row, column = divmod(int(candidates[int(place * len(candidates))]), canvas.shape[1])
        patch = drawn(lengths, (outwards(column, middle[1]), outwards(row, middle[0])))
        # A patch changes the closing less than `factor` pixels around it, and what that takes into account is less than
        # `factor` pixels beyond; the boundary may change one pixel further.
        half, frame = len(patch) // 2, factor + 1
        reach = half + 2 * frame
        if min(row, column, len(canvas) - 1 - row, canvas.shape[1] - 1 - column) < reach:
            room = max(ROOM, reach)
            canvas, boundary, row, column = np.pad(canvas, room), np.pad(boundary, room), row + room, column + room
            middle = [place + room for place in middle]
        canvas[around(row, column, half)] |= patch
        if number == 0:  # the shape itself need not be closed
            canvas = closed(canvas, factor)
            boundary = boundary_of(canvas)
            continue
        near = around(row, column, reach)
        canvas[around(row, column, reach - frame)] = closed(canvas[near], factor)[frame:-frame, frame:-frame]
        boundary[near][1:-1, 1:-1] = boundary_of(canvas[near])[1:-1, 1:-1]
    return torch.from_numpy(canvas[bounding_box(canvas)].copy())


def random_patches(factor: int, count: int, seed: int) -> list[Patch]:
    """The random numbers of `add_noise`: all widths first, then all lengths, then all places.

    >>> [patch.lengths.shape[1] for patch in random_patches(3, 4, seed=0)]
    [5, 3, 1, 4]
    """
    factor, count = checks.count(factor, "factor"), checks.count(count, "count")
    generator = torch.Generator("cpu").manual_seed(checks.integer(seed, "seed", 0))

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


def outwards(place: int, middle: float) -> tuple[bool, bool]:
    """Whether lines reach to smaller coordinates, and to larger ones: away from the middle, and both ways in it.

    >>> outwards(3, 9.5), outwards(9, 9.0)
    ((True, False), (True, True))
    """
    return place <= middle, place >= middle


def drawn(lengths: NDArray[np.int64], sides: tuple[tuple[bool, bool], tuple[bool, bool]]) -> Mask:
    """Lines of lengths (2, width), in x and in y, side by side around the middle of a square of odd side.

    `sides` says for x and for y whether they reach to smaller coordinates and whether to larger ones.

    >>> drawn(np.array([[2], [1]]), ((False, True), (True, True))).astype(int)
    array([[0, 0, 0, 0, 0],
           [0, 0, 1, 0, 0],
           [0, 0, 1, 1, 1],
           [0, 0, 1, 0, 0],
           [0, 0, 0, 0, 0]])
    """
    width = lengths.shape[1]
    reach = max(width // 2, int(lengths.max(initial=0)))
    along = np.arange(-reach, reach + 1)
    start = reach - max(width - 1, 0) // 2
    patch = np.zeros((2, 2 * reach + 1, 2 * reach + 1), dtype=np.bool_)
    for lines, length, (below, above) in zip(patch, lengths, sides, strict=True):
        side = (along == 0) | ((along < 0) & below) | ((along > 0) & above)
        lines[start : start + width] = side & (abs(along) <= length[:, None])
    whole: Mask = patch[0] | patch[1].T
    return whole


def around(row: int, column: int, reach: int) -> tuple[slice, slice]:
    """The square window around a pixel."""
    return slice(row - reach, row + reach + 1), slice(column - reach, column + reach + 1)
