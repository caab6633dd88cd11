"""Whether a pull on some images is one on others: how right simplified predictions are, and how gradients agree."""

import torch
from torch import Tensor
from torch.nn import functional

import torchlinf
from benchmarks.regulariser.real_images.data import Images
from benchmarks.regulariser.real_images.methods import total_variation
from benchmarks.regulariser.real_images.network import UNet
from benchmarks.regulariser.real_images.pulls import PRICE, balanced, simpler, towards
from benchmarks.regulariser.real_images.training import data_term, logits_of

PRICES = (PRICE, 30.0)
FEW = 20  # images of either part
DATA, AREA = "data term", "area"
Numbers = dict[str, dict[str, float]]


def carried(network: UNet, seen: Images, other: Images) -> dict[str, Numbers]:
    """By kind, by row: shares of flips, and cosines of gradients."""
    flips: Numbers = {}
    gradients: list[dict[str, Tensor]] = []
    for part, images in (("seen", seen), ("choose", other)):
        few = Images(images.images[:FEW], images.masks[:FEW])
        logits = logits_of(network, few.images)
        targets = [simpler(logits, price) for price in PRICES]
        for price, target in zip(PRICES, targets, strict=True):
            flips[f"{part}, {price:g}"] = of_flips(logits, target, few.masks > 0)
        gradients.append(in_parameters(network, few, targets[0]))
    here, there = gradients
    return {
        "flips": flips,
        "gradients": {
            term: {
                "pairs": mean_cosine(here[term]),
                "other images": cosine(here[term], there[term]),
                **{name: cosine(here[term], here[name]) for name in (AREA, DATA)},
            }
            for term in here
        },
    }


def of_flips(logits: Tensor, target: Tensor, truth: Tensor) -> dict[str, float]:
    """Shares of the pixels that a simplification flips: of the objects, removed, right, and right by the network."""
    flipped = target != (logits > 0)
    inside = torch.sigmoid(logits)
    number = max(int(flipped.sum()), 1)
    return {
        "of the objects": number / max(int((logits > 0).sum()), 1),
        "removed": int((flipped & ~target).sum()) / number,
        "right": int((flipped & (target == truth)).sum()) / number,
        "expected": float(torch.where(target, inside, 1 - inside)[flipped].sum()) / number,
    }


def in_parameters(network: UNet, images: Images, targets: Tensor) -> dict[str, Tensor]:
    """Gradients (images, parameters) by term. That of the area is of the mean probability."""
    found: dict[str, list[Tensor]] = {}
    for picture, mask, target in zip(images.images.split(1), images.masks.split(1), targets.split(1), strict=True):
        logits = network(picture)
        for term, gradient in in_logits(logits.detach(), mask, target).items():
            parts = torch.autograd.grad(logits, list(network.parameters()), gradient, retain_graph=True)
            found.setdefault(term, []).append(torch.cat([part.flatten() for part in parts]))
    return {term: torch.stack(values) for term, values in found.items()}


def in_logits(logits: Tensor, mask: Tensor, target: Tensor) -> dict[str, Tensor]:
    """Gradients in the logits by term."""
    leaf = logits.clone().requires_grad_()
    loss = torchlinf.losses.ShapeComplexityLoss(activation="sigmoid", per="object")
    values = {
        DATA: data_term(leaf, mask),
        "total variation": total_variation(leaf, 1.0),
        "loss": loss(leaf),
        AREA: torch.sigmoid(leaf).mean(),
    }
    found = {name: torch.autograd.grad(value, leaf)[0] for name, value in values.items()}
    flipped = target != (logits > 0)
    pull = towards(target, logits, flipped)
    found["simplified predictions"] = pull
    found["the same, where right"] = towards(target, logits, flipped & (target == (mask > 0)))
    found["the same, area kept"] = balanced(pull, logits)
    return found


def cosine(one: Tensor, other: Tensor) -> float:
    """Of the means of the rows."""
    return float(functional.cosine_similarity(one.mean(0), other.mean(0), dim=0))


def mean_cosine(gradients: Tensor) -> float:
    """Of all pairs of rows."""
    units = functional.normalize(gradients, dim=1)
    number = len(units)
    return float((units.sum(0).square().sum() - units.square().sum()) / (number * (number - 1)))
