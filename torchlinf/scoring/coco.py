"""Masks of COCO JSON files: polygons, and run lengths of both kinds. Polygons need the extra `coco` (pycocotools)."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torchlinf._helpers.extras import require
from torchlinf.scoring.names import name_beside
from torchlinf.scoring.values import UnreadableMaskError, require_size

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


@dataclass(frozen=True)
class Segment:
    """A mask as COCO panoptic has it: a colour of a PNG.

    Attributes:
        picture: the PNG.
        label: R + 256 G + 65536 B.
    """

    picture: Path
    label: int


class Annotation(NamedTuple):
    """One annotation of a file: its name, its mask or what is wrong with it, its category and image."""

    name: str
    outline: Outline | Segment | None
    error: str | None
    category: str | None = None
    image: str | None = None


def coco_masks(path: Path, content: Any) -> Iterator[Annotation]:
    """List the annotations of a COCO file, in its order: instances, results (a bare list), or panoptic.

    The name of each is its `id`; without one, its position from 0 on; of a second one of a name, the name with "~2"
    behind. A panoptic file has its PNG images in a folder of its own name, or beside it.

    Args:
        path: the file.
        content: what its JSON says.

    Raises:
        ImportError: pycocotools is not installed.
        UnreadableMaskError: it is not COCO JSON.
    """
    require("pycocotools.mask", "reading COCO files", "coco")
    try:
        if isinstance(content, list):
            if not content or not all(isinstance(one, dict) and "image_id" in one for one in content):
                raise TypeError("a list, but not of results with an image_id")
            content = {"images": [], "annotations": content}
        images = {image["id"]: image for image in content["images"] if isinstance(image, dict) and "id" in image}
        annotations = list(content["annotations"])
        categories = {
            one["id"]: str(one.get("name", one["id"]))
            for one in content.get("categories") or ()
            if isinstance(one, dict) and "id" in one
        }
    except (ValueError, KeyError, TypeError) as error:
        raise UnreadableMaskError(
            f"not a COCO file with images and annotations, nor one of labelme ({type(error).__name__}: {error})"
        ) from error
    seen: set[str] = set()
    for position, annotation in enumerate(annotations):
        if not isinstance(annotation, dict):
            entries = [Annotation(str(position), None, "the annotation is not an object")]
        elif isinstance(annotation.get("segments_info"), list):
            entries = _segments(path, annotation)
        else:
            entries = [_annotation(annotation, position, images)]
        for entry in entries:
            name = name_beside(entry.name, seen)  # in files that were merged ids stand twice: each mask counts
            seen.add(name)
            category = categories.get(_key(entry.category), None if entry.category is None else str(entry.category))
            yield entry._replace(name=name, category=category, image=_image(entry.image, images))


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
    require_size((height, width), max_pixels, "read the mask")
    segmentation = outline.segmentation
    if not isinstance(segmentation, dict):
        from pycocotools import mask

        polygons = _polygons(segmentation)
        segmentation = mask.merge(mask.frPyObjects(polygons, height, width))
    if segmentation.get("size") != [height, width]:
        raise UnreadableMaskError(f"run lengths of size {segmentation.get('size')} in an image of {[height, width]}")
    return _from_runs(segmentation.get("counts"), height, width)


def _key(value: Any) -> Any:
    """What can be looked up: files of strangers may hold lists where numbers are meant."""
    return value if isinstance(value, int | str) else None


def _image(key: Any, images: dict[Any, Any]) -> str | None:
    name = images.get(_key(key), {}).get("file_name", key)
    return None if name is None else str(name)


def _annotation(annotation: dict[str, Any], position: int, images: dict[Any, Any]) -> Annotation:
    name = str(position if annotation.get("id") is None else annotation["id"])
    known: Any = (annotation.get("category_id"), annotation.get("image_id"))
    segmentation = annotation.get("segmentation")
    if not isinstance(segmentation, list | dict) or not segmentation:
        return Annotation(name, None, "the annotation has no segmentation", *known)
    image = images.get(_key(annotation.get("image_id")), {})
    size = image.get("height"), image.get("width")
    if not image and isinstance(segmentation, dict) and isinstance(segmentation.get("size"), list):
        size = (*segmentation["size"], None, None)[:2]  # a list of results names no images
    height, width = (int(side) if isinstance(side, float) and side.is_integer() else side for side in size)
    if not (isinstance(height, int) and isinstance(width, int) and height > 0 and width > 0):
        error = f"no image of known size has the id {annotation.get('image_id')!r}"
        return Annotation(name, None, error, *known)
    return Annotation(name, Outline(height, width, segmentation), None, *known)


def _segments(path: Path, annotation: dict[str, Any]) -> list[Annotation]:
    """The segments of an image of COCO panoptic."""
    image, file = annotation.get("image_id"), str(annotation.get("file_name"))
    places = [folder / file for folder in (path.with_suffix(""), path.parent)]
    picture = next((place for place in places if place.is_file()), None)
    entries = []
    for segment in annotation["segments_info"]:
        label = segment.get("id") if isinstance(segment, dict) else None
        error = None
        if "/" in file or "\\" in file or file in ("..", "."):
            error = "the name of its PNG leads elsewhere; it is not read"
        elif picture is None:
            error = f"its PNG is not there: {file} in the folder {places[0].parent.name} or beside the file"
        elif not isinstance(label, int):
            error = "the segment has no id"
        mask = None if error or picture is None or label is None else Segment(picture, label)
        category: Any = segment.get("category_id") if isinstance(segment, dict) else None
        entries.append(Annotation(f"{file}#{label}", mask, error, category, image))
    return entries


def _polygons(segmentation: list[Any]) -> list[list[float]]:
    """The polygons of a mask; points and lines beside them, which annotators leave behind, have no area."""
    if segmentation and all(isinstance(value, int | float) for value in segmentation):
        segmentation = [segmentation]  # one polygon, without the list around it
    parts = [one for one in segmentation if not (isinstance(one, list) and len(one) in (0, 2, 4))]
    return [_polygon(points) for points in parts or segmentation]


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
