"""
Zero complexity, and the entropy of the pattern spectrum
========================================================

Squares are not the only shapes of complexity zero. The paper names shapes of constant width, and two equal squares that
overlap or touch on a diagonal. One sentence of it adds that these have complexity zero in the framework of Maragos too,
at the scale given by the largest square. This page shows shapes of complexity zero, and compares the complexity with
the entropy of Maragos's pattern spectrum, with squares of growing size. The comparison is ours.

Run with ``--full`` for noise on a larger square.
"""

# %%
# The pattern spectrum of a shape is what openings take away from it: :math:`p_k` is the share of its pixels that lie in
# some square of side *k* inside the shape, but in none of side *k* + 1. Its entropy
# :math:`-\sum_k p_k \log_2 p_k` is zero if all of the shape is made of squares of one size.

import sys

import matplotlib.pyplot as plt
import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage, stats
from torch import Tensor

import torchlinf
from torchlinf import plot, shapes


def pattern_spectrum(mask: Tensor) -> NDArray[np.float64]:
    """Entry k - 1: the share of the pixels in a square of side k inside the shape, but in none of side k + 1."""
    inside = mask.numpy().astype(np.uint8)
    areas = [float(inside.sum())]
    while areas[-1]:
        side = len(areas) + 1
        # Without the frame, what is outside of the array would count as inside.
        areas.append(float(ndimage.grey_opening(np.pad(inside, side), size=side).sum()))
    return -np.diff(areas) / areas[0]


def spectrum_entropy(mask: Tensor) -> float:
    """Entropy of the pattern spectrum in bits."""
    shares = pattern_spectrum(mask)
    return float(stats.entropy(shares, base=2))


def complexity(mask: Tensor) -> float:
    """Mean complexity over all scales in bits."""
    return float(torchlinf.complexity(mask, spatial_ndim=2))


