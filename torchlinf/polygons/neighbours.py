"""Outlines beside each other: what lies in the way of each, and which pairs overlap more than they did."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchlinf.polygons.drawing import Edges, Grid, draw_on, turn
from torchlinf.polygons.geometries import polygons_of

SLIGHT = 1e-6  # of the smaller outline: more overlap than that is not rounding

Shapes = NDArray[np.object_]
Indices = NDArray[np.int64]


class Neighbours:
    """Polygons in one call, those of other geometries beside each of them.

    Args:
        shapes: (N,) shapely polygons, or None.
        owner: (N,) the geometry of each; polygons of one geometry are no neighbours.
        edges: those of the shapes.
        angles: (N,) degrees that each is turned by to its frame.
    """

    def __init__(self, shapes: Shapes, owner: Indices, edges: Edges, angles: NDArray[np.float64]) -> None:
        import shapely

        self._shapes, self._edges, self._angles = shapes, edges, angles
        frames = np.full(len(shapes), None)
        for i in np.flatnonzero(~shapely.is_missing(shapes)).tolist():
            angle, centre = angles[i], edges.centres[i]
            ends = turn(edges[i], angle)
            corners = shapely.get_coordinates(shapely.box(*ends.min(axis=(0, 1)), *ends.max(axis=(0, 1))))
            frames[i] = shapely.Polygon(turn(corners, -angle) + centre)
        # All pixels that an outline may gain lie in the box of its frame.
        mine, other = shapely.STRtree(shapes).query(frames, predicate="intersects")
        apart = owner[mine] != owner[other]
        order = np.argsort(mine[apart], kind="stable")
        self._others = other[apart][order]
        self._first = np.searchsorted(mine[apart][order], np.arange(len(shapes) + 1))

    def drawn(self, i: int, grid: Grid) -> NDArray[np.bool_]:
        """The pixels of the grid of a polygon whose centre is inside of a neighbour."""
        found = np.zeros((grid.height, grid.width), np.bool_)
        centres = self._edges.centres
        for j in self._of(i):
            found |= draw_on(grid, turn(self._edges[j] + (centres[j] - centres[i]), self._angles[i]))
        return found

    def cut(self, i: int, outline: Any) -> Any:
        """A new outline of a polygon without what it has gained of its neighbours, less than half a pixel deep.

        No pixel's centre is in that if none was gained in a neighbour. The outline itself if that is next to nothing,
        or if it would not have as many parts and holes.
        """
        import shapely

        taken = shapely.difference(shapely.union_all(self._shapes[self._of(i)]), self._shapes[i])
        if shapely.area(shapely.intersection(outline, taken)) <= SLIGHT * shapely.area(self._shapes[i]):
            return outline
        rest = polygons_of(shapely.difference(outline, taken))
        counts = [(shapely.get_num_geometries(one), len(shapely.get_rings(one))) for one in (rest, outline)]
        return rest if counts[0] == counts[1] and shapely.is_valid(rest) else outline

    def _of(self, i: int) -> Indices:
        found: Indices = self._others[self._first[i] : self._first[i + 1]]
        return found


def more_overlap(before: Shapes, after: Shapes, slight: float | None = None) -> tuple[Indices, Indices]:
    """The pairs i < j of outlines that overlap more than they did.

    Args:
        before: (N,) shapely polygons and multipolygons, or None.
        after: (N,) the same.
        slight: an area that does not count; None for a millionth of the smaller outline.
    """
    import shapely

    first, second = shapely.STRtree(after).query(after, predicate="intersects")
    changed = np.array([new is not old for new, old in zip(after, before, strict=True)], np.bool_)
    pairs = (first < second) & (changed[first] | changed[second])
    first, second = first[pairs], second[pairs]
    more = shapely.area(shapely.intersection(after[first], after[second]))
    more -= shapely.area(shapely.intersection(before[first], before[second]))
    if slight is None:
        worse = more > SLIGHT * np.minimum(shapely.area(before[first]), shapely.area(before[second]))
    else:
        worse = more > slight
    return first[worse], second[worse]


def overlap_of_flips(before: Shapes, after: Shapes) -> Indices:
    """Which outlines have to be as they were, so that no two overlap more than before; of two the later one, if it can.

    Args:
        before: (N,) shapely polygons and multipolygons, or None.
        after: (N,) the same; where nothing was flipped, the same objects.
    """
    after = after.copy()
    flipped = np.array([new is not old for new, old in zip(after, before, strict=True)], dtype=np.bool_)
    changed = flipped.copy()
    while True:
        first, second = more_overlap(before, after)
        if not len(first):
            return np.flatnonzero(changed & ~flipped)
        for i, j in zip(first, second, strict=True):
            back: Any = j if flipped[j] else i
            after[back], flipped[back] = before[back], False
