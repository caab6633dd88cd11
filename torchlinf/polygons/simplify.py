"""Outlines to simpler outlines: each is drawn in its own frame, simplified there, and traced back."""

import time
from collections.abc import Callable
from typing import Any, Unpack

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from torchlinf import __version__
from torchlinf._helpers.checks import choice, count, flag, positive
from torchlinf._helpers.parallel import for_each
from torchlinf.losses import simplify as simplify_masks
from torchlinf.measure import Measure, WindowOptions, takes
from torchlinf.polygons.drawing import TooLargeError, edges_of, grid_of, turn
from torchlinf.polygons.flipped_outline import flipped_outline, restored
from torchlinf.polygons.geometries import read_geometries
from torchlinf.polygons.measuring import Drawing, angles_of, too_small
from torchlinf.polygons.neighbours import Neighbours, overlap_of_flips
from torchlinf.polygons.straight_outline import straight_outlines
from torchlinf.polygons.table import ERRORS, MAX_PIXELS, pixel_size, raise_first

SEVERAL = ("mean", "least")
NUMBERS = ("before", "after", "flips", "changed", "angle", "resolution")  # what is found of every polygon
SUMS = ("flips", "changed")

Column = NDArray[Any]


class OutlineOptions(WindowOptions, total=False):
    """Options of outlines that are simplified: one window, in one frame."""

    orientation: float | str | ArrayLike | Tensor | None


