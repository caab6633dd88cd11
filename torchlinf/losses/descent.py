"""The descent of `simplify`: one shape, its objective, and the region flips that lower it, one after another."""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf.losses.region_flips import Candidates, Region, candidates, code_of
from torchlinf.measure import Measure, SolvedShape, mean_of_levels

# Bits that are expected of a region, times the root of its share of the area: only the order of trying depends on it.
PROMISE = 0.5
ANY_NUMBER = 1 << 30
LOOKED_AT = 1000  # groups of regions that are looked at until enough of them keep the topology
STEPS = 2.0**20  # prices are rounded to 1 / STEPS, so that their sums do not depend on the order of pixels
EQUAL = 1e-9  # bits; what differs by less is equal, and what gains less does not pay


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


@dataclass(eq=False)
class _Flip:
    """A region with what its flip adds to the objective; `stale` if another flip was made since."""

    pixels: Region
    change: float
    stale: bool = False


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
        self._price, self._allowed = price.reshape(-1), allowed.reshape(-1)
        self._mask, self._before = mask, mask.reshape(-1)
        self._area = int(mask.sum())
        self._weights: dict[int, NDArray[np.float64]] = {}
        self._refused: list[int] = []  # codes of regions that did not pay
        self.solved = SolvedShape(mask, rule.measure, check)
        self.before = self._complexity()
        self._value = self._mean(self.solved.levels.values)
        self.flips: list[Region] = []
        self._topology = Topology(mask) if rule.keep_topology else None
        while self._value > EQUAL and len(self.flips) < rule.max_flips and self._make_flips(self._regions()):
            pass

    def result(self) -> Simplified:
        """What has become of the shape."""
        mask, number = flipped(self._mask, self.flips)
        return Simplified(mask, number, len(self.flips), self.before, self._complexity())

    def _complexity(self) -> float:
        """The complexity of the shape as it is."""
        values, measure = self.solved.levels.values, self._rule.measure
        return float(mean_of_levels(values, np.array([len(values)]), measure.low, measure.high)[0])

    def _mean(self, values: NDArray[np.float64]) -> float:
        """The complexity of levels, as `mean_of_levels` has it up to rounding."""
        radius, measure = len(values), self._rule.measure
        if radius not in self._weights:
            ends = np.clip(np.arange(radius + 1) / radius, measure.low, measure.high)
            self._weights[radius] = np.diff(ends) / (measure.high - measure.low)
        return float((values * self._weights[radius]).sum())

    def _signs(self) -> NDArray[np.int64]:
        """+1 where a flip changes a pixel, -1 where it changes it back."""
        return np.where(self.solved.mask.reshape(-1) == self._before, 1, -1)

    def _regions(self) -> list[Region]:
        """The regions that promise most, of those whose flip may pay and that were not refused before."""
        inside = torch.from_numpy(self.solved.mask)[None]
        proposed = candidates(self._probability, self._rule.threshold, ANY_NUMBER, inside)
        signs = self._signs()
        price = _sums(signs * self._price, proposed)
        pays = self._cost_of(price) < self._value - EQUAL  # a complexity is 0 or more
        changed = int((signs < 0).sum()) + _sums(signs, proposed)
        fits = changed <= self._rule.max_change * self._area
        outside = ~(self.solved.mask.reshape(-1) | self._allowed)
        lies_right = _sums(outside.astype(np.int64), proposed) == 0
        new = ~np.isin(proposed.code, np.array(self._refused, np.uint64))
        size = np.diff(proposed.begin)
        numbers = np.flatnonzero(pays & fits & lies_right & new & (size <= self.solved.mask.sum() // 2))
        expected = self._cost_of(price) - PROMISE * np.sqrt(size / self._area)
        facts = np.stack([proposed.code[numbers].view(np.int64), size[numbers], price[numbers]])
        order = np.lexsort((*facts, expected[numbers]))
        found: list[Region] = []
        for group in itertools.islice(_groups(numbers[order], facts[:, order]), LOOKED_AT):
            if len(group) > self._rule.tries:
                continue
            regions = [region for i in group if self._keeps_topology(region := proposed.region(i))]
            if len(found) + len(regions) <= self._rule.tries:
                found += regions
            if len(found) == self._rule.tries:
                break
        return found

    def _keeps_topology(self, pixels: Region) -> bool:
        return self._topology is None or self._topology.keeps(pixels)

    def _cost_of(self, price: NDArray[np.int64]) -> NDArray[np.float64]:
        return (price * (self._rule.weight / (STEPS * self._area))).astype(np.float64)

    def _tried(self, pixels: Region) -> _Flip:
        """A region and what its flip would add to the objective, inf where it is not allowed."""
        signs = self._signs()
        changed = int((signs < 0).sum()) + int(signs[pixels].sum())
        allowed = changed <= self._rule.max_change * self._area
        if not allowed or not self._keeps_topology(pixels):
            return _Flip(pixels, math.inf)
        values = self.solved.after(pixels).values
        if not len(values):
            return _Flip(pixels, math.inf)
        price = (signs * self._price)[pixels].sum()
        return _Flip(pixels, self._mean(values) - self._value + float(self._cost_of(price)))

    def _make_flips(self, regions: list[Region]) -> bool:
        """Flip the best, until none pays; whether any did.

        After a flip the others keep what was found for them, until it is their turn: then they are tried again.
        """
        tried = [self._tried(region) for region in regions]
        self._refused += [code_of(flip.pixels) for flip in tried if not flip.change < -EQUAL]
        flips = [flip for flip in tried if flip.change < -EQUAL]
        any_made = False
        while flips and len(self.flips) < self._rule.max_flips:
            best = min(flips, key=lambda flip: (round(flip.change / EQUAL), len(flip.pixels)))
            equal = [f for f in flips if abs(f.change - best.change) <= EQUAL and len(f.pixels) == len(best.pixels)]
            flips = [flip for flip in flips if not any(flip is other for other in equal)]
            if any(flip.stale for flip in equal):
                flips += [again for flip in equal if (again := self._tried(flip.pixels)).change < -EQUAL]
                continue
            if len(equal) > 1:  # all or none, so that mirror images stay mirror images
                best = self._tried(np.unique(np.concatenate([flip.pixels for flip in equal])))
                if not best.change < -EQUAL:
                    continue
            self._make(best.pixels)
            any_made = True
            flips = [
                _Flip(flip.pixels, flip.change, True) for flip in flips if not np.isin(flip.pixels, best.pixels).any()
            ]
        return any_made

    def _make(self, pixels: Region) -> None:
        if self._topology is not None:
            self._topology.keeps(pixels, make=True)
        self._value = self._mean(self.solved.after(pixels, keep=True).values)
        self.flips.append(pixels)


def flipped(mask: NDArray[np.bool_], flips: list[Region]) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
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
    """A mask in 1-D or 2-D of which it can be told whether a flip keeps its topology."""

    def __init__(self, mask: NDArray[np.bool_]) -> None:
        from torchlinf.kernels.simple_flips import simple_neighbourhoods

        self._mask = np.pad(mask, 1).astype(np.uint8)
        index = np.zeros(self._mask.shape, np.bool_)
        index[(slice(1, -1),) * mask.ndim] = True
        self._place = np.flatnonzero(index).astype(np.int32)
        width = self._mask.shape[-1]
        around = [1, -1] if mask.ndim == 1 else [1, 1 - width, -width, -1 - width, -1, width - 1, width, width + 1]
        self._around = np.array(around, np.int64)
        self._simple = simple_neighbourhoods()

    def keeps(self, pixels: Region, make: bool = False) -> bool:
        """Whether a flip of these pixels is a series of simple flips; with `make` they stay flipped."""
        from torchlinf.kernels.simple_flips import flip_simply

        flat, places = self._mask.reshape(-1), self._place[pixels]
        kept = bool(flip_simply(flat, places, self._around, self._simple, np.empty(len(places), np.int32)))
        if kept and not make:
            flat[places] ^= 1
        return kept


def _groups(numbers: NDArray[np.int64], facts: NDArray[np.int64]) -> Iterator[list[int]]:
    """The regions in their order, each once, those of one size and price together: some may be mirror images.

    Args:
        numbers: (R,) of the regions.
        facts: (3, R), their code, size and price; the same ones stand together.
    """
    different = np.flatnonzero(np.diff(facts, axis=1, prepend=-1).any(axis=0))
    numbers, facts = numbers[different], facts[:, different]
    first = np.flatnonzero(np.diff(facts[1:], axis=1, prepend=-1).any(axis=0)).tolist()
    for begin, end in itertools.pairwise([*first, len(numbers)]):
        yield numbers[begin:end].tolist()


def _sums(values: NDArray[np.int64], proposed: Candidates) -> NDArray[np.int64]:
    """The sum of the values of the pixels of each region."""
    return np.diff(np.concatenate([[0], np.cumsum(values[proposed.pixels])])[proposed.begin])
