"""What every solver takes and returns."""

from dataclasses import dataclass

import torch
from torch import Tensor

# Ulps of max v below which no residual is asked for. A sweep rounds three numbers of up to 2 max v, so that its result
# has a residual of up to 3 ulps, and momentum adds about as much again; in float32 up to 5.5 ulps were seen to remain.
RESOLUTION = 8


@dataclass(frozen=True)
class Problem:
    """N shapes on one grid, each with its own screening.

    Attributes:
        mask: the shapes, `(N, *spatial)` bool.
        distance: d, int32 like `mask`.
        radius: D = max d, `(N,)` int32; 0 for an empty shape.
        screening: s = 1 / rho^2, `(N,)` float64 (float32 where the device has no float64); fixes the dtype of v.
        compile: whether the methods in torch operations fuse their sweeps by torch.compile.
    """

    mask: Tensor
    distance: Tensor
    radius: Tensor
    screening: Tensor
    compile: bool = False


@dataclass(frozen=True)
class Solved:
    """What a solver found, one entry a shape.

    Attributes:
        value: the field f, `(N, *spatial)`, not normalised, 0 outside.
        error_bound: certified bound of |value - f| / f over the shape, `(N,)`; inf if nothing is certified.
        num_sweeps: how often the stencil was applied to the shape, certificates included, `(N,)` int64.
        num_solves: linear solves, `(N,)` int64.
        status: `(N,)` int64, values of `torchlinf.Status`.
    """

    value: Tensor
    error_bound: Tensor
    num_sweeps: Tensor
    num_solves: Tensor
    status: Tensor


def certify(residuals: Tensor) -> Tensor:
    """Relative error bound from the residuals R(v) of each shape.

    With p = max R^+ < 1 and q = max R^-: v / (1 - p) has the residual (R - p) / (1 - p) <= 0, so it is nowhere below f,
    and v / (1 + q) has the residual (R + q) / (1 + q) >= 0, so it is nowhere above f. Hence -p f <= v - f <= q f.

    Args:
        residuals: `(N, P)`, 0 outside the shapes.

    Returns:
        `(N,)`: max(p, q), inf where p >= 1, NaN where the residual is not finite.

    >>> certify(torch.tensor([[0.25, -0.5], [1.5, 0.0]])).tolist()
    [0.5, inf]
    """
    low, high = residuals.aminmax(dim=1)
    bound = torch.maximum(-low, high)
    return torch.where(high >= 1, torch.inf, bound)
