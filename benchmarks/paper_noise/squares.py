"""Noisy squares under the assumptions that the paper leaves open."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box
from torchlinf.shapes.noise import around, boundary_of, closed, drawn, outwards, random_patches

FACTORS = (1, 2, 3, 4, 5, 6)

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Assumptions:
    """How the squares of a data set are made; the defaults are those of `torchlinf.shapes.add_noise`.

    Attributes:
        side: of the square, in pixels.
        lines: where lines of length L lead: "outwards" away from the middle of the square; "to the nearer end" of the
            run of inside pixels that holds theirs; "both" L to both sides; "half" to both, L long in all.
        closing: "always" for one after every addition, or "last".
        boundary: "present" places an addition on the outline as it is by then, "first" on that of the square.
        growing: True for a square with 100 additions that has grown from the one with 50, False for one made afresh.
        counts: numbers of additions, ascending.
    """

    side: int = 160
    lines: str = "outwards"
    closing: str = "always"
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
    boundary, found = boundary_of(canvas), []
    for i, (place, lengths) in enumerate(random_patches(factor, counts[-1], seed), start=1):
        candidates = np.flatnonzero(boundary)
        row, column = divmod(int(candidates[int(place * len(candidates))]), len(canvas))
        patch = _patch(lengths, assumptions.lines, canvas, row, column)
        half, frame = len(patch) // 2, factor + 1
        near = around(row, column, half + 2 * frame)
        canvas[around(row, column, half)] |= patch
        if assumptions.closing == "always":
            filled = closed(canvas[near], factor)[frame:-frame, frame:-frame]
            canvas[around(row, column, half + frame)] = filled
        if assumptions.boundary == "present":
            boundary[near][1:-1, 1:-1] = boundary_of(canvas[near])[1:-1, 1:-1]
        if i in counts:
            found.append(torch.from_numpy(closed(canvas[bounding_box(canvas)], factor)))
    return found


def _patch(lengths: NDArray[np.int64], lines: str, canvas: Mask, row: int, column: int) -> Mask:
    """The lines of one addition around the pixel at `row` and `column`."""
    if lines == "outwards":
        middle = (len(canvas) - 1) / 2
        return drawn(lengths, (outwards(column, middle), outwards(row, middle)))
    if lines == "to the nearer end":
        return drawn(lengths, (nearer_end(canvas[row], column), nearer_end(canvas[:, column], row)))
    if lines == "half":
        lengths = (lengths - 1) // 2
    return drawn(lengths, ((True, True), (True, True)))


def nearer_end(line: Mask, place: int) -> tuple[bool, bool]:
    """Whether lines along an axis reach to smaller coordinates, and to larger ones, from an inside pixel of its line.

    They reach to the nearer end of the run of inside pixels, and to both if these are equally near.

    >>> nearer_end(np.array([False, True, True, True, True, False]), 2)
    (True, False)
    """
    before, after = np.flatnonzero(~line[:place]), np.flatnonzero(~line[place:])
    below = place - int(before[-1]) if len(before) else place + 1
    above = int(after[0]) if len(after) else len(line) - place
    return below <= above, above <= below
