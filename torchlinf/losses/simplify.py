"""The simplest shape that is close to a prediction: one proximal step of the complexity, by region flips.

Flips that pay, the gain in complexity less the price in log-odds, are made one after another, the best first, until
none does. Which regions are tried is in `region_flips`.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, Unpack

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.checks import as_mask, choice, count, flag, fraction, not_negative
from torchlinf._helpers.parallel import for_each
from torchlinf.kernels import has_compiler
from torchlinf.losses.region_flips import Candidates, Region, candidates, code_of
from torchlinf.measure import Measure, SolvedShape, WindowOptions, mean_of_levels, takes

__all__ = ["Simplification", "simplify"]

# Bits that are expected of a region, times the root of its share of the area: only the order of trying depends on it.
PROMISE = 0.5
ANY_NUMBER = 1 << 30
LOOKED_AT = 1000  # groups of regions that are looked at until enough of them keep the topology
CERTAIN = 16.0  # log-odds beyond which a prediction is not told apart from certainty, as float32 does not
STEPS = 2.0**20  # prices are rounded to 1 / STEPS, so that their sums do not depend on the order of pixels
EQUAL = 1e-9  # bits; what differs by less is equal, and what gains less does not pay
MARGIN = 16  # pixels that a shape may grow beyond its box, and an object beyond itself
SCOPES = ("mask", "object")


@dataclass(frozen=True, eq=False)
class Simplification:
    """Simplified shapes; made by `simplify`. `batch` stands for the batch shape, (B, C) by default.

    Attributes:
        mask: bool, like the prediction.
        flip_number: int64, like the prediction: which flip of its shape, 1, 2, ... in the order they were made, has
            changed a pixel last; 0 for none.
        num_flips: (*batch) int64.
        before: (*batch) float64, the complexity of the prediction in bits (share of the field's maximum for "std"): of
            each shape, or the mean over its objects; NaN for an empty shape.
        after: the same of `mask`.
        cost: (*batch) float64, the sum of the log-odds (natural logarithm) of the pixels that are changed in the end;
            their number for a mask.
        measure: how complexity was measured.
    """

    mask: Tensor
    flip_number: Tensor
    num_flips: Tensor
    before: Tensor
    after: Tensor
    cost: Tensor
    measure: Measure


@takes(WindowOptions)
def simplify(
    prediction: Tensor,
    *,
    weight: float = 10.0,
    threshold: float = 0.5,
    max_flips: int = 256,
    tries: int = 32,
    max_change: float = 0.5,
    keep_topology: bool = False,
    per: Literal["mask", "object"] = "mask",
    spatial_ndim: int | None = None,
    **options: Unpack[WindowOptions],
) -> Simplification:
    """Make predicted shapes simpler where the prediction leaves a doubt.

    It looks for the shape S* that minimises C(S*) + weight * sum of |z| over the pixels that are changed / area of the
    shape. C is the complexity and z the log-odds of a pixel against the threshold. From the thresholded prediction on,
    the region flip that lowers this most is made, as long as one does. The regions are those of `ShapeComplexityLoss`,
    of which `tries` are tried at a time, first those that are large for their price; each difference of complexity is
    exact. What is found is a local minimum, not the least.

    A network's logits need no training for it. A `weight` that is too small changes what the network is sure of.

    Args:
        prediction: (B, C, *spatial) with 1 to 4 spatial dimensions, each (b, c) one shape: probabilities in [0, 1], for
            example `torch.sigmoid(logits)`; or a mask, bool or integers of 0 and 1, where each pixel that is changed
            costs 1. Log-odds count up to 16.
        weight: price of log-odds against bits, 0 or more. Choose it on held-out images.
        threshold: a pixel is inside if its probability is greater; in (0, 1).
        max_flips: how many flips a shape (object) may have.
        tries: regions that are solved before the best is flipped, and that have to be tried in vain for an end: with
            more of them it finds more, and takes longer.
        max_change: share of the area of a shape (object) that may be changed, in (0, 1]. No single flip is of more than
            half of it.
        keep_topology: if True, only flips that consist of simple flips of pixels are made: components (joined through
            faces and corners), holes (joined through faces) and how they lie in each other stay the same. In 1-D and
            2-D only.
        per: "mask", or "object": each component (joined through faces and corners) is simplified alone, by its own
            complexity, and never touches another one; it grows by at most 16 pixels.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.
        {measure options}
            Here rho must be None or one number, not a tensor.

    Returns:
        A `Simplification` on the device of the prediction; the work is done on the CPU. An empty shape stays as it is,
        with NaN values; a box stays as it is. Deterministic, and what else is in the batch does not matter. Mirror
        images become mirror images: of regions that are equal in all but their place all are flipped or none. Not
        differentiable.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong rank or value; or `keep_topology` in more than two dimensions.
        ImportError: numba is not installed.
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020; the step is this library's, docs/training.

    Example:
        >>> from torchlinf import shapes
        >>> shape = shapes.with_appendages((9, 9), [shapes.Appendage("right", 3, 1)], margin=2)
        >>> found = simplify(shape, weight=3.0, spatial_ndim=2)
        >>> found.before > 0.1, found.after, found.cost  # the appendage of 3 pixels is gone
        (tensor(True), tensor(0., dtype=torch.float64), tensor(3., dtype=torch.float64))
    """
    measure = Measure.of(options, WindowOptions)
    measure.scalar_rho()
    rule = _Rule(
        weight=not_negative(weight, "weight"),
        threshold=fraction(threshold, "threshold"),
        max_flips=count(max_flips, "max_flips"),
        tries=count(tries, "tries"),
        max_change=_share(max_change),
        keep_topology=flag(keep_topology, "keep_topology"),
        measure=measure,
    )
    choice(per, SCOPES, "per")
    probability, price, batch_shape = _prices(prediction, rule.threshold, spatial_ndim)
    if rule.keep_topology and probability.ndim > 3:
        raise ValueError(
            f"keep_topology=True needs 1 or 2 spatial dimensions; got {probability.ndim - 1}. Pass keep_topology=False."
        )
    if not has_compiler():
        raise ImportError("simplify solves flips with numba, which is not installed. Run: pip install numba")
    inside = (probability > rule.threshold).numpy()
    jobs = [
        _Job(n, box, mine, allowed)
        for n, mask in enumerate(inside)
        for box, mine, allowed in (_objects(mask) if per == "object" else _whole(mask))
    ]
    results: list[_Descent] = [None] * len(jobs)  # type: ignore[list-item]

    def descend(i: int, check: Callable[[], None]) -> None:
        job = jobs[i]
        results[i] = _Descent(probability[job.place], price[job.place], job.mask, job.allowed, rule, check)

    for_each(descend, len(jobs))
    mask, number = inside.copy(), np.zeros(inside.shape, np.int64)
    flips, cost = np.zeros(len(inside), np.int64), np.zeros(len(inside))
    for job, result in zip(jobs, results, strict=True):
        place = job.place
        mask[place] ^= result.mask ^ job.mask
        number[place] += np.where(result.number > 0, result.number + flips[job.shape], 0)
        flips[job.shape] += result.num_flips
        cost[job.shape] += result.cost
    owner = [job.shape for job in jobs]
    before = _mean_over([result.before for result in results], owner, len(inside), measure)
    after = _mean_over([result.solved.levels.values for result in results], owner, len(inside), measure)
    shape, device = prediction.shape, prediction.device
    return Simplification(
        mask=torch.from_numpy(mask).reshape(shape).to(device),
        flip_number=torch.from_numpy(number).reshape(shape).to(device),
        num_flips=torch.from_numpy(flips).reshape(batch_shape).to(device),
        before=before.reshape(batch_shape).to(device),
        after=after.reshape(batch_shape).to(device),
        cost=torch.from_numpy(cost).reshape(batch_shape).to(device),
        measure=measure,
    )


@dataclass(frozen=True)
class _Rule:
    weight: float
    threshold: float
    max_flips: int
    tries: int
    max_change: float
    keep_topology: bool
    measure: Measure


@dataclass(frozen=True, eq=False)
class _Job:
    """What is simplified alone: the shape it is of, its box, what is inside of it there, and where it may grow."""

    shape: int
    box: tuple[slice, ...]
    mask: NDArray[np.bool_]
    allowed: NDArray[np.bool_]

    @property
    def place(self) -> Any:
        """Its place in a batch of shapes."""
        return (self.shape, *self.box)


@dataclass(eq=False)
class _Flip:
    """A region with what its flip adds to the objective; `stale` if another flip was made since."""

    pixels: Region
    change: float
    stale: bool = False


class _Descent:
    """The simplification of one shape: its mask, the number of the flip that changed each pixel last, and the cost."""

    def __init__(
        self,
        probability: Tensor,
        price: NDArray[np.int64],
        mask: NDArray[np.bool_],
        allowed: NDArray[np.bool_],
        rule: _Rule,
        check: Callable[[], None],
    ) -> None:
        self._probability, self._rule, self._check = probability.contiguous()[None], rule, check
        self._price, self._allowed = price.reshape(-1), allowed.reshape(-1)
        self._before = mask.reshape(-1)
        self._area = int(mask.sum())
        self._weights: dict[int, NDArray[np.float64]] = {}
        self._refused: list[int] = []  # codes of regions that did not pay
        self.solved = SolvedShape(mask, rule.measure, check)
        self.before = self.solved.levels.values
        self._value = self._mean(self.before)
        self.number, self.num_flips = np.zeros(mask.shape, np.int64), 0
        self._topology = _Topology(mask) if rule.keep_topology else None
        while self._value > EQUAL and self.num_flips < rule.max_flips and self._make_flips(self._regions()):
            pass
        self.mask = self.solved.mask
        self.cost = int(self._price[self.mask.reshape(-1) != self._before].sum()) / STEPS

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
        while flips and self.num_flips < self._rule.max_flips:
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
        self.num_flips += 1
        self.number.reshape(-1)[pixels] = self.num_flips


class _Topology:
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


def _share(max_change: float) -> float:
    return 1.0 if max_change == 1 else fraction(max_change, "max_change")


def _prices(
    prediction: Tensor, threshold: float, spatial_ndim: int | None
) -> tuple[Tensor, NDArray[np.int64], tuple[int, ...]]:
    """Probability (N, *spatial) on the CPU, the price of each pixel in 1 / STEPS, and the batch shape."""
    if isinstance(prediction, Tensor) and prediction.is_floating_point():
        if not bool(((prediction >= 0) & (prediction <= 1)).all()):
            raise ValueError(
                f"prediction must hold probabilities in [0, 1]; got values from {float(prediction.min()):.4g} to "
                f"{float(prediction.max()):.4g}. Pass torch.sigmoid(logits)."
            )
        _, batch_shape = as_mask(prediction > threshold, spatial_ndim)
        ndim = prediction.ndim - len(batch_shape)
        probability = prediction.detach().cpu().double().reshape(-1, *prediction.shape[prediction.ndim - ndim :])
        odds = torch.logit(probability, eps=1e-12) - math.log(threshold / (1 - threshold))
        price = odds.abs().clamp(max=CERTAIN)
    else:
        mask, batch_shape = as_mask(prediction, spatial_ndim)
        probability = mask.cpu().double()
        price = torch.ones_like(probability)
    return probability, (price * STEPS).round().long().numpy(), batch_shape


def _whole(mask: NDArray[np.bool_]) -> list[tuple[tuple[slice, ...], NDArray[np.bool_], NDArray[np.bool_]]]:
    """A shape in its box and the margin, where it may grow everywhere; nothing for an empty one."""
    if not mask.any():
        return []
    box = _grown(bounding_box(mask), mask.shape)
    return [(box, mask[box], np.ones_like(mask[box]))]


def _objects(mask: NDArray[np.bool_]) -> list[tuple[tuple[slice, ...], NDArray[np.bool_], NDArray[np.bool_]]]:
    """Each component in its box and the margin, with the pixels that are nearer to it than to any other."""
    from scipy.ndimage import find_objects, label, maximum_filter, minimum_filter

    labels, number = label(mask, np.ones((3,) * mask.ndim))
    zone, none = labels.copy(), number + 1
    # All grow at the same speed, and where two meet none does. So no two of them touch.
    for _ in range(MARGIN if number > 1 else 0):
        most = maximum_filter(zone, 3, mode="constant")
        least = minimum_filter(np.where(zone > 0, zone, none), 3, mode="constant", cval=none)
        zone = np.where((zone == 0) & (most == least), most, zone)
    if number > 1:
        least = minimum_filter(np.where(zone > 0, zone, none), 3, mode="constant", cval=none)
        zone = np.where(maximum_filter(zone, 3, mode="constant") == least, zone, 0)
    found = []
    for i, box in enumerate(find_objects(labels), start=1):
        box = _grown(box, mask.shape)
        found.append((box, labels[box] == i, (zone[box] == i) | (number == 1)))
    return found


def _grown(box: tuple[slice, ...], shape: tuple[int, ...]) -> tuple[slice, ...]:
    """A box with the margin around it, as far as the array goes."""
    return tuple(
        slice(max(0, side.start - MARGIN), min(size, side.stop + MARGIN)) for side, size in zip(box, shape, strict=True)
    )


def _mean_over(levels: list[NDArray[np.float64]], owner: list[int], num_shapes: int, measure: Measure) -> Tensor:
    """The mean complexity of what belongs to each shape, NaN for none."""
    radius = np.array([len(values) for values in levels], np.int64)
    means = mean_of_levels(np.concatenate([np.zeros(0), *levels]), radius, measure.low, measure.high)
    number = np.bincount(owner, minlength=num_shapes) if owner else np.zeros(num_shapes, int)
    total = np.bincount(owner, means, num_shapes) if owner else np.zeros(num_shapes)
    found = np.full(num_shapes, np.nan)
    return torch.from_numpy(np.divide(total, number, out=found, where=number > 0))
