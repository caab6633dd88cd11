"""The rule of what is inside a mask, from its numbers alone. The command and the transforms both follow it.

Masks of 0 and one other value, grey images and probabilities are clear. A label map is not: whoever has one must say
what is wanted of it, and is told so.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Mask = NDArray[np.bool_]

NONZERO = "nonzero"
SHOWN = 6  # values that a message lists
LEVELS = 32  # a gradient has at least that many values
FLAT = 0.5  # of a label map most pixels are like their neighbours; of soft edges and pictures few are


class UnclearMaskError(ValueError):
    """What is inside is not clear from the values; the message says what they are.

    Attributes:
        example: one of the values, as an example for the advice.
    """

    def __init__(self, message: str, example: int | float) -> None:
        super().__init__(message)
        self.example = example


def above(threshold: float) -> str:
    """The rule of a threshold, in words.

    >>> above(127)
    '> 127'
    """
    return f"> {text(threshold)}"


def find_inside(
    array: Array, valid: Mask | None = None, *, top: int | None = None, lossy: bool = False
) -> "tuple[Mask, str]":
    """Tell what is inside.

    Args:
        array: bool, integer or floating point; the last two axes are those of an image.
        valid: which pixels count; the others are outside. None if all count.
        top: the number that is white, in images of grey. None takes 255 for uint8 and 65535 for uint16; other types
            are not images of grey.
        lossy: whether compression has changed values, so that 0 may have become 3.

    Returns:
        True inside, in the shape of the array; and the rule in words: "nonzero", or a threshold such as "> 127".

    Raises:
        UnclearMaskError: a ValueError: it is a label map, or holds other numbers that tell no inside.

    Example:
        >>> find_inside(np.array([[0, 255]], dtype=np.uint8))
        (array([[False,  True]]), 'nonzero')
        >>> find_inside(np.array([[0, 1, 15, 255]], dtype=np.uint8))
        Traceback (most recent call last):
        torchlinf._helpers.inside.UnclearMaskError: 4 values (0, 1, 15, 255)
    """
    threshold = _threshold(array, valid, top, lossy)
    inside: Mask = array != 0 if threshold is None else array > threshold
    return (inside if valid is None else inside & valid), NONZERO if threshold is None else above(threshold)


def distinct(array: Array, valid: Mask | None = None) -> tuple[Array, Array]:
    """The values of the pixels that count, in ascending order, and how many pixels have each."""
    pixels = array.ravel() if valid is None else array[valid]
    if array.dtype in (np.uint8, np.uint16):  # without sorting: images are large
        counts = np.bincount(pixels, minlength=1)
        return np.flatnonzero(counts).astype(array.dtype), counts[counts > 0]
    return np.unique(pixels, return_counts=True)


def _threshold(array: Array, valid: Mask | None, top: int | None, lossy: bool) -> float | None:
    """What must be exceeded to be inside; None where inside is what is not 0."""
    if array.dtype == np.bool_:
        return None
    values, counts = distinct(array, valid)
    if not len(values):
        return None
    low, high = values[0].item(), values[-1].item()
    if top is None and array.dtype in (np.uint8, np.uint16):
        top = np.iinfo(array.dtype).max
    half = None if top is None else top // 2
    if lossy and half is not None:
        return float(half)
    if len(values) <= 2:
        is_share = isinstance(low, float) and 0 < low <= high < 1
        if (low == high or 0 in (low, high)) and not is_share:
            return None
        if low < 0 < high:
            return 0.0
    if array.dtype.kind == "f":
        if low >= 0 and high <= 1:
            return 0.5
        if not bool((values == np.rint(values)).all()):
            raise UnclearMaskError(f"numbers from {low:g} to {high:g}", 0)
    elif half is not None and low <= half < high and _is_grey(array, valid, values, counts, half):
        return float(half)
    raise UnclearMaskError(f"{len(values)} values ({listed(values)})", _example(values, counts))


def text(value: int | float) -> str:
    """A number for a message; integers keep every digit.

    >>> text(2**62 + 1), text(3.0), text(0.1)
    ('4611686018427387905', '3', '0.1')
    """
    return str(value) if isinstance(value, int) else f"{value:.10g}"


def listed(values: Array) -> str:
    """Values for a message, shortened in the middle.

    >>> listed(np.arange(20))
    '0, 1, 2, 3, 4 ... 19'
    """
    texts = [text(value) for value in values.tolist()]
    return ", ".join(texts) if len(texts) <= SHOWN else f"{', '.join(texts[: SHOWN - 1])} ... {texts[-1]}"


def _example(values: Array, counts: Array) -> int | float:
    """The commonest value that is not 0."""
    most: int | float = values[np.argmax(np.where(values == 0, 0, counts))].item()
    return most


def _is_grey(array: Array, valid: Mask | None, values: Array, counts: Array, half: int) -> bool:
    """Whether values are shades, not labels: soft edges, ringing, a picture or a gradient.

    A label covers areas: most of its pixels equal both the next one to the right and the next one below. A shade
    between dark and bright does not, unless it is part of a wide gradient, whose steps are small.
    """
    if array.ndim < 2 or min(array.shape[-2:]) < 2:
        return False
    dark = values[np.argmax(np.where(values <= half, counts, 0))]
    bright = values[np.argmax(np.where(values > half, counts, 0))]
    corner, right, below = array[..., :-1, :-1], array[..., :-1, 1:], array[..., 1:, :-1]
    between = (corner != dark) & (corner != bright)
    if valid is not None:
        between &= valid[..., :-1, :-1]
    count = np.count_nonzero(between)
    if not count:
        return False
    if np.count_nonzero(between & (corner == right) & (corner == below)) < FLAT * count:
        return True
    steps = np.abs(corner.astype(np.int64) - right)[corner != right]
    return len(values) >= LEVELS and steps.size > 0 and float(np.median(steps)) <= half / LEVELS
