"""Masks in files and archives in, one row of numbers a mask out. A bad mask gives a row with an error."""

import os
import time
from collections.abc import Collection, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any, Unpack

import numpy as np
import torch
from numpy.typing import NDArray

from torchlinf import __version__
from torchlinf._helpers.axes import image_shape
from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.checks import number_of_axes
from torchlinf.measure import (
    ComplexityProfile,
    Measure,
    MeasureOptions,
    ragged_profile,
    spacing_words,
    takes,
)  # fmt: skip
from torchlinf.scoring.mask_rules import MAX_PIXELS, Found, in_cubes, read_all, read_inside
from torchlinf.scoring.options import ScoreOptions, score_measure
from torchlinf.scoring.rows import WINDOWS, Score
from torchlinf.scoring.sources import Source
from torchlinf.scoring.values import UnreadableMaskError
from torchlinf.scoring.workers import in_order

LONGEST = 500  # characters of an error: some quote a part of the file
EMPTY = "no foreground: no pixel is inside"
SMALL = "no object: every component has fewer pixels than min_pixels"
OBLONG = "objects of pixels that are no cubes have no rows of their own; pass --spacing pixels, or leave --per out"
SIDES = (("front", "back"), ("top", "bottom"), ("left", "right"))  # of a box, by axis
NOT_OF_A_MASK = (
    *("path", "seconds", "inside", "spacing", "label", "category", "image", "version", "measure"),
    *("object", *chain.from_iterable(SIDES)),
)


@takes(MeasureOptions, windows=WINDOWS)
def score_mask(
    inside: NDArray[np.bool_], *, spatial_ndim: int | None = None, **options: Unpack[MeasureOptions]
) -> dict[str, Any]:
    """Numbers of one mask, by the names of the columns of a table.

    Args:
        inside: bool (H, W), True inside; beyond the array is outside. Axes of length 1 before and behind it
            are dropped.
        spatial_ndim: 3 for a volume (D, H, W). None means an image; then three axes raise, since they may be a stack.
        {measure options}

    Returns:
        The columns from `height` to `field_error_bound`, with one for each window, `objects`, `angle`, `standard_error`
        and `error`; see `Score`. If `low`
        or `high` is given, or `windows` is None, the one window is called "complexity". For a mask without a pixel
        inside `error` says so, and its complexities are None. With `per="object"` the numbers of the objects are
        pooled, if nothing else is said by `pool="mean"`.

    Raises:
        TypeError: an option is of the wrong type; `rho` must be None or one number.
        ValueError: an option has a wrong value, or `spatial_ndim` does not explain the axes of `inside`.
        RuntimeError: the field could not be solved to `tol`.

    Example:
        >>> row = score_mask(np.ones((4, 6), dtype=bool))
        >>> row["pixels"], row["radius"], row["components"], row["complexity"]
        (24, 2, 1, 0.0)
    """
    axes = None if spatial_ndim is None else number_of_axes(spatial_ndim)
    inside = inside.reshape(image_shape(inside.shape, axes, "inside"))
    (row,) = (one.cells() for one in _numbers(inside, _pooling(score_measure(options))))
    return {name: value for name, value in row.items() if name not in NOT_OF_A_MASK}


