"""
5. Cubes with appendages
========================

The measure has one definition for all dimensions: in a volume the block is of 27 voxels, and the simplest shape a cube.
The paper puts smaller cubes of side 16 on one to six faces of a cube of side 64, ten shapes in all. Where the number
leaves a choice, a name with *a* prefers opposite faces, and one with *b* adjacent faces. It says that the complexity of
the cube is zero, that it increases with the number of appendages, and that all are zero above the scale 16/64, in
agreement with the results in two dimensions.
"""

# %%
# A cube of side 64 and the nine ways, up to rotation, to put cubes of side 16 on its faces. Each is drawn as what it is
# made of, a few boxes, from behind to the front.

from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Polygon

import torchlinf
from torchlinf import plot, shapes

SIDE, SMALL = 64, 16

# The faces that come first: in opposite pairs, or around a corner.
OPPOSITE = ("left", "right", "top", "bottom", "front", "back")
ADJACENT = ("left", "top", "front", "right", "bottom", "back")
family = shapes.cube_family(SIDE, SMALL)
NAMES = {name: "S" + name.replace(" opposite", "a").replace(" adjacent", "b") for name in family}  # as in the paper

# The directions of the faces as right, down and to the back, and how much white is in those that are seen.
DIRECTIONS = {"left": (-1, 0, 0), "right": (1, 0, 0), "top": (0, -1, 0), "bottom": (0, 1, 0), "front": (0, 0, -1)}
DIRECTIONS["back"] = (0, 0, 1)
SEEN = {"top": 0.7, "right": 0.1, "front": 0.45}


def box(ax: Axes, centre: np.ndarray, half: float, color: str) -> None:
    """Draw the three faces of a box that are seen, in parallel projection, each in its own tint."""
    for face, white in SEEN.items():
        normal = np.array(DIRECTIONS[face])
        first, second = (np.roll(abs(normal), turn) for turn in (1, 2))
        corners = [centre + half * (normal + i * first + j * second) for i, j in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
        flat = [(x + 0.5 * z, y - 0.4 * z) for x, y, z in corners]
        tint = white + (1 - white) * np.array(to_rgb(color))
        ax.add_patch(Polygon(flat, facecolor=tint, edgecolor="#222222", linewidth=0.6, joinstyle="round"))


def draw(ax: Axes, faces: tuple[str, ...], color: str) -> None:
    """Draw the cube with smaller cubes on these faces: first those behind it, then the cube, then those in front."""
    for hidden in (True, False):
        for face in faces:
            if (face not in SEEN) == hidden:
                box(ax, (SIDE + SMALL) / 2 * np.array(DIRECTIONS[face]), SMALL / 2, color)
        if hidden:
            box(ax, np.zeros(3), SIDE / 2, color)
    ax.set(xlim=(-66, 66), ylim=(62, -62), aspect="equal")
    ax.set_axis_off()


fig, axes = plt.subplots(2, 5, figsize=(8, 4.3), layout="constrained")
fig.get_layout_engine().set(h_pad=0.08)
for ax, name in zip(axes.flat, family, strict=True):
    number, *way = name.split()
    faces = (ADJACENT if way == ["adjacent"] else OPPOSITE)[: int(number)]
    draw(ax, faces, plot.COLOURS[int(number)])
    value = float(torchlinf.complexity(family[name], high=0.25, spatial_ndim=3))
    ax.set_title(f"{NAMES[name]}\n{value:.2f} bits", fontsize=10)
fig.supxlabel("above each: the number of appendages, and the mean complexity over the scales (0, 1/4]", fontsize=10)
plt.show()

# %%
# The profiles over the scales (0, 0.3], as in the paper; opposite faces with a wide line and adjacent ones with a thin
# one on top.

profiles = {name: torchlinf.complexity_profile(mask, spatial_ndim=3) for name, mask in family.items()}
fig, ax = plt.subplots(figsize=(8, 3.4), layout="constrained")
for name, profile in profiles.items():
    thin = name.endswith("adjacent")
    color = "#222222" if thin else plot.COLOURS[int(name[0])]
    plot.profile(profile, label=NAMES[name], color=color, ax=ax)
    ax.patches[-1].set_linewidth(1 if thin else 4)
ax.axvline(0.25, color="#555555", linestyle=":", linewidth=1)
ax.text(0.25, 1.0, " 1/4", transform=ax.get_xaxis_transform(), va="top", color="#555555")
ax.set_xlim(0, 0.3)
handles, names = ax.get_legend_handles_labels()
ax.legend(handles[::-1], names[::-1], title="appendages", frameon=False, loc="upper right", ncols=2)
plt.show()

# %%
# What the exact solution says: **all of it holds.** Everything is exactly zero above 1/4. Each appendage adds, a little
# less than the one before. The paper has no number for *a* against *b*; here they are equal, level by level.

print("faces          mean over (0, 1/4]   over (1/4, 1]   (bits)")
for name, profile in profiles.items():
    print(f"{NAMES[name]:12} {float(profile.mean(0, 0.25)):14.5f} {float(profile.mean(0.25, 1)):17.5f}")
    assert profile.radius == SIDE // 2
    assert (profile.levels()[SIDE // 8 :] == 0).all()
for number in (2, 3, 4):
    assert (profiles[f"{number} opposite"].levels() == profiles[f"{number} adjacent"].levels()).all()
ladder = [
    profiles[name].levels()[: SIDE // 8] for name in ("0", "1", "2 opposite", "3 opposite", "4 opposite", "5", "6")
]
means = [round(float(levels.mean()), 5) for levels in ladder]
assert means == [0.0, 0.28311, 0.49757, 0.68159, 0.84437, 0.99070, 1.12364]
for fewer, more in pairwise(ladder):
    assert (fewer < more).all(), "more complex at every scale up to 1/4"
steps = np.diff(means)
assert (np.diff(steps) < 0).all(), "each adds less than the one before"
