"""Line-drawn floor plans: rooms, the walls between them, apertures in the walls, and an obstacle."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.checks import count, integer
from torchlinf.shapes._margin import with_margin

# Aperture in pixels, and sides of the obstacle, of the plans P0 to P3 with rooms of side 128.
PLANS = ((0, (0, 0)), (32, (0, 0)), (32, (32, 4)), (80, (0, 0)))


def floor_plan(number: int, *, margin: int = 0) -> Tensor:
    """One of four floor plans: two by two rooms of side 128 behind walls 4 pixels thick.

    | plan | apertures | obstacle | complexity is zero |
    |---|---|---|---|
    | 0 | none | none | at all scales |
    | 1 | 32 | none | above scale 32 / 128 = 0.25 |
    | 2 | 32 | 32 x 4 | above 31 / 64 = 0.484 |
    | 3 | 80 | none | above 80 / 128 = 0.625 |

    Args:
        number: which plan, from 0 to 3.
        margin: outside pixels around the plan, which ends with the rooms: the outer walls are not drawn; 0 or more.

    Returns:
        bool tensor (260 + 2 margin, 260 + 2 margin), True where one can stand; its radius D is 64.

    Raises:
        TypeError: an argument is no integer.
        ValueError: an argument is out of range.

    Source: P0 to P3 of Arslan and Tari (2020), whose sizes these are, with the obstacle in the upper right room. How
    thick the walls are is not in the text. It makes P3 from P2 by wider apertures; but that P3 is simpler than P2 at
    low scales holds only without the obstacle. Their P4, the drawing they started from, is not described.

    Example:
        >>> floor_plan(3, margin=2).shape
        torch.Size([264, 264])
    """
    if integer(number, "number", 0) >= len(PLANS):
        raise ValueError(f"number must be from 0 to {len(PLANS) - 1}; got {number}. Pass 0 for the closed rooms.")
    aperture, obstacle = PLANS[number]
    return rooms(2, 2, aperture=aperture, obstacle=obstacle, margin=margin)


def rooms(
    rows: int,
    columns: int,
    *,
    side: int = 128,
    wall: int = 4,
    aperture: int = 0,
    obstacle: tuple[int, int] = (0, 0),
    margin: int = 0,
) -> Tensor:
    """Square rooms in rows and columns, an aperture in the middle of every wall between two of them.

    An aperture adds complexity at scales up to aperture / side and at none above, like an appendage of that width.

    Args:
        rows: number of rooms from top to bottom, 1 or more.
        columns: number of rooms from left to right, 1 or more.
        side: side of a room in pixels, 1 or more.
        wall: thickness of the walls in pixels, 1 or more.
        aperture: width of the apertures in pixels, from 0 (none) to `side`.
        obstacle: (height, width) in pixels of an outside box in the middle of the upper right room, each from 0 to
            `side`; a 0 means none.
        margin: outside pixels on every side, 0 or more.

    Returns:
        bool tensor, the bounding box of the rooms plus the margin.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument is out of range.

    Example:
        >>> rooms(1, 2, side=4, wall=1, aperture=2).int()
        tensor([[1, 1, 1, 1, 0, 1, 1, 1, 1],
                [1, 1, 1, 1, 1, 1, 1, 1, 1],
                [1, 1, 1, 1, 1, 1, 1, 1, 1],
                [1, 1, 1, 1, 0, 1, 1, 1, 1]], dtype=torch.int32)
    """
    side, wall = count(side, "side"), count(wall, "wall")
    if not isinstance(obstacle, Sequence) or len(obstacle) != 2:
        raise TypeError(f"obstacle must be a pair (height, width); got {obstacle!r}. Pass (0, 0) for none.")
    for name, length in (("aperture", aperture), ("obstacle", obstacle[0]), ("obstacle", obstacle[1])):
        if integer(length, name, 0) > side:
            raise ValueError(f"{name} must fit into a room of side {side}; got {length}. Pass {side} or less.")
    numbers = count(rows, "rows"), count(columns, "columns")
    sides = (n * (side + wall) - wall for n in numbers)
    row, column = (np.arange(size) % (side + wall) for size in sides)  # counted in each room
    row = row[:, None]
    plan = (row < side) & (column < side)
    plan |= _middle(row, side, aperture) & (column >= side)
    plan |= (row >= side) & _middle(column, side, aperture)
    plan[:side, -side:] &= ~(_middle(row, side, obstacle[0]) & _middle(column, side, obstacle[1]))[:side, -side:]
    return with_margin(plan, margin)


def _middle(place: NDArray[np.int64], side: int, length: int) -> NDArray[np.bool_]:
    """Whether a place is within the middle `length` of a room."""
    start = (side - length) // 2
    return (place >= start) & (place < start + length)
