"""Outlines drawn as masks: in any frame, at any resolution, never resampled."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SUBPIXEL = 2.0**20  # corners are rounded to this share of a pixel, so that two on one pixel line stay on it
TRIALS = 8  # drawings at most until a shape has the radius that is asked for
FIRST_SIDE = 2048  # pixels of the longer side in the first of them, at most


class TooLargeError(ValueError):
    """A drawing would have more pixels than the limit; the message names the resolution."""


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of many polygons, holes included, in one array.

    Attributes:
        ends: (E, 2, 2) both ends of every edge, as x and y, less the centre of the polygon's box.
        first: (N + 1,) where the edges of each polygon begin.
        hulls: (N,) the corners (H, 2) of the convex hull of each, less the same centre.
        centres: (N, 2) of the boxes.
    """

    ends: NDArray[np.float64]
    first: NDArray[np.int64]
    hulls: list[NDArray[np.float64]]
    centres: NDArray[np.float64]

    def __getitem__(self, i: int) -> NDArray[np.float64]:
        """The edges of one polygon."""
        return self.ends[self.first[i] : self.first[i + 1]]


def edges_of(shapes: NDArray[np.object_]) -> Edges:
    """Take shapely polygons and multipolygons apart; None has no edges.

    >>> import shapely
    >>> edges_of(np.array([shapely.box(10, 20, 12, 21), None])).ends[:, 0].tolist()
    [[1.0, -0.5], [1.0, 0.5], [-1.0, 0.5], [-1.0, -0.5]]
    """
    import shapely

    bounds = shapely.bounds(shapes)
    centre = (bounds[:, :2] + bounds[:, 2:]) / 2
    parts, of_shape = shapely.get_parts(shapes, return_index=True)
    rings, of_part = shapely.get_rings(parts, return_index=True)
    points, of_ring = shapely.get_coordinates(rings, return_index=True)
    owner = of_shape[of_part[of_ring]]
    points = points - centre[owner]
    edge = of_ring[1:] == of_ring[:-1]  # not from the last point of a ring to the first of the next
    ends = np.stack([points[:-1][edge], points[1:][edge]], axis=1)
    first = np.searchsorted(owner[:-1][edge], np.arange(len(shapes) + 1))
    corners, of_hull = shapely.get_coordinates(shapely.convex_hull(shapes), return_index=True)
    hulls = np.split(corners - centre[of_hull], np.searchsorted(of_hull, np.arange(1, len(shapes))))
    return Edges(ends, first, hulls if len(shapes) else [], centre)


def turn(ends: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    """Turn points (..., 2) counter-clockwise, y being up."""
    if degrees == 0:
        return ends
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turned: NDArray[np.float64] = ends @ np.array([[cos, sin], [-sin, cos]])
    return turned


@dataclass(frozen=True, eq=False)
class Grid:
    """The pixels that a polygon is drawn on.

    Attributes:
        height: rows.
        width: columns.
        resolution: side of a pixel, in the unit of the points.
        middle: (2,) of the grid, as x and y; that of the polygon's box.
    """

    height: int
    width: int
    resolution: float
    middle: NDArray[np.float64]

    def pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 2) in pixels from the upper left corner, x to the right and y down."""
        scaled: NDArray[np.float64] = (points - self.middle) / self.resolution * (1, -1)
        return scaled + np.array([self.width / 2, self.height / 2])

    def points(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """The points of what `pixels` returns."""
        scaled: NDArray[np.float64] = (pixels - np.array([self.width / 2, self.height / 2])) * self.resolution * (1, -1)
        return scaled + self.middle


def grid_of(ends: NDArray[np.float64], resolution: float, max_pixels: int) -> Grid:
    """The grid that `draw` draws these edges on; the arguments and errors are the same."""
    low, high = ends.min(axis=(0, 1)), ends.max(axis=(0, 1))
    width, height = (int(side) for side in np.minimum(np.rint((high - low) / resolution), 2.0**31))
    if width * height > max_pixels:
        least = math.sqrt(float(np.prod(high - low)) / max_pixels)
        raise TooLargeError(
            f"{height} x {width} pixels at a resolution of {resolution:g} are more than the limit of {max_pixels}; "
            f"a resolution of {_rounded_up(least)} needs fewer"
        )
    return Grid(height, width, resolution, (low + high) / 2)


def draw(ends: NDArray[np.float64], resolution: float, max_pixels: int) -> NDArray[np.bool_]:
    """Draw a polygon by its edges: inside is every pixel whose centre is.

    The box of the polygon has w x h pixels, each side rounded, and the grid has its centre in the middle of the box. So
    no pixel's centre is nearer than a quarter of a pixel to a side of the box, and a rectangle along the axes comes out
    as a full box of pixels however its corners are rounded.

    Args:
        ends: (E, 2, 2) both ends of every edge of closed rings, as x and y. Inside is what an odd number of edges lies
            before, so rings within rings are holes.
        resolution: side of a pixel, in the unit of the edges.
        max_pixels: larger drawings are refused.

    Returns:
        (h, w) bool, the first row on top (the largest y); of size 0 if the polygon is less than half a pixel wide.

    Raises:
        TooLargeError: there are more pixels than `max_pixels`.

    Example:
        >>> corners = np.array([[0, 0], [4, 0], [4, 1], [2, 1], [2, 3], [0, 3], [0, 0]], dtype=float)
        >>> draw(np.stack([corners[:-1], corners[1:]], axis=1), 1.0, max_pixels=100).astype(int)
        array([[1, 1, 0, 0],
               [1, 1, 0, 0],
               [1, 1, 1, 1]])
    """
    grid = grid_of(ends, resolution, max_pixels)
    return draw_on(grid, ends)


def draw_on(grid: Grid, ends: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Draw a polygon by its edges on a grid that may be another one's; what lies outside of the grid is left out."""
    if not grid.width * grid.height:
        return np.zeros((grid.height, grid.width), dtype=np.bool_)
    at = np.rint(grid.pixels(ends) * SUBPIXEL) / SUBPIXEL
    return _filled(at, grid.height, grid.width)


