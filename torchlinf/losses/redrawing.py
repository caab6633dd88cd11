"""A shape that is simplified in a frame of its own, and drawn back onto the pixels that it came from.

The shape is turned, and the probabilities and prices of its pixels are interpolated. What the flips change in the frame
is drawn back, and nothing else: so a pixel far from all flips stays as it was. In the frame every edge lies between two
rows of pixels, half a pixel at most from where it was. So each piece that is drawn back is first moved by a part of a
pixel, until the outline around it agrees with that of the shape.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf.losses.descent import EQUAL, STEPS, Descent, Rule, Simplified, Topology, flipped
from torchlinf.losses.parts import Part, cut_out, parts_of
from torchlinf.measure import Measure, complexity

MORE_MARGIN = 8  # pixels around the frame, beside those of `parts`
AROUND = 8  # pixels around a piece, in which the outline tells where it belongs
SHIFTS = np.linspace(-0.5, 0.5, 17)  # of a pixel

Mask = NDArray[np.bool_]


def simplified_in_frame(
    probability: Tensor,
    price: NDArray[np.int64],
    mask: Mask,
    allowed: Mask,
    rule: Rule,
    measure: Measure,
    check: Callable[[], None],
) -> Simplified:
    """Simplify one shape in the frame that `measure` asks for.

    Of its flips the last ones are left out, until what is drawn back pays, keeps the topology if it is to, and changes
    no more than it may.

    Args:
        probability: (*spatial) in [0, 1].
        price: int64, of a change of each pixel, in 1 / STEPS.
        mask: bool, the shape; not empty.
        allowed: bool, where it may grow.
        rule: what is asked for.
        measure: how complexity is measured, with its orientation.
        check: called now and then, so that it can end the work by an exception.

    Returns:
        The shape on its own pixels. A shape that is not turned is simplified on them.
    """
    [part] = parts_of(mask[None], replace(measure, per="mask"))
    frame = _Frame.of(part, mask.shape)
    if frame is None:
        descent = Descent(probability, price, mask, allowed, rule, check)
        if not isinstance(measure.orientation, str):  # what it becomes is measured in the same frame
            return descent.result()
    else:
        prices = cut_out(torch.from_numpy(price / STEPS), frame.part)
        descent = Descent(
            cut_out(probability, frame.part),
            (prices * STEPS).round().long().numpy(),
            frame.part.inside,
            frame.of_pixels(allowed | mask),
            rule,
            check,
        )
    topology = Topology(mask) if rule.keep_topology else None
    area, before = int(mask.sum()), descent.before
    count = len(descent.flips)
    while count > 0:
        check()
        flips = descent.flips[:count]
        after, number = flipped(mask, flips) if frame is None else frame.drawn_back(flips, mask)
        changed = (after ^ mask) & (allowed | mask)
        after = mask ^ changed
        pixels = np.flatnonzero(changed)
        fits = len(pixels) <= rule.max_change * area and after.any()
        if len(pixels) and fits and (topology is None or topology.keeps(pixels)):
            value = float(complexity(torch.from_numpy(after), spatial_ndim=mask.ndim, **measure.options()))
            if value - before + rule.weight * int(price[changed].sum()) / (STEPS * area) < -EQUAL:
                made, dense = np.unique(number[changed], return_inverse=True)
                number = np.zeros(mask.shape, np.int64)
                number[changed] = dense + 1
                return Simplified(after, number, len(made), before, value)
        count //= 2
    return Simplified(mask, np.zeros(mask.shape, np.int64), 0, before, before)


@dataclass(frozen=True, eq=False)
class _Frame:
    """A shape in its frame, and where the frame's pixels lie.

    Attributes:
        part: the shape, turned.
        back: (n, n), from a step in the frame to a step in the grid.
        offset: (n,), where pixel 0 of the frame lies in the grid.
        size: of the grid.
    """

    part: Part
    back: NDArray[np.float64]
    offset: NDArray[np.float64]
    size: tuple[int, ...]

    @classmethod
    def of(cls, part: Part, size: tuple[int, ...]) -> "_Frame | None":
        """The frame of a part of a grid of this size, with more pixels around it; None if it is not turned."""
        back = part.back
        if back is None:
            return None
        offset = part.offset - back @ np.full(len(size), MORE_MARGIN)
        part = replace(part, inside=np.pad(part.inside, MORE_MARGIN), offset=offset)
        return cls(part, back, offset + part.origin, size)

    def of_pixels(self, values: Mask) -> Mask:
        """The value of the grid's pixel that is nearest to each pixel of the frame; False beyond the grid."""
        steps = np.indices(self.part.inside.shape).reshape(len(self.size), -1)
        return _looked_up(values, self.back @ steps + self.offset[:, None]).reshape(self.part.inside.shape)

    def drawn_back(self, flips: list[NDArray[np.int64]], mask: Mask) -> tuple[Mask, NDArray[np.int64]]:
        """What flips in the frame make of the mask on its own pixels, and which of them has changed a pixel."""
        from scipy import ndimage

        after, number = flipped(self.part.inside, flips)
        changed, box = after ^ self.part.inside, np.ones((3,) * mask.ndim)
        number = np.where(changed, number, 0)
        number = np.where(changed, number, ndimage.maximum_filter(number, 3))  # and beside it
        pieces, count = ndimage.label(number > 0, box)
        place = self.back.T @ (np.indices(self.size).reshape(mask.ndim, -1) - self.offset[:, None])
        piece = _looked_up(pieces, place)
        around = ndimage.binary_dilation(changed, box, AROUND) & (pieces == 0)
        beside = _looked_up(around, place)
        drawn, numbers = mask.reshape(-1).copy(), np.zeros(mask.size, np.int64)
        for i in range(1, count + 1):
            here = np.flatnonzero(piece == i)
            if not len(here):
                continue  # no pixel of the grid is nearest to any of it
            low, high = place[:, here].min(axis=1), place[:, here].max(axis=1)
            near = beside & ((place >= (low - AROUND)[:, None]) & (place <= (high + AROUND)[:, None])).all(axis=0)
            at = place[:, here] + self._shift(place[:, near], mask.reshape(-1)[near])[:, None]
            drawn[here], numbers[here] = _looked_up(after, at), _looked_up(number, at)
        return drawn.reshape(mask.shape), np.maximum(numbers, piece > 0).reshape(mask.shape)

    def _shift(self, place: NDArray[np.float64], values: Mask) -> NDArray[np.float64]:
        """By how much the frame has to be moved along each axis to agree best with values of pixels at these places."""
        best = np.zeros(len(place))
        for axis in range(len(place)):
            moved = np.zeros((len(place), 1))
            wrong = []
            for shift in SHIFTS:
                moved[axis] = shift
                wrong.append(np.count_nonzero(_looked_up(self.part.inside, place + moved) != values))
            best[axis] = SHIFTS[np.array(wrong) == min(wrong)].mean()
        return best


def _looked_up(values: NDArray, place: NDArray[np.float64]) -> NDArray:  # type: ignore[type-arg]
    """The values nearest to places (n, P); 0 beyond the array."""
    at = np.rint(place).astype(np.int64)
    size = np.array(values.shape)[:, None]
    within = ((at >= 0) & (at < size)).all(axis=0)
    found = values[tuple(np.clip(at, 0, size - 1))]
    return np.where(within, found, np.zeros_like(found))