@takes(OutlineOptions, orientation="own")
def simplify(
    geometries: Any,
    *,
    resolution: float | None = None,
    pixels_per_radius: int | None = None,
    weight: float = 10.0,
    max_flips: int = 256,
    tries: int = 32,
    max_change: float = 0.5,
    keep_topology: bool = True,
    straighten: float | None = None,
    repair: bool = False,
    max_pixels: int = MAX_PIXELS,
    errors: str = "row",
    **options: Unpack[OutlineOptions],
) -> dict[str, Column]:
    """Make outlines simpler, such as the footprints of buildings that a model has found.

    Every polygon is drawn as `complexity_table` draws it, alone and in its own frame. There `torchlinf.simplify` flips
    regions of pixels as long as that lowers the complexity by more than weight * changed pixels / pixels of the
    polygon. What was flipped is cut out of the polygon, or united with it. Sides that no flip has touched keep their
    corners; a new side goes on where the sides before and behind it stop. What lies in a neighbour is not gained, and
    neighbours overlap no more than before: if they would, the later one stays as it was. With `straighten`, the stairs
    of an outline that was traced from pixels become straight walls in the end.

    Args:
        geometries: N polygons or multipolygons, as `complexity_table` takes them. Each polygon of a multipolygon is
            simplified alone; one that holds no pixel's centre, such as a sliver, stays as it is. Heights (Z) are left
            out. Those of one call are neighbours on one map: of different images, pass those of each alone.
        resolution: side of a pixel, in the unit of the coordinates. This or `pixels_per_radius` must be given.
        pixels_per_radius: instead of one resolution for all, the radius of every drawing, as in `complexity_table`.
        weight: bits for the whole area of a polygon, 0 or more: a flip of 1 % of the area must lower the complexity by
            weight / 100.
        max_flips: how many flips a polygon may have.
        tries: how many regions have to be tried in vain, one after another, for an end, as in `torchlinf.simplify`;
            twice as many by default, since outlines have few large parts.
        max_change: share of the area of a polygon that may be changed, in (0, 1].
        keep_topology: whether the drawing keeps its components, joined through faces and corners, and holes, and no
            new slit or spike is more than twice as deep as wide. Without it a flip may cut a polygon in two. What is
            joined by a corner alone comes out as two polygons.
        straighten: None, or a tolerance above 0 in the unit of the coordinates. Then every outline, flipped or not,
            gets as few straight sides as stay so near to it. Each side is fitted to its part of the outline by least
            squares; it lies along the frame of the long sides where the tolerance lets it, else it keeps its own
            direction. Nothing of the outline is farther than this from the new one; corners, where two sides cross, may
            lie sqrt(2) times as far from the old one. Holes and parts stay. 0.85 pixels of the raster that was traced
            is right for stairs; more takes small notches too. With weight=1e9 nothing else is done.
        repair: whether invalid geometries are made valid by shapely's `make_valid` first.
        max_pixels: an outline that needs a larger drawing is refused.
        errors: "row", what cannot be simplified has None for a geometry and the reason in "error"; or "raise".
        {measure options}
            Here orientation must be "own", degrees or None.

    Returns:
        Columns by name, one entry per geometry in their order.

        - "index": as in `complexity_table`.
        - "geometry": object, shapely geometries, valid; the same object where nothing was changed, unless it had
          heights. None for an error.
        - "objects": int64, how many polygons it had.
        - "area", "area_after": float64, exact areas, in the square of the unit.
        - "before", "after": float64, complexity of the drawing in bits (or share, for "std"), the mean over the
          polygons that hold a pixel's centre. `straighten` comes after it.
        - "flips", "changed": int64, how many flips were made, and how many pixels they changed in the end.
        - "changed_area": float64, exact area that is in one of both outlines alone.
        - "angle", "resolution": float64, of the drawing; NaN where several polygons do not share one.
        - "seconds": float64.
        - "error": object, what went wrong in words, or None.
        - "version" and "measure": the version of torchlinf and `Measure.settings()`.

        Not differentiable. The work is done on the CPU, on torch's number of threads.

    Raises:
        ImportError: shapely or numba is not installed.
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value; the coordinates are degrees, as the coordinate reference system says;
            or, with errors="raise", an outline cannot be simplified.

    Source: this library's, see docs/polygons; the measure is that of Arslan and Tari, IEEE TIP 2020. The straight sides
    go back to Imai and Iri, 1988, and to Selinger, 2003.

    Example:
        >>> import shapely
        >>> from shapely import affinity
        >>> house = shapely.union(shapely.box(0, 0, 12, 8), shapely.box(5, 8, 6, 9))  # a bump on one side
        >>> found = simplify([affinity.rotate(house, 20)], resolution=0.25, weight=3.0)
        >>> found["after"], found["changed"], found["area_after"].round(6), found["angle"].round(2)
        (array([0.]), array([16]), array([96.]), array([-20.]))
        >>> len(found["geometry"][0].exterior.coords)
        5
        >>> pixels = [shapely.box(x, y, x + 1, y + 1) for x in range(21) for y in range(x // 3, x // 3 + 12)]
        >>> traced = shapely.simplify(shapely.union_all(pixels), 0)
        >>> found = simplify([traced], resolution=0.5, straighten=0.85)
        >>> len(traced.exterior.coords), len(found["geometry"][0].exterior.coords)
        (29, 5)
    """
    measure = Measure.of({"orientation": "own", **options}, OutlineOptions)
    measure.scalar_rho()
    if isinstance(measure.orientation, tuple) or measure.orientation in SEVERAL:
        raise ValueError(
            f'orientation must be one frame in the plane; got {measure.orientation!r}. Pass "own", degrees or None.'
        )
    drawing = Drawing(*pixel_size(resolution, pixels_per_radius), count(max_pixels, "max_pixels"))
    tolerance = None if straighten is None else positive(straighten, "straighten")
    raising = choice(errors, ERRORS, "errors") == "raise"
    rule = {
        "weight": weight, "max_flips": max_flips, "tries": tries, "max_change": max_change,
        "keep_topology": keep_topology, "per": "mask", **measure.plain().options(),
    }  # fmt: skip
    simplify_masks(torch.zeros(1, 1, dtype=torch.bool), spatial_ndim=2, **rule)  # checks the options before the work
    found = read_geometries(geometries, flag(repair, "repair")).flat()
    if raising:
        raise_first(found.errors, found.index)
    parts, owner = found.parts()
    columns = _simplified(parts.shapes, owner, parts.errors, drawing, measure, rule)
    rows = _joined(columns, owner, found.shapes, tolerance)
    if raising:
        raise_first(rows["error"], found.index)
    number = len(found.index)
    return {
        "index": found.index,
        **rows,
        "version": np.full(number, __version__),
        "measure": np.full(number, measure.settings()),
    }


