"""Whether a pull on some images is one on others: how right simplified predictions are, and how gradients agree."""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

import torchlinf
from benchmarks.regulariser.real_images.data import Images
from benchmarks.regulariser.real_images.methods import total_variation
from benchmarks.regulariser.real_images.network import UNet
from benchmarks.regulariser.real_images.pulls import simpler
from benchmarks.regulariser.real_images.training import data_term, logits_of

PRICES = (10.0, 30.0)
FEW = 20  # images of either part whose gradients are taken
Numbers = dict[str, dict[str, float]]


def carried(network: UNet, seen: Images, other: Images) -> dict[str, Numbers]:
    """By kind, by row: shares of flips, and cosines of gradients."""
    flips: Numbers = {}
    for part, images in (("seen", seen), ("choose", other)):
        logits = logits_of(network, images.images)
        for price in PRICES:
            flips[f"{part}, {price:g}"] = of_flips(logits, simpler(logits, price), images.masks > 0)
    gradients: Numbers = {}
    here, there = (few_gradients(network, images) for images in (seen, other))
    for term in here:
        gradients[term] = {
            "each other": mean_cosine(here[term]),
            "other images": cosine(here[term].mean(0), there[term].mean(0)),
            "data term": cosine(here[term].mean(0), here["data term"].mean(0)),
        }
    return {"flips": flips, "gradients": gradients}


def of_flips(logits: Tensor, target: Tensor, truth: Tensor) -> dict[str, float]:
    """Of the pixels that a simplification flips, as shares: how many, right by the truth, and by the network itself."""
    flipped = target != (logits > 0)
    inside = torch.sigmoid(logits)
    number = max(int(flipped.sum()), 1)
    return {
        "of the objects": number / max(int((logits > 0).sum()), 1),
        "right": int((flipped & (target == truth)).sum()) / number,
        "expected": float(torch.where(target, inside, 1 - inside)[flipped].sum()) / number,
    }


def few_gradients(network: UNet, images: Images) -> dict[str, Tensor]:
    """(images, parameters) for each term: the data term, pulls, and total variation."""
    loss = torchlinf.losses.ShapeComplexityLoss(activation="sigmoid", per="object")
    found: dict[str, list[Tensor]] = {}
    for picture, mask in zip(images.images[:FEW].split(1), images.masks[:FEW].split(1), strict=True):
        logits = network(picture)
        target = simpler(logits.detach())
        flipped = target != (logits > 0)
        terms: dict[str, Callable[[], Tensor]] = {
            "data term": lambda z=logits, y=mask: data_term(z, y),
            "simplified predictions": lambda z=logits, s=target, c=flipped: _entropy(z, s, c),
            "the same, where right": lambda z=logits, s=target, c=flipped & (target == (mask > 0)): _entropy(z, s, c),
            "loss": lambda z=logits: loss(z),
            "total variation": lambda z=logits: total_variation(z, 1.0),
        }
        for term, value in terms.items():
            parts = torch.autograd.grad(value(), list(network.parameters()), retain_graph=True)
            found.setdefault(term, []).append(torch.cat([part.flatten() for part in parts]))
    return {term: torch.stack(values) for term, values in found.items()}


def _entropy(logits: Tensor, target: Tensor, counted: Tensor) -> Tensor:
    each = functional.binary_cross_entropy_with_logits(logits, target.to(logits), reduction="none")
    return (each * counted).sum() / logits.numel()


def cosine(one: Tensor, other: Tensor) -> float:
    """0 where one of them is zero."""
    return float(functional.cosine_similarity(one, other, dim=0))


def mean_cosine(gradients: Tensor) -> float:
    """Of all pairs of rows."""
    units = functional.normalize(gradients, dim=1)
    number = len(units)
    return float((units.sum(0).square().sum() - units.square().sum()) / (number * (number - 1)))
