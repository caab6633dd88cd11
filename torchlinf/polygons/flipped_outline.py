"""An outline after flips of pixels of its drawing: sides that no flip has touched stay as they are.

What was flipped is cut out of the polygon, or united with it, as a region of its own. A side that is new goes on where
the sides before and behind it stop, not on the nearest line between pixels, so that no step is left there.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchlinf.polygons.geometries import polygons_of

REACH = 0.51  # pixels from a line between pixels to the side that was drawn there: half a pixel, and what rounding adds
STAIR = 0.75  # pixels from a straight side to the corners of its stairs: half a diagonal, and what rounding adds
# Pixels; a corner that is nearer to the line between its neighbours is none, where something was flipped.
STRAIGHT = 0.1
SAME = 1e-6  # pixels between a corner and itself, there and back again

Mask = NDArray[np.bool_]
Points = NDArray[np.float64]


def flipped_outline(polygon: Any, before: Mask, after: Mask) -> Any:
    """The outline of a mask, by the outline of another one.

    Args:
        polygon: a valid shapely polygon in pixels, x to the right and y down; pixel (row, column) has its centre at
            (column + 1/2, row + 1/2).
        before: (H, W), its drawing: inside is every pixel whose centre is.
        after: (H, W), the mask whose outline is wanted.

    Returns:
        A shapely Polygon or MultiPolygon; valid, and the same object if nothing was flipped. Parts and holes without a
        pixel are left out, unless `polygon` has such a hole already. It is empty if `after` is.

    Example:
        >>> import shapely
        >>> polygon = shapely.Polygon([(0, 0.25), (2, 0.25), (2, -1), (4, -1), (4, 0.25), (8, 0.25), (8, 4), (0, 4)])
        >>> before = np.zeros((6, 8), dtype=bool)
        >>> before[1:5], before[0, 2:4] = True, True
        >>> moved, after = shapely.transform(polygon, lambda xy: xy + (0, 1)), before.copy()
        >>> after[0] = False  # the part on top is gone, and the side below it goes through
        >>> shapely.get_coordinates(flipped_outline(moved, before, after).normalize()).tolist()
        [[0.0, 1.25], [0.0, 5.0], [8.0, 5.0], [8.0, 1.25], [0.0, 1.25]]
    """
    import shapely

    if not (before != after).any():
        return polygon
    margin = 2  # of pixels outside, so that every flipped one has neighbours
    before, after = np.pad(before, margin), np.pad(after, margin)
    old = shapely.transform(polygon, lambda points: points + margin)
    flips = _Flips(before ^ after, old)
    new = old
    for cells, stays, combine in (
        (before & ~after, after, shapely.difference),
        (after & ~before, ~after, shapely.union),
    ):
        if cells.any():
            new = combine(new, flips.region(cells, stays))
    new = _cleaned(new, old, before, after)
    return shapely.transform(new, lambda points: points - margin)


@dataclass(frozen=True)
class _Side:
    """A run of pixel sides between flipped pixels and pixels that stay, all in one direction.

    Attributes:
        start, end: corners of pixels, as x and y.
        along: unit vector from start to end; `across` is that to the pixels that stay.
    """

    start: NDArray[np.int64]
    end: NDArray[np.int64]
    along: NDArray[np.int64]

    @property
    def across(self) -> NDArray[np.int64]:
        x, y = self.along
        return np.array([y, -x])


class _Flips:
    """All flips of a drawing, and the outline that it was drawn from."""

    def __init__(self, changed: Mask, outline: Any) -> None:
        import shapely

        self.changed = changed
        self._sides = shapely.boundary(outline)
        shapely.prepare(self._sides)

    def region(self, cells: Mask, stays: Mask) -> Any:
        """The region to cut out for flipped pixels.

        It has all that the outline can have of these pixels, and ends at the new sides.

        Args:
            cells: the flipped pixels.
            stays: the pixels that are different from them now; between both there are new sides.
        """
        import shapely

        kept = [piece for chain in _chains(cells, stays) for piece in self._beyond(chain, cells, stays)]
        kept += _corners(cells, stays)
        return shapely.difference(shapely.union_all(_boxes(cells)), shapely.union_all(kept))

    def _beyond(self, chain: list[_Side], cells: Mask, stays: Mask) -> Iterator[Any]:
        """What lies behind the new sides, as far as the region without them reaches."""
        import shapely

        first, last = chain[0], chain[-1]
        is_closed = len(chain) > 1 and bool((first.start == last.end).all())
        if len(chain) > 2 and not is_closed and (slope := self._slope(chain, stays)) is not None:
            yield slope
            return
        shifts = np.zeros((len(chain), 2))  # across each side, at its start and its end
        path, far = np.zeros((len(chain) + 1, 2)), np.zeros((len(chain), 2, 2))
        if not is_closed:
            begin = self._shift(first.start, -first.along, first.across, stays)
            end = self._shift(last.end, last.along, last.across, stays)
            if len(chain) == 1:
                begin, end = (end if begin is None else begin), (begin if end is None else end)
                shifts[0] = begin or 0.0, end or 0.0
            else:
                shifts[0], shifts[-1] = begin or 0.0, end or 0.0
        for i, side in enumerate(chain):
            far[i] = side.start + REACH * side.across, side.end + REACH * side.across
            path[i] = side.start + shifts[i, 0] * side.across
            if i or is_closed:
                path[i] += shifts[i - 1, 1] * chain[i - 1].across
        path[-1] = path[0] if is_closed else last.end + shifts[-1, 1] * last.across
        # Beyond its ends the side before and behind is kept too, if it is not flipped away by another region.
        if not is_closed and not cells[_pixel(first.start, -first.along, first.across)]:
            path[0] -= REACH * first.along
            far[0, 0] -= REACH * first.along
        if not is_closed and not cells[_pixel(last.end, last.along, last.across)]:
            path[-1] += REACH * last.along
            far[-1, 1] += REACH * last.along
        for i, side in enumerate(chain):
            yield shapely.make_valid(shapely.Polygon([path[i], path[i + 1], far[i, 1], far[i, 0]]))
            following = chain[i + 1] if i + 1 < len(chain) else first if is_closed else None
            if following is not None and (following.across == side.along).all():  # what stays lies around a corner
                corner = far[i, 1] + REACH * following.across
                yield shapely.make_valid(
                    shapely.Polygon([path[i + 1], far[i, 1], corner, side.end + REACH * following.across])
                )

    def _slope(self, chain: list[_Side], stays: Mask) -> Any:
        """What lies behind a straight side that stands for stairs of pixels; None where they are no stairs."""
        import shapely

        first, last = chain[0], chain[-1]
        begin, end = (
            self._goes_on(corner, along, across, stays)
            for corner, along, across in (
                (first.start, -first.along, first.across),
                (last.end, last.along, last.across),
            )
        )
        if begin is None or end is None:
            return None
        side = end - begin
        length = float(np.hypot(*side))
        if not length:
            return None
        behind = np.array([side[1], -side[0]]) / length
        corners = np.array([first.start, *(one.end for one in chain)])
        ahead = [one.along @ side for one in chain]
        if min(ahead) < 0 or np.abs((corners - begin) @ behind).max() > STAIR:
            return None
        return shapely.Polygon([begin, end, end + 2 * behind, begin + 2 * behind])

    def _goes_on(
        self, corner: NDArray[np.int64], along: NDArray[np.int64], across: NDArray[np.int64], stays: Mask
    ) -> Points | None:
        """The outline half a pixel behind the end of a new side, straight on or around the corner of what stays."""
        ahead, beside = _pixel(corner, along, across), _pixel(corner, along, -across)
        if self.changed[ahead] or (stays[ahead] and (stays[beside] or self.changed[beside])):
            return None
        towards = along if stays[ahead] else across
        return self._nearest(corner + towards / 2)

    def _nearest(self, point: Points) -> Points | None:
        """The point of the outline that is nearest, if it is where the outline would have been drawn there."""
        import shapely

        nearest = shapely.get_coordinates(shapely.shortest_line(shapely.Point(point), self._sides))[1]
        return nearest if np.hypot(*(nearest - point)) <= STAIR else None

    def _shift(
        self, corner: NDArray[np.int64], along: NDArray[np.int64], across: NDArray[np.int64], stays: Mask
    ) -> float | None:
        """How far across a new side lies the outline that goes straight on behind its end; None if none does."""
        ahead, beside = _pixel(corner, along, across), _pixel(corner, along, -across)
        goes_on = stays[ahead] and not stays[beside] and not self.changed[ahead] and not self.changed[beside]
        if not goes_on:
            return None
        nearest = self._nearest(corner + along / 2)
        if nearest is None:
            return None
        shift = float((nearest - corner) @ across)
        return shift if abs(shift) <= REACH else None


def _pixel(corner: NDArray[np.int64], *towards: NDArray[np.int64]) -> tuple[int, int]:
    """The pixel (row, column) at a corner of pixels, in the direction of two unit vectors."""
    x, y = corner + (np.sum(towards, axis=0) - 1) // 2
    return int(y), int(x)


def _boxes(cells: Mask) -> Any:
    """The pixels by their runs in rows, each a little larger than it is."""
    import shapely

    steps = np.diff(cells.astype(np.int8), axis=1, prepend=0, append=0)
    row, left = np.nonzero(steps == 1)
    right = np.nonzero(steps == -1)[1]
    return shapely.box(left - REACH, row - REACH, right + REACH, row + 1 + REACH)


def _corners(cells: Mask, stays: Mask) -> list[Any]:
    """The corners of pixels that stay, where they touch a flipped pixel and are its neighbours by nothing else."""
    import shapely

    found = []
    for row, column in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        diagonal = np.roll(stays, (-row, -column), (0, 1))
        beside = [np.roll(cells | stays, shift, axis) for shift, axis in ((-row, 0), (-column, 1))]
        y, x = np.nonzero(cells & diagonal & ~beside[0] & ~beside[1])
        y, x = y + (row > 0), x + (column > 0)
        ends = np.stack([x, x + REACH * column, y, y + REACH * row])
        found += shapely.box(ends[:2].min(0), ends[2:].min(0), ends[:2].max(0), ends[2:].max(0)).tolist()
    return found


def _chains(cells: Mask, stays: Mask) -> Iterator[list[_Side]]:
    """The new sides in a row, with the flipped pixels to the right of their direction as seen on the map of pixels."""
    following: dict[tuple[int, ...], tuple[int, ...] | None] = {}
    for along in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        across = (along[1], -along[0])
        neighbour = np.roll(stays, (-across[1], -across[0]), (0, 1))
        rows, columns = np.nonzero(cells & neighbour)
        # The corner of the pixel from which its side on this edge begins.
        x = columns + (along[0] < 0 or across[0] > 0)
        y = rows + (along[1] < 0 or across[1] > 0)
        for begin in zip(x.tolist(), y.tolist(), strict=True):
            following[(*begin, *along)] = _next(begin, along, cells, stays)
    reached = {edge for edge in following.values() if edge is not None}
    starts = [edge for edge in following if edge not in reached]
    left = dict(following)
    while left:
        edge: tuple[int, ...] | None = starts.pop() if starts else next(iter(left))
        edges = []
        while edge is not None and edge in left:
            edges.append(edge)
            edge = left.pop(edge)
        if edge == edges[0]:  # closed: begin at a corner
            turn = next(i for i in range(len(edges)) if edges[i][2:] != edges[i - 1][2:])
            edges = edges[turn:] + edges[:turn]
        yield _sides(edges)


def _next(begin: tuple[int, int], along: tuple[int, int], cells: Mask, stays: Mask) -> tuple[int, ...] | None:
    """The new side of a pixel's length behind another one; None if what is behind it is no new side."""
    u, across = np.array(along), np.array([along[1], -along[0]])
    end = np.array(begin) + u
    beside, ahead = _pixel(end, u, -across), _pixel(end, u, across)
    if not cells[beside]:
        return (*end.tolist(), *(-across).tolist()) if stays[beside] else None
    if not cells[ahead]:
        return (*end.tolist(), *along) if stays[ahead] else None
    return (*end.tolist(), *across.tolist())