def gallery(masks: dict[str, Tensor], columns: int) -> None:
    """Shapes with level lines of f, and both numbers."""
    rows = -(-len(masks) // columns)
    _, axes = plt.subplots(rows, columns, figsize=(8, 2.7 * rows), layout="constrained")
    for ax, (name, mask) in zip(axes.flat, masks.items(), strict=True):
        plot.levels(mask, ax=ax)
        ax.set(xticks=[], yticks=[], ylabel="", anchor="S")
        ax.set_title(name, fontsize=11)
        ax.set_xlabel(f"complexity {complexity(mask):.2f}\nspectrum {spectrum_entropy(mask):.2f}")
        ax.spines[:].set_visible(False)
    plt.show()


# %%
# Eight shapes of complexity zero, with level lines of the field f. On each the field depends on the distance to the
# outside alone, so that its lines run along the boundary as they do on a square. Bands have the same width everywhere;
# a square that is repeated on the diagonal, overlapping or touching in a corner, adds nothing. The pattern spectrum
# says the same: each of them consists of squares of one size, 32 pixels, and no larger one fits.

repeated = shapes.zero_complexity(32)
gallery(repeated, columns=4)
assert all(complexity(mask) == spectrum_entropy(mask) == 0 for mask in repeated.values())

# %%
# A T and a plus of constant width are zero too. They are what the paper describes: a rectangle with sides *a* < *b*,
# and another one with a contact of width *a* on it.

tee, plus = torch.zeros(64, 96, dtype=torch.bool), torch.zeros(96, 96, dtype=torch.bool)
tee[:32] = tee[:, 32:64] = True
plus[32:64] = plus[:, 32:64] = True
gallery({"T": tee, "plus": plus}, columns=2)
assert complexity(tee) == complexity(plus) == 0

# %%
# The paper says that its measure is consistent with a claim of Donderi: that the perceived complexity of two
# overlapping shapes is the average of their dissimilarity and of the mean of their complexities. Squares have
# complexity zero, so what remains is the dissimilarity. Here a square of 64 and a second one overlap, the middle of the
# second at a corner of the first. Two equal squares give zero. Unequal ones do not; but the more unequal they are, the
# smaller is the number, since a smaller square also counts on fewer scales.


def corner_pair(small: int, side: int = 64) -> Tensor:
    """A square, and a smaller one around its lower right corner."""
    canvas = torch.zeros(side + small // 2, side + small // 2, dtype=torch.bool)
    canvas[:side, :side] = True
    canvas[side - small // 2 :, side - small // 2 :] = True
    return canvas


gallery({f"64 and {small}": corner_pair(small) for small in (64, 48, 32, 16)}, columns=4)
assert [round(complexity(corner_pair(small)), 3) for small in (64, 48, 32, 16)] == [0, 0.784, 0.610, 0.169]

# %%
# That all of a shape is made of equal squares is no rule for zero. Below, the first two shapes consist of equal squares
# too, moved along no axis and no diagonal; their spectrum has entropy zero, but the complexity sees the joint. On the
# other two the thickness falls from 64 pixels to 63. The radius is 32 for both, and so the complexity is zero; for the
# spectrum there are two sizes. (Maragos enlarges a block of 3 x 3 pixels, which gives the odd sides only. Then 63 and
# 64 are one size, and the last two are zero too.)


def squares(side: int, *corners: tuple[int, int]) -> Tensor:
    """Union of equal squares by their upper left corners."""
    canvas = torch.zeros(*(max(c) + side for c in zip(*corners, strict=True)), dtype=torch.bool)
    for row, column in corners:
        canvas[row : row + side, column : column + side] = True
    return canvas


step = shapes.rectangle(64, 128)
step[0, 64:] = False
odd_ones = {
    "overlap, aslant": squares(64, (0, 0), (48, 20)),
    "stairs": squares(48, (0, 0), (12, 30), (48, 40), (60, 80)),
    "a step of 1 pixel": step,
    "bump of 63 on 64": shapes.with_appendages((64, 64), [shapes.Appendage("right", 63, 32)]),
}
gallery(odd_ones, columns=4)
assert all(complexity(odd_ones[name]) > 0 == spectrum_entropy(odd_ones[name]) for name in ("overlap, aslant", "stairs"))
assert complexity(step) == 0 < spectrum_entropy(step)

# %%
# The spectrum counts pixels, wherever they are. A square of 64 with four squares of 16 has one spectrum, whether these
# are centred on its sides, flush with its corners, touching those corners or apart. The complexity is the same for the
# first two (on rims it is not), and lower for the others: where nothing is joined, the field bends
# around no joint, and only differs from one square to the next.


def with_four(*corners: tuple[int, int]) -> Tensor:
    """A square of 64 pixels with its upper left corner at (32, 32), and four small ones."""
    canvas = torch.zeros(128, 128, dtype=torch.bool)
    canvas[32:96, 32:96] = True
    for row, column in corners:
        canvas[row : row + 16, column : column + 16] = True
    return canvas


gallery(
    {
        "centred": with_four((56, 96), (56, 16), (16, 56), (96, 56)),
        "flush": with_four((32, 96), (80, 16), (16, 32), (96, 80)),
        "at the corners": with_four((16, 16), (16, 96), (96, 16), (96, 96)),
        "apart": with_four((8, 56), (104, 56), (56, 8), (56, 104)),
    },
    columns=4,
)

# %%
# Both look at a shape scale by scale, and both see where something ends: S3 is a square of 128 with appendages of width
# 96, 64 and 32. The spectrum has a bar for each width, as high as its share of the area. The profile steps down at each
# width's share of the side, and is a number of its own at every scale: the spectrum has one entropy, the complexity one
# for each scale.

s3 = shapes.nested_appendages(128, 48)["S3"]
shares = pattern_spectrum(s3)
fig, (left, right) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
left.bar(np.arange(1, len(shares) + 1), shares, width=3, color=plot.COLOURS[1])
left.set(xlabel="side k of the square (pixels)", ylabel="pattern spectrum\n(share of the area)", xlim=(0, 134))
left.set_xticks([32, 64, 96, 128])
left.spines[["top", "right"]].set_visible(False)
plot.profile(s3, ax=right)
right.set_xticks([0, 0.25, 0.5, 0.75, 1])
plt.show()

# %%
# Families: a square of 96 that turns; a square of 128 with one to four appendages of width 32; with one appendage of
# growing width; discs of growing radius.


def turned(degrees: float, side: int = 96) -> Tensor:
    """A square at an angle, of the pixels whose centres are in it."""
    axis = torch.arange(-side, side + 1, dtype=torch.float64)
    y, x = axis[:, None], axis[None, :]
    cos, sin = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return ((cos * x + sin * y).abs() <= side / 2) & ((cos * y - sin * x).abs() <= side / 2)


def bumped(number: int, width: int) -> Tensor:
    """A square of 128 with appendages on its first sides."""
    bumps = [shapes.Appendage(face, width, 32) for face in ("right", "left", "top", "bottom")[:number]]
    return shapes.with_appendages((128, 128), bumps)


angles, numbers, radii = [0, 1, 2, 5, 10, 15, 20, 25, 30, 35, 40, 45], range(5), [8, 16, 24, 32, 48, 64]
widths = [1, 8, 16, 32, 48, 64, 80, 96, 112, 120, 126, 127, 128]
families = {
    "angle of a square (degrees)": (angles, [turned(angle) for angle in angles]),
    "number of appendages": (numbers, [bumped(number, 32) for number in numbers]),
    "width of one appendage (pixels)": (widths, [bumped(1, width) for width in widths]),
    "radius of a disc (pixels)": (radii, [shapes.disc(radius) for radius in radii]),
}
fig, axes = plt.subplots(2, 2, figsize=(8, 5.4), layout="constrained")
for ax, (label, (at, members)) in zip(axes.flat, families.items(), strict=True):
    ax.plot(at, [complexity(mask) for mask in members], "o-", markersize=4, color=plot.COLOURS[0], label="complexity")
    ax.plot(at, [spectrum_entropy(mask) for mask in members], "s--", markersize=4, color=plot.COLOURS[1],
            label="spectrum entropy")  # fmt: skip
    ax.set(xlabel=label, ylabel="bits")
    ax.spines[["top", "right"]].set_visible(False)
axes[0, 1].set_xticks(numbers)
axes[0, 0].legend(frameon=False)
plt.show()

# %%
# They rise together with the angle, with the number of appendages, and with the radius of a disc, whose pixels are a
# finer staircase the larger it is. They part at the width: a wider appendage lasts to a higher scale, so the complexity
# grows faster, up to the point where the appendage is as thick as the body, and it is zero. For the spectrum there the
# area of the narrow part still counts, until the last pixel.
#
# With noise on a square (patches of several sizes and numbers), the order that the two give is nearly the same.

SIDE, SEEDS = (128, 6) if "--full" in sys.argv else (64, 2)
fig, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
found = []
for factor, color, marker in zip((1, 2, 3, 4), plot.COLOURS, "osD^", strict=False):
    pairs = [
        (complexity(noisy), spectrum_entropy(noisy))
        for count in (10, 20, 40, 80)
        for seed in range(SEEDS)
        for noisy in [shapes.add_noise(shapes.square(SIDE), factor, count, seed=seed)]
    ]
    ax.scatter(*zip(*pairs, strict=True), s=22, color=color, marker=marker, label=f"patches of {factor} pixels")
    found += pairs
ax.set(xlabel="complexity (bits)", ylabel="entropy of the pattern spectrum (bits)")
ax.legend(frameon=False)
ax.spines[["top", "right"]].set_visible(False)
plt.show()
tau = stats.kendalltau(*zip(*found, strict=True)).statistic
print(f"{len(found)} noisy squares: Kendall's tau between the two numbers is {tau:.2f}")
assert tau > 0.9
