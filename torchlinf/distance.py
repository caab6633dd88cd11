"""Exact chessboard (L-infinity) distance to the outside."""

import torch
from torch import Tensor

from torchlinf._checks import as_mask


def chessboard_distance(mask: Tensor, *, spatial_ndim: int | None = None) -> Tensor:
    """Chessboard distance of every inside pixel to the nearest outside pixel.

    Nonzero is inside, as in SciPy and MONAI (Kornia's transform measures the opposite), and everything beyond the
    array is outside. The result is exact. Work grows with the logarithm of the largest possible distance, see
    docs/method.

    Args:
        mask: ``(B, C, *spatial)`` with 1 to 4 spatial dimensions, values 0 or 1 of any real dtype, any device.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.

    Returns:
        int32 tensor like ``mask``, in pixels: 0 outside, 1 on pixels that touch the outside, at most half the
        shortest side, rounded up. All zeros for an empty mask. Not differentiable.

    Raises:
        TypeError: ``mask`` is no real tensor.
        ValueError: ``mask`` has a wrong rank, a spatial dimension of size 0, or values other than 0 and 1.

    >>> chessboard_distance(torch.ones(1, 1, 3, 6)).tolist()
    [[[[1, 1, 1, 1, 1, 1], [1, 2, 2, 2, 2, 1], [1, 1, 1, 1, 1, 1]]]]
    """
    shapes, lead = as_mask(mask, spatial_ndim)
    return distance_of(shapes).reshape(*lead, *shapes.shape[1:])


def distance_of(mask: Tensor) -> Tensor:
    """Distance of a checked bool mask ``(N, *spatial)``: int32 like it.

    d(x) > r exactly where the erosion of the shape by the block of radius r holds x. So d - 1 is found bit by bit from
    the highest: with a the bits found so far (a multiple of 2h), bit h is set where every y in the block of radius h
    around x has d(y) > a(x).
    Where a(x) = 0 that is the erosion by radius h. Elsewhere {d <= a(x)} is a union of blocks of radius a(x) > h, and
    a smaller block that meets a larger one has a corner in it: the corners, two shifts an axis, tell.
    """
    erosions = _erosions(mask.view(torch.uint8))
    # the largest a is below half the shortest side
    found = torch.zeros_like(mask, dtype=torch.uint8 if min(mask.shape[1:]) < 512 else torch.int32)
    for h, eroded in reversed(erosions):
        inner = tuple(slice(h, -h) for _ in mask.shape[1:])
        bits = found[:, *inner]
        bits += ((_corners(found, h) >= bits) & eroded.bool()) * h
    return found.to(torch.int32) + mask


def _erosions(mask: Tensor) -> list[tuple[int, Tensor]]:
    """(radius, erosion by that block) for the radii 1, 2, 4 ..., each without its border of that width, all zeros."""
    room = (min(mask.shape[1:]) - 1) // 2
    erosions: list[tuple[int, Tensor]] = []
    if room >= 1:
        eroded = mask
        for dim in range(1, mask.ndim):
            size = mask.shape[dim] - 2
            sides = torch.minimum(eroded.narrow(dim, 0, size), eroded.narrow(dim, 2, size))
            eroded = torch.minimum(sides, eroded.narrow(dim, 1, size))
        erosions.append((1, eroded))
    while erosions and 2 * erosions[-1][0] <= room:
        radius, eroded = erosions[-1]
        erosions.append((2 * radius, _corners(eroded, radius)))
    return erosions


def _corners(x: Tensor, h: int) -> Tensor:
    """Minimum over the corners of the block of radius h, where all of them lie in the array."""
    for dim in range(1, x.ndim):
        size = x.shape[dim] - 2 * h
        x = torch.minimum(x.narrow(dim, 0, size), x.narrow(dim, 2 * h, size))
    return x
