"""Training: a first run on crops without any term, then a short one on whole images, with a term or without."""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from benchmarks.regulariser.real_images.data import TURNS, Images, batch
from benchmarks.regulariser.real_images.network import UNet

STEPS = {"buildings": 3600, "facades": 1500}
CROPS, RATE = 12, 3e-3
MORE_STEPS, WHOLE, MORE_RATE = 120, 3, 5e-4  # whole images, so that no object is cut

State = dict[str, Tensor]
Term = Callable[[Tensor], Tensor]  # of logits (B, 1, H, W)


def data_term(logits: Tensor, masks: Tensor) -> Tensor:
    """Cross-entropy and Dice."""
    inside = torch.sigmoid(logits)
    overlap = (2 * (inside * masks).sum() + 1) / (inside.sum() + masks.sum() + 1)
    return functional.binary_cross_entropy_with_logits(logits, masks) + 1 - overlap


def first_run(name: str, images: Images, seed: int) -> UNet:
    """A network trained without any term."""
    torch.manual_seed(seed)
    network = UNet(name).to(memory_format=torch.channels_last)
    optimiser = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=STEPS[name])
    draw = torch.Generator().manual_seed(seed)
    for _ in range(STEPS[name]):
        pictures, masks = batch(images, CROPS, False, TURNS[name], draw)
        optimiser.zero_grad(set_to_none=True)
        data_term(network(pictures), masks).backward()
        optimiser.step()
        schedule.step()
    return network


def second_run(name: str, images: Images, seed: int, start: State, term: Term | None) -> UNet:
    """The network goes on from `start`, on the same batches whatever the term is."""
    network = UNet(name).to(memory_format=torch.channels_last)
    network.load_state_dict(start)
    optimiser = torch.optim.AdamW(network.parameters(), lr=MORE_RATE, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, MORE_STEPS)
    draw = torch.Generator().manual_seed(1000 + seed)
    for _ in range(MORE_STEPS):
        pictures, masks = batch(images, WHOLE, True, TURNS[name], draw)
        optimiser.zero_grad(set_to_none=True)
        logits = network(pictures)
        loss = data_term(logits, masks)
        if term is not None:
            loss = loss + term(logits)
        loss.backward()
        optimiser.step()
        schedule.step()
    return network


@torch.no_grad()
def logits_of(network: UNet, images: Tensor) -> Tensor:
    """(N, 1, H, W), float32."""
    return torch.cat([network(some) for some in images.split(10)])
