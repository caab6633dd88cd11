"""
3. Squares and discs of many sizes
==================================

On a grid a square is a square at every size, and a disc is a staircase with ever more steps. The paper says that
squares of all sizes have complexity zero, and that discs are ordered by their size at all scales, the larger the more
complex. The peak for the discs is close to 5 bits, and the smallest of them, of radius 64, is above 3 bits on 75 % of
the scales. In the limit of small radii the disc becomes a cross, which has complexity zero.

Run with ``--full`` for discs up to radius 1024.
"""

# %%
# Squares and discs, pixel by pixel, with their complexity; the darker a pixel, the larger the field *f*. In a square it
# depends on the distance to the outside alone. A disc of radius 2 is a square of 3 pixels with a pixel on each side;
# one of radius 32 is round to the eye.

import sys
from itertools import combinations

import matplotlib.pyplot as plt
import torch
from matplotlib.colors import LinearSegmentedColormap

import torchlinf
from torchlinf import plot, shapes

SMALL = (2, 4, 8, 16, 32)
fig, axes = plt.subplots(2, len(SMALL), figsize=(8, 4), layout="constrained")
for column, radius in zip(axes.T, SMALL, strict=True):
    side = 2 * radius + 1
    pair = {f"side {side}": shapes.square(side), f"radius {radius}": shapes.disc(radius)}
    for number, (ax, (name, mask)) in enumerate(zip(column, pair.items(), strict=True)):
        shades = LinearSegmentedColormap.from_list(name, ["white", plot.COLOURS[number]])
        ax.imshow(torchlinf.linf_field(mask, spatial_ndim=2).numpy(), cmap=shades, vmin=0, vmax=1)
        value = float(torchlinf.complexity(mask, spatial_ndim=2))
        ax.set_title(f"{name}\n{value:.2f} bits", fontsize=10)
        ax.set(xticks=(0, side - 1), yticks=(0, side - 1))
        ax.spines[:].set_visible(False)
fig.supxlabel("column (pixels)", fontsize=10)
fig.supylabel("row (pixels)", fontsize=10)
plt.show()

# %%
# Complexity against scale. The line of the squares is the ground.

SHOWN = (8, 16, 32, 64, 128, 256)
fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
plot.profile(shapes.square(129), label="squares", color="#555555", ax=ax)
for number, radius in enumerate(SHOWN):
    plot.profile(shapes.disc(radius), label=f"disc, radius {radius}", color=plot.COLOURS[number], ax=ax)
ax.axhline(3, color="#555555", linestyle=":", linewidth=1)
ax.text(1, 3, "3 bits", va="bottom", ha="right", color="#555555")
handles, names = ax.get_legend_handles_labels()
ax.legend(handles[::-1], names[::-1], frameon=False, loc="center left", bbox_to_anchor=(1.01, 0.5))
plt.show()

# %%
# The same as three numbers for each disc: the mean over all scales, the peak, and the share of scales above 3 bits.

RADII = [2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 16, 20, 24, 32, 40, 48, 64, 80, 96, 128, 160, 192, 256, 384, 512]
RADII += [768, 1024] if "--full" in sys.argv else []
profiles = {radius: torchlinf.complexity_profile(shapes.disc(radius), spatial_ndim=2) for radius in RADII}
mean = torch.stack([profile.mean() for profile in profiles.values()])
peak = torch.stack([profile.peak()[0] for profile in profiles.values()])
above = torch.stack([(profile.levels() > 3).double().mean() for profile in profiles.values()])