@takes(MeasureOptions, windows=WINDOWS)
def score_masks(
    sources: Iterable[Source],
    *,
    threshold: float | None = None,
    label: int | None = None,
    nonzero: bool = False,
    ignore: int | Collection[int] = (),
    invert: bool = False,
    max_pixels: int = MAX_PIXELS,
    volume: bool = False,
    labels: bool = False,
    stack: bool = False,
    spacing: str | Sequence[float] | None = None,
    voxel: float | None = None,
    workers: int = 1,
    isolated: bool = False,
    **options: Unpack[MeasureOptions],
) -> Generator[Score]:
    """Score masks, in the order of the sources.

    Args:
        sources: what `find_masks` found.
        threshold: inside is what is greater, in each file's own units.
        label: inside is what has this label.
        nonzero: inside is what is not 0: all labels as one shape. Without these three, `RULE` says what is inside.
        ignore: values that are outside of everything, such as 255, the void of PASCAL VOC; also with `invert`.
        invert: swap inside and outside.
        max_pixels: larger images are refused.
        volume: arrays of three axes, and TIFFs of several pages, are volumes (D, H, W).
        labels: a row for each label of a map but 0, named with the label behind: "map.png#15".
        stack: arrays of three axes, and TIFFs of several pages, are masks (N, H, W), each with a row: "stack.npy[0]".
        spacing: size of a pixel along each axis, depth first, or "header" for what the file says, or "pixels" for none;
            None takes that of NIfTI and no other. A mask of oblong pixels is brought to cubes before it is measured:
            see `torchlinf.equal_spacing`.
        voxel: size of the cubes, in the same unit; None takes the finest of the spacing.
        workers: how many masks are worked on at a time. The numbers do not depend on it. With several workers and
            over a hundred sources they are processes, so that the call must stand under
            `if __name__ == "__main__":` in a script.
        isolated: use processes in any case, so that a mask which ends its process, by its need of memory for example,
            gives a row like any other that fails.
        {measure options}

    Returns:
        An iterator of one row a source (with `labels` and `stack` one a mask in it; with `per="object"` and without
        `pool` one an object, named with its number behind: "map.png@2"), each as soon as it and those before it are
        done. A mask that fails gives a row with `error`. If `low` or `high` is given, or `windows` is
        None, the one window is called "complexity". Close
        the iterator, for example by `contextlib.closing`, to end the workers before the last row.

    Raises:
        TypeError: an option is of the wrong type; `rho` must be None or one number.
        ValueError: an option has a wrong value.
        NoWorkersError: a RuntimeError, from the iterator: worker processes do not start.

    Example:
        >>> from torchlinf.scoring import find_masks
        >>> rows = score_masks(find_masks(["no-such-file.png"]))
        >>> next(rows).error
        'no such file'
    """
    chosen = ScoreOptions(
        threshold, invert, max_pixels, None, score_measure(options), label, nonzero, ignore, volume, labels, stack,
        spacing, voxel,
    )  # fmt: skip
    return score_each(sources, chosen, workers=workers, isolated=isolated)


@takes(MeasureOptions, windows=WINDOWS)
def score_source(
    source: Source,
    *,
    threshold: float | None = None,
    label: int | None = None,
    nonzero: bool = False,
    ignore: int | Collection[int] = (),
    invert: bool = False,
    max_pixels: int = MAX_PIXELS,
    volume: bool = False,
    spacing: str | Sequence[float] | None = None,
    voxel: float | None = None,
    **options: Unpack[MeasureOptions],
) -> Score:
    """Score one mask; whatever is wrong with it is the row's `error`.

    With `per="object"` the numbers of the objects are pooled, if nothing else is said by `pool="mean"`.

    Args:
        source: one of those that `find_masks` found.
        threshold: inside is what is greater, in the file's own units.
        label: inside is what has this label.
        nonzero: inside is what is not 0: all labels as one shape. Without these three, `RULE` says what is inside.
        ignore: values that are outside of everything, such as 255, the void of PASCAL VOC; also with `invert`.
        invert: swap inside and outside.
        max_pixels: a larger image is refused.
        volume: arrays of three axes, and TIFFs of several pages, are volumes (D, H, W).
        spacing: size of a pixel along each axis, "header", "pixels" or None; as in `score_masks`.
        voxel: size of the cubes that it is brought to, in the same unit; None takes the finest of the spacing.
        {measure options}

    Raises:
        TypeError: `source` is not a `Source`, or an option is of the wrong type.
        ValueError: an option has a wrong value.
    """
    chosen = ScoreOptions(
        threshold, invert, max_pixels, None, _pooling(score_measure(options)), label, nonzero, ignore, volume,
        spacing=spacing, voxel=voxel,
    )  # fmt: skip
    (row,) = score_rows(source, chosen)
    return row


def score_each(
    sources: Iterable[Source], options: ScoreOptions, *, workers: int = 1, isolated: bool = False
) -> Generator[Score]:
    """`score_masks` with options that have been checked."""
    with closing(score_groups(sources, options, workers=workers, isolated=isolated)) as groups:
        for rows in groups:
            yield from rows


