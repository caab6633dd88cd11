"""What is measured of a design: agreement in sign, rank correlation, and what it does to free logits."""

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass

import torch
from scipy.stats import spearmanr
from torch import Tensor

import torchlinf
from benchmarks.regulariser.designs import Design
from benchmarks.regulariser.families import Family, noisy_square

NOTICEABLE = 1e-3  # bits; smaller differences of the hard complexity have no sign to agree with


def sign_agreement(design: Design, families: Iterable[Family]) -> dict[str, tuple[int, int]]:
    """For each kind of family: at how many members the signs agree, and of how many.

    At each inner member the slope along the family, <gradient, next shape - previous shape>, is compared with the
    difference of the hard complexities of the next and the previous shape.
    """
    found: dict[str, tuple[int, int]] = {}
    for name, members in families:
        values = torchlinf.complexity(torch.stack(members), spatial_ndim=2).tolist()
        for i in range(1, len(members) - 1):
            difference = values[i + 1] - values[i - 1]
            if abs(difference) >= NOTICEABLE:
                slope = (design(members[i].double())[1] * (members[i + 1].double() - members[i - 1].double())).sum()
                right, number = found.get(name, (0, 0))
                found[name] = (right + (slope.item() * difference > 0), number + 1)
    return found


def rank_correlation(design: Design, shapes: Tensor) -> float:
    """Spearman's correlation of the design's value with the hard complexity."""
    hard = torchlinf.complexity(shapes, spatial_ndim=2)
    soft = [design(shape.double())[0] for shape in shapes]
    return float(spearmanr(hard, soft).statistic)


@dataclass(frozen=True)
class Descent:
    """A descent of free logits from a noisy square."""

    complexity: tuple[float, float]
    iou: tuple[float, float]
    seconds: float


def descent(design: Design, weight: float, additions: int, seed: int, steps: int = 40) -> Descent:
    """Adam on pixel logits: cross-entropy to the noisy square, plus the design."""
    noisy, clean = noisy_square(additions, seed)
    target = noisy.double()
    logits = (4 * target - 2).requires_grad_()
    optimiser = torch.optim.Adam([logits], lr=0.15)
    began = time.process_time()
    for _ in range(steps):
        probability = torch.sigmoid(logits)
        loss = torch.nn.functional.binary_cross_entropy_with_logits(logits, target)
        loss = loss + weight * (design(probability.detach())[1] * probability).sum()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    seconds = time.process_time() - began
    last = logits.detach() > 0
    before, after = torchlinf.complexity(torch.stack([noisy, last]), spatial_ndim=2).tolist()
    return Descent((before, math.nan if not last.any() else after), (_iou(noisy, clean), _iou(last, clean)), seconds)


def _iou(a: Tensor, b: Tensor) -> float:
    return ((a & b).sum() / (a | b).sum()).item()
