"""Complexity of shapes whose array is a window: its edge is no boundary of them, and what lies beyond is not known.

Distances count to the outside pixels of the window alone, and the block of a pixel ends at the edge. Both are what the
shape has when it is mirrored at every edge, again and again to infinity: the copies of a pixel have its value, and
neighbours beyond an edge are copies of neighbours within. A finite part of that infinite shape, cut off some way beyond
the window, is a shape like any other. The effect of the cut travels along chains of neighbours, which end at an outside
pixel or at a local maximum near by. So a cut that is far enough away does not change the field in the window; the
certificate of the field, with blocks that end at the edge, tells whether it was far enough.
"""

import math
from time import perf_counter

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.checks import positive_tensor
from torchlinf.field import RESOLUTION, certify, residual, solve_field
from torchlinf.measure import (
    ComplexityProfile,
    LevelOptions,
    Levels,
    Measure,
    complexity_profile,
    level_values,
    profile_of_levels,
)

LARGEST = 1 << 27  # pixels of the mirrored shape, a gigabyte for each array of them

Mask = NDArray[np.bool_]


def open_profile(mask: Tensor, measure: Measure) -> ComplexityProfile:
    """`complexity_profile` of shapes (N, *spatial), bool, whose array is a window, on the CPU.

    Straight bands and half-planes along the axes have 0, and so does a full mask, which has no boundary. The radius of
    a full mask would be infinite; it gets that of a box. An empty mask has radius 0 and NaN values.

    Args:
        mask: (N, *spatial) bool, on any device.
        measure: how complexity is measured; `rho` may have one value a shape. Its window is not used here.

    Returns:
        The profile on the default scales, of the batch shape (N,).

    Raises:
        RuntimeError: a field could not be certified to `tol`.
        ValueError: the mirrored shape would be larger than `LARGEST`.

    Example:
        >>> corner = torch.ones(1, 9, 12, dtype=torch.bool)
        >>> corner[:, :4, :4] = False
        >>> profile = open_profile(torch.cat([corner, ~corner]), Measure())
        >>> profile.radius, profile.mean()
        (tensor([8, 4]), tensor([1.3543, 0.0000], dtype=torch.float64))
    """
    nothing = torch.zeros(0, dtype=torch.float64, device="cpu")
    values, bounds, errors, seconds = [nothing], [nothing], [], []
    for shape, rho in zip(mask.cpu(), _rho_of_each(measure, len(mask)), strict=True):
        start = perf_counter()
        of_levels, bound, error = _levels_of(shape, rho, measure)
        values.append(of_levels)
        bounds.append(bound)
        errors.append(error)
        seconds.append(perf_counter() - start)
    levels = Levels(
        values=torch.cat(values),
        error_bound=torch.cat(bounds),
        radius=torch.tensor([len(of_levels) for of_levels in values[1:]], dtype=torch.int64, device="cpu"),
        field_error_bound=torch.tensor(errors, dtype=torch.float64, device="cpu"),
        seconds=torch.tensor(seconds, dtype=torch.float64, device="cpu"),
    )
    return profile_of_levels(levels, (len(mask),), measure)


def _rho_of_each(measure: Measure, count: int) -> list[float | None]:
    if isinstance(measure.rho, Tensor):
        return positive_tensor(measure.rho, (count,), "rho").tolist()
    return [measure.rho] * count


def _levels_of(mask: Tensor, rho: float | None, measure: Measure) -> tuple[Tensor, Tensor, float]:
    """The values of the levels of one shape, their error bounds, and the bound of the field's error."""
    if bool(mask.all()) or not bool(mask.any()):
        levels = {**measure.options(LevelOptions), "rho": rho}
        profile = complexity_profile(mask, spatial_ndim=mask.ndim, **levels)
        return profile.level_values, profile.level_error_bound, float(profile.field_error_bound)
    distance = open_distance(mask.numpy())
    radius = int(distance.max())
    value, error = open_field(mask.numpy(), radius, float(radius) if rho is None else rho, measure.tol)
    field, distances = torch.from_numpy(value)[None], torch.from_numpy(distance)[None]
    errors = field.new_tensor([error])
    values, bounds = level_values(field, distances, distances.new_tensor([radius]), errors, measure)
    return values, bounds, error


def open_distance(mask: Mask) -> NDArray[np.int32]:
    """Chessboard distance to the outside pixels of the array itself, of which there must be one.

    Example:
        >>> open_distance(np.array([[True, True, False, True]]))
        array([[2, 1, 0, 1]], dtype=int32)
    """
    from scipy.ndimage import distance_transform_cdt

    distance: NDArray[np.int32] = distance_transform_cdt(mask, metric="chessboard").astype(np.int32)
    return distance


def open_field(mask: Mask, radius: int, rho: float, tol: float) -> tuple[NDArray[np.float64], float]:
    """The field of one shape and the certified bound of its relative error.

    Example:
        >>> open_field(np.array([[True, True, False]]), 2, 2.0, 1e-9)[0].round(4)  # that of a box of radius 2
        array([[1.7931, 1.2414, 0.    ]])
    """
    reach = radius
    while True:
        sides = _sides(mask, reach)
        beyond = np.pad(mask, sides, mode="symmetric")
        solution = solve_field(torch.from_numpy(beyond), rho=rho, tol=tol / 4, spatial_ndim=mask.ndim)
        inner = tuple(slice(low, low + size) for (low, _), size in zip(sides, mask.shape, strict=True))
        value = np.ascontiguousarray(solution.value.numpy()[inner])
        bound = _certified(value, mask, rho)
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
            'Pass a smaller resolution, or boundary="background".'
        )
    return 2 * reach


def _certified(value: NDArray[np.float64], mask: Mask, rho: float) -> float:
    """Bound of the relative error of a field whose blocks end at the edge."""
    # A ring of copies adds nothing to a block at the edge that it does not hold already.
    ringed = torch.from_numpy(np.pad(value, 1, mode="edge"))[None]
    inside = torch.from_numpy(np.pad(mask, 1))[None]
    residuals = residual(ringed, inside, torch.tensor([1 / rho**2], dtype=torch.float64, device="cpu"))
    return float(certify(residuals.flatten(1)))