def draw_at_radius(ends: NDArray[np.float64], radius: int, max_pixels: int) -> tuple[NDArray[np.bool_], float]:
    """Draw a polygon at the resolution at which its chessboard radius is so many pixels.

    The first resolution is twice the area over the circumference, which of a square is half its side, over the radius.
    A drawing of radius D has squares of sides 2 D - 1 or 2 D in it; the resolution is multiplied by
    (D - 1/4) / (radius - 1/4) until D is the radius asked for, eight times at most. Then the nearest radius is taken.

    Returns:
        The drawing as `draw` gives it, and its resolution.

    Raises:
        TooLargeError: it would have more pixels than `max_pixels`.

    Example:
        >>> corners = np.array([[0, 0], [5, 0], [5, 3], [0, 3], [0, 0]], dtype=float)
        >>> mask, resolution = draw_at_radius(np.stack([corners[:-1], corners[1:]], axis=1), 8, max_pixels=1000)
        >>> mask.shape, round(resolution, 3)
        ((15, 24), 0.204)
    """
    side = float(np.ptp(ends, axis=(0, 1)).max())
    (x0, y0), (x1, y1) = ends[:, 0].T, ends[:, 1].T
    area, around = abs(float(np.sum(x0 * y1 - x1 * y0))) / 2, float(np.hypot(x1 - x0, y1 - y0).sum())
    resolution = max(2 * area / around / radius, side / FIRST_SIDE)
    best: tuple[NDArray[np.bool_], float] | None = None
    nearest = math.inf
    for _ in range(TRIALS):
        try:
            mask = draw(ends, resolution, max_pixels)
        except TooLargeError as error:
            text = str(error).partition(";")[0]
            raise TooLargeError(f"{text}, for a radius of {radius} pixels; pass fewer pixels_per_radius") from error
        found = _radius(mask)
        if found and abs(found - radius) < nearest:
            best, nearest = (mask, resolution), abs(found - radius)
        if found == radius:
            break
        resolution *= (max(found, 0.5) - 0.25) / (radius - 0.25)
    return best or (mask, resolution)


def _radius(mask: NDArray[np.bool_]) -> int:
    from scipy.ndimage import distance_transform_cdt

    return int(distance_transform_cdt(np.pad(mask, 1), metric="chessboard").max())


def _filled(ends: NDArray[np.float64], height: int, width: int) -> NDArray[np.bool_]:
    """Fill closed rings given in pixels, x to the right and y down, by the parity of the edges left of each centre."""
    ends = np.where(ends[:, :1, 1:] > ends[:, 1:, 1:], ends[:, ::-1], ends)  # every edge downwards
    (x0, y0), (x1, y1) = ends[:, 0].T, ends[:, 1].T
    # Rows whose centre line an edge crosses: y0 <= row + 1/2 < y1, so that a corner on the line counts once.
    top = np.clip(np.ceil(y0 - 0.5), 0, height).astype(np.int64)
    rows = np.clip(np.ceil(y1 - 0.5), 0, height).astype(np.int64) - top
    edge = np.repeat(np.arange(len(rows)), rows)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(rows) - rows - top, rows)
    slope = (x1 - x0) / np.where(y1 > y0, y1 - y0, 1.0)
    x = x0[edge] + (row + 0.5 - y0[edge]) * slope[edge]
    column = np.clip(np.ceil(x - 0.5), 0, width).astype(np.int64)  # the first pixel whose centre is not before x
    crossed = np.zeros((height, width + 1), dtype=np.uint8)
    np.add.at(crossed.reshape(-1), row * (width + 1) + column, np.uint8(1))
    inside: NDArray[np.bool_] = (np.bitwise_xor.accumulate(crossed[:, :width] & 1, axis=1)).view(np.bool_)
    return inside


def _rounded_up(value: float) -> str:
    """Two digits, rounded up.

    >>> _rounded_up(0.03141), _rounded_up(271.8)
    ('0.032', '280')
    """
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / step) * step:.6g}"
