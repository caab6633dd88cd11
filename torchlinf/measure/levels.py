"""The levels of shapes: the sets of pixels at one distance, how much the field varies on each, and how sure that is.

`levels_of` goes from masks to the values of their levels. On the CPU each shape is cropped to its box, solved, and
sorted by level in compiled kernels, several shapes at a time, and nothing of it is kept but the values. On other
devices the batch is solved in torch operations. Levels of all shapes stand in one flat list: first all levels of shape
0, then those of shape 1.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import ceil
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.checks import positive_tensor
from torchlinf._helpers.parallel import for_each
from torchlinf._helpers.transfer import to_host
from torchlinf.field import ROUNDING, Problem, Status, pose, raise_failures, solve, solve_shape, uses_kernels
from torchlinf.kernels import has_compiler
from torchlinf.measure.entropy import EDGE_SLACK, ESTIMATORS, entropy_bounds, std_bounds
from torchlinf.measure.options import Measure

CHUNK = 8  # shapes that a thread takes at a time: handing over one costs a tenth of solving a small one

MaskAt = Callable[[int], NDArray[np.bool_]]
Keep = Callable[[int, tuple[slice, ...], NDArray[np.float64], NDArray[np.int32]], None]


@dataclass(frozen=True, eq=False)
class Levels:
    """The values of the levels of N shapes.

    Attributes:
        values: (sum of radius,) floating point, all levels of all shapes one after the other.
        error_bound: like `values`, in their unit: how far each can be from that of the exact field.
        radius: (N,) int64, the number of levels of each shape; 0 for an empty one.
        field_error_bound: (N,) certified relative error of each field.
        seconds: (N,) float64, the time that each shape took; a batch in torch operations shares its time evenly.
    """

    values: Tensor
    error_bound: Tensor
    radius: Tensor
    field_error_bound: Tensor
    seconds: Tensor


def levels_of(masks: Tensor, lead: tuple[int, ...], measure: Measure, method: str = "auto") -> Levels:
    """The levels of checked masks, bool (N, *spatial), of the leading shape `lead`; where they were computed.

    Raises:
        RuntimeError: a field could not be certified.
    """
    if uses_kernels(masks, method):
        (on_host,) = to_host(masks)
        arrays = on_host.numpy()
        return levels_of_each(lambda i: arrays[i], len(arrays), lead, measure)
    return solved_levels(masks, lead, measure, method)[2]


def solved_levels(
    masks: Tensor, lead: tuple[int, ...], measure: Measure, method: str = "auto"
) -> tuple[Problem, Tensor, Levels]:
    """The same in torch operations, with the problem and its field (N, *spatial), from which the levels are.

    Raises:
        RuntimeError: a field could not be certified.
    """
    start = perf_counter()
    problem = pose(masks, measure.rho, lead)
    solved = solve(problem, lead, tol=measure.tol, method=method)
    radius = problem.radius.long()
    field, error = solved.value, solved.error_bound
    values, bounds = level_values(field, problem.distance, radius, error, measure)
    for tol in _tighter(measure):
        doubtful = shape_of_level(radius)[bounds > measure.tol_bits].unique()
        if not len(doubtful):
            break
        finer = solve(problem.select(doubtful), (len(doubtful),), tol=tol, method=method, throw=False)
        better = finer.error_bound < error[doubtful]
        field, error = field.clone(), error.clone()
        field[doubtful[better]], error[doubtful[better]] = finer.value[better], finer.error_bound[better]
        values, bounds = level_values(field, problem.distance, radius, error, measure)
    share = (perf_counter() - start) / max(len(masks), 1)
    seconds = torch.full((len(masks),), share, dtype=torch.float64, device="cpu")
    return problem, field, Levels(values, bounds, radius, error, seconds)


def _tighter(measure: Measure) -> Iterator[float]:
    """The tolerances to solve to next, as long as a level is in doubt."""
    if measure.estimator == "std" and measure.tol_bits == 0:
        return  # the bound of a standard deviation falls with that of the field and never is 0
    tol = measure.tol
    while measure.tol_bits > 0 and tol > 1e-11:
        tol /= 100
        yield tol
    yield 1e-300  # as far as floating point goes


def levels_of_each(
    mask_at: MaskAt, count: int, lead: tuple[int, ...], measure: Measure, keep: Keep | None = None
) -> Levels:
    """The levels of `count` shapes that need not be of one size, on the CPU.

    Only the masks being worked on exist, one for each of torch's threads, and a shape costs its kernels and little
    else. Without numba the shapes are solved one by one in torch operations.

    Args:
        mask_at: the i-th mask, bool, any box that holds the shape; called on several threads.
        count: how many there are, the product of `lead`.
        lead: leading shape, for messages and for a `rho` with one value a shape.
        measure: how complexity is measured.
        keep: called with the number of each shape that was solved, its box, and the field and the distance (on the
            rims, for those) in it; on several threads. It needs the compiled kernels.

    Raises:
        RuntimeError: a field could not be certified.
    """
    rhos = _rho_of_each(measure, lead)
    values: list[NDArray[np.float64]] = [np.zeros(0)] * count
    bounds: list[NDArray[np.float64]] = [np.zeros(0)] * count
    error, seconds, sweeps = np.zeros(count), np.zeros(count), np.zeros(count, np.int64)
    status = np.full(count, int(Status.EMPTY), np.int64)

    def solve_one(i: int, check: Callable[[], None]) -> None:
        mask = mask_at(i)
        box = bounding_box(mask)
        if not mask[box].size:
            return
        if has_compiler():
            solved = _by_kernels(mask[box], rhos(i), measure, check)
            values[i], bounds[i], error[i], sweeps[i], status[i] = solved[:5]
            if keep is not None and status[i] == Status.CONVERGED:
                keep(i, box, solved.field, solved.distance)
        else:
            alone = torch.from_numpy(np.ascontiguousarray(mask[box]))[None]
            found = levels_of(alone, (), replace(measure, rho=rhos(i)), "accelerated")
            values[i], bounds[i] = found.values.numpy(), found.error_bound.numpy()
            error[i], status[i] = float(found.field_error_bound), int(Status.CONVERGED)

    chunk = min(CHUNK, ceil(count / (4 * torch.get_num_threads())) or 1)

    def solve_chunk(number: int, check: Callable[[], None]) -> None:
        for i in range(number * chunk, min((number + 1) * chunk, count)):
            start = perf_counter()
            solve_one(i, check)
            seconds[i] = perf_counter() - start

    for_each(solve_chunk, ceil(count / chunk))
    field_error_bound = torch.from_numpy(error)
    raise_failures(torch.from_numpy(status), field_error_bound, torch.from_numpy(sweeps), measure.tol, lead)
    radius = torch.tensor([len(found) for found in values], dtype=torch.int64, device="cpu")
    flat, flat_bounds = (torch.from_numpy(np.concatenate([np.zeros(0), *parts])) for parts in (values, bounds))
    return Levels(flat, flat_bounds, radius, field_error_bound, torch.from_numpy(seconds))


def _rho_of_each(measure: Measure, lead: tuple[int, ...]) -> Callable[[int], float | None]:
    rho = measure.rho
    if not isinstance(rho, Tensor):
        return lambda _: rho
    given = positive_tensor(rho, lead, "rho").reshape(-1).tolist()
    return given.__getitem__


class _Solved(NamedTuple):
    """The solve of one shape: its levels, its error, and field and distance (on the rims, for those) in its box."""

    values: NDArray[np.float64]
    error_bound: NDArray[np.float64]
    field_error_bound: float
    sweeps: int
    status: int
    field: NDArray[np.float64]
    distance: NDArray[np.int32]


def _by_kernels(mask: NDArray[np.bool_], rho: float | None, measure: Measure, check: Callable[[], None]) -> _Solved:
    """Solve one cropped shape."""
    from torchlinf.kernels import grid

    solved = solve_shape(mask, rho, measure.tol, check)
    number = numbers_of(solved.shape.distance, solved.shape.grid.strides, measure)
    values, bounds = refined_estimates(solved, number, measure)
    shape = solved.shape.grid.shape
    within = grid.interior(len(shape))
    field, distance = solved.v.reshape(shape)[within], number.reshape(shape)[within]
    return _Solved(values, bounds, solved.bound, solved.sweeps(), int(solved.status), field, distance)


def numbers_of(distance: NDArray[np.int32], strides: NDArray[np.int64], measure: Measure) -> NDArray[np.int32]:
    """The level of each pixel of one shape, 0 for none; flat and padded."""
    from torchlinf.kernels import histograms

    return histograms.rim(distance, strides) if measure.levels == "rim" else distance


def refined_estimates(
    solved: Any, number: NDArray[np.int32], measure: Measure
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values and bounds of the levels of what `solve_shape` gives, which is solved on while a level is in doubt."""
    values, bounds = estimates(solved.v, number, solved.shape.radius, solved.bound, measure)
    for tol in _tighter(measure):
        if bounds.max() <= measure.tol_bits or not solved.refine(tol):
            break
        values, bounds = estimates(solved.v, number, solved.shape.radius, solved.bound, measure)
    return values, bounds


