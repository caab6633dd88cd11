"""Shapes of the paper as boolean tensors `(*spatial)`, True inside.

They carry no batch dimensions: pass `spatial_ndim=2` (or 1, 3) beside them, or `torch.stack` several of one size. All
are deterministic, on the CPU, and hold no more than their bounding box unless a `margin` of outside pixels is asked
for; the library counts everything beyond the array as outside anyway.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral

import torch
from torch import Tensor

from torchlinf._checks import choice, count, positive

# Each face as its axis, counted from the last as in (depth, height, width), and whether it is the far end of that axis.
FACES = {
    "left": (-1, False),
    "right": (-1, True),
    "top": (-2, False),
    "bottom": (-2, True),
    "front": (-3, False),
    "back": (-3, True),
}


def square(side: int, *, margin: int = 0) -> Tensor:
    """Axis-aligned square; its complexity is exactly 0.

    Args:
        side: side in pixels, 1 or more.
        margin: outside pixels on every side, 0 or more.

    Returns:
        bool tensor (side + 2 margin, side + 2 margin).

    Raises:
        TypeError, ValueError: an argument is no integer, or too small.

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
        TypeError, ValueError: an argument is no integer or too small, or there are no sides or more than 4.

    Example:
        >>> box(2, 3).shape, box(5, margin=1).int()
        (torch.Size([2, 3]), tensor([0, 1, 1, 1, 1, 1, 0], dtype=torch.int32))
    """
    if not 1 <= len(sides) <= 4:
        raise ValueError(f"sides must be 1 to 4 numbers; got {len(sides)}. Pass one side for each dimension.")
    return _with_margin(torch.ones([count(side, "side") for side in sides], dtype=torch.bool), margin)


def disc(radius: float, *, margin: int = 0) -> Tensor:
    """Digital disc x^2 + y^2 <= radius^2 around the centre of a pixel.

    Args:
        radius: Euclidean radius in pixels, above 0. The chessboard radius D of the disc is smaller, about 0.71 radius.
        margin: outside pixels on every side, 0 or more.

    Returns:
        bool tensor of side 2 floor(radius) + 1 + 2 margin.

    Raises:
        TypeError, ValueError: an argument is no number, not finite or too small.

    Example:
        >>> disc(2).int()
        tensor([[0, 0, 1, 0, 0],
                [0, 1, 1, 1, 0],
                [1, 1, 1, 1, 1],
                [0, 1, 1, 1, 0],
                [0, 0, 1, 0, 0]], dtype=torch.int32)
    """
    squares = _offsets(positive(radius, "radius")).square()
    return _with_margin(squares[:, None] + squares <= radius**2, margin)


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
        TypeError, ValueError: an argument is no number, not finite or too small.

    Example:
        >>> superellipse(2, 1).int()
        tensor([[0, 0, 1, 0, 0],
                [0, 1, 1, 1, 0],
                [1, 1, 1, 1, 1],
                [0, 1, 1, 1, 0],
                [0, 0, 1, 0, 0]], dtype=torch.int32)
    """
    powers = (_offsets(positive(radius, "radius")).abs() / radius) ** positive(exponent, "exponent")
    # Points that lie on the curve exactly, such as (3, 4) for radius 5, must not fall out by rounding.
    return _with_margin(powers[:, None] + powers <= 1 + 4 * torch.finfo(powers.dtype).eps, margin)


@dataclass(frozen=True)
class Appendage:
    """A box attached to a face of a body.

    Attributes:
        face: "left" or "right" (last dimension), "top" or "bottom" (last but one), "front" or "back" (third from last).
        width: contact width in pixels along the face, the same in every direction of it, 1 or more.
        depth: how far it reaches away from the face in pixels, 1 or more.
        offset: pixels between the low end of the face and the appendage, in every direction of the face; 0 is flush
            with the low corner, side - width with the high one. None centres it, rounded down.
    """

    face: str
    width: int
    depth: int
    offset: int | None = None


