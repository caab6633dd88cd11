"""Masks of COCO JSON files: polygons, and run lengths of both kinds. Polygons need the extra `coco` (pycocotools)."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torchlinf._extras import require
from torchlinf.scoring.readers import UnreadableMaskError

# pycocotools walks along the outline in steps of a fifth of a pixel, wherever it leads.
FARTHEST = 1e6


@dataclass(frozen=True)
class Outline:
    """A mask as COCO has it.

    Attributes:
        height: of the image, pixels.
        width: of the image, pixels.
        segmentation: polygons [[x, y, x, y ...] ...], or {"counts": run lengths, "size": [height, width]}.
    """

    height: int
    width: int
    segmentation: Any


class Annotation(NamedTuple):
    """One annotation of a file: its name, and its mask or what is wrong with it."""

    name: str
    outline: Outline | None
    error: str | None


def coco_masks(path: Path) -> Iterator[Annotation]:
    """List the annotations of a COCO file, in its order; the name of each is its `id`.

    Raises:
        ImportError: pycocotools is not installed.
        OSError: the file cannot be read.
        UnreadableMaskError: it is not COCO JSON.
    """
    require("pycocotools.mask", "reading COCO files", "coco")
    try:
        content = json.loads(path.read_bytes())
        sizes = {image["id"]: (image["height"], image["width"]) for image in content["images"]}
        annotations = list(content["annotations"])
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise UnreadableMaskError(
            f"not a COCO file with images and annotations ({type(error).__name__}: {error})"
        ) from error
    seen: set[str] = set()
    for annotation in annotations:
        entry = _annotation(annotation, sizes)
        if entry.name in seen:
            name = next(new for number in count(2) if (new := f"{entry.name}#{number}") not in seen)
            entry = Annotation(name, None, "the file holds another annotation of this id before")
        seen.add(entry.name)
        yield entry


def draw(outline: Outline, max_pixels: int) -> NDArray[np.bool_]:
    """Draw a mask at the size of its image; what lies outside of the image is cut off.

    Returns:
        bool (height, width).

    Raises:
        UnreadableMaskError: the image is too large, or the segmentation is not valid.

    Example:
        >>> draw(Outline(2, 3, {"size": [2, 3], "counts": [2, 3, 1]}), max_pixels=6).astype(int)
        array([[0, 1, 1],
               [0, 1, 0]])
    """
    height, width = outline.height, outline.width
    if height * width > max_pixels:
        raise UnreadableMaskError(
            f"{height} x {width} pixels are more than the limit of {max_pixels}; raise it to read the mask"
        )
    segmentation = outline.segmentation
    if not isinstance(segmentation, dict):
        from pycocotools import mask

        polygons = [_polygon(points) for points in segmentation]
        segmentation = mask.merge(mask.frPyObjects(polygons, height, width))
    if segmentation.get("size") != [height, width]:
        raise UnreadableMaskError(f"run lengths of size {segmentation.get('size')} in an image of {[height, width]}")
    return _from_runs(segmentation.get("counts"), height, width)


def _annotation(annotation: Any, sizes: dict[Any, tuple[Any, Any]]) -> Annotation:
    name = str(annotation.get("id")) if isinstance(annotation, dict) else "None"
    if name == "None":
        return Annotation(name, None, "the annotation has no id")
    height, width = sizes.get(annotation.get("image_id"), (None, None))
    if not (isinstance(height, int) and isinstance(width, int) and height > 0 and width > 0):
        return Annotation(name, None, f"no image of known size has the id {annotation.get('image_id')!r}")
    segmentation = annotation.get("segmentation")
    if not isinstance(segmentation, list | dict) or not segmentation:
        return Annotation(name, None, "the annotation has no segmentation")
    return Annotation(name, Outline(height, width, segmentation), None)


def _polygon(points: Any) -> list[float]:
    try:
        values = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.ndim != 1 or len(values) < 6 or len(values) % 2:
        raise UnreadableMaskError("a polygon must be a list of three or more pairs x, y")
    if not (np.abs(values) <= FARTHEST).all():  # false for NaN
        raise UnreadableMaskError(f"a polygon must have finite coordinates of at most {FARTHEST:g} pixels")
    coordinates: list[float] = values.tolist()
    return coordinates


def _from_runs(counts: Any, height: int, width: int) -> NDArray[np.bool_]:
    """Runs of pixels outside and inside in turn, down the columns.

    Decoded here: pycocotools 2.0.11 hands out uninitialised memory where the runs end before the image does.
    """
    text = counts.encode("utf-8") if isinstance(counts, str) else counts
    runs = _expand(text) if isinstance(text, bytes) else text
    whole = isinstance(runs, list) and all(isinstance(run, int) and run >= 0 for run in runs)
    if not whole or sum(runs) != height * width:
        raise UnreadableMaskError("run lengths must be whole numbers that add up to the pixels of the image")
    inside = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
    return inside.reshape(width, height).T


def _expand(text: bytes) -> list[int]:
    """The run lengths in COCO's compressed form.

    Each is a number in digits of five bits, the lowest first, as characters from "0" on; a sixth bit says that more
    digits follow, and the fifth of the last one is the sign. From the fourth run on, a number is the difference to
    the run before the last.
    """
    runs: list[int] = []
    value = shift = 0
    for digit in (letter - 48 for letter in text):
        if not 0 <= digit < 64 or shift > 60:
            raise UnreadableMaskError("compressed run lengths hold a character or a number that is not valid")
        value |= (digit & 31) << shift
        shift += 5
        if not digit & 32:
            value -= (digit >> 4 & 1) << shift
            runs.append(value + (runs[-2] if len(runs) > 2 else 0))
            value = shift = 0
    if shift:
        raise UnreadableMaskError("compressed run lengths end within a number")
    return runs
