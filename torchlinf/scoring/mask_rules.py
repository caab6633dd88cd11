"""What is inside and what is outside: from the numbers in a file to a mask.

`RULE` states what is inside where the caller does not say it. `torchlinf._helpers.inside` decides by the numbers, for
files as for the transforms; here stands what only files have: colours, pixels without data, stacks.
"""

import os
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from torchlinf._helpers.checks import count, flag, number_or_none, positive
from torchlinf._helpers.inside import NONZERO, UnclearMaskError, above, distinct, find_inside, listed, text
from torchlinf.scoring.coco import Outline, Segment, draw
from torchlinf.scoring.in_memory import InMemory, values_in_memory
from torchlinf.scoring.labelme import Drawing, draw_shapes
from torchlinf.scoring.last_read import read_once
from torchlinf.scoring.readers import read_values
from torchlinf.scoring.sources import Source
from torchlinf.scoring.values import UnreadableMaskError, Values

# 8192 x 8192. Solving takes some 130 bytes a pixel, so that a mask of this size still fits into 10 GB.
MAX_PIXELS = 2**26

MAX_LABELS = 2**16  # a label map with more is a picture
ADVISED = ("--labels", "--label", "--nonzero", "--threshold")  # options that say what is inside

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
axis; three axes (N, H, W), and a TIFF of several pages, need --stack or --volume. NIfTI is a volume by nature, and one
of several volumes needs --stack; where its voxels are no cubes, it is brought to cubes first (--spacing)."""

SPACINGS = ("header", "pixels")
EXCEPT = " except "  # in the column `inside`, before what --ignore names


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
        spacing: size of a pixel along each axis, or "header" for what the file says, or "pixels" for none; None takes
            that of NIfTI and no other.
        voxel: size of the cubes that masks with a spacing are brought to; None takes the finest of the spacing.
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
    spacing: str | Sequence[float] | None = None
    voxel: float | None = None

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
        if isinstance(self.spacing, str):
            if self.spacing not in SPACINGS:
                raise ValueError(
                    f"spacing must be numbers, 'header' or 'pixels'; got {self.spacing!r}. Pass for example (2, 1, 1)."
                )
        elif self.spacing is not None:
            from torchlinf.measure import checked_spacing  # it needs torch, and the help of the command does not

            object.__setattr__(self, "spacing", checked_spacing(self.spacing))
        if self.voxel is not None:
            object.__setattr__(self, "voxel", positive(self.voxel, "voxel"))
            if self.spacing == "pixels":
                raise ValueError("voxel needs a spacing; got voxel and spacing='pixels'. Leave one of them out.")

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
        spacing: size of a pixel along each axis, if the mask is to be measured by it; None if in pixels.
    """

    suffix: str
    inside: NDArray[np.bool_]
    rule: str
    label: int | None
    shape: tuple[int, ...]
    origin: tuple[int, ...] = ()
    spacing: tuple[float, ...] | None = None


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
        path: an image, a NIfTI volume, an .npy or .npz file: one of `SUFFIXES`. Arrays are read without pickle.
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
        source: the mask. Outlines of COCO and labelme files are masks already: they can be inverted, and all else does
            not concern them.
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


def read_all(
    source: Source,
    reading: Reading,
    *,
    page: int | None = None,
    keep: bool = False,
    advised: Collection[str] = ADVISED,
) -> Iterator[Found]:
    """The masks of a source: one, or with `labels` and `stack` any number.

    Args:
        source: the mask, or what holds them.
        reading: how.
        page: of a stack this mask alone.
        keep: whether to keep the file's numbers until another file is read so: for many calls with one file.
        advised: which options an error may name where it is not clear what is inside.

    Raises:
        UnreadableMaskError: as `read_source`; from the iterator.
    """
    if source.error:
        raise UnreadableMaskError(source.error)
    data = source.data
    if isinstance(data, Outline | Drawing | Segment):
        if isinstance(data, Segment):
            inside = _labels(read_once(data.picture, None, reading.max_pixels)) == data.label
            label = data.label
        else:
            draw_it: Any = draw if isinstance(data, Outline) else draw_shapes
            inside, label = draw_it(data, reading.max_pixels), None
        rule = "outline" if label is None else f"label {label}"
        if reading.invert:
            inside, rule = ~inside, f"not {rule}"
        sizes = _sizes(None, False, inside.ndim, reading)
        yield Found("", inside, rule, label, inside.shape, spacing=sizes)
        return
    if isinstance(data, InMemory):
        values, is_volume = values_in_memory(data, reading.max_pixels), data.spatial_ndim == 3
    else:
        read = read_once if keep else read_values
        values, is_volume = read(source.path, source.member, reading.max_pixels, data, reading.volume), False
    for suffix, numbers in _pages(values, reading, 3 if reading.volume or is_volume else 2, page):
        sizes = _sizes(numbers.spacing, numbers.is_to_scale, numbers.array.ndim, reading)
        for found in _masks(numbers, reading, advised):
            yield found._replace(suffix=suffix + found.suffix, spacing=sizes)


def read_measured(source: Source, reading: Reading) -> NDArray[np.bool_]:
    """The mask of a source that holds one, as `read_inside`, in cubes if its pixels have a spacing."""
    return in_cubes(read_inside(source, reading), reading)


