"""Complexity against scale: the profile of shapes, and its exact mean over a window of scales."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from torchlinf._helpers.checks import as_mask, choice, real_dtype, window
from torchlinf.field import METHODS
from torchlinf.measure.levels import (
    Levels,
    MaskAt,
    first_level,
    level_values,
    levels_of,
    levels_of_each,
    numbered,
    shape_of_level,
)
from torchlinf.measure.options import LevelOptions, Measure, WindowOptions, takes

UNIT = 2.0**55  # sums of levels are kept in steps of 1 / UNIT


@dataclass(frozen=True, eq=False)
class ComplexityProfile:
    """Complexity of each shape of a batch against scale; made by `complexity_profile`.

    Scale t in (0, 1] is the distance as a fraction of the shape's radius D, and belongs to level k = ceil(t D).
    `lead` stands for the leading dimensions of the mask, (B, C) by default.

    A profile that is computed can be averaged over any window, plotted, ordered and put into a table without another
    solve.

    Attributes:
        scales: (L,) the scale grid.
        values: (*lead, L) the level value (bits for "entropy", share of the field's maximum for "std") at each scale;
            NaN for an empty shape.
        radius: (*lead) int64, D in pixels; 0 for an empty shape.
        field_error_bound: (*lead) float64, the certified relative error of the field at every pixel.
        level_values: (sum of radius,) float64, all levels of all shapes one after the other; `levels` splits it.
        level_error_bound: like `level_values` and in their unit, how far each can be from that of the exact field.
            `error_bound` makes the bound of a mean of it.
        measure: how the levels were measured. Its window is not used here.
        seconds: (*lead) float64 on the CPU, the time that each shape took.
    """

    scales: Tensor
    values: Tensor
    radius: Tensor
    field_error_bound: Tensor
    level_values: Tensor
    level_error_bound: Tensor
    measure: Measure
    seconds: Tensor

    def levels(self) -> list[Any] | Tensor:
        """Values of the levels themselves, without a scale grid.

        Returns:
            Lists nested like the leading dimensions, [b][c] by default, of 1-D tensors of the dtype of `values`: entry
            k - 1 is level k, and a shape of radius D has D entries, an empty one none. For a mask without leading
            dimensions it is that one tensor.

        Example:
            >>> import torchlinf
            >>> profile = torchlinf.complexity_profile(torch.ones(1, 1, 3, 6))
            >>> profile.levels()
            [[tensor([0., 0.], dtype=torch.float64)]]
        """
        parts = torch.split(self.level_values.to(self.values.dtype), self.radius.flatten().tolist())
        return _nest(parts, tuple(self.radius.shape))

    def __getitem__(self, index: Any) -> "ComplexityProfile":
        """The profile of some of the shapes, without another solve.

        Args:
            index: what a tensor of the leading shape may be indexed with: integers, slices, a bool or integer tensor.

        Returns:
            A `ComplexityProfile` whose leading shape is that of `radius[index]`; its tensors are copies.

        Raises:
            IndexError: the index does not go with the leading shape.

        Example:
            >>> import torchlinf
            >>> masks = torch.stack([torchlinf.shapes.box(13, 13), torchlinf.shapes.disc(6)])
            >>> profile = torchlinf.complexity_profile(masks, spatial_ndim=2)
            >>> profile[1].mean(), profile[:1].radius
            (tensor(0.8227, dtype=torch.float64), tensor([7]))
        """
        radius, lead = self.radius.flatten(), tuple(self.radius.shape)
        numbers = torch.arange(len(radius), device=radius.device).reshape(lead)
        try:
            chosen = numbers[index]
        except (IndexError, TypeError) as error:
            raise IndexError(
                f"index must select from the leading shape {lead}; got {index!r}. Pass integers or slices."
            ) from error
        shapes = chosen.flatten()
        size = radius[shapes]
        entry = torch.arange(int(size.sum()), device=radius.device)
        entry += (first_level(radius)[shapes] - first_level(size))[shape_of_level(size)]
        measure = self.measure
        if isinstance(measure.rho, Tensor):
            measure = replace(measure, rho=measure.rho.broadcast_to(lead)[index])
        return ComplexityProfile(
            scales=self.scales,
            values=self.values.reshape(-1, len(self.scales))[shapes].reshape(*chosen.shape, len(self.scales)),
            radius=size.reshape(chosen.shape),
            field_error_bound=self.field_error_bound.flatten()[shapes].reshape(chosen.shape),
            level_values=self.level_values[entry],
            level_error_bound=self.level_error_bound[entry],
            measure=measure,
            seconds=self.seconds.flatten()[shapes.cpu()].reshape(chosen.shape),
        )

    def mean(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """Exact mean over the scales in (low, high], not a mean over a grid of samples.

        It is sum_k E_k length(((k-1)/D, k/D] ∩ (low, high]) / (high - low).

        Args:
            low: lower end of the window, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            (*lead) tensor of the dtype of `values`, in its unit and range; NaN for an empty shape.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.

        Example:
            >>> import torchlinf
            >>> profile = torchlinf.complexity_profile(torchlinf.shapes.disc(6), spatial_ndim=2)
            >>> profile.mean(), profile.mean(0.75, 1.0)
            (tensor(0.8227, dtype=torch.float64), tensor(0.1837, dtype=torch.float64))
        """
        return self._mean_of(self.level_values, *window(low, high))

    def error_bound(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """How far `mean(low, high)` can be from the complexity of the exact field, proven.

        The field is known to a relative error at every pixel. So it is known of every pixel which bins it may be in, of
        every bin how many pixels it holds at least and at most, and within which bounds the entropy lies. Where no
        pixel may be in another bin the bound is 0: then the number is the exact one, up to the rounding of the sum of
        its terms (less than 1e-11 for a million pixels).

        Args:
            low: lower end of the window, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            (*lead) tensor of the dtype of `values`, in their unit, 0 or more; NaN for an empty shape.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.

        Source: docs/method, "An error bound in bits".

        Example:
            >>> import math, torchlinf
            >>> disc = torchlinf.shapes.disc(16)
            >>> torchlinf.complexity_profile(disc, spatial_ndim=2).error_bound()
            tensor(0., dtype=torch.float64)
            >>> rough = torchlinf.complexity_profile(
            ...     disc, tol=0.01, tol_bits=math.inf, method="accelerated", spatial_ndim=2
            ... )
            >>> bool((rough.mean() - 1.7651).abs() <= rough.error_bound()), bool(rough.error_bound() < 4)
            (True, True)
        """
        return self._mean_of(self.level_error_bound, *window(low, high))

    def _mean_of(self, of_levels: Tensor, low: float, high: float) -> Tensor:
        """Exact mean over the scales in (low, high] of one number a level."""
        arrays = of_levels.numpy(force=True), self.radius.flatten().numpy(force=True)
        return self._lead(mean_of_levels(*arrays, low, high))

    def peak(self) -> tuple[Tensor, Tensor]:
        """Largest level value and the scale it is reached at.

        Returns:
            Two (*lead) tensors of the dtype of `values`: max_k E_k, and k/D of the first level that reaches it; both
            NaN for an empty shape.

        Example:
            >>> import torchlinf
            >>> torchlinf.complexity_profile(torchlinf.shapes.disc(8), spatial_ndim=2).peak()
            (tensor(1.2867, dtype=torch.float64), tensor(0.1667, dtype=torch.float64))
        """
        shape, number = numbered(self.radius.flatten())
        radius, levels = (x.numpy(force=True) for x in (self.radius.flatten(), self.level_values))
        value, scale = np.full((2, len(radius)), np.nan)
        value[radius > 0] = _reduced(np.maximum, levels, radius)
        # Levels that do not reach the maximum stand behind every level that does.
        rank = np.where(levels == value[shape], number, number + radius[shape])
        scale[radius > 0] = _reduced(np.minimum, rank, radius) / radius[radius > 0]
        return self._lead(value), self._lead(scale)

    def _lead(self, flat: NDArray[np.float64]) -> Tensor:
        return torch.from_numpy(flat).to(self.values.dtype).to(self.values.device).reshape(self.radius.shape)


def mean_of_levels(
    of_levels: NDArray[np.float64], radius: NDArray[np.int64], low: float, high: float
) -> NDArray[np.float64]:
    """Exact mean over the scales in (low, high] of one number a level, for N shapes; NaN for radius 0.

    Args:
        of_levels: (sum of radius,) the levels of all shapes one after the other.
        radius: (N,) how many each shape has.
        low: lower end of the window, excluded.
        high: upper end, included.

    Example:
        >>> mean_of_levels(np.array([1.0, 2.0, 5.0]), np.array([2, 0, 1]), 0.0, 0.75).round(3)
        array([1.333,   nan, 5.   ])
    """
    shape, number = numbered(torch.from_numpy(radius))
    terms = of_levels * length_within(number, radius[shape], low, high)
    # Summed as integers: no value exceeds 20 bits, and the lengths add up to 1.
    found = np.full(len(radius), np.nan)
    found[radius > 0] = _reduced(np.add, np.rint(terms * UNIT).astype(np.int64), radius) / UNIT / (high - low)
    return found


@takes(LevelOptions)
def complexity_profile(
    mask: Tensor,
    *,
    scales: Tensor | ArrayLike | None = None,
    method: str = "auto",
    spatial_ndim: int | None = None,
    dtype: torch.dtype | None = None,
    **options: Unpack[LevelOptions],
) -> ComplexityProfile:
    """Complexity of shapes against scale.

    Level k of a shape is the set of pixels at chessboard distance k from the outside. On an axis-aligned box the
    screened L-infinity field is constant on every level; the value E_k of a level says how far it is from that.
    At scale t the profile shows level ceil(t D), D being the radius: an appendage of contact width w on a body of
    width W shows at no t above w/W.

    Args:
        mask: (B, C, *spatial) with 1 to 4 spatial dimensions, values 0 or 1 of any real dtype, nonzero is inside,
            beyond the array is outside. Each (b, c) is one shape.
        scales: (L,) scales in (0, 1]; None means 0.01, 0.02 ... 1.00.
        method: how the field is solved, "auto", "compiled", "accelerated" or "monotone"; see `solve_field`.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.
        dtype: of the values returned; None means float64 (float32 on a device without it), in which they are always
            computed. `field_error_bound` keeps its own dtype, since it may be too small for a shorter one.
        {measure options}

    Returns:
        A `ComplexityProfile`. An empty shape has radius 0 and NaN values; a full mask is a box, so exactly 0.0. Not
        differentiable. What else is in the batch does not change the values of a shape. Flips and axis swaps of a shape
        change them by no more than the errors of the fields explain; at the default `tol` by nothing on all shapes that
        were tried.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong rank or value.
        RuntimeError: a field could not be solved to `tol`; the message names the shapes.

    Source: Arslan and Tari, "Complexity of Shapes Embedded in Z^n with a Bias Towards Squares", IEEE TIP 2020.

    Example:
        >>> from torchlinf import shapes
        >>> profile = complexity_profile(shapes.disc(8), scales=[0.25, 0.5, 1.0], spatial_ndim=2)
        >>> profile.values, profile.radius
        (tensor([0.9799, 0.8813, 0.0000], dtype=torch.float64), tensor(6))
    """
    measure = Measure.of(options, LevelOptions)
    choice(method, ("auto", *METHODS), "method")
    real_dtype(dtype)
    grid = scale_grid(scales)
    masks, lead = as_mask(mask, spatial_ndim)
    return profile_of_levels(levels_of(masks, lead, measure, method), lead, measure, grid, dtype)


def ragged_profile(mask_at: MaskAt, count: int, measure: Measure) -> ComplexityProfile:
    """What `complexity_profile` gives for each of many masks alone, of whatever size, as one profile.

    A batch of tensors would be as large as the largest mask times the number of shapes. Here only the masks being
    worked on exist, one for each of torch's threads.

    Args:
        mask_at: the i-th mask, a bool array, any box that holds the shape; called on several threads.
        count: how many there are.
        measure: how complexity is measured. Its window is not used here.

    Returns:
        The profile on the CPU, on the default scales, of the leading shape (count,).

    Raises:
        RuntimeError: a field could not be solved.

    Example:
        >>> import numpy as np
        >>> masks = [np.ones((3, 5), dtype=bool), np.eye(4, dtype=bool)]
        >>> profile = ragged_profile(masks.__getitem__, 2, Measure())
        >>> profile.radius, profile.mean()
        (tensor([2, 1]), tensor([0., 0.], dtype=torch.float64))
    """
    return profile_of_levels(levels_of_each(mask_at, count, (count,), measure), (count,), measure)


@takes(WindowOptions)
def complexity(
    mask: Tensor,
    *,
    method: str = "auto",
    spatial_ndim: int | None = None,
    dtype: torch.dtype | None = None,
    **options: Unpack[WindowOptions],
) -> Tensor:
    """Mean complexity of each shape over the scales in (low, high].

    The same as `complexity_profile(mask, ...).mean(low, high)`: an exact mean over scales, not one over samples.

    Args:
        mask: (B, C, *spatial) with 1 to 4 spatial dimensions, values 0 or 1 of any real dtype, nonzero is inside,
            beyond the array is outside. Each (b, c) is one shape.
        method: how the field is solved, "auto", "compiled", "accelerated" or "monotone"; see `solve_field`.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.
        dtype: of the result; None means float64 (float32 on a device without it).
        {measure options}

    Returns:
        Tensor of the leading shape, (B, C) by default, in bits (share of the field's maximum for "std"). NaN for an
        empty shape; exactly 0.0 for a full mask and for any axis-aligned box. Not differentiable, and detached from
        what the mask was made of: for a gradient use `soft_complexity` or `losses.ShapeComplexityLoss`.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong rank or value.
        RuntimeError: a field could not be solved to `tol`; the message names the shapes.

    Source: Arslan and Tari, "Complexity of Shapes Embedded in Z^n with a Bias Towards Squares", IEEE TIP 2020.

    Example:
        >>> from torchlinf import shapes
        >>> complexity(torch.stack([shapes.box(17, 17), shapes.disc(8)]), spatial_ndim=2)
        tensor([0.0000, 0.6233], dtype=torch.float64)
    """
    measure = Measure.of(options, WindowOptions)
    choice(method, ("auto", *METHODS), "method")
    real_dtype(dtype)
    masks, lead = as_mask(mask, spatial_ndim)
    profile = profile_of_levels(levels_of(masks, lead, measure, method), lead, measure, dtype=dtype)
    return profile.mean(measure.low, measure.high)


def profile_of_field(field: Tensor, distance: Tensor, field_error: Tensor, measure: Measure) -> ComplexityProfile:
    """The profile of one shape whose field is solved already.

    Args:
        field: (*spatial), as `solve_field` gives it, of a shape that is not empty.
        distance: (*spatial), its chessboard distance.
        field_error: the certified relative error of the field, without dimensions.
        measure: how complexity is measured; `rho` and `tol` are those of the solve.

    Returns:
        The profile, without batch dimensions.

    Example:
        >>> from torchlinf import chessboard_distance, shapes, solve_field
        >>> disc = shapes.disc(8)
        >>> solved = solve_field(disc, spatial_ndim=2)
        >>> distance = chessboard_distance(disc, spatial_ndim=2)
        >>> profile_of_field(solved.value, distance, solved.error_bound, Measure()).mean()
        tensor(0.6233, dtype=torch.float64)
    """
    radius, error = distance.max().reshape(1).long(), field_error.reshape(1)
    values, bounds = level_values(field[None], distance[None], radius, error, measure)
    return profile_of_levels(
        Levels(values, bounds, radius, error, torch.zeros(1, dtype=torch.float64, device="cpu")), (), measure
    )


def profile_of_levels(
    levels: Levels,
    lead: tuple[int, ...],
    measure: Measure,
    grid: tuple[Tensor, Tensor] | None = None,
    dtype: torch.dtype | None = None,
) -> ComplexityProfile:
    """The profile of levels that are known; `grid` is what `scale_grid` gives, None its default."""
    found = levels.values
    scales, slack = (x.to(found) for x in (scale_grid(None) if grid is None else grid))
    return ComplexityProfile(
        scales=scales.to(dtype or found.dtype),
        values=at_scales(found, levels.radius, scales - slack).reshape(*lead, len(scales)).to(dtype or found.dtype),
        radius=levels.radius.reshape(lead),
        field_error_bound=levels.field_error_bound.reshape(lead),
        level_values=found,
        level_error_bound=levels.error_bound,
        measure=measure,
        seconds=levels.seconds.reshape(lead),
    )


def at_scales(found: Tensor, radius: Tensor, scales: Tensor) -> Tensor:
    """Look up level k = ceil(t D) of each shape for each scale t: (N, L), NaN where the radius is 0."""
    size = radius.numpy(force=True)[:, None]  # (N, 1)
    level = np.clip(np.ceil(scales.numpy(force=True) * size).astype(np.int64), 1, np.maximum(size, 1))  # (N, L)
    position = np.where(size > 0, np.cumsum(size)[:, None] - size + level - 1, len(found))
    return torch.from_numpy(np.append(found.numpy(force=True), np.nan)[position]).to(found)


def scale_grid(scales: Tensor | ArrayLike | None) -> tuple[Tensor, Tensor]:
    """The scales as (L,) float64, and how far rounding may have carried each above what was meant.

    Without that slack 0.07 * 100, a little above 7 in floating point, would be level 8.
    """
    if scales is None:
        scales = torch.arange(1, 101, dtype=torch.float64, device="cpu") / 100
    elif not isinstance(scales, Tensor):
        array = np.asarray(scales)
        if array.dtype.kind not in "biuf":
            raise TypeError(f"scales must be real numbers; got {array.dtype}. Pass for example scales=[0.1, 0.5].")
        # Scales that were rounded to fewer digits keep their dtype, which says by how much.
        short = array.dtype.kind == "f" and array.dtype.itemsize < 8
        scales = torch.from_numpy(array.astype(array.dtype.newbyteorder("=") if short else np.float64))
    if scales.is_complex():
        raise TypeError(f"scales must be real numbers; got {scales.dtype}. Pass scales.real.")
    if scales.ndim != 1 or len(scales) == 0:
        raise ValueError(
            f"scales must be one row of numbers; got shape {tuple(scales.shape)}. Pass for example scales=[0.1, 0.5]."
        )
    if not bool(((scales > 0) & (scales <= 1)).all()):
        raise ValueError(
            f"scales must lie in (0, 1]; got {scales.tolist()}. Pass fractions of the radius, for example [0.1, 0.5]."
        )
    eps = torch.finfo(scales.dtype).eps if scales.is_floating_point() else 0.0
    scales = scales.detach().double()
    return scales, (scales * (0.51 * eps)).clamp(min=1e-9)


def length_within(level: NDArray[np.int64], radius: NDArray[np.int64], low: float, high: float) -> NDArray[np.float64]:
    """Length of the scales in (low, high] that belong to a level: of ((k-1)/D, k/D] ∩ (low, high].

    Args:
        level: k, any shape.
        radius: D, broadcast with it.
        low: lower end of the window.
        high: its upper end.

    Returns:
        Array in [0, 1/D].

    Example:
        >>> length_within(np.arange(1, 5), np.array(4), 0.375, 1.0)
        array([0.   , 0.125, 0.25 , 0.25 ])
    """
    length: NDArray[np.float64] = np.minimum(level / radius, high) - np.maximum((level - 1) / radius, low)
    return length.clip(min=0)


def _reduced(function: np.ufunc, of_levels: NDArray[Any], radius: NDArray[np.int64]) -> NDArray[Any]:
    """One number for each shape that is not empty, from all of its levels."""
    sizes = radius[radius > 0]
    return function.reduceat(of_levels, np.cumsum(sizes) - sizes) if len(sizes) else of_levels[:0]


def _nest(parts: Sequence[Tensor], lead: tuple[int, ...]) -> list[Any] | Tensor:
    if not lead:
        return parts[0]
    step = len(parts) // max(lead[0], 1)
    return [_nest(parts[i * step : (i + 1) * step], lead[1:]) for i in range(lead[0])]
