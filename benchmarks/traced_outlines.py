"""Walls from pixels: true outlines of buildings in Boulder, traced from pixels and made straight again.

Run `TORCHLINF_FOOTPRINTS=folder python -m benchmarks.traced_outlines`; it prints a table in Markdown. Each outline is
drawn as a mask, sharp or blurred by a Gaussian of one pixel as a model's are, and traced. buildingregulariser and
mask2polymin are compared with if they are installed.
"""

import argparse
import importlib.util
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import shapely
import torch
from scipy.ndimage import gaussian_filter

from torchlinf.polygons import simplify

FILE, CRS = "boulder_13491.gpkg", "EPSG:32613"
CASES = ((0.5, 0.0), (0.5, 1.0), (1.0, 0.0), (1.0, 1.0))  # metres a pixel, and the Gaussian's deviation in pixels
LEAST = 60.0  # square metres; smaller buildings are left out
WALL = 4  # pixels; the direction of shorter sides is not asked for
FINE = 4  # parts of a pixel's side, where a drawing is blurred
MARGIN = 4  # pixels
NOTHING_ELSE = 1e9  # a weight at which no flip pays

Shapes = Any


def traced(shape: Any, pixel: float, blur: float) -> Any:
    """The largest part of the outline of a drawing, north up, on a grid whose lines are multiples of the pixel."""
    bounds = np.array(shape.bounds).reshape(2, 2) / pixel
    x0, y0 = np.floor(bounds[0]) - MARGIN
    width, height = (np.ceil(bounds[1]) + MARGIN - (x0, y0)).astype(int)
    fine = FINE if blur else 1
    x, y = np.meshgrid((np.arange(width * fine) + 0.5) / fine, (np.arange(height * fine) + 0.5) / fine)
    mask = shapely.contains_xy(shape, (x0 + x) * pixel, (y0 + y) * pixel)
    if blur:
        grey = gaussian_filter(mask.astype(float), blur * fine)
        mask = grey.reshape(height, fine, width, fine).mean(axis=(1, 3)) > 0.5
    row, column = np.nonzero(mask)
    left, low = (x0 + column) * pixel, (y0 + row) * pixel
    whole = shapely.union_all(shapely.box(left, low, left + pixel, low + pixel))
    return shapely.simplify(max(shapely.get_parts(whole), key=shapely.area), 0)


def sides(shape: Any, least: float) -> tuple[Any, Any, Any]:
    """Sides of at least some length as lines, their lengths, and their directions in degrees."""
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(shape)]
    ends = np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings])
    x, y = (ends[:, 1] - ends[:, 0]).T
    long = np.hypot(x, y) >= least
    return shapely.linestrings(ends[long]), np.hypot(x, y)[long], np.degrees(np.arctan2(y, x))[long]


def angle_error(true: Any, found: Any, least: float) -> float:
    """Degrees between the long sides and the nearest true ones, the mean by length; NaN without long sides."""
    lines, lengths, angles = sides(found, least)
    walls, _, truth = sides(true, least)
    if not len(lines) or not len(walls):
        return float("nan")
    middles = shapely.line_interpolate_point(lines, 0.5, normalized=True)
    nearest = shapely.distance(middles[:, None], walls[None]).argmin(axis=1)
    return float(np.average(np.abs((angles - truth[nearest] + 90) % 180 - 90), weights=lengths))


