"""Complexity against scale: the profile of shapes, and its exact mean over a window of scales."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from torchlinf._helpers.checks import window
from torchlinf._helpers.transfer import float_of, to_device
from torchlinf.measure.levels import Levels, level_values, numbered
from torchlinf.measure.options import Measure

UNIT = 2.0**55  # sums of levels are kept in steps of 1 / UNIT


@dataclass(frozen=True, eq=False)
class ComplexityProfile:
    """Complexity of each shape of a batch against scale; made by `complexity_profile`.

    Scale t in (0, 1] is the distance as a fraction of the shape's radius D, and belongs to level k = ceil(t D).
    `lead` stands for the leading dimensions of the mask, (B, C) by default.

    A profile that is computed can be averaged over any window, plotted, ordered and put into a table without another
    solve.

    With `per="object"`, and with `orientation="mean"`, it is the mean of the profiles of its `parts`, scale by scale.
    Parts differ in radius, so that it has no levels of its own: `level_values` is empty, and `levels` raises.

    Attributes:
        scales: (L,) the scale grid.
        values: (*lead, L) the level value (bits for "entropy", share of the field's maximum for "std") at each scale;
            NaN for an empty shape.
        radius: (*lead) int64, D in pixels; 0 for an empty shape; of several parts that of the largest.
        field_error_bound: (*lead) float64, the certified relative error of the field at every pixel; of several parts
            the largest.
        level_values: (sum of radius,) float64, all levels of all shapes one after the other; `levels` splits it.
        level_error_bound: like `level_values` and in their unit, how far each can be from that of the exact field.
            `error_bound` makes the bound of a mean of it.
        measure: how the levels were measured. Its window is not used here.
        seconds: (*lead) float64 on the CPU, the time that each shape took.
        angle: (*lead) float64 on the CPU, degrees that each shape was turned by; None along the grid's axes, for a
            rotation matrix, and where there are parts, which have angles of their own.
        parts: what the profile is the mean of; None where a mask is one shape in one frame.
    """

    scales: Tensor
    values: Tensor
    radius: Tensor
    field_error_bound: Tensor
    level_values: Tensor
    level_error_bound: Tensor
    measure: Measure
    seconds: Tensor
    angle: Tensor | None = None
    parts: "Parts | None" = None

    @property
    def objects(self) -> Tensor:
        """(*lead) int64: how many shapes each mask has: its objects with per="object", else 1, or 0 if it is empty.

        Example:
            >>> import torchlinf
            >>> mask = torch.tensor([[1, 1, 0, 1], [1, 1, 0, 1]])
            >>> torchlinf.complexity_profile(mask, per="object", spatial_ndim=2).objects
            tensor(2)
        """
        if self.parts is None or self.measure.per == "mask":
            return (self.radius > 0).long()
        counts = torch.from_numpy(self.parts.counts(self.radius.numel()))
        return counts.reshape(self.radius.shape).to(self.radius)

    def levels(self) -> list[Any] | Tensor:
        """Values of the levels themselves, without a scale grid.

        Returns:
            Lists nested like the leading dimensions, [b][c] by default, of 1-D tensors of the dtype of `values`: entry
            k - 1 is level k, and a shape of radius D has D entries, an empty one none. For a mask without leading
            dimensions it is that one tensor.

        Raises:
            ValueError: the profile is a mean of parts.

        Example:
            >>> import torchlinf
            >>> profile = torchlinf.complexity_profile(torch.ones(1, 1, 3, 6))
            >>> profile.levels()
            [[tensor([0., 0.], dtype=torch.float64)]]
        """
        if self.parts is not None:
            raise ValueError(
                "levels must be those of one shape in one frame; got a mean of several. Pass profile.parts.profile, "
                "which has the levels of each."
            )
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
        numbers = torch.from_numpy(np.arange(len(radius))).to(radius.device).reshape(lead)
        try:
            chosen = numbers[index]
        except (IndexError, TypeError) as error:
            raise IndexError(
                f"index must select from the leading shape {lead}; got {index!r}. Pass integers or slices."
            ) from error
        shapes, lead = chosen.flatten().numpy(force=True), tuple(chosen.shape)
        sizes = radius.numpy(force=True) if self.parts is None else np.zeros(len(radius), np.int64)
        entry = _entries(sizes, shapes)
        measure = self.measure
        if isinstance(measure.rho, Tensor):
            measure = replace(measure, rho=measure.rho.broadcast_to(self.radius.shape)[index])
        return ComplexityProfile(
            scales=self.scales,
            values=_taken(self.values.reshape(-1, len(self.scales)), shapes).reshape(*lead, len(self.scales)),
            radius=_taken(radius, shapes).reshape(lead),
            field_error_bound=_taken(self.field_error_bound.flatten(), shapes).reshape(lead),
            level_values=_taken(self.level_values, entry),
            level_error_bound=_taken(self.level_error_bound, entry),
            measure=measure,
            seconds=_taken(self.seconds.flatten(), shapes).reshape(lead),
            angle=None if self.angle is None else _taken(self.angle.flatten(), shapes).reshape(lead),
            parts=None if self.parts is None else self.parts.select(shapes, len(radius)),
        )

    def mean(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """Exact mean over the scales in (low, high], not a mean over a grid of samples.

        It is sum_k E_k length(((k-1)/D, k/D] ∩ (low, high]) / (high - low); of parts the mean of theirs.

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
        low, high = window(low, high)
        if self.parts is not None:
            return self._pooled(self.parts.profile.mean(low, high))
        return self._mean_of(self.level_values, low, high)

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
        low, high = window(low, high)
        if self.parts is not None:
            return self._pooled(self.parts.profile.error_bound(low, high))
        return self._mean_of(self.level_error_bound, low, high)

    def standard_error(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """How much `mean(low, high)` would vary if other rotations were taken, for orientation="mean".

        The standard deviation (with n - 1) of the numbers of the n rotations, divided by the square root of n.

        Args:
            low: lower end of the window, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            (*lead) tensor of the dtype of `values`, in their unit; NaN for an empty shape and for one rotation.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1, or the orientation is another one.

        Example:
            >>> import torchlinf
            >>> disc = torchlinf.shapes.disc(16)
            >>> profile = torchlinf.complexity_profile(disc, orientation="mean", rotations=3, spatial_ndim=2)
            >>> bool(profile.standard_error() < 0.1 * profile.mean())
            True
        """
        each = self._by_rotation(*window(low, high)).T  # (rotations, N)
        if len(each) == 1:
            return self._lead(np.full(each.shape[1], np.nan))
        # One after the other: the sums of NumPy's `std` depend on how many shapes there are.
        mean = np.cumsum(each / len(each), axis=0)[-1]
        square = np.cumsum((each - mean) ** 2, axis=0)[-1]
        return self._lead(np.sqrt(square / (len(each) - 1) / len(each)))

    def _by_rotation(self, low: float, high: float) -> NDArray[np.float64]:
        """The mean over (low, high] of each shape at each rotation, its objects pooled: (N, rotations)."""
        if self.measure.orientation != "mean" or self.parts is None:
            raise ValueError(
                "a standard error must be one over rotations; got a profile with "
                f'orientation={self.measure.orientation!r}. Pass orientation="mean".'
            )
        parts = self.parts
        if self.measure.per == "mask":
            return parts.profile.mean(low, high).numpy(force=True).reshape(-1, self.measure.rotations)
        return parts.pooled(parts.profile._by_rotation(low, high), self.radius.numel())

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
        if self.parts is not None:
            return self._peak_of_parts()
        shape, number = numbered(self.radius.flatten())
        radius, levels = (x.numpy(force=True) for x in (self.radius.flatten(), self.level_values))
        value, scale = np.full((2, len(radius)), np.nan)
        value[radius > 0] = _reduced(np.maximum, levels, radius)
        # Levels that do not reach the maximum stand behind every level that does.
        rank = np.where(levels == value[shape], number, number + radius[shape])
        scale[radius > 0] = _reduced(np.minimum, rank, radius) / radius[radius > 0]
        return self._lead(value), self._lead(scale)

    def _pooled(self, values: Tensor) -> Tensor:
        """One number a mask of one number a part."""
        assert self.parts is not None
        return self._lead(self.parts.pooled(values.numpy(force=True)[:, None], self.radius.numel())[:, 0])

    def _peak_of_parts(self) -> tuple[Tensor, Tensor]:
        value = torch.full(self.radius.shape, torch.nan, dtype=self.values.dtype, device=self.values.device)
        scale = value.clone()
        for index in (self.radius > 0).nonzero().tolist():
            ends, values, _ = (self if self.radius.numel() == 1 else self[tuple(index)]).steps()
            value[tuple(index)], scale[tuple(index)] = values.max(), ends[values.argmax()]
        return value, scale

    def steps(self) -> tuple[Tensor, Tensor, Tensor]:
        """The profile of one shape as the staircase that it is.

        Returns:
            Three (S,) tensors of the dtype of `level_values`: the scale at which each step ends, in (0, 1] and
            ascending, its value, and how far this can be from that of the exact field. A shape of radius D has D steps
            of the same length; a mean of parts steps where one of them does. An empty shape has none.

        Raises:
            ValueError: the profile is of several shapes.

        Example:
            >>> import torchlinf
            >>> mask = torch.ones(3, 9)
            >>> mask[1:, 4] = 0
            >>> torchlinf.complexity_profile(mask, per="object", spatial_ndim=2).steps()[0]
            tensor([0.5000, 1.0000], dtype=torch.float64)
        """
        if self.radius.numel() != 1:
            raise ValueError(f"steps must be those of one shape; got {self.radius.numel()}. Pass profile[0].steps().")
        if self.parts is not None:
            return self.parts.steps()
        count = len(self.level_values)
        number = torch.arange(1, count + 1, device=self.level_values.device).to(self.level_values)
        return number / max(count, 1), self.level_values, self.level_error_bound

    def _lead(self, flat: NDArray[np.float64]) -> Tensor:
        return torch.from_numpy(flat).to(self.values.dtype).to(self.values.device).reshape(self.radius.shape)

    def moved(self, device: torch.device, dtype: torch.dtype | None) -> "ComplexityProfile":
        """A profile of float64 on the CPU brought to a device, its values in `dtype`."""
        real = float_of(device)
        scales, values, radius, field_error_bound, level_values, level_error_bound = to_device(
            device,
            self.scales.to(dtype or real),
            self.values.to(dtype or real),
            self.radius,
            self.field_error_bound.to(real),
            self.level_values.to(real),
            self.level_error_bound.to(real),
        )
        moved = replace(
            self,
            scales=scales,
            values=values,
            radius=radius,
            field_error_bound=field_error_bound,
            level_values=level_values,
            level_error_bound=level_error_bound,
        )
        if self.parts is None:
            return moved
        return replace(moved, parts=self.parts.moved(device))


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


@dataclass(frozen=True, eq=False)
class Parts:
    """What a profile was pooled from: the objects of each mask, or the rotations of each shape.

    P parts of N masks, those of the first mask first.

    Attributes:
        profile: of the leading shape (P,), the parts alone. Of objects with orientation="mean" it has parts itself, the
            rotations of each object.
        owner: (P,) int64, ascending: the number of the mask that each part belongs to, in the flattened batch.
        weight: (P,) int64, how much each part counts in the mean: 1, or for pool="area" its pixels.
        pixels: (P,) int64, pixels of each object in the mask, before any turn; None for rotations.
        box: (P, spatial dimensions, 2) int64, the box of each object in the mask: first row and the one behind the
            last, first column and the one behind the last, and so on; None for rotations.

    Example:
        >>> import torchlinf
        >>> mask = torch.tensor([[1, 1, 0, 0, 0], [1, 1, 0, 1, 1]])
        >>> parts = torchlinf.complexity_profile(mask, per="object", spatial_ndim=2).parts
        >>> parts.owner, parts.pixels, parts.box[1].tolist()
        (tensor([0, 0]), tensor([4, 2]), [[1, 2], [3, 5]])
    """

    profile: "ComplexityProfile"
    owner: Tensor
    weight: Tensor
    pixels: Tensor | None
    box: Tensor | None

    def number(self) -> Tensor:
        """(P,) int64: the number of each part within its mask, from 1.

        Example:
            >>> import torchlinf
            >>> masks = torch.tensor([[[1, 0, 1]], [[0, 1, 0]]])
            >>> torchlinf.complexity_profile(masks, per="object", spatial_ndim=2).parts.number()
            tensor([1, 2, 1])
        """
        begin = torch.searchsorted(self.owner, self.owner)
        return torch.arange(1, len(self.owner) + 1, device=self.owner.device) - begin

    def counts(self, masks: int) -> NDArray[np.int64]:
        """(masks,) how many parts each mask has."""
        return np.bincount(self.owner.numpy(force=True), minlength=masks)

    def pooled(self, values: NDArray[np.float64], masks: int) -> NDArray[np.float64]:
        """The weighted mean of the numbers of the parts of each mask.

        It does not depend on the order of the parts. The numbers of a single part are kept to the last bit. The
        rotations of an empty mask are NaN, and so is their mean.

        Args:
            values: (P, L), any count of numbers a part, in [0, 32) as those of all levels are.
            masks: how many masks there are.

        Returns:
            (masks, L); NaN for a mask without parts.
        """
        owner, weight, counts = self.owner.numpy(force=True), self.weight.numpy(force=True), self.counts(masks)
        total = np.bincount(owner, weight, masks)
        # Summed as integers, of which none exceeds 2^61.
        unit = np.ldexp(1.0, 61 - np.frexp(32 * total)[1])[owner, None]
        terms = np.rint(np.nan_to_num(values) * weight[:, None] * unit).astype(np.int64)
        mean = np.full((masks, values.shape[1]), np.nan)
        some = counts > 0
        mean[some] = _reduced(np.add, terms, counts) / _reduced(np.maximum, unit, counts) / total[some, None]
        alone = counts[owner] == 1
        mean[owner[alone]] = values[alone]
        mean[owner[np.isnan(values).any(axis=1)]] = np.nan
        return mean

    def total(self, values: Tensor, masks: int) -> Tensor:
        """The sum of one number a part, for each mask."""
        found = np.bincount(self.owner.numpy(force=True), values.numpy(force=True), masks)
        return torch.from_numpy(found).to(values)

    def largest(self, values: Tensor, masks: int) -> Tensor:
        """The largest of one number of 0 or more a part, for each mask; 0 for a mask without parts."""
        counts = self.counts(masks)
        found = np.zeros(masks)
        found[counts > 0] = _reduced(np.maximum, values.numpy(force=True), counts)
        return torch.from_numpy(found).to(values)

    def select(self, masks: NDArray[np.int64], count: int) -> "Parts":
        """The parts of some of the masks, (M,) of their numbers, in this order; they are numbered anew."""
        counts = self.counts(count)
        index = _entries(counts, masks)
        owner = torch.from_numpy(np.repeat(np.arange(len(masks)), counts[masks])).to(self.owner.device)
        pixels, box = (None if one is None else _taken(one, index) for one in (self.pixels, self.box))
        profile = self.profile[torch.from_numpy(index).to(self.owner.device)]
        return Parts(profile, owner, _taken(self.weight, index), pixels, box)

    def moved(self, device: torch.device) -> "Parts":
        """The parts on a device."""
        return replace(
            self,
            profile=self.profile.moved(device, None),
            owner=self.owner.to(device),
            weight=self.weight.to(device),
            pixels=None if self.pixels is None else self.pixels.to(device),
            box=None if self.box is None else self.box.to(device),
        )

    def steps(self) -> tuple[Tensor, Tensor, Tensor]:
        """The steps of the mean of all parts against scale: see `ComplexityProfile.steps`."""
        each = list(self._steps_of_each())
        ends = torch.unique(torch.cat([self.profile.level_values.new_zeros(0), *(end for end, _, _ in each)]))
        middles = (ends + torch.cat([ends.new_zeros(1), ends[:-1]])) / 2
        weight = self.weight.to(ends) / self.weight.sum()
        values, bounds = torch.zeros_like(ends), torch.zeros_like(ends)
        for share, (end, value, bound) in zip(weight, each, strict=True):
            at = torch.searchsorted(end, middles)
            values += share * value[at]
            bounds += share * bound[at]
        return ends, values, bounds

    def _steps_of_each(self) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
        if self.profile.parts is not None:
            yield from (self.profile[i].steps() for i in range(len(self.owner)))
            return
        sizes = self.profile.radius.tolist()
        levels = self.profile.level_values.split(sizes), self.profile.level_error_bound.split(sizes)
        for size, values, bounds in zip(sizes, *levels, strict=True):
            yield torch.arange(1, size + 1, device=values.device).to(values) / max(size, 1), values, bounds


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


def _entries(sizes: NDArray[np.int64], chosen: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where the entries of those that are chosen stand in a flat list, of which each has so many.

    >>> _entries(np.array([2, 0, 3]), np.array([2, 0]))
    array([2, 3, 4, 0, 1])
    """
    size = sizes[chosen]
    shift = (np.cumsum(sizes) - sizes)[chosen] - (np.cumsum(size) - size)
    return np.arange(size.sum()) + np.repeat(shift, size)


def _taken(values: Tensor, index: NDArray[np.int64]) -> Tensor:
    """Rows of a tensor; by NumPy on the CPU, which starts no threads of OpenMP, see `torchlinf._helpers.parallel`."""
    if values.device.type != "cpu":
        return values[torch.from_numpy(index).to(values.device)]
    return torch.from_numpy(values.numpy()[index])


def _reduced(function: np.ufunc, of_levels: NDArray[Any], radius: NDArray[np.int64]) -> NDArray[Any]:
    """One number for each shape that is not empty, from all of its levels."""
    sizes = radius[radius > 0]
    return function.reduceat(of_levels, np.cumsum(sizes) - sizes) if len(sizes) else of_levels[:0]


def _nest(parts: Sequence[Tensor], lead: tuple[int, ...]) -> list[Any] | Tensor:
    if not lead:
        return parts[0]
    step = len(parts) // max(lead[0], 1)
    return [_nest(parts[i * step : (i + 1) * step], lead[1:]) for i in range(lead[0])]
