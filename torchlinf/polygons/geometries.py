"""Outlines in, from whatever library: shapely, GeoPandas, GeoJSON, COCO. What is wrong with one is said in words."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchlinf._helpers.extras import require

POLYGONAL = (3, 6)  # shapely's type numbers of Polygon and MultiPolygon
COLLECTION = 7
WANTED = "Pass shapely polygons, a GeoSeries or GeoDataFrame, GeoJSON, or COCO polygons."


@dataclass(frozen=True, eq=False)
class Geometries:
    """Geometries in a row, not all of which can be measured.

    Attributes:
        shapes: (N,) shapely Polygons and MultiPolygons; None where there is an error.
        index: (N,) what each is called.
        errors: (N,) what is wrong, in words; None where nothing is.
    """

    shapes: NDArray[np.object_]
    index: NDArray[Any]
    errors: NDArray[np.object_]

    def parts(self) -> "tuple[Geometries, NDArray[np.int64]]":
        """Every polygon of a MultiPolygon alone, and which of the geometries each is of; an error stays one row."""
        import shapely

        parts, owner = shapely.get_parts(self.shapes, return_index=True)
        broken = np.flatnonzero(shapely.is_missing(self.shapes))
        owner = np.concatenate([owner, broken])
        order = np.argsort(owner, kind="stable")
        shapes = np.concatenate([parts, np.full(len(broken), None)])[order]
        owner = owner[order]
        return Geometries(shapes, self.index[owner], self.errors[owner]), owner

    def flat(self) -> "Geometries":
        """The same without heights (Z); the same objects where there are none."""
        import shapely

        shapes, has_z = self.shapes.copy(), shapely.has_z(self.shapes)
        shapes[has_z] = shapely.force_2d(shapes[has_z])
        return replace(self, shapes=shapes)


def read_geometries(given: Any, repair: bool = False) -> Geometries:
    """The polygons of what a user has.

    Args:
        given: as `complexity_table` takes it.
        repair: whether invalid geometries are made valid by shapely's `make_valid`.

    Raises:
        ImportError: shapely is not installed.
        TypeError: it is nothing that holds geometries.
        ValueError: the coordinates are degrees, as the coordinate reference system says, or JSON of another kind.

    Example:
        >>> square = {"type": "Polygon", "coordinates": [[[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]]]}
        >>> found = read_geometries([square, [0, 0, 3, 0, 3, 1], {"type": "Point", "coordinates": [1, 1]}, None])
        >>> found.shapes
        array([<POLYGON ((0 0, 2 0, 2 2, 0 2, 0 0))>, <POLYGON ((0 0, 3 0, 3 -1, 0 0))>, None, None], dtype=object)
        >>> found.errors.tolist()
        [None, None, 'a Point has no inside', 'there is no geometry']
    """
    require("shapely", "measuring outlines", "geo")
    with np.errstate(invalid="ignore"):  # coordinates that are NaN: their row says so
        return _checked(_collected(given), repair)


def _collected(given: Any) -> Geometries:
    """Shapely geometries of any type, or an error where there is none."""
    import shapely

    if isinstance(given, shapely.Geometry):
        given = [given]
    elif hasattr(given, "crs") and hasattr(given, "to_crs"):  # of GeoPandas: a frame, a series or an array
        _refuse_degrees(given.crs)
        shapes = np.asarray(getattr(given, "geometry", given), dtype=object)
        index = given.index.to_numpy() if hasattr(given, "index") else np.arange(len(shapes))
        return Geometries(shapes, index, np.full(len(shapes), None))
    elif hasattr(given, "to_numpy") and hasattr(given, "index"):  # a column of a table
        index, given = given.index.to_numpy(), given.to_numpy()
        return replace(_each(given), index=index)
    elif isinstance(given, Mapping) or hasattr(given, "__geo_interface__"):
        given = _entries(given if isinstance(given, Mapping) else given.__geo_interface__)
    if isinstance(given, str | bytes) or not isinstance(given, Sequence | np.ndarray):
        raise TypeError(f"geometries must be polygons; got {type(given).__name__}. {WANTED}")
    return _each(given)


def _entries(content: Mapping[str, Any]) -> Sequence[Any]:
    """What a JSON object holds: the features of a collection, the annotations of a COCO file, or one geometry."""
    entries: Any = [content]
    if content.get("type") == "FeatureCollection":
        entries = content.get("features")
        _refuse_degrees(_old_crs(content))
    elif "annotations" in content:
        entries = content["annotations"]
    elif "type" not in content and "segmentation" not in content:
        raise ValueError(f"geometries must be GeoJSON or COCO if they are JSON; got keys {list(content)[:6]}. {WANTED}")
    if not isinstance(entries, Sequence) or isinstance(entries, str):
        raise ValueError(f"geometries must be a list of features or annotations; got {entries!r:.60}. {WANTED}")
    return entries


def _each(entries: Iterable[Any]) -> Geometries:
    entries = list(entries)
    shapes, errors = np.full(len(entries), None), np.full(len(entries), None)
    for i, entry in enumerate(entries):
        try:
            shapes[i] = _shape(entry)
        except Exception as error:  # files of strangers hold anything, and a broken entry is one row
            errors[i] = f"not a geometry ({type(error).__name__}: {' '.join(str(error).split()):.200})"
    names = [entry.get("id") if isinstance(entry, Mapping) else None for entry in entries]
    index = np.arange(len(entries))
    if entries and all(isinstance(name, int | str) for name in names) and len(set(names)) == len(names):
        index = np.array(names, dtype=np.int64 if all(isinstance(name, int) for name in names) else object)
    return Geometries(shapes, index, errors)


def _shape(entry: Any) -> Any:
    """A shapely geometry of one entry, or None if it says that there is none."""
    import shapely
    from shapely.geometry import shape

    if entry is None or isinstance(entry, shapely.Geometry):
        return entry
    if hasattr(entry, "__geo_interface__"):
        entry = entry.__geo_interface__
    if isinstance(entry, Mapping):
        if entry.get("type") == "Feature":
            return _shape(entry.get("geometry"))
        if "segmentation" in entry:
            return _coco(entry["segmentation"])
        return shape(entry)
    if isinstance(entry, float) and np.isnan(entry):  # an empty cell of a table
        return None
    return _coco(entry)


def _coco(segmentation: Any) -> Any:
    """The union of COCO's polygons [[x, y, x, y ...] ...], whose y goes down: it is turned over."""
    import shapely

    if isinstance(segmentation, Mapping):
        raise ValueError("run lengths are a mask, not an outline; use torchlinf score or labels.complexity_table")
    rows = list(segmentation)
    if rows and all(isinstance(value, Real) for value in rows):
        rows = [rows]  # one polygon, without the list around it
    rings = [np.asarray(row, dtype=np.float64).reshape(-1, 2) * (1, -1) for row in rows if len(row) not in (0, 2, 4)]
    polygons = [shapely.Polygon(ring) for ring in rings]
    if len(polygons) == 1 or not all(polygon.is_valid for polygon in polygons):
        return polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)
    return shapely.union_all(polygons) if polygons else None