def with_appendages(sides: Sequence[int], appendages: Sequence[Appendage], *, margin: int = 0) -> Tensor:
    """Box with smaller boxes attached to its faces.

    On a square body of side W an appendage of width w adds complexity at scales up to w/W and none above, wherever on
    the face it is.

    Args:
        sides: 1 to 3 sides of the body in pixels, each 1 or more.
        appendages: what to attach; none gives the box.
        margin: outside pixels beyond body and appendages on every side, 0 or more.

    Returns:
        bool tensor, the bounding box of the whole plus the margin.

    Raises:
        TypeError, ValueError: an argument of the wrong type, a face that the body has not, an appendage that leaves its
            face, or a size too small.

    Example:
        >>> with_appendages((3, 3), [Appendage("right", width=1, depth=2), Appendage("top", 2, 1, offset=0)]).int()
        tensor([[1, 1, 0, 0, 0],
                [1, 1, 1, 0, 0],
                [1, 1, 1, 1, 1],
                [1, 1, 1, 0, 0]], dtype=torch.int32)
    """
    if not 1 <= len(sides) <= 3:
        raise ValueError(f"sides must be 1 to 3 numbers; got {len(sides)}. Pass one side for each dimension.")
    boxes = [[(0, count(side, "side")) for side in sides]] + [_place(appendage, sides) for appendage in appendages]
    low = [min(start for start, _ in spans) for spans in zip(*boxes, strict=True)]
    high = [max(stop for _, stop in spans) for spans in zip(*boxes, strict=True)]
    whole = torch.zeros([stop - start for start, stop in zip(low, high, strict=True)], dtype=torch.bool)
    for spans in boxes:
        whole[tuple(slice(start - zero, stop - zero) for (start, stop), zero in zip(spans, low, strict=True))] = True
    return _with_margin(whole, margin)


def cube_with_appendages(side: int, appendage_side: int, faces: Sequence[str], *, margin: int = 0) -> Tensor:
    """Cube with one smaller cube centred on each of the given faces.

    Args:
        side: side of the body in voxels, 1 or more.
        appendage_side: side of every appended cube in voxels, from 1 to `side`.
        faces: any of "left", "right", "top", "bottom", "front", "back", each at most once; none gives the cube.
        margin: outside voxels beyond body and appendages on every side, 0 or more.

    Returns:
        bool tensor (depth, height, width), the bounding box of the whole plus the margin.

    Raises:
        TypeError, ValueError: an argument of the wrong type, an unknown or repeated face, or a size out of range.

    Example:
        >>> cube_with_appendages(8, 2, ["left", "right", "top"]).shape
        torch.Size([8, 10, 12])
    """
    if len(set(faces)) < len(faces):
        raise ValueError(f"faces must differ from each other; got {list(faces)}. Name each face once.")
    appendages = [Appendage(face, width=appendage_side, depth=appendage_side) for face in faces]
    return with_appendages((side, side, side), appendages, margin=margin)


def _offsets(radius: float) -> Tensor:
    reach = math.floor(radius)
    return torch.arange(-reach, reach + 1, dtype=torch.float64)


def _with_margin(shape: Tensor, margin: int) -> Tensor:
    return torch.nn.functional.pad(shape, [_from_zero(margin, "margin")] * (2 * shape.ndim))


def _from_zero(value: object, name: str) -> int:
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise TypeError(f"{name} must be an integer of 0 or more; got {value!r}. Pass an int.")
    if value < 0:
        raise ValueError(f"{name} must be an integer of 0 or more; got {value!r}. Pass 0 for none.")
    return int(value)


def _place(appendage: Appendage, sides: Sequence[int]) -> list[tuple[int, int]]:
    """Where the appendage starts and stops along each axis, counted from the low corner of the body."""
    choice(appendage.face, tuple(FACES)[: 2 * len(sides)], "face")
    axis, far = FACES[appendage.face]
    depth = count(appendage.depth, "depth")
    outwards = (sides[axis], sides[axis] + depth) if far else (-depth, 0)
    return [outwards if i == axis + len(sides) else _along_face(appendage, side) for i, side in enumerate(sides)]


def _along_face(appendage: Appendage, side: int) -> tuple[int, int]:
    """Where the appendage starts and stops along a face of that side."""
    width = count(appendage.width, "width")
    start = (side - width) // 2
    if appendage.offset is not None:
        start = _from_zero(appendage.offset, "offset")
    if not 0 <= start <= side - width:
        raise ValueError(
            f"width and offset must keep the appendage on its face of side {side}; got width={width}, "
            f"offset={appendage.offset}. Pass a width up to {side} and an offset up to {side} - width."
        )
    return start, start + width
