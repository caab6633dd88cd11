"""Frames: the smallest rectangle around a shape, and a mask turned into another frame.

Angles are in degrees and turn counter-clockwise as an image is seen, with the row axis down: from the first axis
towards the second, as `numpy.rot90` turns. For points (x, y) with y up that is counter-clockwise too.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torchlinf._helpers.boxes import bounding_box

# Turning must save this share of the area of the box along the axes: shapes along the axes stay as they are.
LEAST_SAVING = 0.01
# Degrees by which the direction of the smallest rectangle is moved at most, to suit the other sides of the outline.
MOST_MOVED = 0.5
_EQUAL = 1e-9  # areas that differ by a smaller share of the box are equal
_NEVER = -10.0  # radians: no side is put along an axis
_SLACK = 1e-6  # radians: an angle on the border of what a side allows is allowed, whatever its rounding


@dataclass(frozen=True)
class Rectangle:
    """The smallest rectangle around points, by area.

    Attributes:
        angle: degrees in (-45, 45] by which the points must be turned so that the rectangle stands along the axes.
        area: of the rectangle, 0.0 or more.
        sides: of the rectangle after the turn, along the first and the second axis.
        box_area: of the box along the axes that holds the points as they are; never less than `area`.
    """

    angle: float
    area: float
    sides: tuple[float, float]
    box_area: float

    @property
    def saves(self) -> bool:
        """Whether it is at least 1 % smaller than the box along the axes. If not, a shape is not turned."""
        return self.area < (1 - LEAST_SAVING) * self.box_area


def smallest_rectangle(points: ArrayLike) -> Rectangle:
    """The rectangle of least area that holds points in the plane, exactly: a side of it lies on an edge of the hull.

    Of rectangles of the same area the one with the least turn is taken, then the one with a positive angle. So turning
    the points by 90 degrees changes nothing but which side is which.

    Args:
        points: (N, 2) finite numbers, N >= 1: rows and columns, or x and y. Of map coordinates take off an origin near
            the points first: the areas then keep their digits.

    Returns:
        The `Rectangle`; of a single point, or of points on one line, it has area 0.

    Raises:
        ValueError: not (N, 2), no points, or numbers that are not finite.

    Source: Freeman and Shapira, "Determining the minimum-area encasing rectangle for an arbitrary closed curve", 1975.

    Example:
        >>> smallest_rectangle([(0, 0), (2, 1), (1, 3), (-1, 2)])
        Rectangle(angle=-26.56505117707799, area=5.0, sides=(2.23606797749979, 2.23606797749979), box_area=9.0)
    """
    from torchlinf.kernels.outlines import hull

    at = np.asarray(points, dtype=np.float64)
    if at.ndim != 2 or at.shape[1] != 2 or len(at) == 0 or not np.isfinite(at).all():
        raise ValueError(
            f"points must be (N, 2) finite numbers, N >= 1; got shape {at.shape}. Pass rows and columns, or x and y."
        )
    outer = hull(at[np.lexsort((at[:, 1], at[:, 0]))])
    box = float(np.prod(outer.max(axis=0) - outer.min(axis=0)))
    edges = np.roll(outer, -1, axis=0) - outer
    edges = edges[(edges != 0).any(axis=1)]
    if len(edges) == 0:
        return Rectangle(0.0, 0.0, (0.0, 0.0), 0.0)
    # Quarter turns of an edge ask for the same rectangle: each goes to the one within 45 degrees of the first axis.
    steep = np.abs(edges[:, 1]) > np.abs(edges[:, 0])
    edges[steep] = np.stack([edges[steep, 1], -edges[steep, 0]], axis=1)
    edges[edges[:, 0] < 0] *= -1
    edges[edges[:, 0] == edges[:, 1]] *= (1, -1)  # of -45 and 45 degrees it is 45
    along, across = outer @ edges.T, outer @ np.stack([-edges[:, 1], edges[:, 0]])
    areas = np.ptp(along, axis=0) * np.ptp(across, axis=0) / (edges**2).sum(axis=1)
    angles = -np.degrees(np.arctan2(edges[:, 1], edges[:, 0])) + 0.0
    equal = np.flatnonzero(areas <= areas.min() + _EQUAL * box)
    best = min(equal, key=lambda i: (round(abs(angles[i]), 9), angles[i] < 0))
    length = math.hypot(*edges[best])
    sides = float(np.ptp(along[:, best])) / length, float(np.ptp(across[:, best])) / length
    return Rectangle(float(angles[best]), float(areas[best]), sides, max(box, float(areas[best])))


def own_angle(mask: NDArray[np.bool_]) -> float:
    """The turn that puts a shape into its own frame: that of the smallest rectangle around it, by area.

    The outline is first cut into as few straight sides as its pixels allow (see `turned`), since the hull of the pixels
    themselves is as rough as their steps. Around these sides the smallest rectangle is exact. The pixels allow each
    side a few directions; within half a degree the frame takes the one that the sides with the most pixels allow, and
    of these the nearest. If the rectangle is less than 1 % smaller than the box along the axes, there is no turn:
    shapes along the axes keep every digit.

    Args:
        mask: (rows, columns) bool.

    Returns:
        Degrees in (-45, 45] for `turned`; 0.0 for an empty or full mask. A mask turned by 90 degrees has the same
        angle, a mirrored one the opposite angle.

    Example:
        >>> own_angle(np.ones((3, 5), dtype=bool)), own_angle(np.eye(4, dtype=bool))
        (0.0, 45.0)
    """
    mask = mask[bounding_box(mask)]
    return 0.0 if mask.all() else _Outlined(mask).own_angle()


def in_own_frame(mask: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], float]:
    """`turned(mask, own_angle(mask))` and `own_angle(mask)`, with the outline traced once.

    Args:
        mask: (rows, columns) bool.

    Returns:
        The turned shape, cropped, and degrees.

    Example:
        >>> in_own_frame(np.eye(4, dtype=bool))[1]
        45.0
    """
    mask = mask[bounding_box(mask)]
    if mask.all():
        return mask.copy(), 0.0
    outlined = _Outlined(mask)
    angle = outlined.own_angle()
    found = outlined.turned(angle)
    return np.ascontiguousarray(found[bounding_box(found)]), angle


def turned(mask: NDArray[np.bool_], turn: float | ArrayLike) -> NDArray[np.bool_]:
    """A mask turned and cropped to its box, with as little new noise as was found possible.

    In 2-D the outline is cut into straight sides: a side goes on for as long as one line can have all pixels inside on
    one side of it and all outside on the other. These polygons are turned and drawn anew on the grid that has the
    middle of their box. A side that may lie along an axis after the turn does: of the lines that its pixels allow it is
    the simplest. In 3-D the mask is interpolated linearly and cut at one half.

    Args:
        mask: (rows, columns) bool with an angle, or (planes, rows, columns) bool with a rotation.
        turn: degrees, counter-clockwise as an image is seen; in 3-D a rotation, an orthogonal (3, 3) matrix of
            determinant 1 that takes points of the mask to where they are afterwards.

    Returns:
        bool array, the smallest that holds the turned shape; of size 0 if nothing is inside. Multiples of 90 degrees
        only move pixels. A mask turned by 90 degrees beforehand gives the same shape turned by 90 degrees.

    Example:
        >>> turned(np.array([[True, True, True], [False, False, True]]), 90).astype(int)
        array([[1, 1],
               [1, 0],
               [1, 0]])
    """
    mask = mask[bounding_box(mask)]
    if mask.size == 0:
        return mask.copy()
    if mask.ndim == 3:
        found = _turned_volume(mask, np.asarray(turn, dtype=np.float64))
    else:
        degrees = float(turn)  # type: ignore[arg-type]
        found = np.rot90(mask, round(degrees / 90)) if degrees % 90 == 0 else _Outlined(mask).turned(degrees)
    return np.ascontiguousarray(found[bounding_box(found)])


def centred_grid(low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[int]]:
    """The grid of whole pixels that a shape is drawn on: its middle is that of the shape's box.

    Sides of the box that are a whole number of pixels long run between pixels, and no number moves them further than a
    quarter of a pixel from there. Quarter turns and mirror images of a shape have those of its grid.

    Args:
        low: (n,) least coordinates of the shape, in pixels.
        high: (n,) greatest coordinates.

    Returns:
        Where the grid begins, and its number of pixels along each axis, 1 or more.

    Example:
        >>> centred_grid(np.array([0.0, 0.0]), np.array([3.4, 0.2]))
        (array([ 0.2, -0.4]), [3, 1])
    """
    size = np.maximum(1, np.rint(high - low))
    return (low + high - size) / 2, [int(n) for n in size]


class _Outlined:
    """A cropped mask, not all of it inside or outside, and the straight sides of its outline."""

    def __init__(self, mask: NDArray[np.bool_]) -> None:
        from torchlinf.kernels.outlines import sides

        self._mask = mask
        image, self._quarters, self._mirrored = _representative(mask)
        self._sides = sides(np.pad(image, 1))

    def own_angle(self) -> float:
        """The turn that puts the mask into its own frame; see the function of this name."""
        angle = _own_angle(self._sides)
        return -angle if self._mirrored and angle != 45.0 else angle

    def turned(self, degrees: float) -> NDArray[np.bool_]:
        """The mask drawn anew, turned."""
        from torchlinf.kernels.outlines import draw, polygons

        quarters = math.floor(degrees / 90 + 0.5)
        degrees -= 90 * quarters  # from -45 on, below 45
        if degrees == 0 or self._mask.size == 1:
            return np.rot90(self._mask, quarters)
        angle = math.radians(-degrees if self._mirrored else degrees)
        corners, begin = polygons(*self._sides, angle, _SLACK)
        start, size = centred_grid(corners.min(axis=0), corners.max(axis=0))
        found = draw(corners - start, begin, *size)
        if not found.any():  # thinner than a pixel everywhere
            found = np.ones((1, 1), dtype=np.bool_)
        found = np.rot90(found, -self._quarters)
        return np.rot90(found[:, ::-1] if self._mirrored else found, quarters)


def _own_angle(outlines: tuple[NDArray[np.float64], ...]) -> float:
    """The angle of the smallest rectangle around straight sides, moved to suit most of them."""
    from torchlinf.kernels.outlines import polygons

    found = smallest_rectangle(polygons(*outlines, 0.0, _NEVER)[0])
    if not found.saves:
        return 0.0
    *_, lines, core = outlines
    # How far each side, or a quarter turn of it, may be from the rectangle's direction.
    low, high = np.degrees(lines[:, 3:]).T + found.angle
    quarter = 90 * np.rint((low + high) / 180)
    low, high = np.maximum(low - quarter, -MOST_MOVED), np.minimum(high - quarter, MOST_MOVED)
    free = low < high
    low, high, weight = low[free], high[free], np.diff(core[free])[:, 0]
    ends = np.unique(np.concatenate([low, high, [0.0]]))
    middles = (ends[1:] + ends[:-1]) / 2
    moved = 0.0
    if len(middles) > 0:
        agreeing = ((low[:, None] < middles) & (middles < high[:, None])).T @ weight
        most = np.flatnonzero(agreeing == agreeing.max())
        best = most[np.argmin(np.abs(middles[most]))]
        moved = float(np.clip(0.0, ends[best], ends[best + 1]))
    angle = round(found.angle - moved, 9) + 0.0  # the rest is rounding
    return angle - 90 if angle > 45 else angle + 90 if angle <= -45 else angle


def _turned_volume(mask: NDArray[np.bool_], rotation: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Linear interpolation at the turned grid's points, whose middle is that of the mask."""
    from scipy.ndimage import affine_transform

    size = np.array(mask.shape)
    reach = np.ceil(np.abs(rotation) @ size - 1e-9).astype(int)
    offset = (size - 1) / 2 - rotation.T @ ((reach - 1) / 2)
    values = affine_transform(mask.astype(float), rotation.T, offset, tuple(reach), order=1, mode="grid-constant")
    return values > 0.5 - 1e-9


def _representative(mask: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int, bool]:
    """One of the eight images of a mask under quarter turns and mirrors, the same for all eight.

    What is computed from it is the same, in every digit, for all of them.

    Returns:
        The image; how many quarter turns made it; whether the mask was mirrored left to right before.
    """
    images = []
    for mirrored in (False, True):
        for quarters in range(4):
            image = np.ascontiguousarray(np.rot90(mask[:, ::-1] if mirrored else mask, quarters))
            images.append((image.shape, image.tobytes(), quarters, mirrored, image))
    *_, quarters, mirrored, image = min(images, key=lambda entry: entry[:4])
    return image, quarters, mirrored
