"""The loss under DistributedDataParallel: two processes get the gradient that one gets of the whole batch."""

import os
from pathlib import Path

import pytest
import torch
import torch.distributed as dist
from torch import Tensor, nn

from torchlinf import shapes
from torchlinf.losses import ShapeComplexityLoss


class Simplifier(nn.Module):
    """A layer with the loss on top."""

    def __init__(self) -> None:
        super().__init__()
        self.layer = nn.Conv2d(1, 2, 3, padding=1)
        nn.init.constant_(self.layer.weight, 0.3)
        nn.init.constant_(self.layer.bias, -1.0)
        self.loss = ShapeComplexityLoss(weight=[1.0, 0.5], activation="sigmoid", max_flips=6)

    def forward(self, images: Tensor) -> Tensor:
        loss: Tensor = self.loss(self.layer(images))
        return loss


def images() -> Tensor:
    """(4, 1, H, W): a box with one, two and three appendages, and nothing."""
    faces = [shapes.Appendage("right", 4, 3), shapes.Appendage("right", 3, 2, offset=0), shapes.Appendage("top", 5, 3)]
    drawn = [shapes.with_appendages((12, 15), faces[:n], margin=5)[-22:, :24] for n in (1, 2, 3)]
    return torch.stack([*drawn, torch.zeros_like(drawn[0])])[:, None].float()


def gradients(model: nn.Module, batch: Tensor) -> list[Tensor]:
    model(batch).backward()
    return [parameter.grad for parameter in model.parameters() if parameter.grad is not None]


def work(rank: int, folder: str) -> None:
    torch.set_num_threads(1)
    dist.init_process_group("gloo", init_method=f"file://{folder}/meeting", rank=rank, world_size=2)
    model = nn.parallel.DistributedDataParallel(Simplifier())
    found = gradients(model, images()[rank::2])
    torch.save(found, Path(folder) / f"{rank}.pt")
    os._exit(0)  # torch's own end can wait for itself: the interpreter's lock is held while a thread of gloo needs it


@pytest.mark.slow
def test_two_processes_agree_with_one(tmp_path: Path) -> None:
    expected = gradients(Simplifier(), images())
    assert max(part.abs().max().item() for part in expected) > 1e-3
    torch.multiprocessing.spawn(work, args=(str(tmp_path),), nprocs=2)
    for rank in range(2):
        torch.testing.assert_close(torch.load(tmp_path / f"{rank}.pt"), expected, rtol=1e-4, atol=1e-6)
