"""Where the complexity of a shape sits: the share that each pixel has in it."""

from typing import Unpack

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.checks import as_mask, choice, real_dtype
from torchlinf._helpers.transfer import float_of, to_device, to_host
from torchlinf.field import METHODS, normalised, uses_kernels
from torchlinf.measure.entropy import EDGE_SLACK, bin_of
from torchlinf.measure.levels import first_level, levels_of_each, numbered, rim, solved_levels
from torchlinf.measure.options import Measure, WindowOptions, takes
from torchlinf.measure.profile import length_within


@takes(WindowOptions)
def complexity_map(
    mask: Tensor,
    *,
    method: str = "auto",
    spatial_ndim: int | None = None,
    dtype: torch.dtype | None = None,
    **options: Unpack[WindowOptions],
) -> Tensor:
    """The share of each pixel in the complexity of its shape over the scales in (low, high].

    The entropy of a level is the mean of the surprisal of its pixels, -log2 of the share of the level that falls into
    the pixel's bin. So a pixel's share is its surprisal, divided by the number of pixels of its level, times the part
    of the window (low, high] that belongs to the level; and the shares of all pixels add up to
    `complexity(mask, low=low, high=high)`, a number known to `complexity_profile(mask).error_bound(low, high)`; where
    that bound is 0 the two agree up to rounding. A share is high where f differs from what it is at most pixels of the
    same distance. The other estimator of `complexity`, the standard deviation, is no mean over pixels and has no such
    map.

    Args:
        mask: (B, C, *spatial), values 0 or 1, nonzero is inside; each (b, c) is one shape.
        method: how the field is solved, "auto", "compiled", "batched", "accelerated" or "monotone"; see
            `solve_field`.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.
        dtype: of the result; None means float64 (float32 on a device without it).
        {measure options}

    Returns:
        Tensor like `mask`, bits per pixel, 0 or more: 0 outside, on uniform levels and on levels outside the window
        (with levels="rim" also on pixels of no rim),
        so exactly 0.0 all over for any axis-aligned box. NaN at every pixel for an empty shape, whose complexity is
        NaN: so the sum is right for every shape, and an empty one is not taken for a simple one. Not differentiable.
        Flips and axis swaps of a shape flip and swap its map; what else is in the batch does not change it.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong rank or value.
        RuntimeError: a field could not be solved to `tol`; see `solve_field`.

    Source: the complexity is that of Arslan and Tari, IEEE TIP 2020; the map: docs/method, "Where complexity sits".

    Example:
        >>> from torchlinf import complexity, shapes
        >>> shape = shapes.with_appendages((4, 4), [shapes.Appendage("right", width=2, depth=2)])
        >>> share = complexity_map(shape, spatial_ndim=2)
        >>> share[2]
        tensor([0.0130, 0.0000, 0.0000, 0.0130, 0.0938, 0.0938], dtype=torch.float64)
        >>> share.sum(), complexity(shape, spatial_ndim=2)
        (tensor(0.5306, dtype=torch.float64), tensor(0.5306, dtype=torch.float64))
    """
    measure = Measure.of(options, WindowOptions)
    if measure.estimator != "entropy":
        raise ValueError(
            f'estimator must be "entropy" for a map; got {measure.estimator!r}, which is no mean over pixels. '
            "Leave estimator out."
        )
    choice(method, ("auto", *METHODS), "method")
    real_dtype(dtype)
    shapes, lead = as_mask(mask, spatial_ndim)
    if uses_kernels(shapes, method):
        (on_host,) = to_host(shapes)
        shares = torch.from_numpy(_by_kernels(on_host.numpy(), lead, measure)).to(dtype or float_of(mask.device))
        (shares,) = to_device(mask.device, shares)
    else:
        shares = _in_torch(shapes, lead, measure, method)
    return shares.reshape(mask.shape).to(dtype or shares.dtype)


def _by_kernels(masks: NDArray[np.bool_], lead: tuple[int, ...], measure: Measure) -> NDArray[np.float64]:
    """The shares of the pixels of each shape (N, *spatial), several shapes at a time."""
    shares = np.zeros(masks.shape)

    def keep(i: int, box: tuple[slice, ...], field: NDArray[np.float64], distance: NDArray[np.int32]) -> None:
        counted = distance > 0
        level = distance[counted].astype(np.int64) - 1
        bins = ((field[counted] / field.max()) * measure.bins + EDGE_SLACK).astype(np.int64)
        cell = level * measure.bins + np.minimum(bins, measure.bins - 1)
        _, number, count = np.unique(cell, return_inverse=True, return_counts=True)
        size, radius = np.bincount(level), int(distance.max())
        length = length_within(np.arange(1, radius + 1), np.array(radius), measure.low, measure.high)
        weight = length / size / (measure.high - measure.low)
        shares[i][box][counted] = np.log2(size[level] / count[number]) * weight[level]

    radius = levels_of_each(masks.__getitem__, len(masks), lead, measure, keep).radius
    shares[radius.numpy() == 0] = np.nan
    return shares


def _in_torch(masks: Tensor, lead: tuple[int, ...], measure: Measure, method: str) -> Tensor:
    """The same in torch operations, all shapes at once."""
    problem, solution, levels = solved_levels(masks, lead, measure, method)
    field, radius = normalised(solution), levels.radius
    distance = rim(problem.distance) if measure.levels == "rim" else problem.distance
    counted = distance > 0
    shape = counted.nonzero()[:, 0]  # (pixels,) the shape that each pixel of a level belongs to
    number = distance[counted].long()  # (pixels,) the level k that it is on
    level = first_level(radius)[shape] + number - 1
    surprisal, size = level_surprisal(field[counted], level, int(radius.sum()), measure.bins)
    of, k = numbered(radius)
    length = torch.from_numpy(length_within(k, radius.numpy(force=True)[of], measure.low, measure.high)).to(field.dtype)
    shares = torch.zeros_like(field)
    shares[radius == 0] = torch.nan
    shares[counted] = surprisal / size * length.to(field.device)[level] / (measure.high - measure.low)
    return shares


def level_surprisal(values: Tensor, level: Tensor, num_levels: int, bins: int) -> tuple[Tensor, Tensor]:
    """How rare the bin of each value is on its level, in bits, and how many values its level has.

    Args:
        values: (P,) floating point, in [0, 1].
        level: (P,) int64, in [0, num_levels): the level each value belongs to.
        num_levels: number of levels.
        bins: number of bins.

    Returns:
        The surprisal and the size, two (P,) tensors of the dtype of `values`. The surprisal is exactly 0.0 where all
        values of the level share a bin; its mean over a level is `level_entropy`.

    Example:
        >>> values = torch.tensor([0.1, 0.3, 0.3, 0.3, 0.5], dtype=torch.float64)
        >>> level_surprisal(values, torch.tensor([0, 0, 0, 0, 1]), 2, 10)
        (tensor([2.0000, 0.4150, 0.4150, 0.4150, 0.0000], dtype=torch.float64),
         tensor([4., 4., 4., 4., 1.], dtype=torch.float64))
    """
    _, cell, count = torch.unique(level * bins + bin_of(values, bins), return_inverse=True, return_counts=True)
    size = torch.bincount(level, minlength=num_levels)[level].to(values.dtype)  # as integers they divide in float32
    return (size / count[cell]).log2(), size
