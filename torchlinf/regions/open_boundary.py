"""Complexity of shapes whose array is a window: its edge is no boundary of them, and what lies beyond is not known.

Distances count to the outside pixels of the window alone, and the block of a pixel ends at the edge. Both are what the
shape has when it is mirrored at every edge, again and again to infinity: the copies of a pixel have its value, and
neighbours beyond an edge are copies of neighbours within. A part of that infinite shape is a shape like any other, cut
off some way beyond the window. News of the cut travels along chains of neighbours, which end at an outside pixel or at
a summit near by. So from some distance on the cut is not felt in the window at all; the certificate of the field, with
blocks that end at the edge, tells whether that is so.
"""

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf.field import RESOLUTION, certify, residual, solve_field
from torchlinf.measure import ComplexityProfile, Levels, Measure, complexity_profile, level_values, profile_of_levels

LARGEST = 1 << 27  # pixels of the mirrored shape, a gigabyte for each array of them

Mask = NDArray[np.bool_]


def open_profile(mask: Tensor, *, bins: int = 1024, estimator: str = "entropy", tol: float = 1e-9) -> ComplexityProfile:
    """`complexity_profile` of shapes (N, *spatial), bool, whose array is a window, on the CPU.

    Shapes that are straight bands or half-planes along the axes have 0, and so does a full mask, which has no boundary.
    Its radius would be infinite; it is given that of a box.

    Raises:
        RuntimeError: a field could not be certified to `tol`.
        ValueError: the mirrored shape would be larger than `LARGEST`.

    Example:
        >>> corner = torch.ones(1, 9, 12, dtype=torch.bool)
        >>> corner[:, :4, :4] = False
        >>> profile = open_profile(torch.cat([corner, ~corner]))
        >>> profile.radius, profile.mean()
        (tensor([8, 4]), tensor([1.3543, 0.0000], dtype=torch.float64))
    """
    found = [_measure(shape, bins, estimator, tol) for shape in mask.cpu()]
    radius = torch.tensor([len(values) for values, _ in found], dtype=torch.int64)
    values = torch.cat([torch.zeros(0, dtype=torch.float64), *(values for values, _ in found)])
    bounds = torch.tensor([bound for _, bound in found], dtype=torch.float64)
    measure = Measure(bins=bins, estimator=estimator, tol=tol)
    return profile_of_levels(Levels(values, radius, bounds, torch.zeros(len(radius))), (len(radius),), measure)


def _measure(mask: Tensor, bins: int, estimator: str, tol: float) -> tuple[Tensor, float]:
    """The values of the levels of one shape, and the bound of its field's error."""
    if bool(mask.all()) or not bool(mask.any()):
        profile = complexity_profile(mask, bins=bins, estimator=estimator, tol=tol, spatial_ndim=mask.ndim)
        return profile.level_values, float(profile.field_error_bound)
    distance = open_distance(mask.numpy())
    radius = int(distance.max())
    value, bound = open_field(mask.numpy(), radius, tol)
    found = level_values(
        torch.from_numpy(value)[None],
        torch.from_numpy(distance)[None],
        torch.tensor([radius]),
        bins=bins,
        estimator=estimator,
    )
    return found, bound


def open_distance(mask: Mask) -> NDArray[np.int32]:
    """Chessboard distance to the outside pixels of the array itself, of which there must be one.

    Example:
        >>> open_distance(np.array([[True, True, False, True]]))
        array([[2, 1, 0, 1]], dtype=int32)
    """
    from scipy.ndimage import distance_transform_cdt

    found: NDArray[np.int32] = distance_transform_cdt(mask, metric="chessboard").astype(np.int32)
    return found


def open_field(mask: Mask, radius: int, tol: float) -> tuple[NDArray[np.float64], float]:
    """The field of one shape and the certified bound of its relative error.

    Example:
        >>> open_field(np.array([[True, True, False]]), 2, 1e-9)[0].round(4)  # that of a box of radius 2
        array([[1.7931, 1.2414, 0.    ]])
    """
    reach = radius
    while True:
        sides = _sides(mask, reach)
        beyond = np.pad(mask, sides, mode="symmetric")
        solution = solve_field(torch.from_numpy(beyond), rho=float(radius), tol=tol / 4, spatial_ndim=mask.ndim)
        inner = tuple(slice(low, low + size) for (low, _), size in zip(sides, mask.shape, strict=True))
        value = np.ascontiguousarray(solution.value.numpy()[inner])
        bound = _certified(value, mask, radius)
        if bound <= max(tol, RESOLUTION * np.finfo(np.float64).eps * value.max()):
            return value, bound
        reach = _farther(mask, reach)


def _sides(mask: Mask, reach: int) -> list[tuple[int, int]]:
    """Pixels to mirror at the two ends of each axis: none where the shape does not touch the edge."""
    touched = [(mask.take(0, axis).any(), mask.take(-1, axis).any()) for axis in range(mask.ndim)]
    return [(reach * int(first), reach * int(last)) for first, last in touched]


def _farther(mask: Mask, reach: int) -> int:
    """Twice as far, if that can be held in memory."""
    pixels = math.prod(size + sum(ends) for size, ends in zip(mask.shape, _sides(mask, 2 * reach), strict=True))
    if pixels > LARGEST:
        raise ValueError(
            f"the grid must be small enough to be mirrored; got {mask.shape}, which would become {pixels:,} points. "
            'Pass a smaller resolution, or frame="background".'
        )
    return 2 * reach


def _certified(value: NDArray[np.float64], mask: Mask, radius: int) -> float:
    """Bound of the relative error of a field whose blocks end at the edge."""
    # A ring of copies adds nothing to a block at the edge that it does not hold already.
    ringed = torch.from_numpy(np.pad(value, 1, mode="edge"))[None]
    inside = torch.from_numpy(np.pad(mask, 1))[None]
    residuals = residual(ringed, inside, torch.tensor([1 / radius**2], dtype=torch.float64))
    return float(certify(residuals.flatten(1)))
