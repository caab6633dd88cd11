"""
6. Twelve shapes, ordered like a dictionary
===========================================

A square with appendages that differ in three ways: one, two or four of them; narrow or wide, 1/4 or 5/8 of the side;
and in the middle of a side or flush with a corner. The paper says that over (0, 1/4] the order is that of a dictionary:
by their number first, and between equals by width. Over (1/4, 5/8] all shapes with narrow appendages have the same
complexity, and above it all twelve have. The order of the two positions is shown in a figure and not described.
"""

# %%
# The twelve, with level lines of *f*: a body of 128 pixels, appendages 32 or 80 wide and 32 deep.

import matplotlib.pyplot as plt
import numpy as np

import torchlinf
from torchlinf import plot, shapes

family = shapes.appendage_dictionary()
looks = {"1 x 32": 3, "1 x 80": 0, "2 x 32": 7, "2 x 80": 2, "4 x 32": 1, "4 x 80": 4}
colors = {name: plot.COLOURS[looks[name.rsplit(" ", 1)[0]]] for name in family}
order = sorted(family, key=lambda name: [int(x) for x in name.split()[0:3:2]] + [name])

fig, axes = plt.subplots(2, 6, figsize=(8, 3.6), layout="constrained")
fig.get_layout_engine().set(h_pad=0.08)
for ax, name in zip(axes.T.flat, order, strict=True):
    mask = family[name]
    plot.levels(mask, color=colors[name], ax=ax)
    height, width = mask.shape
    ax.set(xlim=(width / 2 - 100, width / 2 + 100), ylim=(height / 2 + 100, height / 2 - 100))
    ax.set_title(name.replace(" centred", "\ncentred").replace(" flush", "\nflush"), fontsize=10)
    ax.set_axis_off()
fig.supxlabel("the names: number of appendages x their width (pixels), and position", fontsize=10)
plt.show()

# %%
# Complexity against scale: wide lines for the centred ones, thin dark ones on top for the flush ones. The dotted lines
# part the three windows.

profiles = {name: torchlinf.complexity_profile(family[name], spatial_ndim=2) for name in order}
fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for name in order:
    flush = name.endswith("flush")
    plot.profile(profiles[name], label=None if flush else name, color="#222222" if flush else colors[name], ax=ax)
    ax.patches[-1].set_linewidth(0.8 if flush else 4)
for label, cutoff in {"1/4": 0.25, "5/8": 0.625}.items():
    ax.axvline(cutoff, color="#555555", linestyle=":", linewidth=1)
    ax.text(cutoff, 1.0, f" {label}", transform=ax.get_xaxis_transform(), va="top", color="#555555")
handles, names = ax.get_legend_handles_labels()
ax.legend(handles[::-1], names[::-1], frameon=False, loc="upper right")
plt.show()

# %%
# The mean over each window, the shapes sorted as in a dictionary.

WINDOWS = {"(0, 1/4]": (0.0, 0.25), "(1/4, 5/8]": (0.25, 0.625), "(5/8, 1]": (0.625, 1.0)}
means = {
    window: np.array([round(float(profile.mean(*ends)), 5) for profile in profiles.values()])
    for window, ends in WINDOWS.items()
}
fig, axes = plt.subplots(1, 3, figsize=(8, 3.8), layout="constrained", sharey=True, sharex=True)
for ax, (window, values) in zip(axes, means.items(), strict=True):
    ax.barh(order, values, color=[colors[name] for name in order])
    ax.set(title=window, xlim=(0, 4.7))
    for place, value in enumerate(values):
        ax.text(value + 0.05, place, f"{value:.2f}" if value else "0", va="center", fontsize=8)
    ax.spines[["top", "right"]].set_visible(False)
axes[0].invert_yaxis()
axes[1].set_xlabel("mean complexity over the window of scales (bits)")
plt.show()

# %%
# What the exact solution says: **the order holds**, in all three windows. On sets of equal distance, which these
# pictures show, the position makes no difference: each flush shape has the complexity of its centred twin, at every
# scale. On rims (the last table) it comes third, flush before centred. The page on four appendages looks into that.

fine, coarse, top = means.values()
number, width = (np.array([int(name.split()[place]) for name in order]) for place in (0, 2))
for name in order:
    if name.endswith("flush"):
        twin = profiles[name.replace("flush", "centred")]
        assert (profiles[name].levels() == twin.levels()).all(), "position makes no difference"
assert (np.diff(fine[::2]) > 0).all(), "(0, 1/4]: by number, then by width"
assert fine[::2].tolist() == [1.31666, 1.6055, 2.08479, 2.40499, 3.01552, 3.16434]
assert (coarse[width == 32] == 0).all(), "(1/4, 5/8]: the narrow ones are as simple as a square"
assert coarse[width == 80][::2].tolist() == [1.89459, 2.81061, 3.7276], "and the wide ones sorted by number"
assert (top == 0).all(), "(5/8, 1]: all are equal"
print("shape                 " + "    ".join(WINDOWS))
for name, *values in zip(order, *means.values(), strict=True):
    print(f"{name:18}" + "".join(f"{value:12.5f}" for value in values))

# %%
# The order is one of means. At the smallest scales two or four narrow appendages count for more than as many wide ones.

for n in (1, 2, 4):
    narrow, wide = (profiles[f"{n} x {w} centred"].levels()[:16] for w in (32, 80))
    above = (narrow > wide).nonzero().flatten() + 1
    assert above.tolist() == list(range(1, {1: 0, 2: 2, 4: 5}[n] + 1))
    print(f"{n} x 32 above {n} x 80: " + (f"at scales up to {len(above) / 64:.2f}" if len(above) else "nowhere"))

# %%
# On rims, ``levels="rim"``, all twelve differ over (0, 1/4], and the order is that of a dictionary in all three
# letters.

rims = {name: torchlinf.complexity_profile(family[name], levels="rim", spatial_ndim=2) for name in order}
words = [f"{n} x {w} {place}" for n in (1, 2, 4) for w in (32, 80) for place in ("flush", "centred")]
fine = [round(float(rims[word].mean(0.0, 0.25)), 3) for word in words]
for word, value in zip(words, fine, strict=True):
    print(f"{word:18} {value:.3f} bits")
assert fine == [1.319, 1.321, 1.608, 1.610, 2.090, 2.096, 2.411, 2.416, 3.031, 3.040, 3.174, 3.180]
assert all(rims[f"{n} x 32 {place}"].mean(0.25, 1.0) == 0 for n in (1, 2, 4) for place in ("flush", "centred"))
assert all(profile.mean(0.625, 1.0) == 0 for profile in rims.values())