def in_cubes(found: Found, reading: Reading) -> NDArray[np.bool_]:
    """A mask as it is measured: cut out and brought to cubes, if its pixels are none; else as it is.

    Raises:
        UnreadableMaskError: there would be too many cubes, or none is inside.
    """
    from torchlinf._helpers.boxes import bounding_box
    from torchlinf.measure import cube_size, equal_spacing

    inside = found.inside
    if found.spacing is None or cube_size(found.spacing, reading.voxel) is None or not inside.any():
        return inside
    own = inside[bounding_box(inside)]
    try:
        cubes = equal_spacing(own, found.spacing, voxel=reading.voxel, max_pixels=reading.max_pixels)
    except ValueError as error:
        raise UnreadableMaskError(str(error)) from error
    if not cubes.any():
        raise UnreadableMaskError(f"nothing is left of the mask in cubes of {reading.voxel:g}; pass a smaller --voxel")
    return cubes


def _pages(
    values: Values, reading: Reading, spatial_ndim: int, page: int | None = None
) -> Iterator[tuple[str, Values]]:
    """The numbers of each mask or map in a file, and what to add to the name of the source."""
    array = values.array
    if array.ndim <= (values.spatial_ndim or spatial_ndim):
        yield "", values
        return
    if not reading.stack and page is None:
        raise UnreadableMaskError(
            f"{len(array)} volumes, {array.shape}: pass --stack for a row each"
            if values.spatial_ndim == 3
            else f"three axes, {array.shape}: pass --stack if these are {len(array)} masks, or --volume if they are "
            "the slices of one"
        )
    if page is not None and page >= len(array):
        raise UnreadableMaskError(f"the stack holds {len(array)} masks; got [{page}]")
    for index in range(len(array)) if page is None else [page]:
        yield f"[{index}]", values.page(index)


def _sizes(
    spacing: tuple[float, ...] | None, is_to_scale: bool, ndim: int, reading: Reading
) -> tuple[float, ...] | None:
    """The size of a pixel along each axis that a mask is to be measured by; None for the pixels as they are."""
    if reading.spacing in (None, "pixels"):
        sizes = spacing if is_to_scale and reading.spacing is None else None
    elif reading.spacing == "header":
        if spacing is None:
            raise UnreadableMaskError("the file does not say how large its pixels are; pass --spacing with numbers")
        sizes = spacing
    else:
        given = cast("tuple[float, ...]", reading.spacing)
        sizes = given * ndim if len(given) == 1 else given
        if len(sizes) != ndim:
            raise UnreadableMaskError(
                f"--spacing has {len(sizes)} numbers, and the mask {ndim} axes; pass one for each"
            )
    if reading.voxel is not None and sizes is None:
        raise UnreadableMaskError("--voxel needs the size of a pixel; pass --spacing")
    return sizes


def excepted(reading: Reading) -> str:
    """What --ignore names, in words, to stand behind a rule; empty if it names nothing."""
    return EXCEPT + ", ".join(map(str, reading.ignored)) if reading.ignored else ""


def _masks(values: Values, reading: Reading, advised: Collection[str]) -> Iterator[Found]:
    valid = _valid(values, reading)
    if reading.labels:
        yield from _every_label(_labels(values), valid)
        return
    inside, rule = _inside(values, valid, reading, advised)
    if reading.invert:
        inside, rule = ~inside, f"not {rule}"
    if valid is not None:
        inside &= valid
    if reading.label is None or reading.invert:
        rule += excepted(reading)
    yield Found("", inside, rule, reading.label, inside.shape)


def _valid(values: Values, reading: Reading) -> NDArray[np.bool_] | None:
    """Which pixels count; None if all do."""
    valid = values.valid
    if values.array.dtype.kind == "f" and bool((unknown := np.isnan(values.array)).any()):
        valid = ~unknown if valid is None else valid & ~unknown
    if reading.ignored:
        kept = ~is_ignored(values, reading)
        valid = kept if valid is None else valid & kept
    return valid


def is_ignored(values: Values, reading: Reading) -> NDArray[np.bool_]:
    """Which pixels have a value that --ignore names."""
    return np.isin(values.labels, reading.ignored)


def _inside(
    values: Values, valid: NDArray[np.bool_] | None, reading: Reading, advised: Collection[str]
) -> tuple[NDArray[np.bool_], str]:
    ids = values.labels
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
        raise UnreadableMaskError(_advice(error, values, valid, advised)) from error


def _dark_and_bright(array: NDArray[Any]) -> bool:
    """Whether the brightest channel of a lossy image tells a dark ground from a bright shape."""
    dark, bright = float((array < 64).mean()), float((array >= 192).mean())
    return min(dark, bright) > 0.001 and dark + bright > 0.8


def _advice(error: UnclearMaskError, values: Values, valid: NDArray[np.bool_] | None, advised: Collection[str]) -> str:
    if values.coloured:
        colours, _ = distinct(values.labels, valid)
        if values.lossy:
            return f"colours ({len(colours)}), changed by compression: pass --threshold for the brightest channel"
        if values.is_rgb:
            shown = listed(colours)
            return (
                f"{len(colours)} colours (R + 256 G + 65536 B: {shown}), and inside is not clear: pass "
                f"{_options(advised, error.example, 'black', ' for the brightest channel')}"
            )
    if (isinstance(error.example, float) and not error.example.is_integer()) or values.lossy or "numbers" in str(error):
        return f"{error}, and inside is not clear: pass --threshold"
    return f"{error}, and inside is not clear: pass {_options(advised, error.example, '0')}"


def _options(advised: Collection[str], example: int | float, outside: str, of_threshold: str = "") -> str:
    """What each of some options is for, as a list in words."""
    purposes = {
        "--labels": " for a row each",
        "--label": f" {text(example)} for one",
        "--nonzero": f" for all but {outside}",
        "--threshold": of_threshold,
    }
    *first, last = [name + purpose for name, purpose in purposes.items() if name in advised]
    return f"{', '.join(first)}, or {last}" if first else last


def _labels(values: Values) -> NDArray[Any]:
    """The labels of a label map, as integers."""
    ids = values.labels
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
