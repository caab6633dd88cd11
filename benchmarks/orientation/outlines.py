"""Outlines of buildings, rectangles, L shapes and discs, and their masks: drawn, not resampled."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchlinf._helpers.boxes import bounding_box
from torchlinf.measure import smallest_rectangle
from torchlinf.measure.frames import centred_grid

Mask = NDArray[np.bool_]
PIXEL = 0.25  # metres


@dataclass(frozen=True)
class Drawn:
    """A mask of an outline at some angle and place.

    Attributes:
        mask: the outline at its angle.
        own: the outline drawn in the frame of its own smallest rectangle.
        angle: the turn that leads there.
        unfilled: share of that rectangle that is not the outline's.
        outline: the outline at its angle, in pixels.
    """

    mask: Mask
    own: Mask
    angle: float
    unfilled: float
    outline: Any


def drawn(outline: Any, phase: tuple[float, float] | None = None) -> Mask:
    """The pixels whose middles an outline (shapely, in pixels) holds; `phase` moves the grid off its centred place."""
    import shapely

    low, high = np.reshape(outline.bounds, (2, 2))
    begin, size = centred_grid(low, high)
    if phase is not None:
        begin, size = begin + phase, [n + 2 for n in size]
    places = [b + np.arange(-1, n + 1) + 0.5 + 1e-7 for b, n in zip(begin, size, strict=True)]
    shapely.prepare(outline)
    mask = shapely.contains_xy(outline, *np.meshgrid(*places, indexing="ij"))
    return np.asarray(mask[bounding_box(mask)], dtype=np.bool_)


def turned_outline(outline: Any, degrees: float) -> Any:
    """An outline turned about the origin."""
    from shapely import affinity

    return affinity.rotate(outline, degrees, origin=(0, 0))


def at_random(outline: Any, rng: np.random.Generator, most: float = 45.0) -> Drawn | None:
    """An outline at a random angle, `most` degrees at most, and place; None if it is smaller than 64 pixels."""
    outline = turned_outline(outline, rng.uniform(-most, most))
    phase = rng.uniform(-0.5, 0.5, 2)
    corners = [part.exterior.coords for part in getattr(outline, "geoms", [outline])]
    found = smallest_rectangle(np.concatenate(corners))
    angle = found.angle if found.saves else 0.0
    mask = drawn(outline, (phase[0], phase[1]))
    if mask.sum() < 64:
        return None
    return Drawn(mask, drawn(turned_outline(outline, angle)), angle, 1 - outline.area / found.area, outline)


def footprints(name: str) -> list[Any]:
    """Outlines of a GeoPackage in the folder TORCHLINF_FOOTPRINTS, in pixels about their middle; [] without it."""
    folder = os.environ.get("TORCHLINF_FOOTPRINTS")
    if not folder:
        return []
    import geopandas
    from shapely import affinity

    table = geopandas.read_file(Path(folder) / name)
    if table.crs.is_geographic:
        table = table.to_crs(table.estimate_utm_crs())
    outlines = []
    for outline in table.geometry:
        middle = outline.centroid
        moved = affinity.translate(outline, -middle.x, -middle.y)
        outlines.append(affinity.scale(moved, 1 / PIXEL, 1 / PIXEL, origin=(0, 0)))
    return outlines


def rectangles(number: int, rng: np.random.Generator) -> Iterator[Any]:
    """Rectangles with a short side of 40 to 120 pixels, up to 2.5 times as long."""
    import shapely

    for _ in range(number):
        short = rng.uniform(40, 120)
        yield shapely.box(0, 0, short, short * rng.uniform(1, 2.5))


def corners(number: int, rng: np.random.Generator) -> Iterator[Any]:
    """L shapes: such rectangles without a corner."""
    import shapely

    for whole in rectangles(number, rng):
        high, wide = whole.bounds[2:]
        yield whole.difference(shapely.box(0, 0, high * rng.uniform(0.2, 0.8), wide * rng.uniform(0.2, 0.8)))


def discs(number: int, rng: np.random.Generator) -> Iterator[Any]:
    """Discs with radii of 20 to 60 pixels."""
    import shapely

    for _ in range(number):
        yield shapely.Point(0, 0).buffer(rng.uniform(20, 60), quad_segs=200)


def silhouettes() -> list[Mask]:
    """The masks of the folder TORCHLINF_MPEG7, cropped; [] without it."""
    folder = os.environ.get("TORCHLINF_MPEG7")
    if not folder:
        return []
    from PIL import Image

    masks = [np.asarray(Image.open(file).convert("L")) > 0 for file in sorted(Path(folder).rglob("*.png"))]
    return [mask[bounding_box(mask)] for mask in masks]


def shrunk(mask: Mask, side: int) -> Mask:
    """A mask whose longer side is `side`: linear interpolation after smoothing, cut at one half."""
    from skimage.transform import resize

    size = [max(1, round(n * side / max(mask.shape))) for n in mask.shape]
    small = resize(mask.astype(float), size, order=1, anti_aliasing=True) > 0.5
    return np.ascontiguousarray(small[bounding_box(small)])
