"""The methods that are compared: terms in training, and what is done afterwards."""

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

import torchlinf
from benchmarks.regulariser.real_images.afterwards import opened_and_closed, regularised, simplified
from benchmarks.regulariser.real_images.training import Term

TRUTH = "truth"
PLAIN = "no term"
TV_WEIGHTS = (1.0, 3.0, 10.0, 30.0)
LOSS_WEIGHTS = (0.1, 0.4)
SIMPLIFY_WEIGHTS = (3.0, 10.0, 30.0)
OWN_WEIGHTS = (10.0,)
TOPOLOGY_WEIGHTS = (30.0,)
SIDES = (2, 3, 5)
TOLERANCES = (1.0, 2.0, 4.0)


def total_variation(logits: Tensor, weight: float) -> Tensor:
    """Anisotropic: the mean over pixels of the differences to the next pixel in both directions."""
    inside = torch.sigmoid(logits)
    return weight * (inside.diff(dim=-1).abs().sum() + inside.diff(dim=-2).abs().sum()) / inside.numel()


def terms() -> dict[str, Term | None]:
    """What is added to the data term, by name."""
    found: dict[str, Term | None] = {PLAIN: None}
    for weight in TV_WEIGHTS:
        found[f"total variation {weight:g}"] = partial(total_variation, weight=weight)
    for weight in LOSS_WEIGHTS:
        found[f"loss {weight:g}"] = torchlinf.losses.ShapeComplexityLoss(
            weight=weight, activation="sigmoid", per="object"
        )
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
    for weight in OWN_WEIGHTS:
        found[f"simplify {weight:g}, own frame"] = partial(simplified, weight=weight, orientation="own")
    for weight in TOPOLOGY_WEIGHTS:
        found[f"simplify {weight:g}, topology kept"] = partial(simplified, weight=weight, keep_topology=True)
    return found


BOTH = ("loss 0.1", 10.0)  # a term, and the weight of `simplify` afterwards