def score_groups(
    sources: Iterable[Source], options: ScoreOptions, *, workers: int = 1, isolated: bool = False
) -> Generator[list[Score]]:
    """As `score_each`, with the rows of a source in one list."""
    if isinstance(sources, str | os.PathLike | Source):
        raise TypeError(f"sources must be what find_masks found; got {sources!r}. Pass find_masks(paths).")
    return in_order(
        partial(score_rows, options=options),
        sources,
        workers=workers,
        seconds=_seconds,
        died=partial(_died, options=options),
        isolated=isolated,
    )


def score_rows(source: Source, options: ScoreOptions) -> list[Score]:
    """The rows of a source: one; with the options `labels` and `stack` one for each mask, or each of its objects."""
    if not isinstance(source, Source):
        raise TypeError(f"sources must be what find_masks found; got {source!r}. Pass find_masks(paths).")
    rows: list[Score] = []
    category, image = (_storable(text) for text in (source.category, source.image))
    blank = replace(blank_row(source.name, options.measure), category=category, image=image)
    start = time.perf_counter()
    try:
        for found in read_all(source, options.reading):
            of_mask = _rows(found, replace(blank, path=source.name + found.suffix), options)
            share = round((time.perf_counter() - start) / len(of_mask), 6)
            rows += [replace(row, seconds=share) for row in of_mask]
            start = time.perf_counter()
    except Exception as error:
        # The others go on, whatever this one met: a damaged file, memory that runs out.
        rows.append(replace(blank, error=error_text(error), seconds=round(time.perf_counter() - start, 6)))
    return rows


def _rows(found: Found, blank: Score, options: ScoreOptions) -> list[Score]:
    """The row of a mask, or one for each of its objects."""
    blank = replace(blank, inside=found.rule, label=found.label)
    if found.spacing is not None:
        blank = replace(blank, spacing=spacing_words(found.spacing, options.voxel))
    try:
        measured = in_cubes(found, options.reading)
        if measured is not found.inside and options.measure.per == "object":
            raise UnreadableMaskError(OBLONG)
        rows = _numbers(found.inside, options.measure, found.origin, measured)
    except Exception as error:  # a field that does not converge, too many cubes
        return [replace(blank, error=error_text(error))]
    kept = ("inside", "spacing", "label", "category", "image")
    own = {name: getattr(blank, name) for name in kept}
    width, height, depth = (*reversed(found.shape), None)[:3]
    return [
        replace(
            row,
            **own,
            path=blank.path if row.object is None else f"{blank.path}@{row.object}",
            width=width,
            height=height,
            depth=depth,
        )
        for row in rows
    ]


def _pooling(measure: Measure) -> Measure:
    """The measure where there can be one row alone: objects are pooled."""
    return replace(measure, pool="mean") if measure.per == "object" and measure.pool is None else measure


def blank_row(path: str, measure: Measure, error: str | None = None) -> Score:
    """A row without numbers."""
    values = dict.fromkeys(measure.named_windows())
    return Score(path, values=values, error=error, version=__version__, measure=measure.settings())


def profile_source(source: Source, options: ScoreOptions) -> tuple[ComplexityProfile, NDArray[np.bool_]]:
    """Read one mask and measure it at all scales.

    Returns:
        The profile, of the leading shape (1,), and the mask, in cubes if its pixels have a spacing.

    Raises:
        UnreadableMaskError: there is no mask, or no pixel is inside, or no object is large enough.
        RuntimeError: the field could not be solved.
    """
    inside = in_cubes(read_inside(source, options.reading), options.reading)
    if not inside.any():
        raise UnreadableMaskError(EMPTY)
    profile = ragged_profile([inside].__getitem__, 1, options.measure)
    if not profile.radius.all():
        raise UnreadableMaskError(SMALL)
    return profile, inside