def _sides(edges: list[tuple[int, ...]]) -> list[_Side]:
    sides: list[_Side] = []
    for x, y, *direction in edges:
        start, along = np.array([x, y]), np.array(direction)
        if sides and (sides[-1].along == along).all():
            sides[-1] = _Side(sides[-1].start, start + along, along)
        else:
            sides.append(_Side(start, start + along, along))
    return sides


def _cleaned(new: Any, old: Any, before: Mask, after: Mask) -> Any:
    """Without parts and holes that have no pixel, and without corners on straight sides."""
    import shapely

    corners = shapely.get_coordinates(old)
    changed = before ^ after
    near = np.zeros_like(changed)
    for row in (-1, 0, 1):
        for column in (-1, 0, 1):
            near |= np.roll(changed, (row, column), (0, 1))
    holes_of_old = [shapely.Polygon(ring) for ring in shapely.get_rings(old)[1:]]
    unseen = [hole for hole in holes_of_old if not _has_pixel(hole, ~before)]
    parts = []
    for part in shapely.get_parts(polygons_of(new)):
        if not _has_pixel(part, after):
            continue
        outer, *holes = shapely.get_rings(part)
        holes = [hole for hole in holes if _is_hole(shapely.Polygon(hole), after, unseen)]
        whole = shapely.Polygon(outer, holes)
        rings = [_straight(shapely.get_coordinates(ring), corners, near) for ring in (outer, *holes)]
        straight = shapely.Polygon(rings[0], [ring for ring in rings[1:] if len(ring) > 3])
        parts.append(straight if shapely.is_valid(straight) else whole)
    return polygons_of(shapely.union_all(parts)) if len(parts) != 1 else parts[0]


