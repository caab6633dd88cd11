"""What is inside and what is outside: from the numbers in a file to a mask.

`RULE` states what is inside where the caller does not say it. `torchlinf._helpers.inside` decides by the numbers, for
files as for the transforms; here stands what only files have: colours, pixels without data, stacks.
"""

import os
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from numbers import Integral
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from torchlinf._helpers.checks import count, flag, number_or_none
from torchlinf._helpers.inside import NONZERO, UnclearMaskError, above, distinct, find_inside, listed, text
from torchlinf.scoring.coco import Outline, Segment, draw
from torchlinf.scoring.in_memory import InMemory, values_in_memory
from torchlinf.scoring.readers import read_values
from torchlinf.scoring.sources import Source
from torchlinf.scoring.values import UnreadableMaskError, Values

# 8192 x 8192. Solving takes some 130 bytes a pixel, so that a mask of this size still fits into 10 GB.
MAX_PIXELS = 2**26

MAX_LABELS = 2**16  # a label map with more is a picture

RULE = """\
Without an option, inside is

- of 0 and one other value: that value;
- of a negative and a positive value: the positive one;
- of a grey image (soft edges, a picture, a JPEG): what lies above half of the type's range (127, 32767);
- of numbers from 0 to 1: what lies above 0.5.

All else is a label map, or not clear, and needs an option: --labels, --label, --nonzero or --threshold. The column
`inside` says which rule was used.

Of a palette of colours the labels are the indices, and 0 is outside. A colour is the label R + 256 G + 65536 B, as in
COCO panoptic, and black is outside; a threshold goes by the brightest of the three. Transparent pixels are black; where
that leaves one colour, the opacity itself is the mask. NaN, the nodata value of a GeoTIFF, and what --ignore names are
outside, also with --invert. Of a GIF the first frame is read. Arrays are (H, W), or with 1, 3 or 4 channels as the last
axis; three axes (N, H, W), and a TIFF of several pages, need --stack or --volume."""


@dataclass(frozen=True)
class Reading:
    """How numbers become masks.

    Attributes:
        threshold: inside is what is greater, in the file's own units.
        label: inside is what has this label.
        nonzero: inside is what is not 0: all labels as one shape.
        ignore: values that are outside of everything, such as 255, the void of PASCAL VOC.
        invert: swap inside and outside.
        max_pixels: larger images are refused before memory is taken for them.
        volume: arrays of three axes, and TIFFs of several pages, are volumes (D, H, W).
        labels: every label is a mask of its own.
        stack: arrays of three axes, and TIFFs of several pages, are masks (N, H, W).
    """

    threshold: float | None = None
    label: int | None = None
    nonzero: bool = False
    ignore: int | Collection[int] = ()
    invert: bool = False
    max_pixels: int = MAX_PIXELS
    volume: bool = False
    labels: bool = False
    stack: bool = False

    def __post_init__(self) -> None:
        """Check the options."""
        number_or_none(self.threshold, "threshold", "Pass for example 127.")
        if self.label is not None and (isinstance(self.label, bool) or not isinstance(self.label, Integral)):
            raise TypeError(f"label must be None or an integer; got {self.label!r}. Pass for example 1.")
        for name in ("nonzero", "invert", "volume", "labels", "stack"):
            flag(getattr(self, name), name)
        count(self.max_pixels, "max_pixels")
        ignore = self.ignore if isinstance(self.ignore, Collection) else (self.ignore,)
        if isinstance(ignore, str) or not all(isinstance(value, Integral) for value in ignore):
            raise TypeError(f"ignore must hold integers; got {self.ignore!r}. Pass for example 255.")
        object.__setattr__(self, "ignore", tuple(int(value) for value in ignore))
        named = {"threshold": self.threshold is not None, "label": self.label is not None}
        chosen = [name for name, given in (named | {"nonzero": self.nonzero, "labels": self.labels}).items() if given]
        if len(chosen) > 1:
            raise ValueError(f"one option must say what is inside; got {' and '.join(chosen)}. Pass one of them.")
        if self.volume and self.stack:
            raise ValueError("three axes are a volume or a stack; got volume and stack. Pass one of them.")
        if self.labels and self.invert:
            raise ValueError("labels cannot be inverted: the outside of a label has no name. Pass label and invert.")

    @property
    def ignored(self) -> tuple[int, ...]:
        """`ignore`, which is a tuple once it is checked."""
        return cast("tuple[int, ...]", self.ignore)


class Found(NamedTuple):
    """A mask that was read.

    Attributes:
        suffix: what to add to the name of the source, "" if it holds this mask only.
        inside: bool (H, W) or (D, H, W), True inside.
        rule: what is inside, in words.
        label: which label, None if the mask is not of one.
        shape: of the whole image; `inside` may be a part of it that holds all of the label.
        origin: where in the image that part begins, one number an axis; empty if `inside` is the whole image.
    """

    suffix: str
    inside: NDArray[np.bool_]
    rule: str
    label: int | None
    shape: tuple[int, ...]
    origin: tuple[int, ...] = ()


