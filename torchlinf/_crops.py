"""Profiles of many shapes of different sizes, each cropped to its own box, without padding them to one."""

from collections.abc import Callable
from math import ceil

import numpy as np
import torch
from numpy.typing import NDArray

from torchlinf._kernels import has_compiler
from torchlinf._parallel import for_each
from torchlinf._profile import ComplexityProfile
from torchlinf.complexity import complexity_profile, from_levels
from torchlinf.entropy import EDGE_SLACK, check_estimator

PART = 8  # shapes that a thread takes at a time: handing over one costs a tenth of solving a small one
Crop = Callable[[int], NDArray[np.bool_]]
Measured = tuple[NDArray[np.float64], float]  # the values of the levels, and the bound of the field's error


def profile_crops(
    crop: Crop, count: int, *, estimator: str = "entropy", bins: int = 1024, tol: float = 1e-9
) -> ComplexityProfile:
    """What `complexity_profile` gives for each shape alone, as one profile of the leading shape (count,).

    A batch of tensors would be as large as the largest box times the number of shapes. Here only the boxes being
    worked on exist, one for each of torch's threads, and a shape costs its kernels and little else.

    Args:
        crop: the i-th mask, any box that holds the shape, the smallest being the quickest; called on several threads.
        count: how many there are.
        estimator: as in `complexity_profile`.
        bins: as there.
        tol: as there.

    Returns:
        The profile on the CPU, on the default scales.

    Raises:
        RuntimeError: a field could not be solved to `tol`.

    Example:
        >>> masks = [np.ones((3, 5), dtype=bool), np.eye(4, dtype=bool)]
        >>> profile = profile_crops(masks.__getitem__, 2)
        >>> profile.radius, profile.mean()
        (tensor([2, 1]), tensor([0., 0.], dtype=torch.float64))
    """
    check_estimator(estimator, bins)
    found: list[Measured] = [(np.zeros(0), 0.0)] * count

    def measure(part: int, check: Callable[[], None]) -> None:
        for i in range(part * PART, min((part + 1) * PART, count)):
            mask = crop(i)
            measured = _by_kernels(mask, estimator, bins, tol, check) if has_compiler() else None
            # What is not certified goes the common way too, which says so in its own words.
            found[i] = measured or _by_tensors(mask, estimator, bins, tol)

    for_each(measure, ceil(count / PART))
    radius = torch.tensor([len(levels) for levels, _ in found], dtype=torch.int64)
    values = torch.from_numpy(np.concatenate([np.zeros(0), *(levels for levels, _ in found)]))
    return from_levels(values, radius, torch.tensor([bound for _, bound in found], dtype=torch.float64))


def _by_tensors(mask: NDArray[np.bool_], estimator: str, bins: int, tol: float) -> Measured:
    alone = torch.from_numpy(np.ascontiguousarray(mask))
    profile = complexity_profile(alone, estimator=estimator, bins=bins, tol=tol, spatial_ndim=mask.ndim)
    return profile.level_values.double().numpy(), float(profile.error_bound)


def _by_kernels(
    mask: NDArray[np.bool_], estimator: str, bins: int, tol: float, check: Callable[[], None]
) -> Measured | None:
    """The same by the compiled kernels alone; None if that is not certified."""
    from torchlinf._compiled import ESTIMATORS
    from torchlinf._kernels import distance, grid, histograms, levels
    from torchlinf._solver.compiled import Field, Shape

    geometry = grid.make_grid(grid.pad(mask))
    if not geometry.pixels:
        return np.zeros(0), 0.0
    depth = distance.chessboard_of(geometry)  # flat, padded
    radius = int(depth.max())
    screening = 1.0 / radius**2
    field = Field(Shape(geometry, depth, screening, levels.square_profile(radius, screening)), tol, None, check)
    field.run()
    if not field.bound <= field.tol:
        return None
    # The ring of outside pixels is on no level, so field and distance can stay padded.
    values, begin = histograms.sort_by_level(field.v, depth, radius)
    return ESTIMATORS[estimator](values, begin, bins, EDGE_SLACK), float(field.bound)
