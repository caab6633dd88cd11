"""The simplest shape that is close to a prediction: one proximal step of the complexity, by region flips.

Flips that pay, the gain in complexity less the price in log-odds, are made one after another, the best first, until
none does. That is in `descent`, and which regions are tried in `region_flips`; `redrawing` is for shapes at a slant.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Unpack

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.checks import as_mask, choice, count, flag, fraction, not_negative
from torchlinf._helpers.parallel import for_each
from torchlinf._helpers.transfer import to_device, to_host
from torchlinf.kernels import has_compiler
from torchlinf.losses.descent import STEPS, Descent, Rule, Simplified
from torchlinf.losses.redrawing import simplified_in_frame
from torchlinf.measure import FrameOptions, Measure, WindowOptions, require_frame, takes

__all__ = ["Simplification", "simplify"]

CERTAIN = 16.0  # log-odds beyond which a prediction is not told apart from certainty, as float32 does not
MARGIN = 16  # pixels that a shape may grow beyond its box, and an object beyond itself
SCOPES = ("mask", "object")


class SimplifyOptions(WindowOptions, FrameOptions, total=False):
    """Options of one number a shape, in which axes."""


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


@takes(SimplifyOptions)
def simplify(
    prediction: Tensor,
    *,
    weight: float = 30.0,
    threshold: float = 0.5,
    max_flips: int = 256,
    tries: int = 16,
    max_change: float = 0.5,
    keep_topology: bool = True,
    per: Literal["mask", "object"] = "object",
    allowed: Tensor | None = None,
    spatial_ndim: int | None = None,
    **options: Unpack[SimplifyOptions],
) -> Simplification:
    """Make predicted shapes simpler where the prediction leaves a doubt.

    It looks for the shape S* that minimises C(S*) + weight * sum of |z| over the pixels that are changed / area of the
    shape. C is the complexity and z the log-odds of a pixel against the threshold. From the thresholded prediction on,
    region flips that lower this are made. The regions are those of `ShapeComplexityLoss`, first those that have much of
    the complexity near them for their price. Of each eight the best are flipped; each difference of complexity is
    exact. What is found is close to a local minimum, and not the least.

    A network's logits need no training for it. A `weight` that is too small changes what the network is sure of.

    Args:
        prediction: (B, C, *spatial) with 1 to 4 spatial dimensions, each (b, c) one shape: probabilities in [0, 1], for
            example `torch.sigmoid(logits)`; or a mask, bool or integers of 0 and 1, where each pixel that is changed
            costs 1. Log-odds count up to 16.
        weight: price of log-odds against bits, 0 or more. Choose it on held-out images: for networks on photographs 30
            cost 0.001 of the overlap (IoU), 10 cost 0.004, docs/regulariser.
        threshold: a pixel is inside if its probability is greater; in (0, 1).
        max_flips: how many flips a shape (object) may have.
        tries: how many regions have to be tried in vain, one after another, for an end: with more of them it finds
            more, and takes longer. After that, regions are looked for once more if the flips so far have lowered the
            sum by 1 % or more.
        max_change: share of the area of a shape (object) that may be changed, in (0, 1]. No single flip is of more than
            half of it.
        keep_topology: if True, only flips that consist of simple flips of pixels are made: components (joined through
            faces and corners), holes (joined through faces) and how they lie in each other stay the same. No new slit
            is cut, and no new spike drawn, of more than twice the depth of its width. In 1-D and 2-D only: pass False
            for volumes.
        per: "object": each component (joined through faces and corners) is simplified alone, by its own complexity,
            and never touches another one; it grows by at most 16 pixels. Or "mask", all together.
        allowed: bool, like the prediction: the pixels that shapes may gain, all by default. For example those that no
            other label has. A shape may always lose pixels.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.
        {measure options}
            Here rho must be None or one number, not a tensor; and orientation not "mean", since each shape (object) is
            simplified in one frame. In a frame that is turned the prices are interpolated, and what the flips change is
            drawn back onto the pixels of the prediction; all others stay as they are. Where that does not pay, or
            would change the topology, the last half of the flips is left out, and so on.

    Returns:
        A `Simplification` on the device of the prediction; the work is done on the CPU. An empty shape stays as it is,
        with NaN values; a box stays as it is. Deterministic, and what else is in the batch does not matter. Along
        the axes of the grid mirror images become mirror images: of regions that are equal in all but their place all
        are flipped or none. Not differentiable.

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
    measure = Measure.of(options, SimplifyOptions)
    measure.scalar_rho()
    if measure.orientation == "mean":
        raise ValueError(
            'orientation must name one frame a shape; got "mean". Pass "own", "least", degrees or a rotation matrix.'
        )
    rule = Rule(
        weight=not_negative(weight, "weight"),
        threshold=fraction(threshold, "threshold"),
        max_flips=count(max_flips, "max_flips"),
        tries=count(tries, "tries"),
        max_change=_share(max_change),
        keep_topology=flag(keep_topology, "keep_topology"),
        measure=measure.plain(),
    )
    choice(per, SCOPES, "per")
    probability, price, batch_shape = _prices(prediction, rule.threshold, spatial_ndim)
    free = _allowed(allowed, prediction).reshape(probability.shape)
    if rule.keep_topology and probability.ndim > 3:
        raise ValueError(
            f"keep_topology=True needs 1 or 2 spatial dimensions; got {probability.ndim - 1}. Pass keep_topology=False."
        )
    require_frame(measure, probability.ndim - 1)
    if not has_compiler():
        raise ImportError("simplify solves flips with numba, which is not installed. Run: pip install numba")
    inside = (probability > rule.threshold).numpy()
    jobs = [
        _Job(n, box, mine, zone & free[n][box])
        for n, mask in enumerate(inside)
        for box, mine, zone in (_objects(mask) if per == "object" else _whole(mask))
    ]
    results: list[Simplified] = [None] * len(jobs)  # type: ignore[list-item]

    def descend(i: int, check: Callable[[], None]) -> None:
        job = jobs[i]
        given = probability[job.place], price[job.place], job.mask, job.allowed, rule
        if measure.orientation is None:
            results[i] = Descent(*given, check).result()
        else:
            results[i] = simplified_in_frame(*given, measure, check)

    for_each(descend, len(jobs))
    mask, number = inside.copy(), np.zeros(inside.shape, np.int64)
    flips, cost = np.zeros(len(inside), np.int64), np.zeros(len(inside))
    for job, result in zip(jobs, results, strict=True):
        changed = result.mask ^ job.mask
        mask[job.place] ^= changed
        number[job.place] += np.where(result.number > 0, result.number + flips[job.shape], 0)
        flips[job.shape] += result.num_flips
        cost[job.shape] += int(price[job.place][changed].sum()) / STEPS
    owner = [job.shape for job in jobs]
    before = _mean_over([result.before for result in results], owner, len(inside))
    after = _mean_over([result.after for result in results], owner, len(inside))
    maps = {"mask": mask, "flip_number": number}
    numbers = {"num_flips": flips, "before": before, "after": after, "cost": cost}
    found = {name: torch.from_numpy(values).reshape(prediction.shape) for name, values in maps.items()}
    found |= {name: torch.from_numpy(values).reshape(batch_shape) for name, values in numbers.items()}
    there = to_device(prediction.device, *found.values())
    return Simplification(**dict(zip(found, there, strict=True)), measure=measure)


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


