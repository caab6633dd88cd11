"""Outside pixels around a shape, which every function of the package offers."""

from numbers import Integral

import torch
from torch import Tensor


def with_margin(shape: Tensor, margin: int) -> Tensor:
    """Return the shape with `margin` outside pixels on every side."""
    return torch.nn.functional.pad(shape, [from_zero(margin, "margin")] * (2 * shape.ndim))


def from_zero(value: object, name: str) -> int:
    """Return the value as an int of 0 or more, or raise with the remedy."""
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise TypeError(f"{name} must be an integer of 0 or more; got {value!r}. Pass an int.")
    if value < 0:
        raise ValueError(f"{name} must be an integer of 0 or more; got {value!r}. Pass 0 for none.")
    return int(value)
