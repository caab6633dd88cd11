"""Noisy squares under the assumptions that the paper leaves open."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._boxes import bounding_box
from torchlinf.shapes.noise import boundary_of, closed, random_patches

FACTORS = (1, 2, 3, 4, 5, 6)

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Assumptions:
    """How the squares of a data set are made; the defaults are those of `torchlinf.shapes.add_noise`.

    Attributes:
        side: of the square, in pixels.
        lines: what a length L means: "both" reach L to both sides of their middle; "half" are L long in all;
            "outwards" reach L to the side that leads away from the middle of the square.
        closing: "last", or "always" for one after every addition.
        boundary: "present" places an addition on the outline as it is by then, "first" on that of the square.
        growing: True for a square with 100 additions that has grown from the one with 50, False for one made afresh.
        counts: numbers of additions, ascending.
    """

    side: int = 200
    lines: str = "both"
    closing: str = "last"
    boundary: str = "present"
    growing: bool = False
    counts: tuple[int, ...] = (50, 100, 150, 200)


def noisy_squares(assumptions: Assumptions, factor: int, number: int) -> list[Tensor]:
    """The squares of one noise factor in the data set of that number, one for each count."""
    if assumptions.growing:
        return _after_each(assumptions, factor, assumptions.counts, seed_of(number, factor, assumptions.counts[-1]))
    return [_after_each(assumptions, factor, [n], seed_of(number, factor, n))[0] for n in assumptions.counts]


def seed_of(number: int, factor: int, count: int) -> int:
    """The seed of a square; those of the gallery page, so that by default the squares are the same.

    The squares of a data set have no random numbers in common: with one seed for all of them they would not be
    independent, and the spread of tau would be another.
    """
    return 1_000_000 * number + 1_000 * factor + count


def _after_each(assumptions: Assumptions, factor: int, counts: Sequence[int], seed: int) -> list[Tensor]:
    """One square as it is after each count of additions."""
    canvas = np.pad(np.ones((assumptions.side, assumptions.side), dtype=np.bool_), 30 * (factor + 1))
    boundary, middle, found = boundary_of(canvas), (len(canvas) - 1) / 2, []
    for i, (place, lengths) in enumerate(random_patches(factor, counts[-1], seed), start=1):
        candidates = np.flatnonzero(boundary)
        row, column = divmod(int(candidates[int(place * len(candidates))]), len(canvas))
        patch = _patch(lengths, assumptions.lines, (column > middle, row > middle))
        # Closing reaches further than the patch by less than its square, and the boundary by one pixel more.
        reach = len(patch) // 2 + (factor if assumptions.closing == "always" else 0)
        near, inner = (_around(row, column, reach + more) for more in (factor + 1, 0))
        canvas[_around(row, column, len(patch) // 2)] |= patch
        if assumptions.closing == "always":
            canvas[inner] |= closed(canvas[near], factor)[factor + 1 : -factor - 1, factor + 1 : -factor - 1]
        if assumptions.boundary == "present":
            boundary[near][1:-1, 1:-1] = boundary_of(canvas[near])[1:-1, 1:-1]
        if i in counts:
            found.append(torch.from_numpy(closed(canvas[bounding_box(canvas)], factor)))
    return found


def _patch(lengths: NDArray[np.int64], lines: str, positive: tuple[bool, bool]) -> Mask:
    """Lines of lengths (2, width) in x and in y; outwards is to larger coordinates where `positive`."""
    width = lengths.shape[1]
    reach = max(width // 2, int(lengths.max(initial=0)))
    along = np.arange(-reach, reach + 1)
    start = reach - max(width - 1, 0) // 2
    patch = np.zeros((2, 2 * reach + 1, 2 * reach + 1), dtype=np.bool_)
    for i in range(2):
        limits = (lengths[i] - 1) / 2 if lines == "half" else lengths[i]
        drawn = np.abs(along) <= limits[:, None]
        if lines == "outwards":
            drawn &= (along >= 0) if positive[i] else (along <= 0)
        patch[i, start : start + width] = drawn
    return patch[0] | patch[1].T


def _around(row: int, column: int, reach: int) -> tuple[slice, slice]:
    return slice(row - reach, row + reach + 1), slice(column - reach, column + reach + 1)
