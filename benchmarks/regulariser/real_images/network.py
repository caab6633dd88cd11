"""A U-Net that two cores can train: about a million parameters, all work at a half or a quarter of the resolution."""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

# Pixels a side that become channels, and channels at each resolution. Small windows need the finer one.
DESIGNS = {"buildings": (4, (24, 48, 96, 128)), "facades": (2, (16, 32, 64, 128, 128))}


def _block(inputs: int, outputs: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for channels in (inputs, outputs):
        layers += [nn.Conv2d(channels, outputs, 3, padding=1, bias=False), nn.GroupNorm(8, outputs), nn.ReLU(True)]
    return nn.Sequential(*layers)


class UNet(nn.Module):
    """Logits (B, 1, H, W) of images (B, 3, H, W), H and W multiples of 32."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.cell, own = DESIGNS[name]
        widths = (3 * self.cell**2, *own)
        self.down = nn.ModuleList(_block(a, b) for a, b in pairwise(widths))
        pairs = zip(own[:0:-1], own[-2::-1], strict=True)
        self.up = nn.ModuleList(_block(below + beside, beside) for below, beside in pairs)
        self.head = nn.Conv2d(own[0], self.cell**2, 3, padding=1)

    def forward(self, images: Tensor) -> Tensor:
        """The logits."""
        x = functional.pixel_unshuffle(images - 0.5, self.cell).contiguous(memory_format=torch.channels_last)
        beside = []
        for i, block in enumerate(self.down):
            x = block(functional.max_pool2d(x, 2) if i else x)
            beside.append(x)
        for block, other in zip(self.up, beside[-2::-1], strict=True):
            x = block(torch.cat([functional.interpolate(x, scale_factor=2.0), other], dim=1))
        return functional.pixel_shuffle(self.head(x), self.cell)
