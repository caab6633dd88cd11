"""Outlines without the stairs of pixels: as few straight sides as stay near the outline, each one fitted to its part.

The fewest sides within a tolerance, by dynamic programming, are those of Imai and Iri (1988); fitted sides whose
crossings are the corners are those of Selinger's potrace (2003). Here the sides are fitted first, to any outline and
for any tolerance, and a side may lie along the frame that the long sides of the outline share.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchlinf._helpers.parallel import for_each
from torchlinf.polygons.flipped_outline import restored
from torchlinf.polygons.geometries import polygons_of

FREE = 0.3  # of a side: the price of one that does not lie along the frame
FRAME = np.radians(5.0)  # sides with such a difference in direction are still of one frame
TRIES = (1.0, 0.9, 0.75, 0.5, 0.25)  # of the tolerance, until the polygon is valid and near enough
CORNER = np.sqrt(2)  # times the tolerance: how far a corner of two sides at a right angle may be off
STEP = 0.5  # of the tolerance, between the points of the old outline whose distance is checked
SAME = 1e-9  # of the tolerance; nearer points are one
CRUMB = 1.0  # squares of the tolerance: what a cut between neighbours leaves of such an area goes

Points = NDArray[np.float64]
Shapes = NDArray[np.object_]


def straight_outlines(shapes: Shapes, tolerance: float) -> Shapes:
    """Outlines without stairs, whose neighbours do not overlap more than before.

    Args:
        shapes: (N,) valid polygons and multipolygons, or None.
        tolerance: as for `straight_outline`.

    Returns:
        (N,) the same, with straight sides. The parts of a multipolygon are made straight each alone, and united. Where
        neighbours overlap that did not before, the later one is cut along the sides of the earlier one; if that cuts it
        in two, or they overlapped already, both stay as they were.
    """
    import shapely

    found = shapes.copy()

    def straighten_one(i: int, check: Any) -> None:
        check()
        if shapes[i] is None:
            return
        parts = shapely.get_parts(shapes[i])
        straight = [straight_outline(part, tolerance) for part in parts]
        if any(new is not old for new, old in zip(straight, parts, strict=True)):
            found[i] = straight[0] if len(straight) == 1 else polygons_of(shapely.union_all(straight))

    for_each(straighten_one, len(shapes))
    _part_neighbours(shapes, found, tolerance)
    return found


def straight_outline(polygon: Any, tolerance: float) -> Any:
    """A polygon with as few straight sides as stay within a tolerance of its outline.

    Args:
        polygon: a valid shapely polygon.
        tolerance: largest distance of the old outline from the new one, above 0, in the unit of the coordinates. The
            sides are as near to the old outline; their corners may be sqrt(2) times as far from it.

    Returns:
        A valid shapely polygon with as many holes; the same object if it has the same corners, or if sides cross each
        other even where they are fitted at a quarter of the tolerance.

    Example:
        >>> import shapely
        >>> stairs = [(x, x + up) for x in range(20) for up in (0, 1)]  # a triangle whose long side is drawn in pixels
        >>> new = straight_outline(shapely.Polygon([*stairs, (20, 20), (20, 0)]), 0.85)
        >>> len(new.exterior.coords), round(new.area)
        (4, 210)
    """
    import shapely

    rings = [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(polygon)]
    middle = np.mean(shapely.bounds(polygon).reshape(2, 2), axis=0)
    dense = shapely.points(shapely.get_coordinates(shapely.segmentize(polygon, STEP * tolerance)))
    for share in TRIES:
        unit = share * tolerance
        new = [ring * unit + middle for ring in _straight_rings([(ring - middle) / unit for ring in rings])]
        outline = shapely.Polygon(new[0], new[1:])
        if shapely.is_valid(outline) and _is_near(outline, polygon, dense, tolerance):
            outline = restored(outline, polygon, tolerance)
            same = shapely.equals_exact(shapely.normalize(outline), shapely.normalize(polygon))
            return polygon if same else outline
    return polygon


def _is_near(new: Any, old: Any, dense: Any, tolerance: float) -> bool:
    """Whether points of the old outline, and corners of the new one, are as near as they must be."""
    import shapely

    corners = shapely.points(shapely.get_coordinates(new))
    most = tolerance * (1 + SAME)
    near = (shapely.distance(dense, shapely.boundary(new)) <= most).all()
    return bool(near and (shapely.distance(corners, shapely.boundary(old)) <= most * CORNER).all())


def _straight_rings(rings: list[Points]) -> list[Points]:
    """The rings of one polygon, whose long sides share a frame; a tolerance of 1."""
    candidates = [_candidates(ring) for ring in rings]
    sums = [_sums(points) for points in candidates]
    first = [_straight_ring(points, sum_, None) for points, sum_ in zip(candidates, sums, strict=True)]
    frame = _frame(np.concatenate([np.roll(ring, -1, axis=0) - ring for ring in first]))
    return [_straight_ring(points, sum_, frame) for points, sum_ in zip(candidates, sums, strict=True)]


def _candidates(ring: Points) -> Points:
    """Where sides may meet: the corners of a ring, and the middles between them."""
    ring = ring[np.hypot(*(ring - np.roll(ring, 1, axis=0)).T) > SAME]
    middles = (ring + np.roll(ring, -1, axis=0)) / 2
    return np.stack([ring, middles], axis=1).reshape(-1, 2)


def _sums(points: Points) -> Points:
    """(2 N + 1, 6) of length, x, y, xx, xy, yy along a ring of N points, twice around."""
    step = np.roll(points, -1, axis=0) - points
    (x, y), (u, v) = (points + step / 2).T, step.T
    pieces = np.stack([np.ones_like(x), x, y, x * x + u * u / 12, x * y + u * v / 12, y * y + v * v / 12], axis=1)
    pieces *= np.hypot(u, v)[:, None]
    return np.concatenate([np.zeros((1, 6)), np.cumsum(np.concatenate([pieces, pieces]), axis=0)])


def _straight_ring(points: Points, sums: Points, frame: float | None) -> Points:
    """The corners of the cheapest ring. A chain must begin somewhere: at the longest run, then at a side of the result.

    Args:
        points: (N, 2) candidates.
        sums: those of the points.
        frame: angle of the polygon's frame in radians; None if it is not known yet.
    """
    from torchlinf.kernels.straight_sides import cheapest, runs

    ends, lines, prices = runs(points, sums, frame or 0.0, 0.0 if frame is None else FREE)
    if not len(ends):
        return points[::2]
    length = np.hypot(*(points[ends[:, 1] % len(points)] - points[ends[:, 0]]).T)
    chain, corners, price = cheapest(points, ends, lines, prices, int(np.argmax(length)))
    if len(chain) < 3:  # no ring has that run: then one has a side of the polygon as it is
        sides = np.flatnonzero((ends[:, 0] % 2 == 0) & (ends[:, 1] == ends[:, 0] + 2))
        if not len(sides):
            return points[::2]
        chain, corners, price = cheapest(points, ends, lines, prices, int(sides[np.argmax(length[sides])]))
        if len(chain) < 3:
            return points[::2]
    side = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    again, new, lower = cheapest(points, ends, lines, prices, int(chain[1 + np.argmax(side[1:])]))
    better: Points = new if len(again) >= 3 and lower < price else corners
    return better


def _frame(sides: Points) -> float:
    """The angle in radians, less quarter turns, around which most sides lie; those of twice the length count 8 times.

    The variance of the angle of a line that is fitted to stairs falls with the third power of its length.
    """
    weight, angle = np.hypot(*sides.T) ** 3, np.arctan2(sides[:, 1], sides[:, 0])
    off = (angle[None] - angle[:, None] + np.pi / 4) % (np.pi / 2) - np.pi / 4
    chosen = int(np.argmax(np.exp(-((off / FRAME) ** 2)) @ weight))
    near = np.abs(off[chosen]) < 2 * FRAME
    return float(angle[chosen] + np.average(off[chosen][near], weights=weight[near]))


def _part_neighbours(before: Shapes, after: Shapes, tolerance: float) -> None:
    """Take back what lets outlines overlap that did not before, in place."""
    import shapely

    slight = 1e-6 * tolerance**2
    cut = True
    while True:
        first, second = shapely.STRtree(after).query(after, predicate="intersects")
        first, second = first[first < second], second[first < second]
        more = shapely.area(shapely.intersection(after[first], after[second]))
        more -= shapely.area(shapely.intersection(before[first], before[second]))
        worse = np.flatnonzero(more > slight)
        if not len(worse):
            return
        for i, j in zip(first[worse], second[worse], strict=True):
            rest = _cut(after[j], after[i], tolerance) if cut else None
            if rest is not None and shapely.area(shapely.intersection(before[i], before[j])) <= slight:
                after[j] = rest
            else:
                after[i], after[j] = before[i], before[j]
        cut = False  # what a cut has not mended is taken back, so that there is an end


def _cut(shape: Any, other: Any, tolerance: float) -> Any:
    """What is left of an outline outside of another one; None if it has not as many parts."""
    import shapely

    rest = shapely.get_parts(polygons_of(shapely.difference(shape, other)))
    rest = rest[shapely.area(rest) > CRUMB * tolerance**2]
    if len(rest) != shapely.get_num_geometries(shape):
        return None
    return rest[0] if len(rest) == 1 else shapely.multipolygons(rest)
