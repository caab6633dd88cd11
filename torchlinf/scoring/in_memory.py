"""Masks that are in memory already: the content of files, and arrays."""

from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np

from torchlinf.scoring.readers import parse_values
from torchlinf.scoring.values import UnreadableMaskError, Values, values_of_array

# What files begin with, for those that are not simply images.
BEGINNINGS = {b"\x93NUMPY": ".npy", b"PK\x03\x04": ".npz", b"II*\0": ".tif", b"MM\0*": ".tif"}


@dataclass(frozen=True, eq=False)
class InMemory:
    """A mask in memory.

    Attributes:
        content: bytes of a file, or an array.
        spatial_ndim: dimensions that an array must have, but for axes of length 1 before and behind them.
    """

    content: Any
    spatial_ndim: int = 2


def values_in_memory(mask: InMemory, max_pixels: int) -> Values:
    """The numbers of a mask in memory: of the bytes of a file, or of an array.

    Raises:
        UnreadableMaskError: the bytes are no image or array, or the numbers cannot be a mask.

    Example:
        >>> values_in_memory(InMemory([[0, 1]]), max_pixels=2).array
        array([[0, 1]])
    """
    if isinstance(mask.content, bytes):
        if not mask.content:
            raise UnreadableMaskError("the file is empty (0 bytes)")
        suffix = next((suffix for start, suffix in BEGINNINGS.items() if mask.content.startswith(start)), "")
        return parse_values(BytesIO(mask.content), suffix, max_pixels)
    array = np.asarray(mask.content)
    if array.dtype.kind not in "buif":
        raise UnreadableMaskError(f"an array must be bool, integer or floating point; got {array.dtype}")
    whole = array.shape
    while array.ndim > mask.spatial_ndim and 1 in (array.shape[0], array.shape[-1]):
        array = array[0] if array.shape[0] == 1 else array[..., 0]
    if array.ndim != mask.spatial_ndim or array.size == 0:
        wanted = "(H, W)" if mask.spatial_ndim == 2 else "(D, H, W)"
        raise UnreadableMaskError(
            f"an array must be {wanted} and hold pixels; got {whole}. Read images as grey, or pass spatial_ndim=3 for "
            "volumes"
        )
    if array.size > max_pixels:
        raise UnreadableMaskError(
            f"{array.size} pixels are more than the limit of {max_pixels}; raise it to score them"
        )
    return values_of_array(array, volume=True)
