"""
Shapes that become simpler
==========================

The pixels of an image as free parameters, and one loss: the complexity of the shape. Its gradient is a finite
difference under flips of whole regions (:class:`torchlinf.losses.ShapeComplexityLoss`), so that bumps go as a whole.
What is printed is the hard complexity all along.

Run with ``--full`` for more steps.
"""

# %%
# Three shapes to begin with: a square with blocks grown onto it, a disc, and the silhouette of a horse. A cross-entropy
# to the first shape holds on to it, and the weight says how much the complexity counts against that. At several times
# its weight the horse would fall apart into squares.

import sys

import matplotlib.pyplot as plt
import torch
from skimage import data
from torch import Tensor

import torchlinf
from torchlinf import shapes
from torchlinf.losses import ShapeComplexityLoss

STEPS = 200 if "--full" in sys.argv else 70
FRAMES = 6


def grown_square(additions: int = 60, factor: int = 3, side: int = 12) -> tuple[Tensor, Tensor]:
    """A square and what becomes of it when blocks are added at random places of its boundary, one after the other."""
    generator = torch.Generator().manual_seed(0)
    coarse = shapes.square(side, margin=5)
    clean = coarse.clone()
    for _ in range(additions):
        beside = torchlinf.chessboard_distance(~coarse, spatial_ndim=2) == 1
        beside[[0, -1]] = beside[:, [0, -1]] = False
        places = beside.nonzero()
        coarse[tuple(places[torch.randint(len(places), (), generator=generator)])] = True
    return tuple(x.repeat_interleave(factor, 0).repeat_interleave(factor, 1) for x in (coarse, clean))


def horse() -> Tensor:
    """scikit-image's horse, black on white, at a fifth of its size."""
    inside = ~torch.from_numpy(data.horse())[None, None]
    small = torch.nn.functional.interpolate(inside.float(), size=(66, 80), mode="area")[0, 0] > 0.5
    return torch.nn.functional.pad(small, (3, 3, 3, 3))


noisy, clean = grown_square()
starts = {"grown square": noisy, "disc": shapes.disc(24, margin=4), "horse": horse()}
weights = {"grown square": 1.0, "disc": 0.2, "horse": 0.04}

# %%
# The pixels are logits; Adam takes the steps. ``keep_area=False``, since here the blocks have to go, and nothing has to
# take their area; the default, ``True``, is for networks, which would learn to shrink everything.


def simplify(shape: Tensor, weight: float, rate: float = 0.06) -> list[Tensor]:
    """The shape at the start, and whenever it changed."""
    target = shape[None, None].float()
    logits = (4 * target - 2).requires_grad_()
    optimiser = torch.optim.Adam([logits], lr=rate)
    regulariser = ShapeComplexityLoss(weight=weight, activation="sigmoid", max_flips=48, keep_area=False)
    path = [shape]
    for _ in range(STEPS):
        loss = torch.nn.functional.binary_cross_entropy_with_logits(logits, target) + regulariser(logits)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        after = logits[0, 0] > 0
        if not torch.equal(after, path[-1]):
            path.append(after)
    return path


paths = {name: simplify(shape, weights[name]) for name, shape in starts.items()}

# %%
# Each row is one descent, with the hard complexity in bits above every frame.

fig, axes = plt.subplots(len(paths), FRAMES, figsize=(11, 6), layout="constrained")
for row, (name, path) in zip(axes, paths.items(), strict=True):
    chosen = [path[round(i * (len(path) - 1) / (FRAMES - 1))] for i in range(FRAMES)]
    for i, (ax, frame) in enumerate(zip(row, chosen, strict=True)):
        ax.imshow(frame, cmap="gray_r", interpolation="nearest")
        ax.set_axis_off()
        ax.set_title(f"{torchlinf.complexity(frame, spatial_ndim=2):.3f}" + (f"  {name}" if i == 0 else ""))
plt.show()

# %%
# The square knows what it was before the blocks were added, though the loss does not.


def iou(a: Tensor, b: Tensor) -> float:
    """Overlap of two shapes."""
    return ((a & b).sum() / (a | b).sum()).item()


for name, path in paths.items():
    values = torchlinf.complexity(torch.stack([starts[name], path[-1]]), spatial_ndim=2)
    print(f"{name:13} complexity {values[0]:.3f} -> {values[1]:.3f}, kept {iou(starts[name], path[-1]):.2f}")
print(f"overlap with the clean square {iou(noisy, clean):.3f} -> {iou(paths['grown square'][-1], clean):.3f}")
