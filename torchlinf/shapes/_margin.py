"""Outside pixels around a shape, which every function of the package offers."""

import torch
from torch import Tensor

from torchlinf._helpers.checks import integer


def with_margin(shape: Tensor, margin: int) -> Tensor:
    """Return the shape with `margin` outside pixels on every side."""
    return torch.nn.functional.pad(shape, [integer(margin, "margin", 0)] * (2 * shape.ndim))
