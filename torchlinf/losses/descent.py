"""The descent of `simplify`: one shape, its objective, and the region flips that lower it, one after another."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf.losses.region_flips import candidates
from torchlinf.measure import Measure, SolvedLevels, SolvedShape, mean_of_levels

# Only the order of trying depends on these: the share of the complexity near a region that its flip is expected to
# gain; the bits that are hoped for, times the root of its share of the area; and one in how many is tried for that.
PROMISE, HOPE, MIXED = 0.2, 0.5, 4
NEAR = (3, 3, 2, 1)  # pixels, by the number of dimensions
UNIT = 2.0**30  # shares of a complexity are summed in steps of 1 / UNIT, as prices in steps of 1 / STEPS
BATCH = 8  # regions that are tried before the best of them is flipped
ENOUGH = 0.01  # share by which the objective has to fall, for regions to be looked for once more
ANY_NUMBER = 1 << 30
STEPS = 2.0**20  # prices are rounded to 1 / STEPS, so that their sums do not depend on the order of pixels
EQUAL = 1e-9  # bits; what differs by less is equal, and what gains less does not pay


Pixels = NDArray[np.signedinteger]  # flat indices, each once


@dataclass(frozen=True)
class Rule:
    """What `simplify` was asked for; the measure along the axes of the grid."""

    weight: float
    threshold: float
    max_flips: int
    tries: int
    max_change: float
    keep_topology: bool
    measure: Measure


@dataclass(frozen=True, eq=False)
class Simplified:
    """One shape, simplified.

    Attributes:
        mask: bool, what it has become.
        number: int64, like the mask: which flip has changed a pixel last, from 1; 0 for none.
        num_flips: how many there are.
        before: its complexity.
        after: that of the mask.
    """

    mask: NDArray[np.bool_]
    number: NDArray[np.int64]
    num_flips: int
    before: float
    after: float


@dataclass(eq=False, slots=True)
class _Flip:
    """A region, the price of its flip, how many changes that adds, its code, and what it adds to the objective."""

    pixels: Pixels
    price: int
    changes: int
    code: int
    change: float = math.inf


class _Around:
    """What is near each pixel of a grid, as `region_weights.weigh` takes it."""

    def __init__(self, sizes: tuple[int, ...]) -> None:
        from torchlinf.kernels.grid import row_strides

        reach = NEAR[len(sizes) - 1]
        self._grid = np.zeros([size + 2 * reach for size in sizes], np.int64)
        self._inner = (slice(reach, -reach),) * len(sizes)
        index = np.arange(self._grid.size).reshape(self._grid.shape)
        offsets = np.indices((2 * reach + 1,) * len(sizes)).reshape(len(sizes), -1) - reach
        strides = np.array(row_strides(self._grid.shape))
        self.place = index[self._inner].reshape(-1)
        self.offsets, self.steps = strides @ offsets, np.concatenate([strides, -strides])
        self.ahead = np.stack([offsets[:, side == reach].T @ strides for side in (*offsets, *-offsets)])

    def padded(self, values: NDArray[np.int64]) -> NDArray[np.int64]:
        """Values with as many 0 around them as is near; overwritten by the next ones."""
        self._grid[self._inner] = values
        return self._grid.reshape(-1)

    def seen(self) -> NDArray[np.int32]:
        """Scratch."""
        return np.zeros(2 * self._grid.size, np.int32)


class Descent:
    """Flips of one shape that pay, made one after another until none does.

    Attributes:
        flips: the pixels of each flip, in the order they were made.
        before: the complexity of the shape.
    """

    def __init__(
        self,
        probability: Tensor,
        price: NDArray[np.int64],
        mask: NDArray[np.bool_],
        allowed: NDArray[np.bool_],
        rule: Rule,
        check: Callable[[], None],
    ) -> None:
        self._probability, self._rule, self._check = probability.contiguous()[None], rule, check
        self._price = price.reshape(-1)
        self._mask, self._closed = mask, ~(mask | allowed).reshape(-1)
        self._area, self._changed = int(mask.sum()), 0
        self._sign = np.ones(mask.size, np.int64)  # -1 where a flip changes a pixel back
        self._touched = np.zeros(mask.size, np.bool_)  # where flips were made since regions were looked for
        self._around = _Around(mask.shape)
        self._weights: dict[int, NDArray[np.float64]] = {}
        self._refused: list[int] = []  # codes of regions that did not pay
        self.solved = SolvedShape(mask, rule.measure, check)
        self.before = self._complexity()
        self._value = self._objective = self._mean(self.solved.levels.values)
        self.flips: list[Pixels] = []
        self._topology = Topology(mask) if rule.keep_topology else None
        while self._may_go_on() and self._went_through():
            pass

    def result(self) -> Simplified:
        """What has become of the shape."""
        mask, number = flipped(self._mask, self.flips)
        return Simplified(mask, number, len(self.flips), self.before, self._complexity())

    def _complexity(self) -> float:
        """The complexity of the shape as it is."""
        values, measure = self.solved.levels.values, self._rule.measure
        return float(mean_of_levels(values, np.array([len(values)]), measure.low, measure.high)[0])

    def _may_go_on(self) -> bool:
        return self._value > EQUAL and len(self.flips) < self._rule.max_flips

    def _mean(self, values: NDArray[np.float64]) -> float:
        """The complexity of levels, as `mean_of_levels` has it up to rounding."""
        return float(values.dot(self._weights_of(len(values))))

    def _weights_of(self, radius: int) -> NDArray[np.float64]:
        """How much each level counts."""
        measure = self._rule.measure
        if radius not in self._weights:
            ends = np.clip(np.arange(radius + 1) / radius, measure.low, measure.high)
            self._weights[radius] = np.diff(ends) / (measure.high - measure.low)
        return self._weights[radius]

    @property
    def _unit(self) -> float:
        """What 1 / STEPS of log-odds costs in bits."""
        return self._rule.weight / (STEPS * self._area)

    def _went_through(self) -> bool:
        """Go through the regions of the shape as it is, until enough are tried in vain; whether that did enough."""
        groups = self._regions()
        began, vain = self._objective, 0
        batch: list[_Flip] = []
        self._touched[:] = False
        for group in itertools.chain(groups, [None]):
            if group is not None:
                batch += [f for f in group if not self._touched[f.pixels].any() and self._keeps_topology(f.pixels)]
                if len(batch) < min(BATCH, self._rule.tries):
                    continue
            here = len(self.flips)
            self._make_flips(batch)
            vain = 0 if len(self.flips) > here else vain + len(batch)
            if vain >= self._rule.tries or not self._may_go_on():
                break
            batch = []
        return self._objective < began - ENOUGH * began

    def _regions(self) -> Iterator[list[_Flip]]:
        """Regions whose flip may pay, those first that promise most; those that may be mirror images stand together.

        A flip straightens what is uneven near it: so it promises the more, the more complexity there is near the
        region, and the less it costs. Among those are mixed some that are large for their price, which may change what
        is far from them and lead out of local minima.
        """
        from torchlinf.kernels.region_weights import weigh

        inside = torch.from_numpy(self.solved.mask)[None]
        proposed = candidates(self._probability, self._rule.threshold, ANY_NUMBER, inside)
        code, numbers = np.unique(proposed.code, return_index=True)
        numbers = numbers[~np.isin(code, np.array(self._refused, np.uint64))]
        share = np.rint(self.solved.shares(self._weights_of(len(self.solved.levels.values))) * UNIT).astype(np.int64)
        around = self._around
        prices, changes, nearby = np.empty((3, len(numbers)), np.int64)
        most_changed = int(self._rule.max_change * self._area) - self._changed
        weigh(
            proposed.pixels, proposed.begin, numbers, self._sign, self._price, self._closed, self._unit,
            self._value - EQUAL, most_changed, int(self.solved.mask.sum()) // 2, around.place, around.padded(share),
            around.offsets, around.steps, around.ahead, around.seen(), prices, changes, nearby,
        )  # fmt: skip
        size = proposed.begin[numbers + 1] - proposed.begin[numbers]
        order = np.lexsort((size, prices, nearby))
        order = order[np.searchsorted(nearby[order], 0, side="right") :]
        facts = np.stack([size, prices, nearby])[:, order]
        first = np.flatnonzero((np.diff(facts, axis=1, prepend=-1) != 0).any(axis=0))
        ends = [*first[1:].tolist(), len(order)]
        size, cost, there = facts[0, first], facts[1, first] * self._unit, facts[2, first] / UNIT
        odds = there / (there + np.maximum(cost, 0) / PROMISE)
        worth = (there * odds**3, HOPE * np.sqrt(size / self._area) - cost)
        careful, bold = ((-gain).argsort(kind="stable").argsort() for gain in worth)
        for i in np.minimum(careful, MIXED * bold).argsort(kind="stable"):
            group = order[first[i] : ends[i]].tolist()
            if len(group) <= self._rule.tries:
                of = numbers[group].tolist()
                codes, pixels = proposed.code[of].tolist(), map(proposed.pixels_of, of)
                sums = prices[group].tolist(), changes[group].tolist()
                yield [_Flip(*facts) for facts in zip(pixels, *sums, codes, strict=True)]

    def _keeps_topology(self, pixels: Pixels) -> bool:
        return self._topology is None or self._topology.keeps(pixels)

    def _change(self, levels: SolvedLevels, price: int) -> float:
        """What a flip adds to the objective that leads to these levels."""
        return self._mean(levels.values) - self._value + price * self._unit if len(levels.values) else math.inf

    def _changes_little(self, flip: _Flip) -> bool:
        return self._changed + flip.changes <= self._rule.max_change * self._area

    def _flip(self, flip: _Flip) -> bool:
        """Make a flip if it pays."""
        if not (self._changes_little(flip) and self._keeps_topology(flip.pixels)):
            return False
        levels = self.solved.after(flip.pixels, keep=lambda levels: self._change(levels, flip.price) < -EQUAL)
        change = self._change(levels, flip.price)
        if change < -EQUAL:
            if self._topology is not None:
                self._topology.keeps(flip.pixels, make=True)
            self._value = self._mean(levels.values)
            self._objective += change
            self._changed += flip.changes
            self._sign[flip.pixels] *= -1
            self._touched[flip.pixels] = True
            self.flips.append(flip.pixels.copy())  # of a view of all that were looked at
        return change < -EQUAL

    def _make_flips(self, flips: list[_Flip]) -> None:
        """Make those of some flips that pay, the best first, each if it still pays at its turn.

        Each alone keeps the topology.
        """
        may = [flip for flip in flips if self._changes_little(flip)]
        for flip, levels in zip(may, self.solved.after_each([flip.pixels for flip in may]), strict=True):
            flip.change = self._change(levels, flip.price)
        self._refused += [flip.code for flip in flips if not flip.change < -EQUAL]
        flips = [flip for flip in flips if flip.change < -EQUAL]
        while flips and len(self.flips) < self._rule.max_flips:
            best = min(flips, key=lambda flip: (round(flip.change / EQUAL), len(flip.pixels)))
            equal = [f for f in flips if abs(f.change - best.change) <= EQUAL and len(f.pixels) == len(best.pixels)]
            flips = [flip for flip in flips if not any(flip is other for other in equal)]
            # All or none, so that mirror images stay mirror images.
            if self._flip(best if len(equal) == 1 else self._together(equal)):
                flips = [flip for flip in flips if not self._touched[flip.pixels].any()]

    def _together(self, flips: list[_Flip]) -> _Flip:
        """One flip of all pixels of some."""
        pixels = np.unique(np.concatenate([flip.pixels for flip in flips]))
        signs = self._sign[pixels]
        return _Flip(pixels, int((signs * self._price[pixels]).sum()), int(signs.sum()), 0)


def flipped(mask: NDArray[np.bool_], flips: Sequence[Pixels]) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """A mask after flips, and the number of the flip that changed each pixel last, from 1; 0 for none.

    >>> flipped(np.array([True, False]), [np.array([0, 1]), np.array([1])])
    (array([False, False]), array([1, 2]))
    """
    after, number = mask.copy(), np.zeros(mask.shape, np.int64)
    for i, pixels in enumerate(flips, start=1):
        after.reshape(-1)[pixels] ^= True
        number.reshape(-1)[pixels] = i
    return after, number


class Topology:
    """A mask in 1-D or 2-D of which it can be told whether a flip keeps its topology, and draws no slit and no spike.

    Topology allows slits that come from the outside, and spikes. They are those of `simple_flips.has_slit`, against the
    mask that was given at first.
    """

    def __init__(self, mask: NDArray[np.bool_]) -> None:
        from torchlinf.kernels.simple_flips import simple_neighbourhoods

        self._mask = np.pad(mask, 1).astype(np.uint8)
        self._before = self._mask.reshape(-1).copy()
        index = np.zeros(self._mask.shape, np.bool_)
        index[(slice(1, -1),) * mask.ndim] = True
        self._place = np.flatnonzero(index).astype(np.int32)
        width = self._mask.shape[-1]
        around = [1, -1] if mask.ndim == 1 else [1, 1 - width, -width, -1 - width, -1, width - 1, width, width + 1]
        self._around = np.array(around, np.int64)
        self._simple = simple_neighbourhoods()

    def keeps(self, pixels: Pixels, make: bool = False) -> bool:
        """Whether a flip of these pixels is a series of simple flips that leaves no new slit and no new spike.

        With `make` they stay flipped.
        """
        from torchlinf.kernels.simple_flips import flip_simply, has_slit

        flat, places = self._mask.reshape(-1), self._place[pixels]
        kept = bool(flip_simply(flat, places, self._around, self._simple, np.empty(len(places), np.int32)))
        strides = self._mask.shape[-1], 1
        slit = kept and self._mask.ndim == 2 and has_slit(flat, self._before, places, self._around, strides)
        if kept and (slit or not make):
            flat[places] ^= 1
        return kept and not slit
