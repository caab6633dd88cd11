"""The numbers by which shapes are ordered, and which of them count as equal."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from torchlinf.measure import ComplexityProfile

# Sums of the same numbers in another order differ by less than so many units in the last place of 1.
ROUNDING = 256


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
        first = first or measured
        if measured != first:
            raise ValueError(
                f"profiles must be measured alike; got {measured} for {name!r} and {first} before "
                "it. Pass the same options for each."
            )


def means_over(
    profiles: Sequence[ComplexityProfile], windows: Mapping[str, tuple[float, float]]
) -> NDArray[np.float64]:
    """Mean of each shape over each window: (shapes, windows)."""
    means = [[float(profile.mean(low, high)) for low, high in windows.values()] for profile in profiles]
    return np.array(means, dtype=np.float64).reshape(-1, len(windows))


def values_at_all_scales(profiles: Sequence[ComplexityProfile]) -> NDArray[np.float64]:
    """Value of each shape between the scales where any shape steps to another level: (shapes, steps)."""
    radii = [int(profile.radius) for profile in profiles]
    steps = np.unique(np.concatenate([[0.0], *(np.arange(1, size + 1) / size for size in radii)]))
    middles = (steps[1:] + steps[:-1]) / 2
    columns = [
        profile.level_values.numpy(force=True)[np.ceil(middles * size).astype(int) - 1]
        for profile, size in zip(profiles, radii, strict=True)
    ]
    return np.array(columns, dtype=np.float64).reshape(len(profiles), len(middles))


def tolerance_of(profiles: Sequence[ComplexityProfile]) -> NDArray[np.float64]:
    """By how much each shape's values may differ from another's and still count as equal: (shapes,).

    Twice the certified relative error of the field, and rounding. It is a heuristic: the error of the field bounds
    no entropy, which jumps where a value crosses the edge of a bin.
    """
    return np.array([2 * float(p.field_error_bound) + ROUNDING * torch.finfo(p.values.dtype).eps for p in profiles])


def ranks(values: NDArray[np.float64], tolerance: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number the values of each column from the lowest; values whose intervals overlap have the same number.

    >>> ranks(np.array([[3.0], [1.0], [1.1], [2.0]]), np.full(4, 0.1)).tolist()
    [[2], [0], [0], [1]]
    """
    low, high = torch.from_numpy(values - tolerance[:, None]), torch.from_numpy(values + tolerance[:, None])
    low, order = low.sort(dim=0, stable=True)
    reach = high.gather(0, order).cummax(dim=0).values
    number = torch.zeros_like(order)
    number[1:] = (low[1:] > reach[:-1]).cumsum(dim=0)
    return torch.empty_like(order).scatter_(0, order, number).numpy()
