"""What a solver is given: shapes with their distance, radius and screening."""

from dataclasses import dataclass

import torch
from torch import Tensor

from torchlinf._helpers.boxes import maxima
from torchlinf._helpers.checks import positive, positive_tensor
from torchlinf._helpers.transfer import float_of
from torchlinf.field.distance import distance_of


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

    def select(self, shapes: Tensor) -> "Problem":
        """The problem of the shapes with these indices."""
        mask, distance, radius = self.mask[shapes], self.distance[shapes], self.radius[shapes]
        return Problem(mask, distance, radius, self.screening[shapes], self.compile)


def pose(mask: Tensor, rho: float | Tensor | None, batch_shape: tuple[int, ...], compile: bool = False) -> Problem:
    """The problem of a checked mask, bool (N, *spatial), with the screening rho of the batch shape."""
    distance = distance_of(mask)
    radius = maxima(distance)
    length = radius.clamp(min=1).to(float_of(mask.device))
    if isinstance(rho, Tensor):
        length = positive_tensor(rho, batch_shape, "rho").to(length).reshape(-1)
    elif rho is not None:
        length = torch.full_like(length, positive(rho, "rho"))
    return Problem(mask, distance, radius, length**-2, compile)
