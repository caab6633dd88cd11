"""Pulls towards simpler shapes: gradients in the logits, scaled to the size of the data term's and added to it."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass

import torch
from torch import Tensor

import torchlinf
from benchmarks.regulariser.real_images.data import TURNS, Images, batch
from benchmarks.regulariser.real_images.network import UNet
from benchmarks.regulariser.real_images.training import MORE_RATE, WHOLE, State, data_term, logits_of

DECAY = 0.98  # a step, of the averaged network
SIZE_DECAY = 0.9  # a step, of the sizes of both gradients
PRICE = 10.0  # weight of `simplify`
FIRST_PRICE = 100.0  # of a price that falls to PRICE: what is in full doubt is flipped first
TRIES = 8  # of `simplify`


@dataclass(frozen=True)
class Step:
    """One step of a training: its batch, the logits of it, and what targets may be made of.

    Attributes:
        progress: from 0 to 1.
        logits: of the network that is trained, (B, 1, H, W), detached.
        truth: like logits, bool.
        first: the simplified predictions of the network before this training, bool.
        averaged: makes the logits of the averaged network.
    """

    progress: float
    logits: Tensor
    truth: Tensor
    first: Tensor
    averaged: Callable[[], Tensor]


Pull = Callable[[Step], Tensor]  # the gradient in the logits, like them


@dataclass(frozen=True)
class Design:
    """How a pull is added to the data term.

    Attributes:
        pull: None for no term.
        share: size of the pull's gradient, as a share of that of the data term's.
        every: it is added in each step of that number.
        warm: if True, the share rises from 0 to `share` over all steps.
        keep_area: if True, what raises or lowers all logits together is taken out of it.
        alone: if True, nothing is added: there is no data term.
        times: how many times as long the training is.
    """

    pull: Pull | None = None
    share: float = 1.0
    every: int = 1
    warm: bool = False
    keep_area: bool = False
    alone: bool = False
    times: int = 1


def loss(step: Step, *, by_doubt: bool = False) -> Tensor:
    """The gradient of the loss, object by object; its flips weigh by their doubt once more, or not."""
    logits = step.logits.clone().requires_grad_()
    value = torchlinf.losses.ShapeComplexityLoss(activation="sigmoid", per="object")(logits)
    (gradient,) = torch.autograd.grad(value, logits)
    return gradient * doubt(step.logits) if by_doubt else gradient


def instead(step: Step) -> Tensor:
    """Towards the first network's simplified predictions on all pixels, as the data term is towards the truth."""
    logits = step.logits.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(data_term(logits, step.first.to(logits)), logits)
    return gradient


def anew(step: Step, *, averaged: bool = False, falling: bool = False) -> Tensor:
    """Towards predictions simplified in this step, of this network or the averaged one, at a fixed price or falling."""
    source = step.averaged() if averaged else step.logits
    price = PRICE * (FIRST_PRICE / PRICE) ** (1 - step.progress) if falling else PRICE
    target = simpler(source, price)
    return towards(target, step.logits, target != (source > 0))


def simpler(logits: Tensor, price: float = PRICE) -> Tensor:
    """Object by object, bool."""
    inside = torch.sigmoid(logits)
    return torchlinf.simplify(inside, weight=price, per="object", keep_topology=False, tries=TRIES).mask


def towards(target: Tensor, logits: Tensor, counted: Tensor) -> Tensor:
    """The gradient of the cross-entropy, a mean over all pixels of those that are counted."""
    return (torch.sigmoid(logits) - target.to(logits)) * counted / target.numel()


def balanced(gradient: Tensor, logits: Tensor) -> Tensor:
    """Changed where there is doubt, such that it no longer raises or lowers all logits of an image together."""
    weight = doubt(logits)
    return gradient - weight * gradient.sum((1, 2, 3), True) / weight.sum((1, 2, 3), True).clamp(min=1e-12)


def doubt(logits: Tensor) -> Tensor:
    """1 for a probability of one half, 0 for 0 and 1."""
    inside = torch.sigmoid(logits)
    return 4 * inside * (1 - inside)


def with_first(images: Images, network: UNet) -> Images:
    """The same, with one more channel of masks: the network's simplified predictions."""
    target = simpler(logits_of(network, images.images))
    return Images(images.images, torch.cat([images.masks, target.float()], dim=1))


def train(name: str, images: Images, seed: int, start: State, design: Design, steps: int) -> UNet:
    """The network goes on from `start` with `images` of `with_first`, on the same batches whatever the design is."""
    network = UNet(name).to(memory_format=torch.channels_last)
    network.load_state_dict(start)
    average = deepcopy(network)
    optimiser = torch.optim.AdamW(network.parameters(), lr=MORE_RATE, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    draw = torch.Generator().manual_seed(1000 + seed)
    sizes = _Sizes()
    for number in range(steps):
        pictures, masks = batch(images, WHOLE, True, TURNS[name], draw)
        optimiser.zero_grad(set_to_none=True)
        logits = network(pictures)
        there = logits.detach().requires_grad_()
        (gradient,) = torch.autograd.grad(data_term(there, masks[:, :1]), there)
        if design.pull is not None and number % design.every == 0:
            progress = number / steps
            maps = masks.split(1, dim=1)
            step = Step(
                progress, logits.detach(), *(each > 0 for each in maps), lambda x=pictures: logits_of(average, x)
            )
            pull = design.pull(step)
            if design.keep_area:
                pull = balanced(pull, step.logits)
            scaled = design.share * (progress if design.warm else 1.0) * sizes.ratio(gradient, pull) * pull
            gradient = scaled if design.alone else gradient + scaled
        logits.backward(gradient)
        optimiser.step()
        schedule.step()
        with torch.no_grad():
            for mean, now in zip(average.parameters(), network.parameters(), strict=True):
                mean.lerp_(now, 1 - DECAY)
    return network


class _Sizes:
    """Running means of the sizes of two gradients."""

    def __init__(self) -> None:
        self._means: tuple[float, float] | None = None

    def ratio(self, data: Tensor, pull: Tensor) -> float:
        """How much larger the data term's gradient is; 0 as long as the pull is zero."""
        now = float(data.norm()), float(pull.norm())
        before = self._means or now
        self._means = (
            SIZE_DECAY * before[0] + (1 - SIZE_DECAY) * now[0],
            SIZE_DECAY * before[1] + (1 - SIZE_DECAY) * now[1],
        )
        return self._means[0] / self._means[1] if self._means[1] > 0 else 0.0
