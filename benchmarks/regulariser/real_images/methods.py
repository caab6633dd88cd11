"""The methods that are compared: terms in training, and what is done afterwards."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

import torchlinf
from benchmarks.regulariser.real_images.afterwards import opened_and_closed, regularised, simplified
from benchmarks.regulariser.real_images.training import Term, data_term

TRUTH = "truth"
PLAIN = "no term"
TV_WEIGHTS = (1.0, 3.0, 10.0, 30.0)
LOSS_WEIGHTS = (0.1, 0.4)
TARGET_WEIGHTS = (1.0, 4.0)
SIMPLIFY_WEIGHTS = (1.0, 3.0, 10.0, 30.0)
TARGET_PRICE = 10.0  # weight of `simplify` where it makes targets
SIDES = (2, 3, 5)
TOLERANCES = (1.0, 2.0, 4.0)


def total_variation(logits: Tensor, weight: float) -> Tensor:
    """Anisotropic: the mean over pixels of the differences to the next pixel in both directions."""
    inside = torch.sigmoid(logits)
    return weight * (inside.diff(dim=-1).abs().sum() + inside.diff(dim=-2).abs().sum()) / inside.numel()


@dataclass(frozen=True)
class Training:
    """A method in training; `needs_targets` if its term takes simplified predictions."""

    term: Term | None
    needs_targets: bool = False


def trainings() -> dict[str, Training]:
    """By name."""
    found = {PLAIN: Training(None)}
    for weight in TV_WEIGHTS:
        found[f"total variation {weight:g}"] = Training(lambda z, _, w=weight: total_variation(z, w))
    for weight in LOSS_WEIGHTS:
        loss = torchlinf.losses.ShapeComplexityLoss(weight=weight, activation="sigmoid", per="object")
        found[f"loss {weight:g}"] = Training(lambda z, _, loss=loss: loss(z))
    for weight in TARGET_WEIGHTS:
        found[f"simplified targets {weight:g}"] = Training(lambda z, s, w=weight: w * data_term(z, s), True)
    return found


def afterwards(name: str) -> dict[str, Callable[[Tensor], Tensor]]:
    """What makes masks of the logits of a network trained without a term, by name."""
    found: dict[str, Callable[[Tensor], Tensor]] = {}
    for side in SIDES:
        found[f"opening, closing {side}"] = lambda z, side=side: opened_and_closed(z > 0, side)
    if name == "buildings":
        for tolerance in TOLERANCES:
            found[f"buildingregulariser {tolerance:g}"] = lambda z, t=tolerance: regularised(z > 0, t)
    for weight in SIMPLIFY_WEIGHTS:
        found[f"simplify {weight:g}"] = partial(simplified, weight=weight)
    for weight in SIMPLIFY_WEIGHTS[1:3]:
        found[f"simplify {weight:g}, own frame"] = partial(simplified, weight=weight, orientation="own")
    return found


BOTH = tuple((method, weight) for method in ("simplified targets 1", "loss 0.1") for weight in (3.0, 10.0))
