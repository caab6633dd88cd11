"""Masks of the rows of a table: found again by the path of the row, as a small picture, and their profiles."""

import base64
import os
import re
from collections.abc import Callable, Iterable, Set
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchlinf._helpers.boxes import bounding_box
from torchlinf.measure import Measure, components, equal_spacing, ragged_profile, spacing_of_words
from torchlinf.report.rows import Row, Table, measure_of, number_of, text_of
from torchlinf.scoring import MAX_PIXELS, Source, UnreadableMaskError, find_masks, read_again, split_name

COLOUR = (31, 73, 125)  # of what is inside
SMALL, LARGE = 64, 128  # sides of a picture in the table and in a gallery, pixels
MOST_LEVELS = 100  # a profile of more levels is stored at this many scales
STEP = 1e-3  # values of a profile are stored as multiples of this; the largest value, 20 bits, fits into a uint16

MaskOf = Callable[[Row], NDArray[np.bool_]]


@dataclass
class Picture:
    """What a page shows of a mask.

    Attributes:
        small: the mask for the table, as a data URI; "" for none.
        large: the mask for a gallery, as a data URI; "" for none.
        profile: values at scales k/n for k = 1 ... n, in steps of `STEP`; empty for none.
        note: why something is missing; "" if nothing is.
    """

    small: str = ""
    large: str = ""
    profile: NDArray[np.uint16] = field(default_factory=lambda: np.empty(0, np.uint16))
    note: str = ""


def read_pictures(
    table: Table,
    shown: Iterable[int],
    mask_of: MaskOf | None,
    *,
    profiled: Set[int],
    large: Set[int],
    advance: Callable[[int, int], None],
) -> dict[int, Picture]:
    """The pictures of some rows of a table, by the number of the row."""
    shown = list(shown)
    pictures = {}
    for done, i in enumerate(shown, 1):
        pictures[i] = Picture()
        if mask_of is not None:
            pictures[i] = _picture(table, i, mask_of, i in profiled, i in large)
            advance(done, len(shown))
    return pictures


def _picture(table: Table, i: int, mask_of: MaskOf, profiled: bool, large: bool) -> Picture:
    row = table.rows[i]
    try:
        mask = mask_of(row)
    except Exception as error:
        # One file that cannot be read, for whatever reason, does not stop the page.
        return Picture(note="" if table.errors[i] else f"no picture: {error}")
    if note := changed(mask, row):
        return Picture(note=note)
    if not mask.any():
        return Picture()
    picture = Picture(thumbnail(mask), thumbnail(mask, LARGE) if large else "")
    if profiled and np.isfinite(table.score[i]):
        picture.profile, picture.note = profile_values(mask, row)
    elif not table.errors[i]:
        picture.note = "no profile: the page holds profiles of some rows only"
    return picture


@dataclass
class MaskReader:
    """Reads the mask that a row of a table tells of, by the row's path, its rule of what is inside, and its depth.

    Attributes:
        folder: where relative paths begin.
        max_pixels: larger masks are refused.
    """

    folder: Path = Path()
    max_pixels: int = MAX_PIXELS
    _found: dict[Path, dict[str, Source]] = field(default_factory=dict, repr=False)

    def __call__(self, row: Row) -> NDArray[np.bool_]:
        """Read the mask of a row.

        Returns:
            bool array (H, W) or (D, H, W), True inside.

        Raises:
            UnreadableMaskError: the file is not there any more, or it cannot be read.
        """
        path = str(row["path"])
        own, page = split_name(path)
        if (source := self._source(path)) is not None:
            page = None
        elif (source := self._source(own)) is None:
            raise UnreadableMaskError("no such file")
        volume, inside = not np.isnan(number_of(row.get("depth"))), text_of(row.get("inside"))
        mask = read_again(source, inside, page=page, volume=volume, max_pixels=self.max_pixels)
        number = number_of(row.get("object"))
        return mask if np.isnan(number) else _object(mask, int(number), measure_of(text_of(row.get("measure"))))

    def _source(self, path: str) -> Source | None:
        """The source of this name: a file, or after a colon one of those in it; None if there is none."""
        if "\0" in path:
            return None
        for name in (path, _bytes_of_escapes(path)):
            if os.path.isfile(self.folder / name):
                return Source(self.folder / name)
        for colon in (i for i, letter in enumerate(path) if letter == ":"):
            file, member = self.folder / path[:colon], path[colon + 1 :]
            if os.path.isfile(file):
                if file not in self._found:
                    self._found[file] = {text_of(one.member): one for one in find_masks([file], members="*")}
                # The array of an archive that holds one only is not found by its name.
                if member in self._found[file]:
                    return self._found[file][member]
        return None


