"""Squares, boxes, discs and what lies between."""

import math

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.checks import count, positive
from torchlinf.shapes._margin import with_margin


def square(side: int, *, margin: int = 0) -> Tensor:
    """Axis-aligned square; its complexity is exactly 0.

    Args:
        side: side in pixels, 1 or more.
        margin: outside pixels on every side, 0 or more.

    Returns:
        bool tensor (side + 2 margin, side + 2 margin).

    Raises:
        TypeError: an argument is no integer.
        ValueError: an argument is too small.

    Example:
        >>> square(2, margin=1).int()
        tensor([[0, 0, 0, 0],
                [0, 1, 1, 0],
                [0, 1, 1, 0],
                [0, 0, 0, 0]], dtype=torch.int32)
    """
    return box(side, side, margin=margin)


def box(*sides: int, margin: int = 0) -> Tensor:
    """Axis-aligned box in as many dimensions as sides are given; its complexity is exactly 0.

    Args:
        *sides: 1 to 4 sides in pixels, each 1 or more, in the order of the tensor's dimensions.
        margin: outside pixels on every side, 0 or more.

    Returns:
        bool tensor of the sides plus 2 margin each.

    Raises:
        TypeError: an argument is no integer.
        ValueError: an argument is too small, or there are no sides or more than 4.

    Example:
        >>> box(2, 3).shape, box(5, margin=1).int()
        (torch.Size([2, 3]), tensor([0, 1, 1, 1, 1, 1, 0], dtype=torch.int32))
    """
    if not 1 <= len(sides) <= 4:
        raise ValueError(f"sides must be 1 to 4 numbers; got {len(sides)}. Pass one side for each dimension.")
    return with_margin(np.ones([count(side, "side") for side in sides], dtype=np.bool_), margin)


def rectangle(height: int, width: int, *, margin: int = 0) -> Tensor:
    """Axis-aligned rectangle; its complexity is exactly 0.

    Args:
        height: rows, 1 or more.
        width: columns, 1 or more.
        margin: outside pixels on every side, 0 or more.

    Returns:
        bool tensor (height + 2 margin, width + 2 margin).

    Raises:
        TypeError: an argument is no integer.
        ValueError: an argument is too small.

    Example:
        >>> rectangle(1, 3, margin=1).int()
        tensor([[0, 0, 0, 0, 0],
                [0, 1, 1, 1, 0],
                [0, 0, 0, 0, 0]], dtype=torch.int32)
    """
    return box(count(height, "height"), count(width, "width"), margin=margin)


def disc(radius: float, *, margin: int = 0) -> Tensor:
    """Digital disc x^2 + y^2 <= radius^2 around the centre of a pixel.

    Args:
        radius: Euclidean radius in pixels, above 0. The chessboard radius D of the disc is smaller, about 0.71 radius.
        margin: outside pixels on every side, 0 or more.

    Returns:
        bool tensor of side 2 floor(radius) + 1 + 2 margin.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument is not finite, or too small.

    Example:
        >>> disc(2).int()
        tensor([[0, 0, 1, 0, 0],
                [0, 1, 1, 1, 0],
                [1, 1, 1, 1, 1],
                [0, 1, 1, 1, 0],
                [0, 0, 1, 0, 0]], dtype=torch.int32)
    """
    squares = _offsets(positive(radius, "radius")) ** 2
    return with_margin(squares[:, None] + squares <= radius**2, margin)


def superellipse(radius: float, exponent: float, *, margin: int = 0) -> Tensor:
    """Digital superellipse |x|^exponent + |y|^exponent <= radius^exponent around the centre of a pixel.

    From a diamond (1) over the disc (2) it approaches the square as the exponent grows.

    Args:
        radius: half the width in pixels, above 0.
        exponent: above 0; below 1 the sides bend inwards.
        margin: outside pixels on every side, 0 or more.

    Returns:
        bool tensor of side 2 floor(radius) + 1 + 2 margin.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument is not finite, or too small.

    Example:
        >>> superellipse(2, 1).int()
        tensor([[0, 0, 1, 0, 0],
                [0, 1, 1, 1, 0],
                [1, 1, 1, 1, 1],
                [0, 1, 1, 1, 0],
                [0, 0, 1, 0, 0]], dtype=torch.int32)
    """
    powers = (np.abs(_offsets(positive(radius, "radius"))) / radius) ** positive(exponent, "exponent")
    # Points that lie on the curve exactly, such as (3, 4) for radius 5, must not fall out by rounding.
    return with_margin(powers[:, None] + powers <= 1 + 4 * np.finfo(powers.dtype).eps, margin)


def _offsets(radius: float) -> NDArray[np.float64]:
    reach = math.floor(radius)
    return np.arange(-reach, reach + 1, dtype=np.float64)
