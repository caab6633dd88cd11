"""The mask of a row of a table, read again by what the row says: its rule of what is inside, its page, its label."""

import numpy as np
from numpy.typing import NDArray

from torchlinf._helpers.inside import NONZERO
from torchlinf.scoring.mask_rules import EXCEPT, MAX_PIXELS, Reading, read_all
from torchlinf.scoring.sources import Source
from torchlinf.scoring.values import UnreadableMaskError


def read_again(
    source: Source, inside: str | None, *, page: int | None = None, volume: bool = False, max_pixels: int = MAX_PIXELS
) -> NDArray[np.bool_]:
    """Read the mask that a row tells of.

    Args:
        source: the mask, or the label map or stack that holds it.
        inside: the column `inside` of the row; None reads by `RULE`.
        page: which mask of a stack; None if the file is none.
        volume: whether the row's mask has a depth.
        max_pixels: larger images are refused.

    Returns:
        bool array (H, W) or (D, H, W), True inside, of the whole image.

    Raises:
        UnreadableMaskError: the file is not there any more, cannot be read, or holds no such mask.
    """
    readings = readings_of(inside or "", max_pixels=max_pixels, volume=volume)
    for number, reading in enumerate(readings, 1):
        try:
            found = next(read_all(source, reading, page=page, keep=True))
        except UnreadableMaskError:
            if number == len(readings):
                raise
        else:
            if not inside or found.rule == inside or number == len(readings):
                return found.inside
    raise UnreadableMaskError(f"what is inside is not known: {inside}")


def readings_of(inside: str, *, max_pixels: int = MAX_PIXELS, volume: bool = False) -> list[Reading]:
    """The ways of reading that give a rule such as "not > 127 except 255"; the first that does is the one.

    >>> (one,) = readings_of("not > 127 except 255, 3")
    >>> one.threshold, one.invert, one.ignore
    (127.0, True, (255, 3))
    >>> [reading.nonzero for reading in readings_of("nonzero")]
    [False, True]
    """
    rule, _, ignored = inside.partition(EXCEPT)
    invert, rule = rule.startswith("not "), rule.removeprefix("not ")
    try:
        ignore = tuple(int(value) for value in ignored.split(",") if value.strip())
        kind, _, value = rule.partition(" ")
        if kind == ">":
            return [Reading(float(value), None, False, ignore, invert, max_pixels, volume)]
        if kind == "label" and value:
            return [Reading(None, int(value), False, ignore, invert, max_pixels, volume)]
    except ValueError:
        return []
    # Without an option "nonzero" comes from masks of one value; with --nonzero from label maps.
    chosen = (False, True) if rule == NONZERO else (False,)
    return [Reading(None, None, nonzero, ignore, invert, max_pixels, volume) for nonzero in chosen]