def read_mask(
    path: str | os.PathLike[str],
    *,
    member: str | None = None,
    threshold: float | None = None,
    label: int | None = None,
    nonzero: bool = False,
    ignore: int | Collection[int] = (),
    invert: bool = False,
    max_pixels: int = MAX_PIXELS,
    volume: bool = False,
) -> NDArray[np.bool_]:
    """Read one mask.

    Args:
        path: a PNG, GIF, TIFF, BMP, JPEG, .npy or .npz file. Arrays are read without pickle.
        member: which array of an .npz archive, by name; None if it holds one only.
        threshold: inside is what is greater, in the file's own units.
        label: inside is what has this label.
        nonzero: inside is what is not 0: all labels as one shape. Without these three, `RULE` says what is inside.
        ignore: values that are outside of everything, such as 255, the void of PASCAL VOC; also with `invert`.
        invert: swap inside and outside.
        max_pixels: larger images are refused before memory is taken for them.
        volume: arrays of three axes, and TIFFs of several pages, are volumes (D, H, W).

    Returns:
        bool array (H, W) or (D, H, W), True inside; it may be empty or full.

    Raises:
        UnreadableMaskError: a ValueError: the file is missing, empty, damaged, too large or holds no mask, or it is not
            clear what is inside; the message says which.
    """
    source = Source(Path(path), member)
    return read_inside(source, Reading(threshold, label, nonzero, ignore, invert, max_pixels, volume)).inside


def read_source(
    source: Source,
    *,
    threshold: float | None = None,
    label: int | None = None,
    nonzero: bool = False,
    ignore: int | Collection[int] = (),
    invert: bool = False,
    max_pixels: int = MAX_PIXELS,
    volume: bool = False,
) -> NDArray[np.bool_]:
    """Read one of the masks that `find_masks` found.

    Args:
        source: the mask. Outlines of COCO files are masks already: they can be inverted, and all else does not concern
            them.
        threshold: inside is what is greater, in the file's own units.
        label: inside is what has this label.
        nonzero: inside is what is not 0: all labels as one shape. Without these three, `RULE` says what is inside.
        ignore: values that are outside of everything, such as 255, the void of PASCAL VOC; also with `invert`.
        invert: swap inside and outside.
        max_pixels: larger images are refused before memory is taken for them.
        volume: arrays of three axes, and TIFFs of several pages, are volumes (D, H, W).

    Returns:
        bool array (H, W) or (D, H, W), True inside; it may be empty or full.

    Raises:
        UnreadableMaskError: a ValueError: the file is missing, empty, damaged, too large or holds no mask, or it is not
            clear what is inside; the message says which.
    """
    return read_inside(source, Reading(threshold, label, nonzero, ignore, invert, max_pixels, volume)).inside


def read_inside(source: Source, reading: Reading) -> Found:
    """The mask of a source that holds one; as `read_source`."""
    (found,) = read_all(source, replace(reading, labels=False, stack=False))
    return found


def read_all(source: Source, reading: Reading) -> Iterator[Found]:
    """The masks of a source: one, or with `labels` and `stack` any number.

    Raises:
        UnreadableMaskError: as `read_source`; from the iterator.
    """
    if source.error:
        raise UnreadableMaskError(source.error)
    data = source.data
    if isinstance(data, Outline):
        inside = draw(data, reading.max_pixels)
        yield Found("", ~inside if reading.invert else inside, "outline", None, inside.shape)
        return
    if isinstance(data, Segment):
        values = read_values(data.picture, None, reading.max_pixels)
        inside = _labels(values) == data.label
        yield Found("", ~inside if reading.invert else inside, f"label {data.label}", data.label, inside.shape)
        return
    if isinstance(data, InMemory):
        values, is_volume = values_in_memory(data, reading.max_pixels), data.spatial_ndim == 3
    else:
        values, is_volume = read_values(source.path, source.member, reading.max_pixels, data, reading.volume), False
    if values.array.ndim == 3 and not (reading.volume or is_volume):
        if not reading.stack:
            raise UnreadableMaskError(
                f"three axes, {values.array.shape}: pass --stack if these are {len(values.array)} masks, or --volume "
                "if they are the slices of one"
            )
        for page in range(len(values.array)):
            for found in _masks(values.page(page), reading):
                yield found._replace(suffix=f"[{page}]{found.suffix}")
        return
    yield from _masks(values, reading)


def _masks(values: Values, reading: Reading) -> Iterator[Found]:
    valid = _valid(values, reading)
    if reading.labels:
        yield from _every_label(_labels(values), valid)
        return
    inside, rule = _inside(values, valid, reading)
    if reading.invert:
        inside, rule = ~inside, f"not {rule}"
    if valid is not None:
        inside &= valid
    yield Found("", inside, rule, reading.label, inside.shape)


