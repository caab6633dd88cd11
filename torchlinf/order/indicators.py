"""The numbers by which shapes are ordered, and which of them count as equal."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf.measure import ComplexityProfile, FrameOptions, ObjectOptions

# Sums of the same numbers in another order differ by less than so many units in the last place of 1.
ROUNDING = 256

# The options that say what is measured, a mask or its parts, and in which axes.
PARTS = (*FrameOptions.__optional_keys__, *ObjectOptions.__optional_keys__)

SLACK = 2e-7  # no profile lowers its scales by more before it rounds them up to levels

Numbers: TypeAlias = NDArray[np.float64]


def require_comparable(profiles: Iterable[tuple[str | int, ComplexityProfile]]) -> None:
    """Raise unless each is the profile of one shape with a pixel inside, and all are measured alike."""
    first = None
    for name, profile in profiles:
        if not isinstance(profile, ComplexityProfile):
            raise TypeError(
                f"profiles must hold a ComplexityProfile for each shape; got {type(profile).__name__} for {name!r}. "
                "Pass torchlinf.complexity_profile(mask, spatial_ndim=2)."
            )
        if profile.radius.numel() != 1:
            raise ValueError(
                f"profiles must be of one shape each; got {profile.radius.numel()} for {name!r}. "
                "Pass profile[0] for the first."
            )
        if not profile.radius.all():
            raise ValueError(
                f"profiles must be of shapes with a pixel inside; got an empty one for {name!r}. Leave it out."
            )
        how = profile.measure
        measured = f"estimator={how.estimator!r}, bins={how.bins}, levels={how.levels!r}"
        if not how.is_plain:
            axes = {name: value for name, value in how.options().items() if name in PARTS}
            measured += "".join(f", {name}={value!r}" for name, value in axes.items())
        first = first or measured
        if measured != first:
            raise ValueError(
                f"profiles must be of one estimator, number of bins and kind of levels, and in the same frames; got "
                f"{measured} for {name!r} and {first} before it. Pass the same options for each."
            )


def means_over(
    profiles: Sequence[ComplexityProfile], windows: Mapping[str, tuple[float, float]]
) -> tuple[Numbers, Numbers]:
    """Mean of each shape over each window, and how far it can be from the exact one: twice (shapes, windows)."""
    ends = list(windows.values())
    # A profile in a short dtype has its levels in full all the same.
    profiles = [replace(profile, values=profile.values.to(profile.level_values.dtype)) for profile in profiles]
    means = [[float(profile.mean(low, high)) for low, high in ends] for profile in profiles]
    bounds = [[float(p.error_bound(low, high)) + rounding_of(p) for low, high in ends] for p in profiles]
    return _rows(means, len(ends)), _rows(bounds, len(ends))


def values_at_all_scales(profiles: Sequence[ComplexityProfile]) -> tuple[Numbers, Numbers]:
    """Value of each shape between the scales where any shape steps to another level: (shapes, steps), and its bound."""
    stairs = [[one.numpy(force=True) for one in profile.steps()] for profile in profiles]
    ends = np.unique(np.concatenate([[0.0], *(end for end, _, _ in stairs)]))
    middles = (ends[1:] + ends[:-1]) / 2
    at = [np.searchsorted(end, middles) for end, _, _ in stairs]
    values = [value[step] for (_, value, _), step in zip(stairs, at, strict=True)]
    bounds = [bound[step] + rounding_of(p) for (_, _, bound), step, p in zip(stairs, at, profiles, strict=True)]
    return _rows(values, len(middles)), _rows(bounds, len(middles))


def bounds_at_scales(profiles: Sequence[ComplexityProfile]) -> Tensor:
    """How far the `values` of each profile can be from the exact ones: (shapes, scales)."""
    return torch.stack([_bounds_at_scales(profile) for profile in profiles])


def _bounds_at_scales(profile: ComplexityProfile) -> Tensor:
    """The larger bound of two steps where rounding of a scale may have led to either of them."""
    ends, _, bounds = (one.cpu().double() for one in profile.steps())
    scales = profile.scales.cpu().double()
    nearest = [torch.searchsorted(ends, scales - slack).clamp(max=len(ends) - 1) for slack in (0.0, SLACK)]
    return torch.maximum(*(bounds[step] for step in nearest)) + rounding_of(profile)


def rounding_of(profile: ComplexityProfile) -> float:
    """By how much rounding of its sums may move a value."""
    return ROUNDING * torch.finfo(profile.level_values.dtype).eps


def _rows(rows: Sequence[Any], width: int) -> Numbers:
    return np.array(rows, dtype=np.float64).reshape(-1, width)


def ranks(values: Numbers, bounds: Numbers) -> NDArray[np.int64]:
    """Number the values of each column from the lowest; values whose intervals meet have the same number.

    >>> ranks(np.array([[3.0], [1.0], [1.1], [2.0]]), np.full((4, 1), 0.1)).tolist()
    [[2], [0], [0], [1]]
    """
    low, high = torch.from_numpy(values - bounds), torch.from_numpy(values + bounds)
    low, order = low.sort(dim=0, stable=True)
    reach = high.gather(0, order).cummax(dim=0).values
    number = torch.zeros_like(order)
    number[1:] = (low[1:] > reach[:-1]).cumsum(dim=0)
    return torch.empty_like(order).scatter_(0, order, number).numpy()
