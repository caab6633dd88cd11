"""Masks in files and archives in, one row of numbers a mask out. Nothing that is wrong with one stops the others."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchlinf.measure import Measure, ragged_profile
from torchlinf.scoring.mask_rules import MAX_PIXELS, read_source
from torchlinf.scoring.readers import UnreadableMaskError
from torchlinf.scoring.rows import Score
from torchlinf.scoring.sources import Source
from torchlinf.scoring.workers import in_order

LONGEST = 500  # characters of an error: some quote what they found


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
    profile = ragged_profile(lambda _: shape, 1, Measure())
    peak, peak_scale = profile.peak()
    return sizes | {
        "pixels": pixels,
        "radius": profile.radius.item(),
        "components": int(label(shape, connectivity=shape.ndim, return_num=True)[1]),  # type: ignore[no-untyped-call]
        "complexity": profile.mean().item(),
        "complexity_low": profile.mean(0.0, 0.25).item(),
        "complexity_high": profile.mean(0.25, 1.0).item(),
        "peak": peak.item(),
        "peak_scale": peak_scale.item(),
        "error_bound": profile.field_error_bound.item(),
    }


def score_masks(
    sources: Iterable[Source],
    *,
    threshold: float | None = None,
    invert: bool = False,
    max_pixels: int = MAX_PIXELS,
    workers: int = 1,
    isolated: bool = False,
) -> Iterator[Score]:
    """Score masks, in the order of the sources.

    Args:
        sources: what `find_masks` found.
        threshold: inside is what is greater, in each file's own units; None chooses by `RULE`.
        invert: swap inside and outside.
        max_pixels: larger images are refused.
        workers: how many masks are worked on at a time. The numbers do not depend on it. With several workers and
            over a hundred sources they are processes, so that the call must stand under
            `if __name__ == "__main__":` in a script.
        isolated: use processes in any case, so that a mask which ends its process, by its need of memory for example,
            gives a row like any other that fails.

    Returns:
        An iterator of one row a source, each as soon as it and those before it are done. A mask that fails gives a row
        with `error`.

    Example:
        >>> from torchlinf.scoring import find_masks
        >>> rows = score_masks(find_masks(["no-such-file.png"]))
        >>> next(rows).error
        'no such file'
    """
    work = partial(score_source, threshold=threshold, invert=invert, max_pixels=max_pixels)
    return in_order(work, sources, workers=workers, seconds=_seconds, died=_died, isolated=isolated)


def score_source(
    source: Source, *, threshold: float | None = None, invert: bool = False, max_pixels: int = MAX_PIXELS
) -> Score:
    """Score one mask; whatever is wrong with it is the row's `error`. Arguments as in `score_masks`."""
    if not isinstance(source, Source):
        raise TypeError(f"sources must be what find_masks found; got {source!r}. Pass find_masks(paths).")
    start, row = time.perf_counter(), Score(source.name)
    try:
        inside = read_source(source, threshold=threshold, invert=invert, max_pixels=max_pixels)
        row = replace(row, **score_mask(inside))
    except UnreadableMaskError as error:
        row = replace(row, error=_one_line(str(error)))
    except Exception as error:
        # The others go on, whatever this one met: a field that does not converge, memory that runs out.
        row = replace(row, error=_one_line(f"{type(error).__name__}: {error}"))
    return replace(row, seconds=round(time.perf_counter() - start, 6))


def _seconds(row: Score) -> float:
    return row.seconds or 0.0


def _died(source: Source) -> Score:
    return Score(source.name, error="the process that scored it was killed or crashed; it may need more memory")


def _one_line(text: str) -> str:
    """The text on one line, not endless, and without characters that no file could hold."""
    return " ".join(text.split())[:LONGEST].encode("utf-8", "backslashreplace").decode()
