"""What is inside and what is outside: from the numbers in a file to a mask.

`RULE` states what is inside where no threshold is given, and `inside_above` finds it.
"""

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchlinf.scoring.coco import Outline, draw
from torchlinf.scoring.in_memory import InMemory, values_in_memory
from torchlinf.scoring.readers import UnreadableMaskError, Values, read_values
from torchlinf.scoring.sources import Source

# 8192 x 8192. Solving takes some 130 bytes a pixel, so that a mask of this size still fits into 10 GB.
MAX_PIXELS = 2**26

RULE = """\
Without a threshold, inside is

- of two values: the larger one;
- of a JPEG, and of 8- and 16-bit images with values above half of their range: what lies above that half (127, 32767);
- of other integers, and of palettes of colours (label maps): what lies above 0;
- of numbers from 0 to 1: what lies above 0.5.

Colours count by the brightest of red, green and blue. Transparent pixels are black; where that leaves one colour, the
opacity itself is the mask. Of a GIF the first frame is read; a TIFF of several pages is a volume. Arrays are (H, W) or
(D, H, W); leading axes of length 1 are dropped."""


def read_mask(
    path: str | os.PathLike[str],
    *,
    member: str | None = None,
    threshold: float | None = None,
    invert: bool = False,
    max_pixels: int = MAX_PIXELS,
) -> NDArray[np.bool_]:
    """Read one mask.

    Args:
        path: a PNG, GIF, TIFF, BMP, JPEG, .npy or .npz file. Arrays are read without pickle.
        member: which array of an .npz archive, by name; None if it holds one only.
        threshold: inside is what is greater, in the file's own units; None chooses by `RULE`.
        invert: swap inside and outside.
        max_pixels: larger images are refused before memory is taken for them.

    Returns:
        bool array (H, W) or (D, H, W), True inside; it may be empty or full.

    Raises:
        UnreadableMaskError: a ValueError: the file is missing, empty, damaged, too large or holds no mask; the message
            says which.
    """
    source = Source(Path(path), member)
    return read_source(source, threshold=threshold, invert=invert, max_pixels=max_pixels)


def read_source(
    source: Source, *, threshold: float | None = None, invert: bool = False, max_pixels: int = MAX_PIXELS
) -> NDArray[np.bool_]:
    """Read one of the masks that `find_masks` found.

    Args:
        source: the mask. Outlines of COCO files are masks already: the threshold does not concern them.
        threshold: inside is what is greater, in the file's own units; None chooses by `RULE`.
        invert: swap inside and outside.
        max_pixels: larger images are refused before memory is taken for them.

    Returns:
        bool array (H, W) or (D, H, W), True inside; it may be empty or full.

    Raises:
        UnreadableMaskError: a ValueError: the file is missing, empty, damaged, too large or holds no mask; the message
            says which.
    """
    if source.error:
        raise UnreadableMaskError(source.error)
    data = source.data
    if isinstance(data, Outline):
        inside = draw(data, max_pixels)
    else:
        values = (
            values_in_memory(data, max_pixels)
            if isinstance(data, InMemory)
            else read_values(source.path, source.member, max_pixels, data)
        )
        inside = values.array > (inside_above(values) if threshold is None else threshold)
    return ~inside if invert else inside


def inside_above(values: Values) -> float:
    """Return the threshold that `RULE` gives: inside is what is greater.

    >>> inside_above(Values(np.array([[0, 255, 0]], dtype=np.uint8)))
    0.0
    >>> inside_above(Values(np.array([[0, 3, 252, 255]], dtype=np.uint8), lossy=True))
    127.0
    >>> inside_above(Values(np.array([[0, 1, 7, 12]])))
    0.0
    """
    array = values.array
    if array.dtype == np.bool_:
        return 0.0
    low, high = array.min(), array.max()
    is_float = array.dtype.kind == "f"
    if is_float and not np.isfinite([low, high]).all():
        raise UnreadableMaskError("values must be finite; got NaN or infinity. Replace them before saving")
    if not values.lossy and low < high and bool(((array == low) | (array == high)).all()):
        return float(low)
    if is_float:
        if low < 0 or high > 1:
            raise UnreadableMaskError(
                f"floating-point values must be two in number or lie in [0, 1]; got {low:g} to {high:g}. "
                "Pass a threshold"
            )
        return 0.5
    half = float(np.iinfo(array.dtype).max // 2)
    is_grey = array.dtype in (np.uint8, np.uint16) and high > half and not values.labels
    return half if values.lossy or is_grey else 0.0
