"""The table of outlines: each is drawn, measured, and written into a row."""

from typing import Any, Literal, Unpack

import numpy as np
from numpy.typing import NDArray

from torchlinf import __version__
from torchlinf._helpers.checks import choice, count, flag, positive
from torchlinf.measure import FrameOptions, GridOptions, Measure, takes
from torchlinf.polygons.geometries import read_geometries
from torchlinf.polygons.measuring import DRAWN, Drawing, measured, pooled

MAX_PIXELS = 2**26  # 8192 x 8192, the limit of the command too
ERRORS = ("row", "raise")
COLUMNS = (
    "index", "object", "objects", "area", "pixels", "radius", "standard_error", "angle", "resolution", "error_bound",
    "field_error_bound", "seconds", "error", "version", "measure",
)  # fmt: skip

Column = NDArray[Any]


class PolygonOptions(GridOptions, FrameOptions, total=False):
    """Options of outlines: their objects are polygons, so nothing has to say which pixels are connected."""

    per: Literal["mask", "object"]
    min_pixels: int
    pool: Literal["mean", "area"] | None


@takes(PolygonOptions)
def complexity_table(
    geometries: Any,
    *,
    resolution: float | None = None,
    pixels_per_radius: int | None = None,
    repair: bool = False,
    max_pixels: int = MAX_PIXELS,
    errors: str = "row",
    **options: Unpack[PolygonOptions],
) -> dict[str, Column]:
    """Measure the complexity of outlines, such as the footprints of buildings.

    Every outline is drawn as a mask, alone, and measured there. Nothing is resampled: in another frame the corners are
    turned, and the outline is drawn anew. A pixel is inside if its centre is. The grid has its middle in the
    middle of the outline's box, so where the outline lies does not matter, and with `orientation="own"` a rectangle at
    any angle has complexity exactly 0.

    Args:
        geometries: N polygons or multipolygons, with or without holes: a list or an array of shapely geometries, of
            GeoJSON geometries or features, or of COCO polygons ([x, y, x, y ...], or a list of such lists; y goes
            down); a GeoSeries or GeoDataFrame; one shapely geometry; a GeoJSON object such as a FeatureCollection, or
            the content of a COCO file. Other columns are not used. Coordinates are lengths, not degrees.
        resolution: side of a pixel, in the unit of the coordinates. This or `pixels_per_radius` must be given.
        pixels_per_radius: instead of one resolution for all, draw each outline in its frame at that resolution at which
            its radius (the chessboard radius D of its mask, about half the side of the largest square in it) is this
            many pixels. So every outline is seen at the same detail, whatever its size. The resolution is found by
            drawing, eight times at most; "resolution" and "radius" say what was reached.
        repair: whether invalid geometries are made valid by shapely's `make_valid` first; what is left of their
            polygons is measured.
        max_pixels: an outline that needs more pixels is an error; each takes about 130 bytes while it is solved.
        errors: "row": what cannot be measured gives a row with `error`, NaN for its numbers and radius 0, and the
            others go on. "raise": the first error is raised.
        {measure options}
            Here rho must be None or one number; degrees turn counter-clockwise where y goes up; "own" always turns,
            since nothing is lost by it. The objects of a multipolygon are its polygons; with pool="area" each counts as
            its area.

    Returns:
        Columns by name, one entry per geometry in their order; with per="object" and no `pool` one entry per polygon.
        `pandas.DataFrame` takes the columns as they are.

        - "index": that of the GeoSeries or GeoDataFrame; else the ids of features or annotations, where each has one of
          its own; else 0, 1 ... N - 1.
        - "object": int64, with per="object": the number of the polygon in its geometry, from 1. With `pool` there is
          "objects" instead: how many polygons were measured.
        - "area": float64, exact area of the outline, in the square of the unit.
        - "pixels": int64, pixels inside, of the first drawing.
        - "radius": int64, largest chessboard distance to the outside, in pixels; of several drawings the largest.
        - "complexity", or the names of `windows`: float64, bits (or share, for "std"). An upright box has exactly 0.0.
        - "standard_error": float64, with orientation="mean": that of the mean over the rotations, in the same unit; of
          several windows the largest.
        - "angle": float64, with an `orientation` in degrees, "own" or "least": degrees that the outline was turned by
          before it was drawn, NaN where `pool` makes one of several.
        - "resolution": float64, side of a pixel; NaN where several drawings do not share one.
        - "error_bound": float64, how far any of the complexities can be from that of the exact field of the drawing,
          proven. It says nothing of the choice of the resolution.
        - "field_error_bound": float64, the certified relative error of the field.
        - "seconds": float64, the time that drawing and solving took.
        - "error": object, what went wrong in words, or None.
        - "version" and "measure": the version of torchlinf and `Measure.settings()`.

    Not differentiable. The outlines are measured on the CPU, on torch's number of threads.

    Raises:
        ImportError: shapely is not installed; the extra `geo` has it.
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value; the coordinates are degrees, as the coordinate reference system says;
            or, with errors="raise", an outline cannot be measured.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020; see docs/polygons for the drawing.

    Example:
        >>> import shapely
        >>> from shapely import affinity
        >>> house = shapely.box(0, 0, 12, 8)
        >>> extended = shapely.union(house, shapely.box(8, 8, 12, 12))
        >>> turned = [affinity.rotate(shape, 20) for shape in (house, extended)]
        >>> for orientation in (None, "own"):
        ...     table = complexity_table(turned, resolution=0.25, orientation=orientation)
        ...     print(table["complexity"].round(2).tolist(), "angle" in table)
        [2.25, 2.75] False
        [0.0, 0.86] True
        >>> table["angle"].round(2).tolist()
        [-20.0, -20.0]
    """
    measure = Measure.of(options, PolygonOptions)
    measure.scalar_rho()
    if isinstance(measure.orientation, tuple):
        raise ValueError('orientation must be of two dimensions; got a 3 x 3 matrix. Pass degrees, or "own".')
    windows = measure.windows_beside({*COLUMNS})
    drawing = Drawing(*pixel_size(resolution, pixels_per_radius), count(max_pixels, "max_pixels"))
    raising = choice(errors, ERRORS, "errors") == "raise"
    found = read_geometries(geometries, flag(repair, "repair"))
    if raising:
        raise_first(found.errors, found.index)
    rows: dict[str, Column] = {"index": found.index}
    if measure.per == "object":
        parts, owner = found.parts()
        numbers = measured(parts.shapes, parts.errors, drawing, measure)
        chosen = (numbers["pixels"] >= measure.min_pixels) | (measure.min_pixels == 1)
        if measure.pool is not None:
            rows |= pooled(numbers, owner, chosen, len(found.index), measure.pool)
        else:
            chosen |= ~numbers[DRAWN]  # what is no polygon, or too large, is not left out as too small
            number = np.arange(len(owner)) - np.searchsorted(owner, owner) + 1
            rows = {"index": parts.index, "object": number, **numbers}
            rows = {name: column[chosen] for name, column in rows.items()}
    else:
        rows |= measured(found.shapes, found.errors, drawing, measure)
    if raising:
        raise_first(rows["error"], rows["index"])
    if measure.orientation is None:
        del rows["angle"]
    rows["version"] = np.full(len(rows["index"]), __version__)
    rows["measure"] = np.full(len(rows["index"]), measure.settings())
    order = [name for name in COLUMNS if name in rows]
    before = order.index("radius") + 1
    return {name: rows[name] for name in (*order[:before], *windows, *order[before:])}


def pixel_size(resolution: float | None, pixels_per_radius: int | None) -> tuple[float | None, int | None]:
    """Check that one of both says how large a pixel is."""
    if (resolution is None) == (pixels_per_radius is None):
        got = "neither" if resolution is None else f"both, {resolution!r} and {pixels_per_radius!r}"
        raise ValueError(
            f"resolution must be given, or pixels_per_radius instead; got {got}. "
            "Pass for example resolution=0.25, the side of a pixel in the unit of the coordinates."
        )
    if resolution is not None:
        return positive(resolution, "resolution"), None
    assert pixels_per_radius is not None
    return None, count(pixels_per_radius, "pixels_per_radius")


def raise_first(errors: Column, index: Column) -> None:
    """Raise the first error, with the name of its geometry."""
    for name, error in zip(index, errors, strict=True):
        if error is not None:
            raise ValueError(
                f"geometries must be polygons that can be measured; got {name!s}: {error}. "
                "Pass errors='row' to have the others measured."
            )