def methods(pixel: float) -> dict[str, Callable[[Shapes], Shapes]]:
    """What makes outlines straight, by name."""
    found: dict[str, Callable[[Shapes], Shapes]] = {"traced": lambda raw: raw}
    for share in (0.75, 1.0):
        found[f"Douglas-Peucker, {share:g} pixels"] = lambda raw, share=share: shapely.simplify(raw, share * pixel)
    if importlib.util.find_spec("buildingregulariser"):
        from buildingregulariser import regularize_geodataframe

        def regularised(raw: Shapes, share: float) -> Shapes:
            frame = geopandas.GeoDataFrame({"number": range(len(raw))}, geometry=raw, crs=CRS)
            by = {"parallel_threshold": share * pixel, "simplify_tolerance": share * pixel, "num_cores": 1}
            new = regularize_geodataframe(frame, **by).set_index("number").geometry
            return np.array([new.get(i, raw[i]) for i in range(len(raw))], dtype=object)

        for share in (1.0, 2.0):
            found[f"buildingregulariser, {share:g} pixels"] = lambda raw, share=share: regularised(raw, share)
    if importlib.util.find_spec("mask2polymin"):
        from mask2polymin import FitterToPointsSequence

        def fitted(shape: Any) -> Any:
            points = shapely.get_coordinates(shapely.segmentize(shape.exterior, pixel))[:-1]
            middle = points.mean(axis=0)
            corners, _ = FitterToPointsSequence().fit((points - middle) / pixel, is_closed=True)
            return shapely.Polygon(corners * pixel + middle) if len(corners) > 2 else shape

        found["mask2polymin, 1 pixel"] = lambda raw: np.array([fitted(shape) for shape in raw], dtype=object)
    for share in (0.75, 0.85, 1.0):
        found[f"`straighten`, {share:g} pixels"] = lambda raw, share=share: simplify(
            raw, resolution=pixel, weight=NOTHING_ELSE, straighten=share * pixel
        )["geometry"]
    return found


def row(true: Shapes, raw: Shapes, new: Shapes, pixel: float) -> tuple[float, ...]:
    """The means of one method; an invalid outline counts as the one that was given."""
    broken = ~shapely.is_valid(new) | shapely.is_empty(new)
    new = np.where(broken, raw, new)
    iou = shapely.area(shapely.intersection(true, new)) / shapely.area(shapely.union(true, new))
    errors = [angle_error(one, other, WALL * pixel) for one, other in zip(true, new, strict=True)]
    corners = float(np.mean(shapely.get_num_coordinates(new) - 1))
    distance = float(np.mean(shapely.hausdorff_distance(true, new))) / pixel
    return (
        float(np.mean(iou)),
        float(np.quantile(iou, 0.05)),
        corners,
        float(np.nanmean(errors)),
        distance,
        broken.sum(),
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.traced_outlines", description=__doc__)
    parser.add_argument("--number", type=int, default=150, help="of buildings, drawn at random")
    number = parser.parse_args().number
    torch.set_num_threads(1)
    frame = geopandas.read_file(Path(os.environ["TORCHLINF_FOOTPRINTS"]) / FILE, engine="pyogrio")
    true = np.asarray(frame.explode().to_crs(CRS).geometry, dtype=object)
    true = true[(shapely.area(true) > LEAST) & shapely.is_valid(true)]
    true = true[np.random.default_rng(1).choice(len(true), number, replace=False)]
    simplify(true[:2], resolution=1.0, straighten=1.0)  # compiles
    names = (
        "IoU with the true outline",
        "5 % quantile",
        "corners",
        "angle error, degrees",
        "Hausdorff, pixels",
        "invalid",
    )
    print(f"{number} outlines; the true ones have {np.mean(shapely.get_num_coordinates(true) - 1):.1f} corners\n")
    print(f"| pixel | outlines | {' | '.join(names)} | ms an outline |\n|---|---|{'---|' * (len(names) + 1)}")
    for pixel, blur in CASES:
        raw = np.array([traced(shape, pixel, blur) for shape in true], dtype=object)
        for name, method in methods(pixel).items():
            start = time.process_time()
            new = method(raw)
            took = 1000 * (time.process_time() - start) / number
            values = " | ".join(f"{value:.4g}" for value in row(true, raw, new, pixel))
            print(f"| {pixel:g} m{', blurred' if blur else ''} | {name} | {values} | {took:.3g} |", flush=True)


if __name__ == "__main__":
    main()
