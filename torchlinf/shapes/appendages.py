"""Boxes with smaller boxes on their faces."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from torchlinf._helpers.checks import choice, count, integer
from torchlinf.shapes._margin import with_margin

# Each face as its axis, counted from the last as in (depth, height, width), and whether it is the far end of that axis.
FACES = {
    "left": (-1, False),
    "right": (-1, True),
    "top": (-2, False),
    "bottom": (-2, True),
    "front": (-3, False),
    "back": (-3, True),
}


@dataclass(frozen=True)
class Appendage:
    """A box attached to a face of a body.

    Attributes:
        face: "left" or "right" (last dimension), "top" or "bottom" (last but one), "front" or "back" (third from last).
        width: contact width in pixels along the face, the same in every direction of it, 1 or more.
        depth: how far it reaches away from the face in pixels, 1 or more.
        offset: pixels between the low end of the face and the appendage, in every direction of the face; 0 is flush
            with the low corner, side - width with the high one. None centres it, rounded down.

    The arguments are checked where a shape is made of it, as by `with_appendages`.

    Example:
        >>> Appendage("right", width=2, depth=3)
        Appendage(face='right', width=2, depth=3, offset=None)
    """

    face: str
    width: int
    depth: int
    offset: int | None = None


def with_appendages(sides: Sequence[int], appendages: Sequence[Appendage], *, margin: int = 0) -> Tensor:
    """Box with smaller boxes attached to its faces.

    On a square body of side W an appendage of width w adds complexity at scales up to w/W and none above, wherever it
    is on the face.

    Args:
        sides: 1 to 3 sides of the body in pixels, each 1 or more.
        appendages: what to attach; none gives the box.
        margin: outside pixels beyond body and appendages on every side, 0 or more.

    Returns:
        bool tensor, the bounding box of the whole plus the margin.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: there are no sides or more than 3, a size is too small, the body does not have a face, or an
            appendage leaves its face.

    Example:
        >>> with_appendages((3, 3), [Appendage("right", width=1, depth=2), Appendage("top", 2, 1, offset=0)]).int()
        tensor([[1, 1, 0, 0, 0],
                [1, 1, 1, 0, 0],
                [1, 1, 1, 1, 1],
                [1, 1, 1, 0, 0]], dtype=torch.int32)
    """
    if not isinstance(sides, Sequence):
        raise TypeError(f"sides must be 1 to 3 numbers; got {sides!r}. Pass for example (128, 128).")
    for appendage in appendages:
        if not isinstance(appendage, Appendage):
            raise TypeError(
                f"appendages must hold Appendage objects; got {appendage!r}. "
                'Pass for example [Appendage("right", width=32, depth=48)].'
            )
    if not 1 <= len(sides) <= 3:
        raise ValueError(f"sides must be 1 to 3 numbers; got {len(sides)}. Pass one side for each dimension.")
    boxes = [[(0, count(side, "side")) for side in sides]] + [_place(appendage, sides) for appendage in appendages]
    low = [min(start for start, _ in spans) for spans in zip(*boxes, strict=True)]
    high = [max(stop for _, stop in spans) for spans in zip(*boxes, strict=True)]
    whole = np.zeros([stop - start for start, stop in zip(low, high, strict=True)], dtype=np.bool_)
    for spans in boxes:
        whole[tuple(slice(start - zero, stop - zero) for (start, stop), zero in zip(spans, low, strict=True))] = True
    return with_margin(whole, margin)


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
        TypeError: an argument is of the wrong type.
        ValueError: a face is unknown or repeated, or a size is out of range.

    Example:
        >>> cube_with_appendages(8, 2, ["left", "right", "top"]).shape
        torch.Size([8, 10, 12])
    """
    if isinstance(faces, str) or not isinstance(faces, Sequence):
        raise TypeError(f'faces must be a sequence of names; got {faces!r}. Pass for example ["left", "top"].')
    if len(set(faces)) < len(faces):
        raise ValueError(f"faces must differ from each other; got {list(faces)}. Name each face once.")
    appendages = [Appendage(face, width=appendage_side, depth=appendage_side) for face in faces]
    return with_appendages((side, side, side), appendages, margin=margin)


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
        start = integer(appendage.offset, "offset", 0)
    if not 0 <= start <= side - width:
        raise ValueError(
            f"width and offset must keep the appendage on its face of side {side}; got width={width}, "
            f"offset={appendage.offset}. Pass a width up to {side} and an offset up to {side} - width."
        )
    return start, start + width
