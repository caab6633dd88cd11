"""Pixels that are not cubes: a mask of them is brought to cubes, since the measure counts steps of one length."""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.checks import count, positive

Mask = TypeVar("Mask", bound=Tensor | NDArray[Any])

MAX_CUBES = 2**27
CLOSE, SIMPLE = 1e-5, 64  # sizes come rounded: 0.3333 and 1 are meant as 1 : 3


def equal_spacing(
    mask: Mask, spacing: Sequence[float], *, voxel: float | None = None, max_pixels: int = MAX_CUBES
) -> Mask:
    """Bring a mask of oblong pixels to squares or cubes, by the nearest pixel.

    Every axis is scaled on its own, so a box stays a box, and its complexity stays exactly 0. With the finest size
    nothing is lost: every pixel becomes a block of one or more cubes, and what touches goes on to touch. The steps
    that thick slices leave stay as they are.

    Args:
        mask: (..., H, W) or (..., D, H, W), or any other number of dimensions; a tensor or an array, of any dtype:
            label maps are scaled alike.
        spacing: size of a pixel along each of the last axes, in any one unit; as many numbers as there are spatial
            axes. Only the ratios count, unless `voxel` is given.
        voxel: size of a cube in the same unit; None takes the finest of `spacing`. If it is larger than that, parts
            that are thinner than it may vanish.
        max_pixels: what would have more cubes than this is refused, before memory is taken for it.

    Returns:
        The mask in cubes, of the same type, dtype and device; the mask itself if its pixels are cubes of that size
        already. An axis of n pixels of size s has round(n s / v) cubes, at least one, that lie centred on it.

    Raises:
        TypeError: `mask` is neither a tensor nor an array, or `spacing` is not a sequence of numbers.
        ValueError: a size is not above 0, there are more sizes than axes, or there would be too many cubes.

    Source: the resampling by nearest neighbours that is usual for label images; the measure needs it because the
    distance and the field of Arslan and Tari (IEEE TIP 2020) are those of a grid of cubes.

    Example:
        >>> mask = np.ones((2, 6), dtype=bool)  # two slices, three times as thick as a pixel is wide
        >>> equal_spacing(mask, (3.0, 1.0)).shape
        (6, 6)
        >>> equal_spacing(mask, (3.0, 1.0), voxel=1.5).shape
        (4, 4)
    """
    if not isinstance(mask, Tensor | np.ndarray):
        raise TypeError(f"mask must be a tensor or an array; got {type(mask).__name__}. Pass np.asarray(mask).")
    sizes = checked_spacing(spacing)
    if len(sizes) > mask.ndim:
        raise ValueError(
            f"spacing must hold one number for each spatial axis of the mask; got {len(sizes)} numbers for shape "
            f"{tuple(mask.shape)}. Pass for example (0.5, 0.5)."
        )
    cube = cube_size(sizes, voxel)
    if cube is None or not all(mask.shape):
        return mask
    axes = range(mask.ndim - len(sizes), mask.ndim)
    ratios = [_ratio(size, cube) for size in sizes]
    shape = [_length(mask.shape[axis], ratio) for axis, ratio in zip(axes, ratios, strict=True)]
    if math.prod((*mask.shape[: axes.start], *shape)) > count(max_pixels, "max_pixels"):
        raise ValueError(
            f"spacing must make at most {max_pixels} cubes of the mask; got {words(sizes, None)} for a mask of "
            f"{tuple(mask.shape)}, which makes {' x '.join(map(str, shape))} cubes of {_text(cube)}. Pass a larger "
            "voxel."
        )
    result: Any = mask
    for axis, ratio, length in zip(axes, ratios, shape, strict=True):
        nearest = _nearest(mask.shape[axis], ratio, length)
        if nearest == list(range(mask.shape[axis])):
            continue
        if isinstance(mask, Tensor):
            result = result.index_select(axis, torch.tensor(nearest, device=mask.device))
        else:
            result = np.take(result, nearest, axis=axis)
    return result


def checked_spacing(spacing: Sequence[float]) -> tuple[float, ...]:
    """The sizes as floats.

    >>> checked_spacing([1, 0.5])
    (1.0, 0.5)
    """
    if isinstance(spacing, str) or not isinstance(spacing, Sequence | np.ndarray) or len(spacing) == 0:
        raise TypeError(f"spacing must hold one number for each axis; got {spacing!r}. Pass for example (0.5, 0.5).")
    return tuple(positive(size, "spacing") for size in spacing)


def cube_size(sizes: tuple[float, ...], voxel: float | None) -> float | None:
    """The size of the cubes that a mask is to be brought to; None if its pixels are that already.

    >>> cube_size((2.0, 0.5), None), cube_size((2.0, 2.0), None), cube_size((2.0, 2.0), 1)
    (0.5, None, 1.0)
    """
    cube = min(sizes) if voxel is None else positive(voxel, "voxel")
    return None if all(_ratio(size, cube) == 1 for size in sizes) else cube


IN_CUBES = " in cubes of "


def words(sizes: tuple[float, ...], voxel: float | None) -> str:
    """What a row of a table says about its spacing, with every digit.

    >>> words((3.0, 0.9, 0.9), None), words((2.0, 2.0), None)
    ('3 x 0.9 x 0.9 in cubes of 0.9', '2 x 2')
    """
    cube = cube_size(sizes, voxel)
    own = " x ".join(map(_text, sizes))
    return own if cube is None else f"{own}{IN_CUBES}{_text(cube)}"


def of_words(text: str) -> tuple[tuple[float, ...], float | None]:
    """The sizes, and that of the cubes, which `words` has put into words.

    Raises:
        ValueError: the text is another one.

    >>> of_words("3 x 0.9 x 0.9 in cubes of 0.9"), of_words("2 x 2")
    (((3.0, 0.9, 0.9), 0.9), ((2.0, 2.0), None))
    """
    own, _, cube = text.partition(IN_CUBES)
    return tuple(float(size) for size in own.split(" x ")), float(cube) if cube else None


def _text(size: float) -> str:
    return np.format_float_positional(size, trim="-")


def _ratio(size: float, cube: float) -> Fraction:
    """Cubes to a pixel; the simple fraction that is meant, if there is one close by."""
    exact = Fraction(size) / Fraction(cube)
    simple = exact.limit_denominator(SIMPLE)
    return simple if abs(simple - exact) <= CLOSE * exact else exact


def _length(pixels: int, ratio: Fraction) -> int:
    return max(1, math.floor(pixels * ratio + Fraction(1, 2)))


def _nearest(pixels: int, ratio: Fraction, length: int) -> list[int]:
    """The pixel that holds the centre of each cube; the row of cubes is centred on that of pixels."""
    p, q = ratio.numerator, ratio.denominator
    # The centre of cube j lies at pixels/2 + (j - (length - 1)/2)/ratio, in pixels; whole numbers keep it exact.
    places = ((pixels * p + (2 * j + 1 - length) * q) // (2 * p) for j in range(length))
    return [min(max(place, 0), pixels - 1) for place in places]
