"""Multi-scale complexity: how much the field varies on each level of the distance, and its mean over scales."""

from collections.abc import Sequence

import torch
from torch import Tensor

from torchlinf._checks import as_mask, real_dtype, window
from torchlinf._profile import ComplexityProfile
from torchlinf.entropy import check_estimator, first_level, level_values
from torchlinf.field import pose, solve

__all__ = ["ComplexityProfile", "complexity", "complexity_profile"]


def complexity_profile(
    mask: Tensor,
    *,
    scales: Tensor | Sequence[float] | None = None,
    bins: int = 1024,
    estimator: str = "entropy",
    rho: float | Tensor | None = None,
    tol: float = 1e-9,
    method: str = "auto",
    spatial_ndim: int | None = None,
    dtype: torch.dtype | None = None,
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
        bins: number of equal bins on [0, 1] for "entropy"; see `torchlinf.entropy.level_entropy` for their edges.
        estimator: "entropy", bits of the histogram of f / max f on the level, in [0, log2(bins)], or "std", the
            population standard deviation of f / max f on the level, in [0, 0.5].
        rho: screening length in pixels, a number or a tensor that broadcasts to the leading shape; None means each
            shape's own radius.
        tol: relative error the field is certified to.
        method: how the field is solved; see `solve_field`.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.
        dtype: of the values returned; they are always computed in float64 (where the device has it), which is also
            what None returns. `error_bound` keeps its own dtype, since it may be too small for a shorter one.

    Returns:
        A `ComplexityProfile`. An empty shape has radius 0 and NaN values; a full mask is a box, so exactly 0.0. Not
        differentiable. Flips and axis swaps of a shape, and what else is in the batch, do not change its values.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong rank or value.
        RuntimeError: a field could not be solved to `tol`; see `solve_field`.

    Source: Arslan and Tari, "Complexity of Shapes Embedded in Z^n with a Bias Towards Squares", IEEE TIP 2020.

    Example:
        >>> from torchlinf import shapes
        >>> profile = complexity_profile(shapes.disc(8), scales=[0.25, 0.5, 1.0], spatial_ndim=2)
        >>> profile.values, profile.radius
        (tensor([0.9799, 0.8813, 0.0000], dtype=torch.float64), tensor(6))
    """
    check_estimator(estimator, bins)
    real_dtype(dtype)
    grid, slack = scale_grid(scales)
    inside, lead = as_mask(mask, spatial_ndim)
    problem = pose(inside, rho, lead)
    solved = solve(problem, lead, tol=tol, method=method)
    radius = problem.radius.long()  # (N,)
    found = level_values(solved.value, problem.distance, radius, estimator=estimator, bins=bins)
    grid = grid.to(found)
    return ComplexityProfile(
        scales=grid.to(dtype or found.dtype),
        values=at_scales(found, radius, grid - slack).reshape(*lead, len(grid)).to(dtype or found.dtype),
        radius=radius.reshape(lead),
        error_bound=solved.error_bound.reshape(lead),
        level_values=found,
    )


def complexity(
    mask: Tensor,
    *,
    low: float = 0.0,
    high: float = 1.0,
    bins: int = 1024,
    estimator: str = "entropy",
    rho: float | Tensor | None = None,
    tol: float = 1e-9,
    method: str = "auto",
    spatial_ndim: int | None = None,
    dtype: torch.dtype | None = None,
) -> Tensor:
    """Mean complexity of each shape over the scales in (low, high].

    The same as `complexity_profile(mask, ...).mean(low, high)`: an exact mean over scales, not one over samples.

    Args:
        mask: (B, C, *spatial), values 0 or 1, nonzero is inside; each (b, c) is one shape.
        low: lower end of the window of scales, excluded.
        high: upper end of the window, included; 0 <= low < high <= 1. Small scales are near the boundary: an appendage
            of contact width w on a body of width W counts at scales up to w/W.
        bins: number of equal bins on [0, 1] for "entropy".
        estimator: "entropy" (bits, in [0, log2(bins)]) or "std" (share of the field's maximum, in [0, 0.5]).
        rho: screening length in pixels, a number or a tensor that broadcasts to the leading shape; None means each
            shape's own radius.
        tol: relative error the field is certified to.
        method: how the field is solved; see `solve_field`.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.
        dtype: of the result; None means float64 (float32 on a device without it).

    Returns:
        Tensor of the leading shape, (B, C) by default. NaN for an empty shape; exactly 0.0 for a full mask and for any
        axis-aligned box. Not differentiable, and detached from what the mask was made of: for a gradient use
        `soft_complexity` or `losses.ShapeComplexityLoss`.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong rank or value.
        RuntimeError: a field could not be solved to `tol`; see `solve_field`.

    Source: Arslan and Tari, "Complexity of Shapes Embedded in Z^n with a Bias Towards Squares", IEEE TIP 2020.

    Example:
        >>> from torchlinf import shapes
        >>> complexity(torch.stack([shapes.box(17, 17), shapes.disc(8)]), spatial_ndim=2)
        tensor([0.0000, 0.6233], dtype=torch.float64)
    """
    window(low, high)
    profile = complexity_profile(
        mask, bins=bins, estimator=estimator, rho=rho, tol=tol, method=method, spatial_ndim=spatial_ndim, dtype=dtype
    )
    return profile.mean(low, high)


def from_levels(found: Tensor, radius: Tensor, error_bound: Tensor) -> ComplexityProfile:
    """Profile of N shapes on the default scales.

    Args:
        found: (sum of radius,) the values of the levels, shape by shape.
        radius: (N,) int64.
        error_bound: (N,) of the fields.
    """
    scales, slack = scale_grid(None)
    values = at_scales(found, radius, scales - slack)
    return ComplexityProfile(scales, values, radius, error_bound, found)


def at_scales(found: Tensor, radius: Tensor, scales: Tensor) -> Tensor:
    """Look up level k = ceil(t D) of each shape for each scale t: (N, L), NaN where the radius is 0."""
    size = radius[:, None]  # (N, 1)
    level = torch.minimum((scales * size).ceil().long().clamp(min=1), size)  # (N, L)
    position = torch.where(size > 0, first_level(radius)[:, None] + level - 1, len(found))
    return torch.cat([found, found.new_full((1,), torch.nan)])[position]


def scale_grid(scales: Tensor | Sequence[float] | None) -> tuple[Tensor, float]:
    """The scales as (L,) float64, and how far rounding may have carried them above what was meant.

    Without that slack 0.07 * 100, a little above 7 in floating point, would be level 8.
    """
    if scales is None:
        scales = torch.arange(1, 101, dtype=torch.float64) / 100
    elif not isinstance(scales, Tensor):
        scales = torch.tensor(scales, dtype=torch.float64)
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
    slack = max(1e-9, torch.finfo(scales.dtype).eps) if scales.is_floating_point() else 1e-9
    return scales.detach().double(), slack
