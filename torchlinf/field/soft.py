"""Soft distance and soft field of a probability: means over thresholds, which on binary masks are the hard ones.

A probability m in [0, 1] is the mean of its slices, m = (o_1 + ... + o_L) / L with o_l = L m - (l - 1) cut to [0, 1]:
o_l is 1 where m is above the l-th of L equal intervals and 0 where it is below. On a binary mask all slices are that
mask. As L grows they become the superlevel sets of m.
"""

import math

import torch
from torch import Tensor

from torchlinf._helpers.checks import as_mask, count, plain, positive, positive_tensor
from torchlinf._helpers.transfer import float_of
from torchlinf.field.adjoint import attach_gradient
from torchlinf.field.erosions import soft_distance_of
from torchlinf.field.solution import FieldSolution, Status
from torchlinf.field.solve import largest, normalised
from torchlinf.field.weighted import solve_weighted

LEAST = 1e-12  # occupancy below which a pixel counts as outside


def as_probability(probability: Tensor, spatial_ndim: int | None) -> tuple[Tensor, tuple[int, ...]]:
    """Check a probability and lay its shapes in a row: (N, *spatial), and the batch shape; halves become float32."""
    if not isinstance(probability, Tensor):
        kind = type(probability).__name__
        raise TypeError(f"probability must be a torch.Tensor; got {kind}. Pass torch.as_tensor(probability).")
    if not probability.is_floating_point():
        raise TypeError(f"probability must be floating point; got {probability.dtype}. Pass mask.float().")
    batch_shape = as_mask(torch.zeros_like(probability, dtype=torch.bool), spatial_ndim, "probability")[1]
    if probability.numel():
        least, most = (bound.item() for bound in probability.detach().aminmax())
        # A sum of probabilities may be rounded to a little above 1.
        if not 0 <= least <= most <= 1 + 4 * torch.finfo(probability.dtype).eps:
            raise ValueError(
                f"probability must lie in [0, 1]; got values from {least:g} to {most:g}. "
                "Pass torch.sigmoid(logits), or torch.softmax(logits, dim=1)."
            )
    dtype = torch.promote_types(probability.dtype, torch.float32)
    shapes = probability.to(dtype).reshape(math.prod(batch_shape), *probability.shape[len(batch_shape) :])
    return _cut(shapes), batch_shape


def soft_chessboard_distance(probability: Tensor, *, spatial_ndim: int | None = None) -> Tensor:
    """Chessboard distance of a grey mask: the mean, over thresholds, of the distance of what lies above the threshold.

    It is the sum of the mask and all its erosions, m + N m + N N m + ..., where N is the minimum over the 3^n block.

    Args:
        probability: (B, C, *spatial) with 1 to 4 spatial dimensions, floating point in [0, 1], any device.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.

    Returns:
        Tensor like `probability`, in pixels: on a binary mask exactly `chessboard_distance`, 0 where the probability is
        0, all zeros for an empty mask. Differentiable once, in memory that grows like the square root of the radius;
        neighbours that tie share the derivative, and pixels of probability 0 have none. float16 and bfloat16 are
        computed in float32. `torch.compile` breaks its graph here, so that `fullgraph=True` raises.

    Raises:
        TypeError: `probability` is no floating-point tensor.
        ValueError: `probability` has a wrong rank, a spatial dimension of size 0, or values outside [0, 1].

    Example:
        >>> soft_chessboard_distance(torch.tensor([0.0, 1.0, 1.0, 1.0, 0.5]), spatial_ndim=1)
        tensor([0.0000, 1.0000, 2.0000, 1.5000, 0.5000])
    """
    shapes, batch_shape = as_probability(probability, spatial_ndim)
    return soft_distance_of(shapes).reshape(*batch_shape, *shapes.shape[1:]).to(probability.dtype)


