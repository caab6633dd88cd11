"""Photographs and masks of a set, in three parts: to train on, to choose on, and held out."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

VARIABLES = {"buildings": "TORCHLINF_BUILDINGS", "facades": "TORCHLINF_FACADES"}
EVERY = 7  # of the training folder, each seventh image is there to choose weights on
TURNS = {"buildings": 4, "facades": 1}  # quarter turns of an image that are images of the same kind
CROP = 128


@dataclass(frozen=True)
class Images:
    """Images (N, 3, H, W) in [0, 1] and masks (N, 1, H, W) of 0 and 1, both float32."""

    images: Tensor
    masks: Tensor


def folder(name: str) -> Path:
    """The folder of a set, which the environment names."""
    value = os.environ.get(VARIABLES[name])
    if not value:
        raise SystemExit(f"Set {VARIABLES[name]} to the folder of {name}, which holds train/ and val/.")
    return Path(value)


def load(name: str, part: str) -> Images:
    """A part of a set: "train", "choose" (both of the folder train) or "held-out" (the folder val)."""
    place = folder(name) / ("val" if part == "held-out" else "train")
    files = sorted((place / "masks").iterdir())
    if part != "held-out":
        files = [file for i, file in enumerate(files) if (i % EVERY == 0) == (part == "choose")]
    masks = np.stack([np.array(Image.open(file).convert("L")) > 127 for file in files])
    images = np.stack([np.array(Image.open(_image_of(place, file)).convert("RGB")) for file in files])
    return Images(
        torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255,
        torch.from_numpy(masks)[:, None].float(),
    )


def _image_of(place: Path, mask: Path) -> Path:
    return next((place / "images").glob(mask.stem + ".*"))


def batch(images: Images, number: int, whole: bool, turns: int, draw: torch.Generator) -> tuple[Tensor, Tensor]:
    """Images and masks drawn at random, whole or cropped, mirrored, turned, and of another brightness."""
    size = images.images.shape[-1]
    found = []
    for _ in range(number):
        i = int(torch.randint(len(images.images), (), generator=draw))
        top, left = (0, 0) if whole else torch.randint(size - CROP + 1, (2,), generator=draw).tolist()
        side = size if whole else CROP
        both = torch.cat([images.images[i], images.masks[i]])[:, top : top + side, left : left + side]
        if torch.rand((), generator=draw) < 0.5:
            both = both.flip(-1)
        both = torch.rot90(both, int(torch.randint(turns, (), generator=draw)), (1, 2))
        gain, shift = 0.8 + 0.4 * torch.rand(3, 1, 1, generator=draw), 0.2 * torch.rand((), generator=draw) - 0.1
        found.append((both[:3] * gain + shift, both[3:]))
    pictures, masks = zip(*found, strict=True)
    return torch.stack(pictures), torch.stack(masks)