def _is_hole(hole: Any, after: Mask, unseen: list[Any]) -> bool:
    import shapely

    return _has_pixel(hole, ~after) or any(shapely.intersects(hole, one) for one in unseen)


def _has_pixel(polygon: Any, mask: Mask) -> bool:
    """Whether the centre of a pixel of a mask is inside a polygon."""
    import shapely

    left, top, right, bottom = shapely.bounds(polygon)
    columns = np.arange(max(int(left), 0), min(int(right) + 1, mask.shape[1]))
    rows = np.arange(max(int(top), 0), min(int(bottom) + 1, mask.shape[0]))
    y, x = np.nonzero(mask[np.ix_(rows, columns)])
    return bool(shapely.contains_xy(polygon, columns[x] + 0.5, rows[y] + 0.5).any()) if len(x) else False


def _straight(ring: Points, corners: Points, near: Mask) -> Points:
    """A closed ring without the corners beside flips that lie on a straight line; old corners exactly as they were."""
    points = list(_moved_to(ring, corners, SAME)[:-1])
    i, since = 0, 0
    while since < len(points) > 3:
        before, point, behind = points[i - 1], points[i % len(points)], points[(i + 1) % len(points)]
        x, y = np.floor(point).astype(int)
        inside = 0 <= y < near.shape[0] and 0 <= x < near.shape[1]
        side = behind - before
        length = np.hypot(*side)
        off = abs(side[0] * (point - before)[1] - side[1] * (point - before)[0]) / length if length else 0.0
        if inside and near[y, x] and off < STRAIGHT and (point - before) @ (point - behind) <= 0:
            del points[i % len(points)]
            i, since = max(i - 1, 0) % len(points), 0
        else:
            i, since = (i + 1) % len(points), since + 1
    return np.array([*points, points[0]])


def restored(outline: Any, given: Any, resolution: float) -> Any:
    """An outline whose corners that were those of another one are exactly so again.

    Args:
        outline: there and back again, in the coordinates of `given`.
        given: the outline before.
        resolution: side of a pixel.
    """
    import shapely

    corners = shapely.get_coordinates(given)
    exact = shapely.transform(outline, lambda points: _moved_to(points, corners, SAME * resolution))
    return exact if shapely.is_valid(exact) else polygons_of(shapely.make_valid(exact))


def _moved_to(points: Points, corners: Points, most: float) -> Points:
    """Points with those that are next to a corner put onto it."""
    from scipy.spatial import cKDTree

    if not len(points):
        return points
    distance, nearest = cKDTree(corners).query(points)
    return np.where((distance < most)[:, None], corners[nearest], points)