def soft_linf_field(
    probability: Tensor,
    *,
    rho: float | Tensor | None = None,
    slices: int = 4,
    tol: float = 1e-9,
    spatial_ndim: int | None = None,
) -> Tensor:
    """The field of a grey mask: the mean over slices of f = o (M f + N f + 1) / (2 + 1/rho^2), normalised to maximum 1.

    Each slice is first divided by its largest value, with which its field is then multiplied. Within a slice,
    occupancy o below 1 acts as a screening of its own, (2 + 1/rho^2) (1 - o) / o, which is strong: the more slices, the
    less of the mask is grey in each, and the closer is the result to the mean of the hard fields over thresholds, as
    `soft_chessboard_distance` is the mean of the hard distances.

    Args:
        probability: (B, C, *spatial) with 1 to 4 spatial dimensions, floating point in [0, 1].
        rho: screening length in pixels, a number or a tensor that broadcasts to the batch shape; None means the
            largest soft distance of each slice, but at least 1.
        slices: number of equal intervals of the probability, 1 or more; time and memory grow with it, but on a binary
            mask.
        tol: relative error of the field of each slice, a number above 0; the bound is proven at every pixel.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.

    Returns:
        Tensor like `probability`, in [0, 1]; on a binary mask that is `linf_field` up to `tol`. All zeros for an empty
        mask; a full mask is a box. Differentiable once, with respect to `probability` and `rho`, by the implicit
        function theorem: one linear solve a slice. It is computed in float64 (float32 on devices without it), and
        returned in the dtype of `probability`. `torch.compile` breaks its graph here, so that `fullgraph=True`
        raises.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong rank or value.
        RuntimeError: the field, or in the backward pass its gradient, could not be solved.

    Example:
        >>> soft_linf_field(torch.ones(1, 1, 3, 4))[0, 0, 1]
        tensor([0.6923, 1.0000, 1.0000, 0.6923])
    """
    plain(rho, "rho")
    shapes, batch_shape = as_probability(probability, spatial_ndim)
    number, tol = count(slices, "slices"), positive(tol, "tol")
    parts = []
    number = number_of_slices(shapes, number)
    for low in range(number):
        occupancy, reached = occupancy_of(shapes, number, low)
        field = occupied_field(occupancy, length_of(rho, batch_shape, soft_distance_of(occupancy)), tol)
        parts.append(field * reached.view(-1, *[1] * (field.ndim - 1)))
    return normalised(torch.stack(parts).sum(dim=0)).reshape(*batch_shape, *shapes.shape[1:]).to(probability.dtype)


def number_of_slices(shapes: Tensor, slices: int) -> int:
    """How many slices are to be taken: a binary mask needs one."""
    return slices if bool(((shapes > 0) & (shapes < 1)).any()) else 1


def occupancy_of(shapes: Tensor, number: int, low: int) -> tuple[Tensor, Tensor]:
    """One of `number` slices of `(N, *spatial)` in float64, divided by its largest value, and that, `(N,)`.

    So a mask of one grey is the mask, and thresholds that leave nothing do not count.
    """
    shapes = shapes.to(float_of(shapes.device))
    part = shapes if number == 1 else _cut(number * shapes - low)
    most = largest(part)
    return part / torch.where(most > LEAST, most, 1).view(-1, *[1] * (part.ndim - 1)), most


def _cut(x: Tensor) -> Tensor:
    """x cut to [0, 1], with the derivative 1 on both ends, so that a binary mask is not cut off from the gradient."""
    return torch.where((x >= 0) & (x <= 1), x, x.detach().clamp(0, 1))


def length_of(rho: float | Tensor | None, batch_shape: tuple[int, ...], distance: Tensor) -> Tensor:
    """rho of every shape, `(N,)` float64."""
    if isinstance(rho, Tensor):
        positive_tensor(rho, batch_shape, "rho")
        return rho.to(distance).broadcast_to(batch_shape).reshape(-1)
    if rho is not None:
        return distance.new_full((len(distance),), positive(rho, "rho"))
    return largest(distance).clamp(min=1)


def occupied_field(occupancy: Tensor, length: Tensor, tol: float, known: list[FieldSolution] | None = None) -> Tensor:
    """f = o (M f + N f + 1) / (2 + 1/rho^2) of `(N, *spatial)`, differentiable by o and rho.

    If a list is given, the solution is put there the first time, and not solved for again the next.
    """
    known = [] if known is None else known
    s = length.reshape(-1, *[1] * (occupancy.ndim - 1)) ** -2
    weight = occupancy / (2 + s)
    if not known:
        known.append(solve_weighted(torch.where(weight.detach() > LEAST, weight.detach(), 0), tol))
    solved = known[0]
    if (solved.status == Status.MAX_SWEEPS).any():
        raise RuntimeError(
            f"every shape must be certified to tol={tol:g}; the error bound of one is "
            f"{solved.error_bound.max().item():.2g}. Pass a larger tol."
        )
    return attach_gradient(solved.value, weight, solved.error_bound)
