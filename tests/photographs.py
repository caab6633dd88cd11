"""Small sets of photographs and masks, as the studies of real images read them."""

from pathlib import Path

import numpy as np
from PIL import Image


def write_photographs(folder: Path) -> None:
    """Nine images to train on and three held out, 160 x 160, each with a bright block."""
    random = np.random.default_rng(0)
    for part, number in (("train", 9), ("val", 3)):
        for kind in ("images", "masks"):
            (folder / part / kind).mkdir(parents=True)
        for i in range(number):
            top, left, height, width = random.integers(20, 70, 4)
            mask = np.zeros((160, 160), np.uint8)
            mask[top : top + height, left : left + width] = 255
            image = (mask // 2)[..., None] + random.integers(0, 60, (160, 160, 3))
            Image.fromarray(image.astype(np.uint8)).save(folder / part / "images" / f"{i}.jpg")
            Image.fromarray(mask).save(folder / part / "masks" / f"{i}.png")
