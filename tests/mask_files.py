"""Masks that tests write into files and archives."""

import io

import numpy as np
from PIL import Image


def noise(seed: int, *size: int) -> np.ndarray:
    """A random shape with holes, touching the border, in several components."""
    return np.random.default_rng(seed).random(size) > 0.15


def png(mask: np.ndarray) -> bytes:
    """A mask as a PNG file of 0 and 255."""
    file = io.BytesIO()
    Image.fromarray(np.where(mask, 255, 0).astype(np.uint8)).save(file, format="PNG")
    return file.getvalue()
