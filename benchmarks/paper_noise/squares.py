"""Noisy squares under the assumptions that the paper leaves open."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf.shapes.noise import _boxed, _closed, _eroded, _normal

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

    def generator(count: int) -> torch.Generator:
        # The seeds of the gallery page: by default the squares are the same.
        return torch.Generator().manual_seed(1_000_000 * number + 1_000 * factor + count)

    if assumptions.growing:
        return _grown(assumptions, factor, assumptions.counts, generator(assumptions.counts[-1]))
    return [_grown(assumptions, factor, [count], generator(count))[0] for count in assumptions.counts]


def _grown(assumptions: Assumptions, factor: int, counts: Sequence[int], generator: torch.Generator) -> list[Tensor]:
    """One square and what it is after each count of additions; random numbers in the order of `add_noise`."""
    widths = _normal(factor, counts[-1], generator).clip(min=0)
    lengths = np.split(_normal(factor, 2 * widths.sum(), generator), 2 * widths.cumsum()[:-1])
    places = torch.rand(counts[-1], generator=generator, dtype=torch.float64).tolist()
    canvas = np.pad(np.ones((assumptions.side, assumptions.side), dtype=np.bool_), 30 * (factor + 1))
    boundary, middle, found = canvas & ~_eroded(canvas), (len(canvas) - 1) / 2, []
    for i, (place, of_patch) in enumerate(zip(places, lengths, strict=True), start=1):
        candidates = np.flatnonzero(boundary)
        row, column = divmod(int(candidates[int(place * len(candidates))]), len(canvas))
        patch = _patch(of_patch.reshape(2, -1), assumptions.lines, (column > middle, row > middle))
        # Closing reaches further than the patch by less than its square, and the boundary by one pixel more.
        closed = len(patch) // 2 + (factor if assumptions.closing == "always" else 0)
        near, inner = (_around(row, column, closed + more) for more in (factor + 1, 0))
        canvas[_around(row, column, len(patch) // 2)] |= patch
        if assumptions.closing == "always":
            canvas[inner] |= _closed(canvas[near], factor)[factor + 1 : -factor - 1, factor + 1 : -factor - 1]
        if assumptions.boundary == "present":
            boundary[near][1:-1, 1:-1] = (canvas[near] & ~_eroded(canvas[near]))[1:-1, 1:-1]
        if i in counts:
            found.append(_boxed(torch.from_numpy(_closed(canvas, factor))))
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
