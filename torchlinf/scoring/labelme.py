"""Masks of labelme's JSON files: a picture's polygons, rectangles, circles and masks, as labelme itself draws them."""

import base64
import math
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torchlinf.scoring.open_image import PILLOW_FORMATS, open_image
from torchlinf.scoring.values import UnreadableMaskError, require_size

FARTHEST = 1e6  # coordinates beyond it are none of an image
WITHOUT_AREA = ("line", "linestrip", "point", "points")


@dataclass(frozen=True)
class Drawing:
    """The shapes of one object.

    Attributes:
        height: of the image, pixels.
        width: of the image, pixels.
        shapes: entries of the list `shapes` of the file.
    """

    height: int
    width: int
    shapes: tuple[Any, ...]


class Marked(NamedTuple):
    """One object of a file: its name, its shapes or what is wrong with them, its label and image."""

    name: str
    drawing: Drawing | None
    error: str | None
    category: str | None
    image: str | None


def is_labelme(content: Any) -> bool:
    """Whether the content of a JSON file is that of labelme."""
    return isinstance(content, dict) and isinstance(content.get("shapes"), list)


def labelme_masks(path: Path, content: dict[str, Any]) -> Iterator[Marked]:
    """List the objects of a labelme file, in its order; each is called by the position of its first shape, from 0 on.

    Shapes of one label and one `group_id` are one object.
    """
    height, width = _size(path, content)
    image = None if content.get("imagePath") is None else str(content["imagePath"])
    objects: dict[Any, list[tuple[int, Any]]] = {}
    for position, shape in enumerate(content["shapes"]):
        group = shape.get("group_id") if isinstance(shape, dict) else None
        key = position if group is None else (str(shape.get("label")), str(group))
        objects.setdefault(key, []).append((position, shape))
    for members in objects.values():
        position, first = members[0]
        shapes = tuple(shape for _, shape in members)
        category = str(first["label"]) if isinstance(first, dict) and first.get("label") is not None else None
        if height is None or width is None:
            error = "the file gives no imageHeight and imageWidth, and its image is not there"
            yield Marked(str(position), None, error, category, image)
        else:
            yield Marked(str(position), Drawing(height, width, shapes), None, category, image)


def draw_shapes(drawing: Drawing, max_pixels: int) -> NDArray[np.bool_]:
    """Draw an object at the size of its image, with its outline, as labelme does; lines and points have no area.

    Returns:
        bool (height, width).

    Raises:
        UnreadableMaskError: the image is too large, or a shape is not valid.

    Example:
        >>> box = {"shape_type": "rectangle", "points": [[2, 0], [1, 1]]}
        >>> draw_shapes(Drawing(3, 4, (box,)), max_pixels=12).astype(int)
        array([[0, 1, 1, 0],
               [0, 1, 1, 0],
               [0, 0, 0, 0]])
    """
    height, width = drawing.height, drawing.width
    require_size((height, width), max_pixels, "read the mask")
    if not all(isinstance(shape, dict) for shape in drawing.shapes):
        raise UnreadableMaskError("the shape is not an object")
    kinds = [str(shape.get("shape_type") or "polygon") for shape in drawing.shapes]
    solid = [pair for pair in zip(kinds, drawing.shapes, strict=True) if pair[0] not in WITHOUT_AREA]
    if not solid:
        raise UnreadableMaskError(f"a {kinds[0]} encloses no area")
    inside = np.zeros((height, width), dtype=np.bool_)
    for kind, shape in solid:
        inside |= _drawn(kind, shape, height, width, max_pixels)
    return inside


def _size(path: Path, content: dict[str, Any]) -> tuple[int | None, int | None]:
    """Height and width of the image; by the image itself, in the file or beside it, where the file does not say."""
    height, width = content.get("imageHeight"), content.get("imageWidth")
    if all(isinstance(side, int) and side > 0 for side in (height, width)):
        return height, width
    data, beside = content.get("imageData"), path.parent / str(content.get("imagePath"))
    if not data and not beside.is_file():  # opening a named pipe would wait for ever
        return None, None
    try:
        with BytesIO(base64.b64decode(data)) if data else beside.open("rb") as file:
            image = open_image(file, PILLOW_FORMATS)
            return image.height, image.width
    except (OSError, ValueError, TypeError):
        return None, None


def _drawn(kind: str, shape: dict[str, Any], height: int, width: int, max_pixels: int) -> NDArray[np.bool_]:
    from PIL import Image, ImageDraw

    points = _points(shape.get("points"))
    needed = {"circle": 2, "rectangle": 2, "mask": 2, "oriented_rectangle": 4}.get(kind)
    if kind not in ("polygon", "oriented_rectangle", "circle", "rectangle", "mask"):
        raise UnreadableMaskError(f"a shape must be a polygon, rectangle, circle or mask; got {kind}")
    if len(points) != needed if needed is not None else len(points) < 3:
        raise UnreadableMaskError(f"a {kind} must have {needed or 'three or more'} points; got {len(points)}")
    if kind == "mask":
        return _stored(shape.get("mask"), points, height, width, max_pixels)
    image = Image.new("L", (width, height))
    draw = ImageDraw.Draw(image)
    if kind == "circle":  # its centre, and a point on it
        (x, y), (to_x, to_y) = points
        radius = math.hypot(x - to_x, y - to_y)
        draw.ellipse([x - radius, y - radius, x + radius, y + radius], outline=1, fill=1)
    elif kind == "rectangle":  # two opposite corners, whichever
        (x, y), (to_x, to_y) = points
        draw.rectangle([min(x, to_x), min(y, to_y), max(x, to_x), max(y, to_y)], outline=1, fill=1)
    else:
        draw.polygon(points, outline=1, fill=1)
    return np.asarray(image) > 0


def _points(points: Any) -> list[tuple[float, float]]:
    try:
        values = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.ndim != 2 or values.shape[1] != 2:
        raise UnreadableMaskError("the points of a shape must be pairs x, y")
    if not (np.abs(values) <= FARTHEST).all():  # false for NaN
        raise UnreadableMaskError(f"points must have finite coordinates of at most {FARTHEST:g} pixels")
    return [(x, y) for x, y in values.tolist()]


def _stored(png: Any, points: list[tuple[float, float]], height: int, width: int, max_pixels: int) -> NDArray[np.bool_]:
    """A mask that the file holds as a PNG in base64, with the pixels of its corners, both of them inside."""
    try:
        picture = open_image(BytesIO(base64.b64decode(png, validate=True)), {"PNG": "Png"})
        (left, top), (right, bottom) = ((int(x), int(y)) for x, y in points)
        require_size((picture.height, picture.width), max_pixels)
        if picture.size != (right - left + 1, bottom - top + 1):
            raise ValueError(f"it is of {picture.size}, and its corners say otherwise")
        stored = np.asarray(picture.convert("L")) > 0
    except (OSError, ValueError, TypeError) as error:
        raise UnreadableMaskError(f"the mask of a shape must be a PNG in base64 ({error})") from error
    inside = np.zeros((height, width), dtype=np.bool_)
    rows, columns = slice(max(top, 0), max(bottom + 1, 0)), slice(max(left, 0), max(right + 1, 0))
    target = inside[rows, columns]
    target |= stored[max(-top, 0) :, max(-left, 0) :][: target.shape[0], : target.shape[1]]
    return inside
