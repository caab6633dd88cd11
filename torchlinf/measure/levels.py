"""The levels of shapes: the sets of pixels at one distance, and how much the field varies on each.

`levels_of` goes from masks to the values of their levels. On the CPU each shape is cropped to its box, solved, and
sorted by level in compiled kernels, several shapes at a time, and nothing of it is kept but the values. On other
devices the batch is solved in torch operations. Levels of all shapes stand in one flat list: first all levels of shape
0, then those of shape 1.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from time import perf_counter

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._boxes import bounding_box
from torchlinf._checks import positive_tensor
from torchlinf._parallel import for_each
from torchlinf.field import Status, pose, raise_failures, solve, solve_shape, uses_kernels
from torchlinf.kernels import has_compiler
from torchlinf.measure.entropy import EDGE_SLACK, ESTIMATORS
from torchlinf.measure.options import Measure

CHUNK = 8  # shapes that a thread takes at a time: handing over one costs a tenth of solving a small one

MaskAt = Callable[[int], NDArray[np.bool_]]


@dataclass(frozen=True, eq=False)
class Levels:
    """The values of the levels of N shapes.

    Attributes:
        values: (sum of radius,) floating point, all levels of all shapes one after the other.
        radius: (N,) int64, the number of levels of each shape; 0 for an empty one.
        field_error_bound: (N,) certified relative error of each field.
        seconds: (N,) float64, the time that each shape took; a batch in torch operations shares its time evenly.
    """

    values: Tensor
    radius: Tensor
    field_error_bound: Tensor
    seconds: Tensor


def levels_of(masks: Tensor, lead: tuple[int, ...], measure: Measure, method: str = "auto") -> Levels:
    """The levels of checked masks, bool (N, *spatial), of the leading shape `lead`; on the device of the masks.

    Raises:
        RuntimeError: a field could not be certified.
    """
    if uses_kernels(masks, method):
        arrays = masks.numpy()
        return levels_of_each(lambda i: arrays[i], len(arrays), lead, measure)
    start = perf_counter()
    problem = pose(masks, measure.rho, lead)
    solved = solve(problem, lead, tol=measure.tol, method=method)
    radius = problem.radius.long()
    values = level_values(solved.value, problem.distance, radius, estimator=measure.estimator, bins=measure.bins)
    seconds = torch.full((len(masks),), (perf_counter() - start) / max(len(masks), 1), dtype=torch.float64)
    return Levels(values, radius, solved.error_bound, seconds)


def levels_of_each(mask_at: MaskAt, count: int, lead: tuple[int, ...], measure: Measure) -> Levels:
    """The levels of `count` shapes that need not be of one size, on the CPU.

    Only the masks being worked on exist, one for each of torch's threads, and a shape costs its kernels and little
    else. Without numba the shapes are solved one by one in torch operations.

    Args:
        mask_at: the i-th mask, bool, any box that holds the shape; called on several threads.
        count: how many there are, the product of `lead`.
        lead: leading shape, for messages and for a `rho` with one value a shape.
        measure: how complexity is measured.

    Raises:
        RuntimeError: a field could not be certified.
    """
    rhos = _rho_of_each(measure, lead)
    values: list[NDArray[np.float64]] = [np.zeros(0)] * count
    bound, seconds, sweeps = np.zeros(count), np.zeros(count), np.zeros(count, np.int64)
    status = np.full(count, int(Status.EMPTY), np.int64)

    def solve_one(i: int, check: Callable[[], None]) -> None:
        mask = mask_at(i)
        box = bounding_box(mask)
        if not mask[box].size:
            return
        if has_compiler():
            values[i], bound[i], sweeps[i], status[i] = _by_kernels(mask[box], rhos(i), measure, check)
        else:
            alone = torch.from_numpy(np.ascontiguousarray(mask[box]))[None]
            found = levels_of(alone, (), Measure(**{**measure.options(), "rho": rhos(i)}), "accelerated")
            values[i], bound[i] = found.values.numpy(), float(found.field_error_bound)
            status[i] = int(Status.CONVERGED)

    chunk = min(CHUNK, ceil(count / (4 * torch.get_num_threads())) or 1)

    def solve_chunk(number: int, check: Callable[[], None]) -> None:
        for i in range(number * chunk, min((number + 1) * chunk, count)):
            start = perf_counter()
            solve_one(i, check)
            seconds[i] = perf_counter() - start

    for_each(solve_chunk, ceil(count / chunk))
    field_error_bound = torch.from_numpy(bound)
    raise_failures(torch.from_numpy(status), field_error_bound, torch.from_numpy(sweeps), measure.tol, lead)
    radius = torch.tensor([len(found) for found in values], dtype=torch.int64)
    found = torch.from_numpy(np.concatenate([np.zeros(0), *values]))
    return Levels(found, radius, field_error_bound, torch.from_numpy(seconds))


def _rho_of_each(measure: Measure, lead: tuple[int, ...]) -> Callable[[int], float | None]:
    rho = measure.rho
    if not isinstance(rho, Tensor):
        return lambda _: rho
    given = positive_tensor(rho, lead, "rho").reshape(-1).tolist()
    return given.__getitem__


def _by_kernels(
    mask: NDArray[np.bool_], rho: float | None, measure: Measure, check: Callable[[], None]
) -> tuple[NDArray[np.float64], float, int, int]:
    """Values of the levels, bound of the field, sweeps and status of one cropped shape."""
    from torchlinf.kernels import histograms

    solved = solve_shape(mask, rho, measure.tol, check)
    # The ring of outside pixels is on no level, so field and distance can stay padded.
    values, begin = histograms.sort_by_level(solved.v, solved.shape.distance, solved.shape.radius)
    estimate = {"entropy": histograms.entropies, "std": histograms.deviations}[measure.estimator]
    return estimate(values, begin, measure.bins, EDGE_SLACK), solved.bound, solved.sweeps(), int(solved.status)


def level_values(
    field: Tensor, distance: Tensor, radius: Tensor, *, estimator: str = "entropy", bins: int = 1024
) -> Tensor:
    """Estimate for every level of every shape how much the field varies on it.

    Args:
        field: (N, *spatial), finite, positive inside each shape and 0 outside; need not be normalised, as every shape
            is divided by its own maximum.
        distance: (N, *spatial) integers, the chessboard distance in pixels, 0 outside.
        radius: (N,) integers, the maximum of `distance` over each shape; 0 for an empty shape.
        estimator: "entropy" (bits, in [0, log2(bins)]) or "std" (population standard deviation of the normalised
            field, in [0, 0.5]).
        bins: number of equal bins on [0, 1]; only "entropy" uses it.

    Returns:
        (sum of radius,) tensor of the field's dtype: levels 1..radius[0] of shape 0, then those of shape 1, and so on.
        Empty shapes contribute no entry, so a batch of empty shapes gives a tensor of size 0. A uniform level gives
        exactly 0.0. Not differentiable: it counts.

    Raises:
        ValueError: the field is not finite.

    Source: the definitions of Arslan and Tari (2020); docs/method, "Complexity".

    Example:
        >>> field = torch.tensor([[1.0, 2.0, 4.0, 2.0, 1.0]], dtype=torch.float64)
        >>> distance = torch.tensor([[1, 2, 2, 2, 1]])
        >>> level_values(field, distance, torch.tensor([2]))
        tensor([0.0000, 0.9183], dtype=torch.float64)
    """
    flat = field.flatten(1)
    peak = flat.amax(dim=1)  # (N,)
    if not bool(torch.isfinite(peak).all()):
        raise ValueError("field must be finite; got NaN or infinity. Solve the field again with another rho.")
    inside = distance.flatten(1) > 0  # (N, P)
    shape = inside.nonzero()[:, 0]  # (pixels,) the shape that each inside pixel belongs to
    level = first_level(radius)[shape] + distance.flatten(1)[inside].long() - 1
    return ESTIMATORS[estimator](flat[inside] / peak[shape], level, int(radius.sum()), bins)


def first_level(radius: Tensor) -> Tensor:
    """Position of each shape's level 1 in the flat list of levels.

    Args:
        radius: (N,) integers, the number of levels of each shape.

    Returns:
        (N,) int64 tensor.

    Example:
        >>> first_level(torch.tensor([3, 0, 2]))
        tensor([0, 3, 3])
    """
    return radius.long().cumsum(0) - radius.long()
