"""Frames: the smallest rectangle around a shape, and a mask turned into another frame.

Angles are in degrees and turn counter-clockwise as an image is seen, with the row axis down: from the first axis towards
the second, as `numpy.rot90` turns. For points (x, y) with y up that is counter-clockwise too.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torchlinf._helpers.boxes import bounding_box

# Turning must save this share of the area of the box along the axes: shapes along the axes stay as they are.
LEAST_SAVING = 0.01
# Areas that differ by a smaller share are equal, and values this close to one half count as one half.
_SLACK = 1e-9


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


def smallest_rectangle(points: ArrayLike) -> Rectangle:
    """The rectangle of least area that holds points in the plane, exactly: one of its sides lies on an edge of the hull.

    Of rectangles of the same area the one with the least turn is taken, then the one with a positive angle. Turning the
    points by 90 degrees so changes nothing but which side is which.

    Args:
        points: (N, 2) finite numbers, N >= 1: rows and columns, or x and y. Map coordinates keep their digits if an
            origin near the points is taken off first.

    Returns:
        The `Rectangle`; of a single point, or of points on one line, it has area 0.

    Raises:
        ValueError: not (N, 2), no points, or numbers that are not finite.

    Source: Freeman and Shapira, "Determining the minimum-area encasing rectangle for an arbitrary closed curve", 1975.

    Example:
        >>> smallest_rectangle([(0, 0), (2, 1), (1, 3), (-1, 2)])
        Rectangle(angle=-26.56505117707799, area=5.0, sides=(2.23606797749979, 2.23606797749979), box_area=9.0)
    """
    at = np.asarray(points, dtype=np.float64)
    if at.ndim != 2 or at.shape[1] != 2 or len(at) == 0 or not np.isfinite(at).all():
        raise ValueError(
            f"points must be (N, 2) finite numbers, N >= 1; got shape {at.shape}. Pass rows and columns, or x and y."
        )
    hull = _hull(at)
    low, high = hull.min(axis=0), hull.max(axis=0)
    box = float(np.prod(high - low))
    edges = np.roll(hull, -1, axis=0) - hull
    edges = edges[np.hypot(*edges.T) > 0]
    if len(edges) == 0:
        return Rectangle(0.0, 0.0, (0.0, 0.0), 0.0)
    # Quarter turns of an edge ask for the same rectangle: all go to directions within 45 degrees of the first axis.
    steep = np.abs(edges[:, 1]) > np.abs(edges[:, 0])
    edges[steep] = np.stack([edges[steep, 1], -edges[steep, 0]], axis=1)
    edges[edges[:, 0] < 0] *= -1
    edges[edges[:, 0] == edges[:, 1]] *= (1, -1)  # 45 degrees either way is the same rectangle: +45 it is
    along, across = hull @ edges.T, hull @ np.stack([-edges[:, 1], edges[:, 0]])
    areas = np.ptp(along, axis=0) * np.ptp(across, axis=0) / (edges**2).sum(axis=1)
    angles = -np.degrees(np.arctan2(edges[:, 1], edges[:, 0]))
    best = np.flatnonzero(areas <= areas.min() + _SLACK * box)
    chosen = min(best, key=lambda i: (round(abs(angles[i]), 9), angles[i] < 0))
    length = math.hypot(*edges[chosen])
    sides = (float(np.ptp(along[:, chosen])) / length, float(np.ptp(across[:, chosen])) / length)
    area = float(areas[chosen])
    return Rectangle(float(angles[chosen]) + 0.0, area, sides, max(box, area))


def own_angle(mask: NDArray[np.bool_]) -> float:
    """The turn that puts a shape into its own frame: that of the smallest rectangle around its pixels.

    Pixels are squares, and the rectangle is that around their corners. If it is less than 1 % smaller than the box
    along the axes, there is no turn: shapes along the axes keep every digit.

    Args:
        mask: (rows, columns) bool.

    Returns:
        Degrees in (-45, 45] for `turned`; 0.0 for an empty or full mask.

    Example:
        >>> own_angle(np.ones((3, 5), dtype=bool)), own_angle(np.eye(4, dtype=bool))
        (0.0, 45.0)
    """
    corners = _corners(mask)
    if len(corners) == 0:
        return 0.0
    found = smallest_rectangle(corners)
    return found.angle if found.area < (1 - LEAST_SAVING) * found.box_area else 0.0


def turned(mask: NDArray[np.bool_], degrees: float | ArrayLike) -> NDArray[np.bool_]:
    """A mask turned about its centre, resampled, and cropped to its box.

    Args:
        mask: (rows, columns) bool, or (planes, rows, columns) with a rotation.
        degrees: the turn, counter-clockwise as an image is seen; in 3-D a rotation, a (3, 3) orthogonal matrix with
            determinant 1 that takes a point of the mask to where it is afterwards.

    Returns:
        bool array, the smallest that holds the turned shape; of size 0 if nothing is inside. Multiples of 90 degrees
        move pixels and change nothing else.

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
        found = _resampled(mask, np.asarray(degrees, dtype=np.float64))
    else:
        quarters = math.floor(float(degrees) / 90 + 0.5)  # type: ignore[arg-type]
        rest = float(degrees) - 90 * quarters  # type: ignore[arg-type]
        found = np.rot90(_turned_plane(mask, rest) if rest else mask, quarters)
    return np.ascontiguousarray(found[bounding_box(found)])


def _turned_plane(mask: NDArray[np.bool_], degrees: float) -> NDArray[np.bool_]:
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return _resampled(mask, np.array([[cos, -sin], [sin, cos]]))


def _resampled(mask: NDArray[np.bool_], rotation: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Bilinear values at the turned grid's points, with the centre of the array where it was."""
    from scipy.ndimage import affine_transform

    size = np.array(mask.shape)
    reach = np.ceil(np.abs(rotation) @ size).astype(int) + 2
    reach += (reach - size) % 2  # the same parity: the middle of the array stays the middle of a pixel or of a border
    back = rotation.T
    offset = (size - 1) / 2 - back @ ((reach - 1) / 2)
    values = affine_transform(mask.astype(np.float64), back, offset, tuple(reach), order=1, mode="grid-constant")
    return values > 0.5 - _SLACK


def _corners(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Corners of the outermost pixels of every row: their hull is that of the corners of all pixels."""
    rows = np.flatnonzero(mask.any(axis=1))
    first = mask[rows].argmax(axis=1)
    last = mask.shape[1] - mask[rows, ::-1].argmax(axis=1)
    top, bottom = np.concatenate([rows, rows]), np.concatenate([first, last])
    return np.concatenate([np.stack([top, bottom], 1), np.stack([top + 1, bottom], 1)]).astype(np.float64)


def _hull(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners of the convex hull in order, by Andrew's monotone chain; points on an edge are left out."""
    ordered = np.unique(points, axis=0)
    if len(ordered) < 3:
        return ordered
    halves = []
    for run in (ordered.tolist(), ordered[::-1].tolist()):
        half: list[list[float]] = []
        for x, y in run:
            while len(half) > 1 and (half[-1][0] - half[-2][0]) * (y - half[-2][1]) <= (half[-1][1] - half[-2][1]) * (
                x - half[-2][0]
            ):
                half.pop()
            half.append([x, y])
        halves.append(half[:-1])
    return np.array(halves[0] + halves[1])