fig, (left, right) = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained", width_ratios=[1.4, 1])
left.plot(RADII, peak, "o-", markersize=3, color=plot.COLOURS[1], label="peak")
left.plot(RADII, mean, "o-", markersize=3, color=plot.COLOURS[0], label="mean over all scales")
left.axhline(5, color="#555555", linestyle=":", linewidth=1)
left.text(2, 5, "the paper's peak, near 5", va="bottom", color="#555555")
left.set(ylabel="complexity (bits)")
left.legend(frameon=False, loc="lower right")
right.plot(RADII, 100 * above, "o-", markersize=3, color=plot.COLOURS[2])
right.axhline(75, color="#555555", linestyle=":", linewidth=1)
right.text(2, 75, "the paper's 75 %", va="bottom", color="#555555")
right.set(ylabel="share of scales above 3 bits (%)", ylim=(-4, 104))
for ax in (left, right):
    ax.set(xscale="log", xticks=(2, 8, 32, 128, 512), xticklabels=("2", "8", "32", "128", "512"))
    ax.set(xlabel="radius of the disc (pixels)")
    ax.spines[["top", "right"]].set_visible(False)
plt.show()

# %%
# What the exact solution says.
#
# **Squares are zero**, exactly, at every size and scale.

for side in (*range(1, 20), 64, 129, 300):
    square = torchlinf.complexity_profile(shapes.square(side), spatial_ndim=2)
    assert (square.levels() == 0).all()

# %%
# **Discs are ordered by size**, by their mean, from radius 10 on. Scale by scale the order holds nearly everywhere: for
# any two of the radii below, the larger disc is below the smaller one at no more than 7 of 100 scales, by up to a bit,
# most of them near the centre, where a level is a handful of pixels. Radii that are nearer to each other cross more
# often: 160 and 192 at 12 scales. Among the smallest discs the order is another, since what their outline looks like
# depends on the radius: they differ by less than one step of the staircase.

growing = mean.diff() > 0
assert growing[RADII.index(10) :].all()
falls = [RADII[i + 1] for i in (~growing).nonzero().flatten().tolist()]
print("simpler than the next smaller one: radius", falls)
assert falls == [3, 4, 5, 7, 8, 10]
crossings = {}
for small, large in combinations((16, 32, 64, 96, 128, 192, 256), 2):
    difference = profiles[large].values - profiles[small].values
    crossings[small, large] = int((difference < 0).sum())
    assert float(difference.min()) > -1
print("scales of 100 at which the larger disc is the simpler one:", {k: v for k, v in crossings.items() if v})
assert max(crossings.values()) == 7
assert int((profiles[192].values < profiles[160].values).sum()) == 12

# %%
# **The peak is close to 5** for radii from 128 (4.78) to 192 (5.16); it is 4.03 at radius 64, and goes on rising, to
# 5.87 at 512. The paper does not say how large its discs were. **Radius 64 is above 3 bits on 74 % of its scales**;
# larger discs have more, and below radius 32 there are none.

print("radius      D   mean   peak (bits)   at scale   above 3 bits")
for radius in (8, 16, 32, 64, 96, 128, 192, 256, 512):
    i, (value, scale) = RADII.index(radius), profiles[radius].peak()
    print(f"{radius:6} {int(profiles[radius].radius):6} {mean[i]:6.3f} {value:8.3f} {scale:13.2f} {above[i]:12.1%}")
peaks = [round(float(peak[RADII.index(radius)]), 2) for radius in (64, 128, 192, 256, 512)]
assert peaks == [4.03, 4.78, 5.16, 5.43, 5.87]
assert [round(float(above[RADII.index(radius)]), 3) for radius in (32, 64, 128)] == [0.087, 0.739, 0.857]
assert above[: RADII.index(32)].max() == 0

# %%
# **The limit of small radii**: the disc of radius 1 is a cross, and zero. From radius 2 on the complexity is above
# zero, and up to radius 8 its mean is below one bit.

cross = shapes.disc(1)
print(cross.int())
assert cross.int().tolist() == [[0, 1, 0], [1, 1, 1], [0, 1, 0]]
assert float(torchlinf.complexity(cross, spatial_ndim=2)) == 0
assert 0 < mean[: RADII.index(8) + 1].min() <= mean[: RADII.index(8) + 1].max() < 1
