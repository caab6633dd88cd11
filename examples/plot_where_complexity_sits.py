"""
Where complexity sits, and parts that are simpler
=================================================

The complexity of a shape is a mean over pixels, so every pixel has a share in it. ``torchlinf.complexity_map`` shows
the shares, and ``torchlinf.decompose.parts`` cuts where they gather. The paper leaves both to future work; what follows
is one way, and it ends with where it fails. Run it with ``--full`` for the horse in full size.
"""

# %%
# The entropy of a level is the mean of the surprisal of its pixels: -log2 of how many pixels of the level share the
# pixel's bin. A pixel with the same value as most others of its distance has a small share, one with a rare value a
# large one. The shares of all pixels add up to the complexity, to the last digits.

import sys

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from skimage import data
from torch import Tensor

import torchlinf
from torchlinf import decompose, plot, shapes

step = 1 if "--full" in sys.argv else 2
horse = torch.from_numpy(np.ascontiguousarray(~data.horse()[::step, ::step].astype(bool)))
noisy = shapes.add_noise(torch.ones(128, 128), factor=4, count=50, seed=0)
limbs = [shapes.Appendage("right", 64, 48), shapes.Appendage("top", 32, 32)]
masks = {
    "disc": shapes.disc(64),
    "noisy square": noisy,
    "square with appendages": shapes.with_appendages((128, 128), limbs),
    "horse": horse,
}
for name, mask in masks.items():
    share = torchlinf.complexity_map(mask, spatial_ndim=2)
    print(f"{name:23} {torchlinf.complexity(mask, spatial_ndim=2):.12f} bits, the shares add up to {share.sum():.12f}")

# %%
# Over all scales. On the square with appendages all that a joint does can be seen: it changes the appendage, and a
# wedge of the body half as deep as the joint is wide; what is pale has the value that most pixels of its level have.
# The bumps of the noisy square have their wedges too. On the disc the shares come from everywhere, and on the horse as
# well: they gather in the trunk, since the inner levels have few pixels, each with a large share.

fig, axes = plt.subplots(2, 2, figsize=(10, 8), layout="constrained")
for ax, (name, mask) in zip(axes.flat, masks.items(), strict=True):
    plot.complexity_map(mask, ax=ax)
    ax.set_title(f"{name}: {ax.get_title()}")
plt.show()

# %%
# Windows of scales take the map apart. The fine scales are the levels near the outline, the coarse ones those inside.
# The narrow appendage, a quarter as wide as the square, acts on no scale above 1/4 and drops out. On the outline of the
# horse the darkest places are neck, thighs and tail.

fig, axes = plt.subplots(2, 2, figsize=(10, 8), layout="constrained")
for row, name in zip(axes, ["square with appendages", "horse"], strict=True):
    for ax, (low, high) in zip(row, [(0.0, 0.25), (0.25, 1.0)], strict=True):
        plot.complexity_map(masks[name], low=low, high=high, ax=ax)
        ax.set_title(f"{name}: {ax.get_title()}\nat scales in ({low}, {high}]", fontsize=11)
plt.show()

# %%
# Now cut. An appendage that is narrower than its body cannot hold the largest squares of the body, so the union of all
# squares of a side ends where the appendage was joined. These cuts are tried for every size of square, the parts are
# solved again, exactly, and cut in turn; of the tree of cuts the parts of least complexity in all remain. Boxes on
# boxes come apart, with a sum of zero. A floor plan is made of boxes too: four rooms, and doorways that are
# parts of their own.


def draw_parts(ax: Axes, name: str, mask: Tensor, found: decompose.Decomposition, objective: str = "sum") -> None:
    """Parts side by side in the colours of their numbers, ten colours in turn, with what was gained."""
    numbers = np.where(mask, (found.label_map - 1) % len(plot.COLOURS), np.nan)
    ax.imshow(numbers, cmap=ListedColormap(plot.COLOURS), vmin=-0.5, vmax=9.5, interpolation="nearest")
    ax.set(xlabel="column (pixels)", ylabel="row (pixels)")
    parts = "part" if found.num_parts == 1 else "parts"
    ax.set_title(
        f"{name}\n{found.before:.2f} bits; {found.num_parts} {parts}, {objective} {found.after:.2f} bits", fontsize=10
    )


joined = {
    "square with appendages": masks["square with appendages"],
    "floor plan with an obstacle": shapes.rooms(2, 2, side=64, wall=2, aperture=16, obstacle=(16, 2)),
}
fig, axes = plt.subplots(1, 2, figsize=(10, 5.8), layout="constrained")
for ax, (name, mask) in zip(axes, joined.items(), strict=True):
    draw_parts(ax, name, mask, decompose.parts(mask, spatial_ndim=2))
plt.show()

# %%
# What is not made of boxes falls into very many. The sum does become lower, for the horse from more than five bits to
# next to nothing, but by a mosaic. A penalty per part says what a part must save, and with a small one the horse
# stays whole: no few parts of it have a lower sum. That is no failure of the search alone. Entropy counts how many
# values a level has, and half of a horse has nearly as many as a horse.
#
# Their mean over the area, which is what a pixel sees on average, is lowered by few parts. ``objective="mean"`` asks
# for that, and with a penalty the parts become trunk, neck, head and legs, cut like boxes.

fig, axes = plt.subplots(2, 2, figsize=(10, 8.4), layout="constrained")
for ax, (objective, penalty) in zip(axes.flat, [("sum", 0.0), ("sum", 0.1), ("mean", 0.1), ("mean", 0.3)], strict=True):
    found = decompose.parts(horse, objective=objective, penalty_per_part=penalty, spatial_ndim=2)
    draw_parts(ax, f'objective="{objective}", penalty_per_part={penalty}', horse, found, objective)
plt.show()

# %%
# Watersheds of *f* are the other candidates. They cut at necks between two maxima of *f*, such as doorways. But *f*
# rises all the way along a limb into the body: a limb has no maximum of its own, and no watershed cuts it off. On the
# square with appendages, the disc and the noisy square there is nothing to cut. The rooms do come apart at the
# doorways, but along curved borders, which leave no box, so that the mean is lower and the sum is not.

rooms = joined["floor plan with an obstacle"]
fig, axes = plt.subplots(1, 2, figsize=(10, 5.2), layout="constrained")
for ax, (name, mask, penalty) in zip(axes, [("floor plan", rooms, 0.0), ("horse", horse, 0.02)], strict=True):
    found = decompose.parts(mask, objective="mean", penalty_per_part=penalty, candidates="watershed", spatial_ndim=2)
    draw_parts(ax, f"{name}, watersheds of f", mask, found, "mean")
plt.show()
