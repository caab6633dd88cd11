"""Exact chessboard (L-infinity) distance to the outside."""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.checks import as_mask
from torchlinf._helpers.parallel import for_each
from torchlinf.kernels import usable


def chessboard_distance(mask: Tensor, *, spatial_ndim: int | None = None) -> Tensor:
    """Chessboard distance of every inside pixel to the nearest outside pixel, exactly.

    Nonzero is inside, as in SciPy and MONAI; Kornia's transform measures the distance to the nonzero pixels instead.
    Everything beyond the array is outside. On the CPU two compiled passes over the
    pixels find it; on other devices the number of torch operations grows with the logarithm of the shortest side.

    Args:
        mask: (B, C, *spatial) with 1 to 4 spatial dimensions, values 0 or 1 of any real dtype, any strides, any device.
        spatial_ndim: if given, that many last dimensions are spatial, and all others, any number, are batch.

    Returns:
        int32 tensor like `mask`, in pixels: 0 outside, 1 on the pixels that touch the outside (corners count), at most
        half the shortest side, rounded up, which a full mask attains. All 0 for an empty mask. Not differentiable.

    Raises:
        TypeError: `mask` is no tensor, or complex.
        ValueError: `mask` has a wrong rank, a spatial dimension of size 0, or values other than 0 and 1.

    Example:
        >>> import torch, torchlinf
        >>> torchlinf.chessboard_distance(torch.ones(1, 1, 3, 6))[0, 0]
        tensor([[1, 1, 1, 1, 1, 1],
                [1, 2, 2, 2, 2, 1],
                [1, 1, 1, 1, 1, 1]], dtype=torch.int32)
    """
    shapes, batch_shape = as_mask(mask, spatial_ndim)
    return distance_of(shapes).reshape(*batch_shape, *shapes.shape[1:])


def distance_of(mask: Tensor) -> Tensor:
    """Distance of a checked mask, bool (N, *spatial); int32 like it: by kernels where they can be used."""
    return compiled_distance(mask) if usable(mask) else eroded_distance(mask)


def compiled_distance(mask: Tensor) -> Tensor:
    """The distance by the compiled kernels, several shapes at a time; on the CPU."""
    from torchlinf.kernels import distance, grid

    masks = mask.numpy()
    distances = np.zeros(masks.shape, np.int32)

    def measure(i: int, _: Callable[[], None]) -> None:
        box = bounding_box(masks[i])
        geometry = grid.make_grid(grid.pad(masks[i][box]))
        distances[i][box] = distance.chessboard_of(geometry).reshape(geometry.shape)[grid.interior(masks.ndim - 1)]

    for_each(measure, len(masks))
    return torch.from_numpy(distances)


def eroded_distance(mask: Tensor) -> Tensor:
    """The same in torch operations, on any device.

    d(x) > r exactly where the block of radius r around x lies in the shape. So d - 1 is found bit by bit, from the
    highest. Let a(x) < d(x) be the bits known, a multiple of 2h. Bit h is set where every y in the block of radius h
    around x has d(y) > a(x), which is a(y) >= a(x).
    - Where a(x) = 0, that is the erosion by radius h.
    - Elsewhere it is enough to look at x and the 2^n corners of that block: {d <= a(x)} is a union of blocks of radius
      a(x) > h, and where a block meets a larger one, a corner of the smaller lies in the larger.
    Values of a within the block are multiples of 2h, so max(a(x), min(a(x), a(corners)) + h) sets the bit.
    """
    largest = (min(mask.shape[1:]) + 1) // 2
    dtype = next(dtype for dtype in (torch.uint8, torch.int16, torch.int32) if largest <= torch.iinfo(dtype).max)
    known = torch.zeros_like(mask, dtype=dtype)
    for h, eroded in reversed(_erosions(mask.contiguous().view(torch.uint8))):
        inner = known[:, *(slice(h, -h) for _ in mask.shape[1:])]
        raised = torch.minimum(inner, _corners(known, h)).add_(eroded.to(dtype), alpha=h)
        torch.maximum(inner, raised, out=inner)
    return known.add_(mask).to(torch.int32)


def _erosions(mask: Tensor) -> list[tuple[int, Tensor]]:
    """(h, erosion by the block of radius h) for h = 1, 2, 4 ..., without the border of width h, where it is empty."""
    room = (min(mask.shape[1:]) - 1) // 2
    if room < 1:
        return []
    eroded = mask
    for dim in range(1, mask.ndim):
        size = mask.shape[dim] - 2
        sides = torch.minimum(eroded.narrow(dim, 0, size), eroded.narrow(dim, 2, size))
        eroded = torch.minimum(sides, eroded.narrow(dim, 1, size))
    erosions = [(1, eroded)]
    while 2 * erosions[-1][0] <= room:
        h, eroded = erosions[-1]
        # two blocks of radius h, shifted by +-h, cover that of radius 2h along an axis
        erosions.append((2 * h, _corners(eroded, h)))
    return erosions


def _corners(x: Tensor, h: int) -> Tensor:
    """Minimum over the 2^n corners of the block of radius h, where they lie in the array."""
    for dim in range(1, x.ndim):
        size = x.shape[dim] - 2 * h
        x = torch.minimum(x.narrow(dim, 0, size), x.narrow(dim, 2 * h, size))
    return x