def error_text(error: Exception) -> str:
    """What went wrong with a mask, on one line, not endless, and without characters that no file could hold."""
    text = str(error) if isinstance(error, UnreadableMaskError) else f"{type(error).__name__}: {error}"
    return str(_storable(" ".join(text.split())[:LONGEST]))


def _storable(text: str | None) -> str | None:
    """A text without characters that no file could hold, such as half of a pair of surrogates."""
    return None if text is None else str(text).encode("utf-8", "backslashreplace").decode()


def _numbers(
    inside: NDArray[np.bool_],
    measure: Measure,
    origin: tuple[int, ...] = (),
    measured: NDArray[np.bool_] | None = None,
) -> list[Score]:
    """The row of a mask that has been read, or one for each of its objects.

    Args:
        inside: the mask.
        measure: how it is measured.
        origin: where the mask lies in its image.
        measured: the mask in cubes, if its pixels are none.
    """
    from skimage.measure import label

    row = replace(blank_row("", measure), pixels=int(np.count_nonzero(inside)))
    row = replace(row, **dict(zip(("width", "height", "depth"), reversed(inside.shape), strict=False)))
    pooled = measure.per == "object" and measure.pool is not None
    if not row.pixels:
        return [replace(row, radius=0, components=0, objects=0 if pooled else None, error=EMPTY)]
    box = bounding_box(inside)
    own = inside[box]
    shape = own if measured is None else measured[bounding_box(measured)]
    profile = ragged_profile([np.ascontiguousarray(shape)].__getitem__, 1, measure)
    if measure.per == "mask" or pooled:
        components = int(label(own, connectivity=own.ndim, return_num=True)[1])  # type: ignore[no-untyped-call]
        row = replace(row, components=components, objects=int(profile.objects) if pooled else None)
        if not profile.radius.all():
            return [replace(row, radius=0, error=SMALL)]
        return [replace(row, **numbers) for numbers in _columns(profile, measure)]
    assert profile.parts is not None
    if not profile.objects.all():
        return [replace(row, radius=0, components=0, error=SMALL)]
    begin = [side.start + first for side, first in zip(box, origin or (0,) * shape.ndim, strict=True)]
    alone, places, pixels = profile.parts.profile, profile.parts.box, profile.parts.pixels
    assert places is not None
    assert pixels is not None
    rows = []
    for number, (columns, place, count) in enumerate(
        zip(_columns(alone, measure), places.tolist(), pixels.tolist(), strict=True), start=1
    ):
        ends = {
            name: first + end
            for names, side, first in zip(SIDES[-shape.ndim :], place, begin, strict=True)
            for name, end in zip(names, side, strict=True)
        }
        rows.append(replace(row, **columns, **ends, object=number, pixels=count, components=1))
    return rows


def _columns(profile: ComplexityProfile, measure: Measure) -> Iterator[dict[str, Any]]:
    """The columns that follow from a profile, of each of its shapes."""
    windows = measure.named_windows()
    means = {name: profile.mean(*ends).tolist() for name, ends in windows.items()}
    bounds = torch.stack([profile.error_bound(*ends) for ends in windows.values()]).amax(dim=0).tolist()
    peaks, scales = (one.tolist() for one in profile.peak())
    angles = [None] * len(bounds) if profile.angle is None else profile.angle.tolist()
    errors = [None] * len(bounds)
    if measure.orientation == "mean":
        found = torch.stack([profile.standard_error(*ends) for ends in windows.values()]).amax(dim=0).tolist()
        errors = [None if np.isnan(error) else error for error in found]
    for i, radius in enumerate(profile.radius.tolist()):
        yield {
            "radius": radius,
            "values": {name: values[i] for name, values in means.items()},
            "peak": peaks[i],
            "peak_scale": scales[i],
            "error_bound": bounds[i],
            "field_error_bound": profile.field_error_bound[i].item(),
            "angle": angles[i],
            "standard_error": errors[i],
        }


def _seconds(rows: list[Score]) -> float:
    return sum(row.seconds or 0.0 for row in rows)


def _died(source: Source, options: ScoreOptions) -> list[Score]:
    error = "the process that scored it was killed or crashed; it may need more memory"
    return [blank_row(source.name, options.measure, error)]