def _share(max_change: float) -> float:
    return 1.0 if max_change == 1 else fraction(max_change, "max_change")


def _prices(
    prediction: Tensor, threshold: float, spatial_ndim: int | None
) -> tuple[Tensor, NDArray[np.int64], tuple[int, ...]]:
    """Probability (N, *spatial) on the CPU, the price of each pixel in 1 / STEPS, and the batch shape."""
    if isinstance(prediction, Tensor):
        (prediction,) = to_host(prediction)
    if isinstance(prediction, Tensor) and prediction.is_floating_point():
        if not bool(((prediction >= 0) & (prediction <= 1)).all()):
            raise ValueError(
                f"prediction must hold probabilities in [0, 1]; got values from {float(prediction.min()):.4g} to "
                f"{float(prediction.max()):.4g}. Pass torch.sigmoid(logits)."
            )
        _, batch_shape = as_mask(prediction > threshold, spatial_ndim)
        ndim = prediction.ndim - len(batch_shape)
        probability = prediction.double().reshape(-1, *prediction.shape[prediction.ndim - ndim :])
        odds = torch.logit(probability, eps=1e-12) - math.log(threshold / (1 - threshold))
        price = odds.abs().clamp(max=CERTAIN)
    else:
        mask, batch_shape = as_mask(prediction, spatial_ndim)
        probability = mask.double()
        price = torch.ones_like(probability)
    return probability, (price * STEPS).round().long().numpy(), batch_shape


def _allowed(allowed: Tensor | None, prediction: Tensor) -> NDArray[np.bool_]:
    """The pixels that may be gained, on the host."""
    if allowed is None:
        return np.ones(prediction.shape, np.bool_)
    if not isinstance(allowed, Tensor) or allowed.dtype != torch.bool:
        given = allowed.dtype if isinstance(allowed, Tensor) else type(allowed).__name__
        raise TypeError(f"allowed must be a bool tensor; got {given}. Pass labels == 0, for example.")
    if allowed.shape != prediction.shape:
        raise ValueError(
            f"allowed must have the prediction's shape {tuple(prediction.shape)}; got {tuple(allowed.shape)}."
        )
    (allowed,) = to_host(allowed)
    return allowed.numpy()


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


def _mean_over(values: list[float], owner: list[int], num_shapes: int) -> NDArray[np.float64]:
    """The mean of what belongs to each shape, NaN for none."""
    of = np.array(owner, np.int64)
    number, total = np.bincount(of, minlength=num_shapes), np.bincount(of, values, num_shapes)
    means: NDArray[np.float64] = np.divide(total, number, out=np.full(num_shapes, np.nan), where=number > 0)
    return means