def _object(mask: NDArray[np.bool_], number: int, measure: Measure) -> NDArray[np.bool_]:
    """One object of a mask, in the whole image."""
    found = components(mask, connectivity=measure.connectivity, min_pixels=measure.min_pixels)
    if number > len(found):
        raise UnreadableMaskError(f"the mask has {len(found)} objects; the table says that this is number {number}")
    alone, one = np.zeros_like(mask), found[number - 1]
    alone[one.box] = one.mask()
    return alone


def _bytes_of_escapes(path: str) -> str:
    """The name of a file as the system has it, if the table has bytes of it that are no UTF-8 as escapes."""
    return re.sub(r"\\x([89a-f][0-9a-f])", lambda match: chr(0xDC00 + int(match[1], 16)), path)


def changed(mask: NDArray[np.bool_], row: Row) -> str:
    """Why a mask is not the one that was scored; "" if nothing speaks against it."""
    pixels, inside = number_of(row.get("pixels")), int(np.count_nonzero(mask))
    if np.isnan(pixels) or pixels == inside:
        return ""
    return (
        f"the mask is not as it was scored: {inside:,} pixels are inside, the table says {int(pixels):,}. The file has "
        "changed"
    )


def thumbnail(mask: NDArray[np.bool_], side: int = SMALL) -> str:
    """A mask as a small picture: its bounding box, as PNG of two colours in a data URI; a volume from the front.

    >>> thumbnail(np.ones((4, 6), dtype=bool))[:22]
    'data:image/png;base64,'
    """
    from PIL import Image

    flat: NDArray[np.bool_] = np.asarray(mask.reshape(-1, *mask.shape[-2:]).any(axis=0))
    shape = Image.fromarray(flat[bounding_box(flat)].astype(np.uint8) * 255)
    scale = (side - 2) / max(shape.size)
    width, height = (max(1, round(length * scale)) for length in shape.size)
    # A few pixels are shown as squares. In a large mask a pixel of the picture is inside from a quarter on, so that
    # thin parts stay visible.
    shape = shape.resize((width, height), Image.Resampling.NEAREST if scale >= 1 else Image.Resampling.BOX)
    inside = np.zeros((side, side), dtype=np.uint8)
    top, left = (side - height) // 2, (side - width) // 2
    inside[top : top + height, left : left + width] = np.asarray(shape) >= 64
    file, picture = BytesIO(), Image.frombytes("P", (side, side), inside.tobytes())
    picture.putpalette([255, 255, 255, *COLOUR])
    picture.save(file, "png", bits=1, transparency=0, optimize=True)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()


def profile_values(mask: NDArray[np.bool_], row: Row) -> tuple[NDArray[np.uint16], str]:
    """The profile of a mask, measured as the row was, for the page.

    Returns:
        The values of a `Picture`, n being the radius, but at most `MOST_LEVELS`. Empty if there is no profile, with the
        reason why.
    """
    settings = text_of(row.get("measure"))
    measure = measure_of(settings) if settings else Measure()
    shape = mask[bounding_box(mask)]
    try:
        if spacing := text_of(row.get("spacing")):
            sizes, voxel = spacing_of_words(spacing)
            shape = equal_spacing(shape, sizes, voxel=voxel)
        shape = np.ascontiguousarray(shape)
        profile = ragged_profile([shape].__getitem__, 1, measure)
    except (RuntimeError, ValueError) as error:
        return np.empty(0, np.uint16), f"no profile: {error}"
    for name, ends in measure.named_windows().items():
        told = number_of(row.get(name))
        if abs(profile.mean(*ends).item() - told) > 1e-6:
            return np.empty(0, np.uint16), (
                f"no profile: {name} of the file is {profile.mean(*ends).item():.6f}, the table says {told:.6f}. The "
                "file has changed, or another version scored it"
            )
    levels = profile.level_values.numpy()
    # The default scales of a profile are k/100. A mean of parts has no levels of one length.
    values = levels if profile.parts is None and len(levels) <= MOST_LEVELS else profile.values[0].numpy()
    return np.round(values / STEP).astype(np.uint16), ""
