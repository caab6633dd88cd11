"""What is measured: real silhouettes, shapes of the documentation, enlargements, and volumes."""

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from torchlinf import shapes
from torchlinf._helpers.boxes import bounding_box

Mask = NDArray[np.bool_]
FOLDER = "TORCHLINF_MPEG7"


@dataclass(frozen=True)
class Named:
    """A shape, `(*spatial)` bool on the CPU, and what to call it."""

    name: str
    mask: Tensor

    @property
    def pixels(self) -> int:
        """Number of inside pixels."""
        return int(self.mask.sum())


def origin() -> str:
    """Where `silhouettes` takes its shapes from, in words."""
    return "MPEG-7 CE-Shape-1" if os.environ.get(FOLDER) else "stand-ins from scikit-image"


def silhouettes(count: int, side: int | None = None) -> list[Named]:
    """Real silhouettes, spread evenly over what there is; `side` shrinks each to that longest side."""
    found = _mpeg7() if os.environ.get(FOLDER) else _stand_ins()
    chosen = [found[i]() for i in np.unique(np.linspace(0, len(found) - 1, count).round().astype(int))]
    if side is not None:
        chosen = [Named(shape.name, _shrink(shape.mask, side)) for shape in chosen]
    return chosen


def documented(scale: float = 1.0) -> list[Named]:
    """Shapes of the method page, and squares with a noisy outline."""
    side = round(128 * scale)
    steps = [("right", 6), ("top", 4), ("left", 2)]
    ladder = [shapes.Appendage(face, side * eighths // 8, side * 3 // 8) for face, eighths in steps]
    return [
        *(Named(f"disc {radius}", shapes.disc(radius)) for radius in (round(64 * scale), round(128 * scale))),
        Named("square with three appendages", shapes.with_appendages((side, side), ladder)),
        Named(f"noisy square {side}", noisy_square(side)),
        Named(f"noisy square {2 * side}", noisy_square(2 * side, seed=1)),
    ]


def noisy_square(side: int, seed: int = 0) -> Tensor:
    """A square whose outline small squares were added to and cut out of."""
    random = np.random.default_rng(seed)
    reach = max(1, side // 16)
    mask = np.pad(np.ones((side, side), dtype=np.bool_), 2 * reach)
    for _ in range(side // 2):
        place = [2 * reach + random.integers(side), 2 * reach + (side - 1) * random.integers(2)]
        y, x = random.permutation(place)
        half = random.integers(1, reach + 1)
        mask[y - half : y + half + 1, x - half : x + half + 1] = random.random() < 0.5
    return torch.from_numpy(mask)


def repeat(mask: Tensor, factor: int) -> Tensor:
    """Enlarge by drawing every pixel as a block: the outline keeps the steps it had, `factor` times as large."""
    for axis in range(mask.ndim):
        mask = mask.repeat_interleave(factor, dim=axis)
    return mask


def smooth(mask: Tensor, factor: int) -> Tensor:
    """Enlarge a blurred copy and threshold it: a new outline at the new resolution, whose steps are one pixel."""
    blurred = ndimage.gaussian_filter(np.pad(mask.numpy(), 4).astype(np.float32), 1.5)
    return torch.from_numpy(ndimage.zoom(blurred, factor, order=3, grid_mode=True, mode="grid-constant") > 0.5)


def volumes(side: int) -> list[Named]:
    """3-D shapes in a cube of that side: a ball, a union of boxes and balls, and a ball with a rough surface."""
    random = np.random.default_rng(2)
    centre = np.indices((side,) * 3) - (side - 1) / 2
    distance = np.sqrt((centre**2).sum(axis=0))
    noise = ndimage.gaussian_filter(random.standard_normal((side,) * 3), max(1.0, side / 42))
    rough = distance / side + 0.03 * noise / noise.std() < 0.4
    return [
        Named("ball", torch.from_numpy(distance <= side / 2 - 1)),
        Named("boxes and balls", torch.from_numpy(_union(side, random))),
        Named("rough ball", torch.from_numpy(rough)),
    ]


def batch(count: int, side: int) -> Tensor:
    """Silhouettes `(count, side, side)`, mirrored and turned where there are too few, each filling the square."""
    found = [_fitted(shape.mask, side) for shape in silhouettes(min(count, 40))]
    filled = []
    for i in range(count):
        mask = torch.rot90(found[i % len(found)], i // len(found))
        padded = torch.zeros(side, side, dtype=torch.bool)
        padded[: mask.shape[0], : mask.shape[1]] = mask
        filled.append(padded)
    return torch.stack(filled)


def _union(side: int, random: np.random.Generator) -> Mask:
    grid = np.indices((side,) * 3)
    whole = np.zeros((side,) * 3, dtype=np.bool_)
    for i in range(12):
        half = random.integers(max(2, side // 12), side // 5 + 2)
        middle = random.integers(half + 1, side - half - 1, 3)
        offset = np.abs(grid - middle[:, None, None, None])
        whole |= (offset.max(axis=0) <= half) if i % 2 else ((offset**2).sum(axis=0) <= half**2)
    return whole


def _shrink(mask: Tensor, side: int) -> Tensor:
    """The shape in its box, with a longest side of at most `side`."""
    mask = mask[bounding_box(mask.numpy())]
    factor = min(1.0, side / max(mask.shape))
    return torch.from_numpy(ndimage.zoom(mask.numpy().astype(np.float32), factor, order=1) > 0.5)


def _fitted(mask: Tensor, side: int) -> Tensor:
    """The shape in its box, enlarged if its longest side is shorter than `side`, which it then has."""
    longest = max(mask[bounding_box(mask.numpy())].shape)
    return _shrink(mask if longest >= side else smooth(mask, math.ceil(side / longest)), side)


def _mpeg7() -> list[Callable[[], Named]]:
    from PIL import Image

    files = sorted(path for path in Path(os.environ[FOLDER]).iterdir() if path.suffix in {".gif", ".png"})
    if not files:
        raise FileNotFoundError(f"{FOLDER} must name a folder of .png or .gif silhouettes; got one without any.")

    def read(path: Path) -> Named:
        return Named(path.stem, torch.from_numpy(np.array(Image.open(path).convert("L")) > 0))

    return [partial(read, path) for path in files]


@cache
def _stand_ins() -> list[Callable[[], Named]]:
    """The horse, and coins cut out of their photograph at four times the side: what scikit-image has in its wheel."""
    from skimage import data, measure

    filled = ndimage.binary_fill_holes(data.coins() > 110)
    labels = measure.label(ndimage.binary_opening(filled, iterations=2))
    regions = [region for region in measure.regionprops(labels) if region.area > 800]

    def coin(number: int) -> Named:
        return Named(f"coin {number}", smooth(torch.from_numpy(regions[number - 1].image), 4))

    horse = partial(Named, "horse", torch.from_numpy(~data.horse()))
    return [horse, *(partial(coin, number) for number in range(1, len(regions) + 1))]
