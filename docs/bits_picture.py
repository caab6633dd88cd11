"""Draw docs/images/bits.png, the picture of the page "What does 2.4 bits mean?".

Run `python docs/bits_picture.py` from the root of the repository. tests/test_docs.py compares the page's numbers with
those of `silhouettes`.
"""

import math
from pathlib import Path

import torch
from torch import Tensor

import torchlinf
from torchlinf import shapes

INK = "#1f3b57"


def rotated_square(side: int, degrees: float) -> Tensor:
    """A square turned about its centre, (H, W) bool."""
    y, x = _centred(side + side // 2)
    angle = math.radians(degrees)
    u, v = x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle)
    return (u.abs() <= side / 2) & (v.abs() <= side / 2)


def noisy_square(side: int, count: int, seed: int) -> Tensor:
    """A square with small blocks all along its outline, (H, W) bool."""
    canvas = torch.zeros(side + 40, side + 40, dtype=torch.bool)
    canvas[20:-20, 20:-20] = True
    generator = torch.Generator().manual_seed(seed)
    for edge, along, reach in torch.rand(count, 3, generator=generator).tolist():
        across, place, half = (20, side + 19)[int(2 * edge)], 20 + int(side * along), 1 + int(8 * reach)
        view = canvas if edge % 0.5 < 0.25 else canvas.T
        view[across - half : across + half + 1, place - half : place + half + 1] = True
    return canvas


def gear(size: int, teeth: int, depth: int) -> Tensor:
    """A disc with straight teeth, (H, W) bool."""
    y, x = _centred(size)
    radius = torch.where(torch.cos(teeth * torch.atan2(y, x)) > 0, size / 2, size / 2 - depth)
    return torch.hypot(x, y) <= radius


def silhouettes() -> dict[str, Tensor]:
    """The shapes of the picture by name, each (H, W) bool, from simple to complex."""
    angle = torch.ones(128, 128, dtype=torch.bool)
    angle[:64, 64:] = False
    plus = torch.zeros(129, 129, dtype=torch.bool)
    plus[43:86] = plus[:, 43:86] = True
    bump = shapes.Appendage("right", width=48, depth=32)
    return {
        "square": shapes.square(128),
        "L": angle,
        "plus": plus,
        "square with a bump": shapes.with_appendages((128, 128), [bump]),
        "floor plan": shapes.floor_plan(3),
        "rounded square": shapes.superellipse(64, 8),
        "noisy square": noisy_square(128, 200, seed=0),
        "small disc": shapes.disc(32),
        "gear": gear(161, 12, 14),
        "disc": shapes.disc(64),
        "turned square": rotated_square(128, 20),
        "horse": _horse(),
    }


def draw(path: Path) -> None:
    """Each shape over its complexity against scale."""
    import matplotlib.pyplot as plt

    found = silhouettes()
    figure, axes = plt.subplots(4, 6, figsize=(13, 8.2), height_ratios=[2.4, 1, 2.4, 1], layout="constrained")
    for i, (name, mask) in enumerate(found.items()):
        profile = torchlinf.complexity_profile(mask, spatial_ndim=2)
        above, below = axes[2 * (i // 6), i % 6], axes[2 * (i // 6) + 1, i % 6]
        side = max(mask.shape) + 8
        canvas = torch.zeros(side, side)
        top, left = (side - mask.shape[0]) // 2, (side - mask.shape[1]) // 2
        canvas[top : top + mask.shape[0], left : left + mask.shape[1]] = mask
        above.imshow(canvas, cmap=plt.matplotlib.colors.ListedColormap(["white", INK]), interpolation="nearest")
        above.set_title(f"{name}\n{profile.mean().item():.2f} bits", fontsize=12)
        above.axis("off")
        levels = profile.levels()
        scale = torch.arange(len(levels) + 1) / len(levels)
        below.stairs(levels, scale, color=INK, fill=True, alpha=0.75)
        below.set(xlim=(0, 1), ylim=(0, 8), xticks=[0, 0.25, 1], yticks=[0, 4, 8])
        below.set_xticklabels(["0", "¼", "1"])
        below.tick_params(labelsize=8)
        if i % 6 == 0:
            below.set_ylabel("bits")
        if i >= 6:
            below.set_xlabel("scale")
    figure.savefig(path, dpi=90)


def _centred(size: int) -> tuple[Tensor, Tensor]:
    place = torch.arange(size) - (size - 1) / 2
    return torch.meshgrid(place, place, indexing="ij")


def _horse() -> Tensor:
    from skimage.data import horse

    return torch.from_numpy(~horse())


if __name__ == "__main__":
    draw(Path(__file__).parent / "images" / "bits.png")