def _simplified(
    shapes: Column, owner: NDArray[np.int64], broken: Column, drawing: Drawing, measure: Measure, rule: dict[str, Any]
) -> dict[str, Column]:
    """Simplify polygons, each alone, without gaining what is a neighbour's.

    Returns:
        The columns `NUMBERS`, "geometry", "seconds", "error" and "unseen", (N,) each. The last is why a polygon was not
        drawn: it holds no pixel's centre.
    """
    import shapely

    edges, bounds = edges_of(shapes), shapely.bounds(shapes)
    angles = angles_of(edges, len(shapes), measure)[:, 0]
    neighbours = Neighbours(shapes, owner, edges, angles)
    columns = {name: np.full(len(shapes), np.nan) for name in NUMBERS}
    columns |= {name: np.zeros(len(shapes), np.int64) for name in SUMS}
    columns |= {"geometry": shapes.copy(), "seconds": np.zeros(len(shapes)), "error": broken.copy()}
    columns["unseen"] = np.full(len(shapes), None)

    def simplify_one(i: int, check: Callable[[], None]) -> None:
        check()
        if broken[i] is not None:
            return
        start = time.perf_counter()
        ends = turn(edges[i], angles[i])
        try:
            before, side = drawing.of(ends)
            if not before.any():
                columns["unseen"][i] = too_small(side, bounds[i])
                return
            grid = grid_of(ends, side, drawing.max_pixels)
            free = torch.from_numpy(~neighbours.drawn(i, grid))
            flipped = simplify_masks(torch.from_numpy(before), allowed=free, spatial_ndim=2, **rule)
            after = flipped.mask.numpy()
            centre, angle = edges.centres[i], angles[i]
            if (before != after).any():
                outline = shapely.transform(shapes[i], lambda points: grid.pixels(turn(points - centre, angle)))
                outline = flipped_outline(outline, before, after)
                outline = shapely.transform(outline, lambda points: turn(grid.points(points), -angle) + centre)
                columns["geometry"][i] = neighbours.cut(i, restored(outline, shapes[i], side))
        except TooLargeError as error:
            columns["error"][i] = str(error)
            return
        except RuntimeError as error:
            columns["error"][i] = f"{type(error).__name__}: {error}"
            return
        numbers = (flipped.before, flipped.after, flipped.num_flips, (before != after).sum(), angle, side)
        for name, number in zip(NUMBERS, numbers, strict=True):
            columns[name][i] = number
        columns["seconds"][i] = time.perf_counter() - start

    for_each(simplify_one, len(shapes))
    return columns


def _joined(
    columns: dict[str, Column], owner: NDArray[np.int64], given: Column, tolerance: float | None
) -> dict[str, Column]:
    """The columns of geometries from those of their polygons.

    One polygon with an error is an error of the whole. Those that were not drawn stay as they are, and are an error if
    none was. With a tolerance outlines are made straight.
    """
    import shapely

    number = len(given)
    first = np.searchsorted(owner, np.arange(number + 1))
    rows: dict[str, Column] = {
        "geometry": given.copy(),
        "objects": np.diff(first),
        "area": shapely.area(given),
        "area_after": np.full(number, np.nan),
    }
    rows |= {name: np.full(number, np.nan) for name in NUMBERS if name not in SUMS}
    rows |= {name: np.zeros(number, np.int64) for name in SUMS}
    rows |= {"changed_area": np.full(number, np.nan), "seconds": np.zeros(number), "error": np.full(number, None)}
    for i in range(number):
        own = slice(first[i], first[i + 1])
        rows["seconds"][i] = columns["seconds"][own].sum()
        drawn = [k for k in range(own.start, own.stop) if columns["unseen"][k] is None]
        unseen = [] if drawn else list(columns["unseen"][own])
        rows["error"][i] = next((error for error in [*columns["error"][own], *unseen] if error is not None), None)
        if rows["error"][i] is not None:
            rows["geometry"][i], rows["objects"][i] = None, 0
            continue
        for name in SUMS:
            rows[name][i] = columns[name][own].sum()
        for name in ("before", "after"):
            rows[name][i] = columns[name][drawn].mean()
        for name in ("angle", "resolution"):
            values = columns[name][drawn]
            rows[name][i] = values[0] if (values == values[0]).all() else np.nan
        if rows["flips"][i]:
            rows["geometry"][i] = shapely.union_all(columns["geometry"][own])
    back = overlap_of_flips(given, rows["geometry"])
    rows["geometry"][back], rows["after"][back] = given[back], rows["before"][back]
    for name in SUMS:
        rows[name][back] = 0
    if tolerance is not None:
        rows["geometry"] = straight_outlines(rows["geometry"], tolerance)
    rows["area_after"] = shapely.area(rows["geometry"])
    rows["changed_area"] = shapely.area(shapely.symmetric_difference(given, rows["geometry"]))
    return rows
