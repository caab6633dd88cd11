"""A file of outlines in, a file of simpler outlines out, with the attributes and the system of coordinates."""

import json
import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from torchlinf.polygons import simplify
from torchlinf.scoring.atomic_write import replace_file
from torchlinf.scoring.geodata import PART, free_names, project, read_geodata

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

LEFT_OUT = ("index", "geometry", "measure")
SIDECARS = {".cpg", ".prj", ".qix", ".sbn", ".sbx"}  # of a shapefile; they would go on to speak of the old one
DRIVERS = {".gpkg": "GPKG", ".geojson": "GeoJSON", ".shp": "ESRI Shapefile"}


def simplified_outlines(
    file: Path, options: Mapping[str, Any], layer: str | None, crs: str | None, advance: Callable[[], None]
) -> "GeoDataFrame":
    """Simplify the outlines of a file.

    Args:
        file: GeoPackage, GeoJSON, Shapefile or GeoParquet.
        options: keywords of `torchlinf.polygons.simplify`.
        layer: which layer, where it has several.
        crs: the system of coordinates to simplify in, or "utm"; the outlines are brought back from it.
        advance: called after every part of the file; with straighten, the whole is one part.

    Returns:
        The attributes, the columns of `torchlinf.polygons.simplify`, and the outlines in the coordinates of the file.
        What was not changed, or has an error, is as it was, less its heights (Z). An attribute with the name of another
        column has "_given" behind its name.

    Raises:
        UnreadableMaskError: the file cannot be read or projected.
    """
    import geopandas
    import pandas as pd
    import shapely

    given = read_geodata(file, layer).reset_index(drop=True)
    flat = project(given, crs).geometry
    parts = []
    # Straight walls must not run into a neighbour, which may be anywhere in the file.
    size = PART if options.get("straighten") is None else max(len(flat), 1)
    for begin in range(0, max(len(flat), 1), size):
        parts.append(pd.DataFrame(simplify(flat.iloc[begin : begin + size], **options)))
        advance()
    numbers = pd.concat(parts, ignore_index=True)
    changed = numbers["changed_area"].to_numpy() > 0
    # New outlines have no heights, and a layer is not to be a mix.
    shapes = shapely.force_2d(np.asarray(given.geometry, dtype=object))
    if changed.any():
        simpler = geopandas.GeoSeries(numbers["geometry"].to_numpy()[changed], crs=flat.crs)
        shapes[changed] = np.asarray(simpler if crs is None else simpler.to_crs(given.crs), dtype=object)
    numbers = numbers.drop(columns=[name for name in LEFT_OUT if name in numbers])
    numbers["error"] = numbers["error"].astype(object).where(numbers["error"].notna(), None)
    numbers["options"] = json.dumps({**options, "crs": crs, "layer": layer})
    attributes = pd.DataFrame(given.drop(columns=given.geometry.name))
    attributes.columns = free_names(list(attributes.columns), list(numbers.columns))
    return geopandas.GeoDataFrame(pd.concat([attributes, numbers], axis=1), geometry=shapes, crs=given.crs)


def write_outlines(out: Path, frame: "GeoDataFrame") -> None:
    """Write outlines in the format that the name asks for, in one piece.

    A shapefile is several files. They are written elsewhere first, and then put in place one after another, so a
    failure to write leaves the old ones; only between two of these steps would both be mixed.

    Raises:
        OSError: the file cannot be written.
    """
    suffix = out.suffix.lower()
    if suffix == ".parquet":
        replace_file(out, lambda temporary: frame.to_parquet(temporary, index=False))
        return
    layer = {"layer": out.stem} if suffix == ".gpkg" else {}
    target = out.resolve()  # a link stays one
    # GDAL goes by the name of the file, and makes others beside it: a shapefile is several, a GeoPackage has a journal.
    with TemporaryDirectory(dir=target.parent, prefix=f".{target.name}.", suffix=".tmp") as folder:
        frame.to_file(Path(folder) / out.name, driver=DRIVERS[suffix], engine="pyogrio", **layer)
        # The geometry last: who finds it finds all of it.
        written = sorted(Path(folder).iterdir(), key=lambda file: file.suffix.lower() == suffix)
        for file in written:
            replace_file(target.with_suffix(file.suffix), partial(os.replace, file))
        if suffix == ".shp":
            for ending in SIDECARS - {file.suffix for file in written}:
                target.with_suffix(ending).unlink(missing_ok=True)
