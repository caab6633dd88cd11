"""Folders of mask files in, one row of numbers a mask out. Nothing that is wrong with one file stops the others."""

import os
import time
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from torchlinf._readers import UnreadableMaskError, Values, read_values
from torchlinf._sources import Source, find_masks
from torchlinf._tables import COLUMNS, Score, open_table, print_table
from torchlinf.complexity import complexity_profile

__all__ = [
    "COLUMNS",
    "MAX_PIXELS",
    "RULE",
    "Score",
    "Source",
    "UnreadableMaskError",
    "find_masks",
    "open_table",
    "print_table",
    "read_mask",
    "score_mask",
    "score_masks",
]

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
    values = read_values(Path(path), member, max_pixels)
    inside: NDArray[np.bool_] = values.array > (inside_above(values) if threshold is None else threshold)
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


def score_mask(inside: NDArray[np.bool_]) -> dict[str, Any]:
    """Numbers of one mask, by the names of the columns of `Score`.

    Args:
        inside: bool (H, W) or (D, H, W).

    Returns:
        The columns from `height` to `error_bound`; for a mask without foreground those up to `components`, and `error`.

    >>> row = score_mask(np.ones((4, 6), dtype=bool))
    >>> row["pixels"], row["radius"], row["components"], row["complexity"]
    (24, 2, 1, 0.0)
    """
    from skimage.measure import label

    sizes = dict(zip(("width", "height", "depth"), reversed(inside.shape), strict=False))
    pixels = int(np.count_nonzero(inside))
    if pixels == 0:
        return sizes | {"pixels": 0, "radius": 0, "components": 0, "error": "no foreground: no pixel is inside"}
    # Beyond the array is outside, so that empty margins add nothing but work.
    extents = [np.flatnonzero(inside.any(axis=tuple(set(range(inside.ndim)) - {axis}))) for axis in range(inside.ndim)]
    shape = np.ascontiguousarray(inside[tuple(slice(extent[0], extent[-1] + 1) for extent in extents)])
    profile = complexity_profile(torch.from_numpy(shape), spatial_ndim=shape.ndim)
    peak, peak_scale = profile.peak()
    return sizes | {
        "pixels": pixels,
        "radius": int(profile.radius),
        "components": int(label(shape, connectivity=shape.ndim, return_num=True)[1]),  # type: ignore[no-untyped-call]
        "complexity": float(profile.mean()),
        "complexity_low": float(profile.mean(0.0, 0.25)),
        "complexity_high": float(profile.mean(0.25, 1.0)),
        "peak": float(peak),
        "peak_scale": float(peak_scale),
        "error_bound": float(profile.error_bound),
    }


def score_masks(
    sources: Iterable[Source],
    *,
    threshold: float | None = None,
    invert: bool = False,
    max_pixels: int = MAX_PIXELS,
    workers: int = 1,
) -> Iterator[Score]:
    """Score masks, in the order of the sources.

    Args:
        sources: what `find_masks` found.
        threshold: inside is what is greater, in each file's own units; None chooses by `RULE`.
        invert: swap inside and outside.
        max_pixels: larger images are refused.
        workers: how many masks are worked on at a time. The numbers do not depend on it.

    Yields:
        One row a source, as soon as it and those before it are done. A mask that fails gives a row with `error`.

    Example:
        >>> rows = score_masks(find_masks(["no-such-file.png"]))
        >>> next(rows).error
        'no such file'
    """
    score = partial(_score, threshold=threshold, invert=invert, max_pixels=max_pixels)
    pool = ThreadPoolExecutor(max_workers=workers)
    waiting: deque[Future[Score]] = deque()
    try:
        for source in sources:
            waiting.append(pool.submit(score, source))
            # Enough in flight to keep the workers busy past one slow mask, few enough for any number of sources.
            if len(waiting) > 8 * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        # After Ctrl-C the masks being solved are not waited for.
        pool.shutdown(wait=False, cancel_futures=True)


def _score(source: Source, *, threshold: float | None, invert: bool, max_pixels: int) -> Score:
    start, row = time.perf_counter(), Score(source.name, error=source.error)
    if row.error is None:
        try:
            inside = read_mask(
                source.path, member=source.member, threshold=threshold, invert=invert, max_pixels=max_pixels
            )
            row = replace(row, **score_mask(inside))
        except UnreadableMaskError as error:
            row = replace(row, error=_one_line(str(error)))
        except Exception as error:
            # The others go on, whatever this one met: a field that does not converge, memory that runs out.
            row = replace(row, error=_one_line(f"{type(error).__name__}: {error}"))
    return replace(row, seconds=round(time.perf_counter() - start, 6))


def _one_line(text: str) -> str:
    return " ".join(text.split())