def estimates(
    v: NDArray[np.float64], number: NDArray[np.int32], radius: int, bound: float, measure: Measure
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values and bounds of the levels 1..radius; `number` is each pixel's level or 0, flat and padded like v."""
    from torchlinf.kernels import histograms

    # The ring of outside pixels is on no level, so field and distance can stay padded.
    values, begin = histograms.sort_by_level(v, number, radius)
    error = bound + ROUNDING * values.max()
    if measure.estimator == "std":
        return histograms.deviations(values, begin), histograms.deviation_bounds(values, begin, error)
    found = histograms.entropies(values, begin, measure.bins, EDGE_SLACK)
    return found, histograms.entropy_bounds(values, begin, measure.bins, EDGE_SLACK, error, found)


def level_values(
    field: Tensor, distance: Tensor, radius: Tensor, error: Tensor, measure: Measure
) -> tuple[Tensor, Tensor]:
    """Estimate for every level of every shape how much the field varies on it, and how sure that is.

    Args:
        field: (N, *spatial), finite, positive inside each shape and 0 outside; need not be normalised, as every shape
            is divided by its own maximum.
        distance: (N, *spatial) integers, the chessboard distance in pixels, 0 outside.
        radius: (N,) integers, the maximum of `distance` over each shape; 0 for an empty shape.
        error: (N,) certified relative error of each field.
        measure: `estimator`, `bins` and `levels` are used.

    Returns:
        The values and their error bounds, two (sum of radius,) tensors of the field's dtype: levels 1..radius[0] of
        shape 0, then those of shape 1, and so on. Empty shapes contribute no entry. A uniform level gives exactly 0.0.
        Not differentiable: it counts.

    Raises:
        ValueError: the field is not finite.

    Source: the definitions of Arslan and Tari (2020); docs/method, "Complexity".

    Example:
        >>> field = torch.tensor([[1.0, 2.0, 4.0, 2.0, 1.0]], dtype=torch.float64)
        >>> distance = torch.tensor([[1, 2, 2, 2, 1]])
        >>> level_values(field, distance, torch.tensor([2]), torch.zeros(1), Measure())[0]
        tensor([0.0000, 0.9183], dtype=torch.float64)
    """
    flat = field.flatten(1)
    peak = flat.amax(dim=1)  # (N,)
    if not bool(torch.isfinite(peak).all()):
        raise ValueError("field must be finite; got NaN or infinity. Solve the field again with another rho.")
    number = (rim(distance) if measure.levels == "rim" else distance).flatten(1)
    inside = number > 0  # (N, P)
    shape = inside.nonzero()[:, 0]  # (pixels,) the shape that each pixel of a level belongs to
    level = first_level(radius)[shape] + number[inside].long() - 1
    values, count = flat[inside] / peak[shape], int(radius.sum())
    known = error + ROUNDING * peak * (torch.finfo(flat.dtype).eps / torch.finfo(torch.float64).eps)
    of_level = known[shape_of_level(radius)]
    found = ESTIMATORS[measure.estimator](values, level, count, measure.bins)
    if measure.estimator == "std":
        return found, std_bounds(values, level, count, of_level)
    return found, entropy_bounds(values, level, found, of_level, measure.bins)


def rim(distance: Tensor) -> Tensor:
    """The distance on the rims, 0 elsewhere: of level k those pixels that touch a smaller distance through a face.

    Args:
        distance: (N, *spatial) integers, 0 outside; what lies beyond the array counts as 0.

    Example:
        >>> rim(torch.tensor([[[1, 1, 1, 1], [1, 2, 2, 1], [1, 2, 2, 1], [1, 1, 2, 2], [0, 1, 1, 2]]]))[0, 3:]
        tensor([[1, 0, 2, 2],
                [0, 1, 1, 2]])
    """
    lowest = distance
    for dim in range(1, distance.ndim):
        padded = torch.nn.functional.pad(distance.movedim(dim, -1), (1, 1))
        beside = torch.minimum(padded[..., 2:], padded[..., :-2]).movedim(-1, dim)
        lowest = torch.minimum(lowest, beside)
    return torch.where(lowest < distance, distance, 0)


def numbered(radius: Tensor) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For each entry of the flat list of levels its shape, and its level k.

    Args:
        radius: (N,) integers, the number of levels of each shape.

    Returns:
        Two (sum of radius,) arrays: by NumPy, which starts no threads of OpenMP, see `torchlinf._helpers.parallel`.

    Example:
        >>> numbered(torch.tensor([3, 0, 2]))
        (array([0, 0, 0, 2, 2]), array([1, 2, 3, 1, 2]))
    """
    sizes = radius.numpy(force=True).astype(np.int64)
    shape = np.repeat(np.arange(len(sizes)), sizes)
    return shape, np.arange(1, len(shape) + 1) - (np.cumsum(sizes) - sizes)[shape]


def shape_of_level(radius: Tensor) -> Tensor:
    """The first of what `numbered` gives, as a tensor on the device of `radius`.

    Example:
        >>> shape_of_level(torch.tensor([3, 0, 2]))
        tensor([0, 0, 0, 2, 2])
    """
    return torch.from_numpy(numbered(radius)[0]).to(radius.device)


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
