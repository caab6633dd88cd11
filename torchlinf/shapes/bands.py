"""Shapes of complexity zero that are no boxes: bands of constant width, and two squares on a diagonal."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from torchlinf._helpers.checks import count, integer, whole
from torchlinf.shapes._margin import with_margin


def band(points: Sequence[Sequence[int]], width: int, *, margin: int = 0) -> Tensor:
    """Band of constant width: what a square (or cube) covers on its way along a line with corners.

    The complexity is exactly 0: no ridge of the distance ends below its maximum, so the field depends on the distance
    alone. This does not hold where the band runs over itself or next to itself, nor where it turns from one diagonal
    to another.

    Args:
        points: the corners of the line in pixels, in the order of the tensor's dimensions (row, column); 1 or more,
            of 1 to 4 coordinates. Each step runs along an axis or a diagonal: all its differences other than 0 have
            the same size.
        width: side of the square in pixels, 1 or more.
        margin: outside pixels on every side, 0 or more.

    Returns:
        bool tensor, the bounding box of the band plus the margin. A line that is moved as a whole gives the same band.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument is too small; there are no points, or points of different dimensions; or a step runs in
            another direction.

    Example:
        >>> band([(0, 0), (3, 0), (3, 2)], width=2).int()
        tensor([[1, 1, 0, 0],
                [1, 1, 0, 0],
                [1, 1, 0, 0],
                [1, 1, 1, 1],
                [1, 1, 1, 1]], dtype=torch.int32)
    """
    width = count(width, "width")
    low = _starts(points)
    low = low - low.amin(dim=0)
    whole = np.zeros((low.amax(dim=0) + width).tolist(), dtype=np.bool_)
    for corner in low.tolist():
        whole[tuple(slice(start, start + width) for start in corner)] = True
    return with_margin(whole, margin)


def diagonal_pair(side: int, shift: int, *, margin: int = 0) -> Tensor:
    """Two equal squares, the second moved down and to the right; the complexity is exactly 0.

    Args:
        side: side of each square in pixels, 1 or more.
        shift: how far the second is moved in either direction, from 0 (one square) over side / 2 (a quarter of each
            square overlaps) to `side` (the squares touch in a corner).
        margin: outside pixels on every side, 0 or more.

    Returns:
        bool tensor of side `side` + `shift` + 2 margin.

    Raises:
        TypeError: an argument is no integer.
        ValueError: an argument is out of range.

    Example:
        >>> diagonal_pair(2, 1).int()
        tensor([[1, 1, 0],
                [1, 1, 1],
                [0, 1, 1]], dtype=torch.int32)
    """
    side, shift = count(side, "side"), integer(shift, "shift", 0)
    if shift > side:
        raise ValueError(f"shift must be from 0 to side={side}; got {shift}. Pass side for squares that touch.")
    whole = np.zeros((side + shift, side + shift), dtype=np.bool_)
    whole[:side, :side] = whole[shift:, shift:] = True
    return with_margin(whole, margin)


def _starts(points: Sequence[Sequence[int]]) -> Tensor:
    """Where the square stands at every step of the line: (steps, ndim)."""
    if not isinstance(points, Sequence) or not all(isinstance(point, Sequence) for point in points):
        raise TypeError(f"points must be a sequence of corners; got {points!r}. Pass for example [(0, 0), (30, 0)].")
    if not points or not 1 <= len(points[0]) <= 4 or any(len(point) != len(points[0]) for point in points):
        raise ValueError(
            f"points must be 1 or more, of the same 1 to 4 coordinates; got {list(points)}. "
            "Pass for example [(0, 0), (30, 0)]."
        )
    corners = torch.tensor([[whole(x, "points") for x in point] for point in points], device="cpu")  # (P, ndim)
    line = [corners[:1]]
    for start, stop in pairwise(corners):
        steps = int((stop - start).abs().max())
        if ((stop - start).abs() % max(steps, 1)).any():
            raise ValueError(
                "points must follow each other along an axis or a diagonal; "
                f"got {start.tolist()} to {stop.tolist()}. Put a corner between them."
            )
        line.append(start + (stop - start).sign() * torch.arange(1, steps + 1, device="cpu")[:, None])
    return torch.cat(line)