def _checked(found: Geometries, repair: bool) -> Geometries:
    """Put errors in place of what cannot be measured."""
    import shapely

    shapes, errors = found.shapes.copy(), found.errors.copy()
    if repair:
        invalid = np.flatnonzero(~shapely.is_valid(shapes) & ~shapely.is_missing(shapes))
        shapes[invalid] = [polygons_of(one) for one in shapely.make_valid(shapes[invalid])]

    def fail(where: NDArray[np.bool_], text: Callable[[Any], str]) -> None:
        for i in np.flatnonzero(where):
            if errors[i] is None:
                errors[i] = text(shapes[i])

    kinds = shapely.get_type_id(shapes)
    fail(kinds == -1, lambda _: "there is no geometry")
    fail(shapely.is_empty(shapes), lambda _: "the geometry is empty")
    fail(~np.isin(kinds, POLYGONAL), lambda shape: f"a {shape.geom_type} has no inside")
    fail(~shapely.is_valid(shapes), _invalid)
    shapes[[error is not None for error in errors]] = None
    return Geometries(shapes, found.index, errors)


def _invalid(shape: Any) -> str:
    """Why a polygon has no clear inside, and what to do.

    >>> import shapely
    >>> _invalid(shapely.Polygon([(0, 0), (2, 2), (2, 0), (0, 2)]))
    'the geometry is invalid (Self-intersection[1 1]); repair it, as repair=True or shapely.make_valid does'
    """
    import shapely

    reason = shapely.is_valid_reason(shape)
    return f"the geometry is invalid ({reason}); repair it, as repair=True or shapely.make_valid does"


def polygons_of(shape: Any) -> Any:
    """The polygons alone, where a repair leaves lines and points beside them."""
    import shapely

    if shapely.get_type_id(shape) != COLLECTION:
        return shape
    parts = shapely.get_parts(shapely.get_parts(shape))
    return shapely.union_all(parts[shapely.get_type_id(parts) == POLYGONAL[0]])


def _old_crs(collection: Mapping[str, Any]) -> Any:
    """The system of coordinates that GeoJSON before RFC 7946 could name, if pyproj is there to read it."""
    member = collection.get("crs")
    try:
        from pyproj import CRS

        return CRS.from_user_input(member["properties"]["name"]) if member else None
    except Exception:  # no pyproj, or a name that it does not know: the rows will tell
        return None


def _refuse_degrees(crs: Any) -> None:
    if crs is not None and crs.is_geographic:
        raise ValueError(
            f"geometries must be in a projected system, in metres for example; got degrees ({name_of(crs)}). "
            "Pass frame.to_crs(frame.estimate_utm_crs())."
        )


def name_of(crs: Any) -> str:
    """The short name of a system of coordinates, such as "EPSG:4326"."""
    authority = crs.to_authority()
    return ":".join(authority) if authority else json.dumps(crs.name)
