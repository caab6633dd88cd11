"""Openings and closings of boolean tensors by boxes, in torch operations."""

from collections.abc import Callable

import torch
from torch import Tensor


def opened(inside: Tensor, sides: tuple[int, ...]) -> Tensor:
    """The union of all boxes of these sides that lie in the shape; (N, *spatial) bool.

    Example:
        >>> opened(torch.tensor([[True, False, True, True]]), (2,))
        tensor([[False, False,  True,  True]])
    """
    x = inside.view(torch.uint8)
    if any(side > size for side, size in zip(sides, inside.shape[1:], strict=True)):
        return torch.zeros_like(inside)
    for dim, side in enumerate(sides, start=1):
        x = _window(torch.minimum, x, dim, side)
    for dim, side in enumerate(sides, start=1):
        around = [0, 0] * (x.ndim - dim - 1) + [side - 1, side - 1]
        x = _window(torch.maximum, torch.nn.functional.pad(x, around), dim, side)
    return x.view(torch.bool)


def closed(inside: Tensor, sides: tuple[int, ...]) -> Tensor:
    """The complement of all boxes of these sides that lie outside the shape, beyond the array or not.

    Example:
        >>> closed(torch.tensor([[True, False, True, False]]), (2,))
        tensor([[ True,  True,  True, False]])
    """
    # A box that is longer than the array meets the same rows of it as one of the array's own length; padding by the
    # longer one would cost the n-th power of it.
    sides = tuple(min(side, size) for side, size in zip(sides, inside.shape[1:], strict=True))
    around = [side for side in reversed(sides) for _ in (0, 1)]
    outside = opened(~torch.nn.functional.pad(inside, around), sides)
    return ~outside[:, *(slice(side, -side) for side in sides)]


def _window(extremum: Callable[..., Tensor], x: Tensor, dim: int, side: int) -> Tensor:
    """Extremum over the windows of `side` pixels along a dimension that lie in the array."""
    width = 1
    while width < side:
        step = min(width, side - width)
        size = x.shape[dim] - step
        x = extremum(x.narrow(dim, 0, size), x.narrow(dim, step, size))
        width += step
    return x
