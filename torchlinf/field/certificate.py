"""The certificate: a relative error bound of the field, from the residual of the equation."""

import torch
from torch import Tensor

# Relative error that the rounding of a residual in float64 can hide, for each unit of max v: it is three sums of
# numbers of at most max v, each rounded once.
ROUNDING = 4 * 2.0**-52

# Ulps of max v below which no residual is asked for. A sweep rounds three numbers of up to 2 max v, so that its result
# has a residual of up to 3 ulps, and momentum adds about as much again; in float32 up to 5.5 ulps were seen to remain.
RESOLUTION = 8


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
    low, high = residuals.amin(dim=1), residuals.amax(dim=1)  # on a CPU aminmax takes eight times as long
    bound = torch.maximum(-low, high)
    return torch.where(high >= 1, torch.inf, bound)