def _valid(values: Values, reading: Reading) -> NDArray[np.bool_] | None:
    """Which pixels count; None if all do."""
    valid = values.valid
    if values.array.dtype.kind == "f" and bool((unknown := np.isnan(values.array)).any()):
        valid = ~unknown if valid is None else valid & ~unknown
    if reading.ignored:
        ids = values.array if values.ids is None else values.ids
        kept = ~np.isin(ids, reading.ignored)
        valid = kept if valid is None else valid & kept
    return valid


def _inside(values: Values, valid: NDArray[np.bool_] | None, reading: Reading) -> tuple[NDArray[np.bool_], str]:
    ids = values.array if values.ids is None else values.ids
    if reading.threshold is not None:
        return values.array > reading.threshold, above(reading.threshold)
    if reading.label is not None:
        return _labels(values) == reading.label, f"label {reading.label}"
    if reading.nonzero:
        return ids != 0, NONZERO
    array = values.array if values.array.dtype.kind != "f" or valid is None else np.where(valid, values.array, 0)
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise UnreadableMaskError("values must be finite; got infinity. Pass --threshold")
    try:
        if not values.coloured:
            return find_inside(array, valid, top=values.top, lossy=values.lossy)
        if values.lossy and _dark_and_bright(array):
            return find_inside(array, valid, lossy=True)
        return find_inside(ids, valid)
    except UnclearMaskError as error:
        raise UnreadableMaskError(_advice(error, values, valid)) from error


def _dark_and_bright(array: NDArray[Any]) -> bool:
    """Whether the brightest channel of a lossy image tells a dark ground from a bright shape."""
    dark, bright = float((array < 64).mean()), float((array >= 192).mean())
    return min(dark, bright) > 0.001 and dark + bright > 0.8


def _advice(error: UnclearMaskError, values: Values, valid: NDArray[np.bool_] | None) -> str:
    if values.coloured:
        colours, _ = distinct(values.array if values.ids is None else values.ids, valid)
        if values.lossy:
            return f"colours ({len(colours)}), changed by compression: pass --threshold for the brightest channel"
        if values.is_rgb:
            shown = listed(colours)
            return (
                f"{len(colours)} colours (R + 256 G + 65536 B: {shown}), and inside is not clear: pass --labels for a "
                f"row each, --label {text(error.example)} for one, --nonzero for all but black, or --threshold for the "
                "brightest channel"
            )
    if (isinstance(error.example, float) and not error.example.is_integer()) or values.lossy or "numbers" in str(error):
        return f"{error}, and inside is not clear: pass --threshold"
    return (
        f"{error}, and inside is not clear: pass --labels for a row each, --label {text(error.example)} for one, "
        "--nonzero for all but 0, or --threshold"
    )


def _labels(values: Values) -> NDArray[Any]:
    """The labels of a label map, as integers."""
    ids = values.array if values.ids is None else values.ids
    if values.lossy:
        raise UnreadableMaskError("lossy compression changes labels; save label maps as PNG or TIFF")
    if ids.dtype == np.bool_:
        return ids.astype(np.uint8)
    if ids.dtype.kind == "f":
        ids = np.where(np.isfinite(ids), ids, 0).astype(np.float64)
        if not bool((ids == np.rint(ids)).all()) or bool((np.abs(ids) > 2**53).any()):
            raise UnreadableMaskError("labels must be whole numbers; got others. Pass --threshold")
        return ids.astype(np.int64)
    return ids


def _every_label(labels: NDArray[Any], valid: NDArray[np.bool_] | None) -> Iterator[Found]:
    """A mask for each label but 0, in ascending order, cut out by its box."""
    from scipy.ndimage import find_objects

    if valid is not None:
        labels = np.where(valid, labels, np.zeros((), labels.dtype))
    names, _ = distinct(labels)
    if len(names) > MAX_LABELS:
        raise UnreadableMaskError(f"{len(names)} labels are more than {MAX_LABELS}: it is a picture. Pass --threshold")
    if len(names) and names[0] < 0:
        raise UnreadableMaskError(
            f"labels must not be negative; got {names[0]}. Pass --ignore {names[0]} if it stands for no label"
        )
    names = names[names != 0]
    numbered = np.searchsorted(names, labels, side="right").astype(np.int32)  # 1 for the first name, 0 for 0
    boxes = find_objects(numbered)
    if not boxes:
        yield Found("", np.zeros(labels.shape, dtype=np.bool_), "no label", None, labels.shape)
    for number, (name, box) in enumerate(zip(names.tolist(), boxes, strict=True), start=1):
        origin = tuple(side.start for side in box)
        yield Found(f"#{name}", numbered[box] == number, f"label {name}", name, labels.shape, origin)
