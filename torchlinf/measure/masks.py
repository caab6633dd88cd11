"""The complexity of masks: what users call. It measures each mask as it stands, or its parts."""

from typing import Unpack

import torch
from numpy.typing import ArrayLike
from torch import Tensor

from torchlinf._helpers.checks import as_mask, choice, real_dtype
from torchlinf._helpers.transfer import float_of, to_device, to_host
from torchlinf.field import METHODS
from torchlinf.measure.levels import MaskAt, levels_of, levels_of_each
from torchlinf.measure.objects import profile_of_parts
from torchlinf.measure.options import MeanOptions, Measure, ProfileOptions, takes
from torchlinf.measure.profile import ComplexityProfile, profile_of_levels, scale_grid


@takes(ProfileOptions)
def complexity_profile(
    mask: Tensor,
    *,
    scales: Tensor | ArrayLike | None = None,
    method: str = "auto",
    spatial_ndim: int | None = None,
    dtype: torch.dtype | None = None,
    **options: Unpack[ProfileOptions],
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
        method: how the field is solved, "auto", "compiled", "batched", "accelerated" or "monotone"; see
            `solve_field`.
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
    measure = Measure.of(options, ProfileOptions)
    choice(method, ("auto", *METHODS), "method")
    real_dtype(dtype)
    grid = scale_grid(scales)
    masks, lead = as_mask(mask, spatial_ndim)
    profile = _profile_of_masks(masks, lead, measure, method, grid, dtype)
    return profile if profile.radius.device == masks.device else profile.moved(masks.device, dtype)


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
    if measure.is_plain:
        return profile_of_levels(levels_of_each(mask_at, count, (count,), measure), (count,), measure)
    return profile_of_parts(mask_at, (count,), measure)


@takes(MeanOptions)
def complexity(
    mask: Tensor,
    *,
    method: str = "auto",
    spatial_ndim: int | None = None,
    dtype: torch.dtype | None = None,
    **options: Unpack[MeanOptions],
) -> Tensor:
    """Mean complexity of each shape over the scales in (low, high].

    The same as `complexity_profile(mask, ...).mean(low, high)`: an exact mean over scales, not one over samples.

    Args:
        mask: (B, C, *spatial) with 1 to 4 spatial dimensions, values 0 or 1 of any real dtype, nonzero is inside,
            beyond the array is outside. Each (b, c) is one shape.
        method: how the field is solved, "auto", "compiled", "batched", "accelerated" or "monotone"; see
            `solve_field`.
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
    measure = Measure.of(options, MeanOptions)
    choice(method, ("auto", *METHODS), "method")
    real_dtype(dtype)
    masks, lead = as_mask(mask, spatial_ndim)
    mean = _profile_of_masks(masks, lead, measure, method, None, dtype).mean(measure.low, measure.high)
    if mean.device == masks.device:
        return mean
    (found,) = to_device(masks.device, mean.to(dtype or float_of(masks.device)))
    return found


def _profile_of_masks(
    masks: Tensor,
    lead: tuple[int, ...],
    measure: Measure,
    method: str,
    grid: tuple[Tensor, Tensor] | None,
    dtype: torch.dtype | None,
) -> ComplexityProfile:
    """The profile of checked masks, bool (N, *spatial), of the leading shape `lead`; where it was computed."""
    if measure.is_plain:
        return profile_of_levels(levels_of(masks, lead, measure, method), lead, measure, grid, dtype)
    if method not in ("auto", "compiled"):
        raise ValueError(
            f'method must be "auto" or "compiled" beside orientation or per="object"; got {method!r}. Leave method out.'
        )
    (on_host,) = to_host(masks)
    profile = profile_of_parts(on_host.numpy().__getitem__, lead, measure, grid)
    return profile.moved(on_host.device, dtype)
