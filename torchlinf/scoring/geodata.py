"""Files of outlines in, one row of numbers an outline out, beside the attributes that the file has for it.

GeoPackage, GeoJSON, Shapefile and GeoParquet. Needs the extra `geo` (GeoPandas, pyogrio, shapely, pyarrow).
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchlinf import __version__
from torchlinf._helpers.extras import require
from torchlinf.measure import Measure
from torchlinf.polygons import MAX_PIXELS, complexity_table
from torchlinf.scoring.options import score_measure
from torchlinf.scoring.values import UnreadableMaskError

if TYPE_CHECKING:
    from geopandas import GeoDataFrame
    from pandas import DataFrame

GEO_SUFFIXES = (".gpkg", ".geojson", ".shp", ".parquet")
PART = 1000  # outlines that are measured, and kept in the journal, at a time
OF_MASKS = ("index", "version", "measure")  # columns of a part that are the same for all, or named otherwise


@dataclass(frozen=True)
class GeoOptions:
    """How files of outlines are read, drawn and measured.

    Attributes:
        resolution: side of a pixel, in the unit of the coordinates; or None.
        pixels_per_radius: the radius that every drawing is to have, instead; or None.
        layer: which layer of a file that has several.
        crs: the coordinate reference system to project to first: as pyproj takes it, such as "EPSG:32633", or "utm" for
            the zone that the file lies in; None leaves the coordinates as they are.
        repair: whether invalid geometries are made valid first.
        max_pixels: larger drawings are refused.
        measure: how complexity is measured.
    """

    resolution: float | None = None
    pixels_per_radius: int | None = None
    layer: str | None = None
    crs: str | None = None
    repair: bool = False
    max_pixels: int = MAX_PIXELS
    measure: Measure = field(default_factory=lambda: score_measure({}))

    def drawing(self) -> str:
        """What is not in the measure, as one line of JSON, for a column of the table."""
        names = [one.name for one in fields(self) if one.name != "measure"]
        return json.dumps({name: getattr(self, name) for name in names})

    def table(self, outlines: Any) -> dict[str, Any]:
        """The table of some outlines."""
        return complexity_table(
            outlines,
            resolution=self.resolution,
            pixels_per_radius=self.pixels_per_radius,
            repair=self.repair,
            max_pixels=self.max_pixels,
            **self.measure.options(),
        )


@dataclass(frozen=True, eq=False)
class GeoPart:
    """Some rows of a table, those of up to `PART` outlines of one file in a row.

    Attributes:
        file: the file.
        begin: the position of the first outline in the file.
        total: outlines in the file.
        columns: the numbers, by column; "row" has the position of each row's outline.
    """

    file: str
    begin: int
    total: int
    columns: dict[str, list[Any]]

    def failed(self) -> int:
        """How many rows say what went wrong."""
        return sum(error is not None for error in self.columns["error"])


def is_geodata(path: Path) -> bool:
    """Whether a file holds outlines, by its name."""
    return path.suffix.lower() in GEO_SUFFIXES


def read_geodata(path: Path, layer: str | None = None) -> "GeoDataFrame":
    """Read a file of outlines with all attributes, in its own coordinates.

    Raises:
        ImportError: the extra `geo` is not installed.
        UnreadableMaskError: it cannot be read, or has several layers and none is chosen.
    """
    geopandas = require("geopandas", "reading outlines", "geo")
    if not path.is_file():
        raise UnreadableMaskError("no such file")
    try:
        if path.suffix.lower() == ".parquet":
            require("pyarrow", "reading GeoParquet", "geo")
            if layer is not None:
                raise UnreadableMaskError(f"a GeoParquet file has no layers; got {layer}")
            return geopandas.read_parquet(path)
        pyogrio = require("pyogrio", "reading outlines", "geo")
        layers = [name for name, kind in pyogrio.list_layers(path) if kind is not None]
        if layer is None and len(layers) != 1:
            several = (
                f"it has the layers {', '.join(layers)}; pass --layer" if layers else "it has no layer of outlines"
            )
            raise UnreadableMaskError(several)
        if layer is not None and layer not in layers:
            raise UnreadableMaskError(f"it has no layer {layer} of outlines, but {', '.join(layers) or 'none'}")
        return geopandas.read_file(path, layer=layer or layers[0], engine="pyogrio")
    except (UnreadableMaskError, ImportError):
        raise
    except Exception as error:  # of pyogrio, GDAL, pyarrow: whatever is wrong with the file
        raise UnreadableMaskError(f"cannot be read ({type(error).__name__}: {error})") from error


def project(frame: "GeoDataFrame", crs: str | None) -> "GeoDataFrame":
    """Bring outlines into a system of coordinates in which lengths can be measured.

    Raises:
        UnreadableMaskError: the coordinates are degrees and `crs` is None, or they cannot be projected.
    """
    if crs is None:
        if frame.crs is not None and frame.crs.is_geographic:
            name = ":".join(frame.crs.to_authority() or (frame.crs.name,))
            raise UnreadableMaskError(
                f"the coordinates are degrees ({name}), not lengths; pass --crs utm, or a projected system such as "
                "--crs EPSG:32633"
            )
        return frame
    if frame.crs is None:
        raise UnreadableMaskError("the file names no coordinate reference system, so --crs cannot project from it")
    try:
        return frame.to_crs(frame.estimate_utm_crs() if crs.lower() == "utm" else crs)
    except Exception as error:  # of pyproj, and of GeoPandas where there is nothing to estimate a zone from
        raise UnreadableMaskError(f"cannot be projected to {crs} ({type(error).__name__}: {error})") from error


def number_of_parts(file: Path, layer: str | None) -> int:
    """How many parts a file will be measured in, as far as its header says it; for a bar that shows the progress."""
    try:
        if file.suffix.lower() == ".parquet":
            outlines = require("pyarrow.parquet", "reading GeoParquet", "geo").read_metadata(file).num_rows
        else:
            outlines = require("pyogrio", "reading outlines", "geo").read_info(file, layer=layer)["features"]
    except ImportError:
        raise
    except Exception:  # what is wrong with the file is said when it is read
        return 1
    return max(ceil(outlines / PART), 1)


def parts_of(file: Path, options: GeoOptions, done: Mapping[int, GeoPart]) -> Iterator[GeoPart]:
    """Measure the outlines of a file, some at a time.

    Args:
        file: the file; a file that cannot be used gives one row that says why.
        options: how it is read, drawn and measured.
        done: parts that are known from before, by the position of their first outline; they are passed on.

    Raises:
        NoTableError: the file has another number of outlines than the parts say.
    """
    from torchlinf.scoring.rows import NoTableError

    try:
        frame = project(read_geodata(file, options.layer), options.crs)
    except UnreadableMaskError as error:
        yield GeoPart(str(file), 0, 0, _columns(options.table([None])) | {"error": [str(error)], "row": [None]})
        return
    outlines = frame.geometry.reset_index(drop=True)
    for begin in range(0, max(len(outlines), 1), PART):  # a file without outlines is one part without rows
        if (known := done.get(begin)) is not None:
            if known.total != len(outlines):
                raise NoTableError(f"{file} had {known.total} outlines when it was begun, and has {len(outlines)} now")
            yield known
            continue
        table = options.table(outlines.iloc[begin : begin + PART])
        yield GeoPart(str(file), begin, len(outlines), _columns(table))


def _columns(table: Mapping[str, Any]) -> dict[str, list[Any]]:
    return {"row": table["index"].tolist()} | {
        name: column.tolist() for name, column in table.items() if name not in OF_MASKS
    }


def joined(parts: Sequence[GeoPart], options: GeoOptions, with_geometry: bool) -> "DataFrame":
    """The whole table: the names, the attributes of the files, and the numbers.

    Args:
        parts: of all files, in order.
        options: how they were read and measured.
        with_geometry: whether the outlines are kept, as they are in the files; those of files in other systems of
            coordinates than the first one are projected to its system.

    Returns:
        A DataFrame with one row a row of the parts; a GeoDataFrame with geometry. An attribute with the name of another
        column has "_given" behind its name.
    """
    import geopandas
    import pandas as pd

    frames: list[Any] = []
    crs = None
    for file in dict.fromkeys(part.file for part in parts):
        own = [part for part in parts if part.file == file]
        numbers = pd.DataFrame({name: [cell for part in own for cell in part.columns[name]] for name in own[0].columns})
        numbers["error"] = numbers["error"].astype(object).where(numbers["error"].notna(), None)
        rows = numbers.pop("row").tolist()
        numbers.insert(0, "path", _paths(file, options.layer, rows, numbers.get("object")))
        numbers = numbers.assign(version=__version__, measure=options.measure.settings(), drawing=options.drawing())
        if rows == [None]:  # the file could not be used
            frames.append(numbers)
            continue
        given = read_geodata(Path(file), options.layer).reset_index(drop=True)
        crs = crs or given.crs
        geometry = given.geometry if given.crs == crs or given.crs is None else given.geometry.to_crs(crs)
        attributes = pd.DataFrame(given.drop(columns=given.geometry.name)).iloc[rows].reset_index(drop=True)
        attributes.columns = free_names(list(attributes.columns), list(numbers.columns))
        pieces = [numbers[["path"]], attributes, numbers.drop(columns="path")]
        if with_geometry:
            pieces.append(pd.DataFrame({"geometry": geometry.iloc[rows].to_numpy()}))
        frames.append(pd.concat(pieces, axis=1))
    whole = frames[0] if len(frames) == 1 else _stacked(frames)
    if not with_geometry:
        return whole
    if "geometry" not in whole:
        whole["geometry"] = None
    return geopandas.GeoDataFrame(whole, geometry="geometry", crs=crs)


def _paths(file: str, layer: str | None, rows: Any, objects: Any) -> list[str]:
    """What each row is called: the file, the position of its outline in it, and of its polygons which one."""
    prefix = file if layer is None else f"{file}:{layer}"
    names = [file if row is None else f"{prefix}:{row}" for row in rows]
    return names if objects is None else [f"{name}@{number}" for name, number in zip(names, objects, strict=True)]


def _stacked(frames: list[Any]) -> Any:
    """The tables of several files below each other: the name, all attributes, and the numbers."""
    import pandas as pd

    whole = pd.concat(frames, ignore_index=True)
    numbers = [name for name in frames[0].columns if all(name in frame for frame in frames)]
    attributes = [name for name in whole.columns if name not in numbers and name != "geometry"]
    order = ["path", *attributes, *(name for name in numbers if name not in ("path", "geometry"))]
    return whole[[*order, *(["geometry"] if "geometry" in whole else [])]]


def free_names(names: list[str], taken: list[str]) -> list[str]:
    """Names for attributes that no other column has, in a database that takes "Area" and "area" for the same.

    >>> free_names(["Area", "year"], ["path", "area"])
    ['Area_given', 'year']
    """
    used = {name.lower() for name in (*taken, "fid", "geom", "geometry")}
    free = []
    for name in names:
        new = str(name)
        while new.lower() in used:
            new += "_given"
        used.add(new.lower())
        free.append(new)
    return free
