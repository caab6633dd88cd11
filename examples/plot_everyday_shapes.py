"""
Everyday shapes: letters, leaves, islands, coins and nuclei in a row
====================================================================

What does the number say of shapes that people know? This page cuts letters and signs out of the fonts that matplotlib
brings along, grows leaves and islands from a few random numbers, takes coins, a nucleus, a cell and a horse from the
pictures of scikit-image, and ranks them. Nothing is downloaded.
"""

# %%
# Outlines become masks at a chosen *radius*, the largest chessboard distance to the outside. Small things have fewer
# levels and coarser stairs, so numbers compare best between shapes of like radius.

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from numpy.typing import NDArray
from scipy import ndimage
from skimage import color, data, draw, filters, measure, morphology, segmentation, transform
from torch import Tensor

import torchlinf
from torchlinf import plot, shapes
from torchlinf.order import dominance, incomparable_pairs

Outline = list[NDArray[np.float64]]  # closed polygons (n, 2) of x to the right and y upwards; a hole is one inside
RADIUS = 24


def rasterise(outline: Outline, size: float, degrees: float = 0.0) -> NDArray[np.bool_]:
    """Pixels inside of an outline of this height in pixels, turned counterclockwise."""
    height = np.ptp(np.concatenate(outline)[:, 1])
    cos, sin = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    scaled = [polygon @ np.array([[cos, sin], [-sin, cos]]) * size / height for polygon in outline]
    low, high = (getattr(np.concatenate(scaled), which)(axis=0) for which in ("min", "max"))
    frame = tuple(np.ceil(high - low).astype(int)[::-1] + 1)
    inside = np.zeros(frame, dtype=bool)
    for polygon in scaled:
        inside ^= draw.polygon2mask(frame, (polygon - low)[:, ::-1])
    return inside[::-1]


def radius_of(inside: NDArray[np.bool_]) -> int:
    """Largest distance to the outside in pixels."""
    return int(torchlinf.chessboard_distance(torch.from_numpy(inside.copy()), spatial_ndim=2).max())


def at_radius(outline: Outline, radius: int = RADIUS, degrees: float = 0.0) -> Tensor:
    """The outline as large as gives about this radius."""
    size = 300 * radius / radius_of(rasterise(outline, 300, degrees))
    return torch.from_numpy(rasterise(outline, size, degrees).copy())


# %%
# Letters and signs are paths of a font. A leaf is a width along its midrib, with lobes; an island is a circle whose
# radius has random waves, few and long ones or many short ones.


def glyph(text: str, font: str = "DejaVu Sans", **look: str) -> Outline:
    """Outline of a character."""
    return TextPath((0, 0), text, size=100, prop=FontProperties(family=font, **look)).to_polygons()


def leaf(lobes: int, depth: float) -> Outline:
    """A leaf that stands upright, with lobes on both sides."""
    along = np.linspace(0, 1, 400)
    half = 0.3 * np.sin(np.pi * along**0.8) * (1 - depth * np.cos(2 * np.pi * lobes * along)) + 0.012
    sides = np.concatenate([half, -half[::-1]]), np.concatenate([along, along[::-1]])
    return [np.stack(sides, axis=1)]


def island(decay: float, seed: int) -> Outline:
    """An island; waves of the coast fall off with this power of their number."""
    generator = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, 1500, endpoint=False)
    waves = np.arange(2, 60)
    strength, phase = 0.45 * generator.standard_normal(58) / waves**decay, generator.uniform(0, 2 * np.pi, 58)
    radius = np.exp((strength * np.cos(waves * angle[:, None] + phase)).sum(axis=1))
    return [np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)]


# %%
# Pictures are thresholded, and the largest piece is taken, or one that is round enough.


def piece(mask: NDArray[np.bool_], solidity: float = 0.0) -> Tensor:
    """The largest connected piece of at least this solidity, without holes, brought to the same radius."""
    regions = measure.regionprops(segmentation.clear_border(measure.label(mask)))
    largest = max((region for region in regions if region.solidity > solidity), key=lambda region: region.area)
    # The outline is made smooth between the pixels, of which a small piece has few.
    inside = ndimage.gaussian_filter(np.pad(ndimage.binary_fill_holes(largest.image), 4).astype(float), 1)
    factor = RADIUS / radius_of(inside > 0.5)
    return torch.from_numpy(transform.rescale(inside, factor, order=3, anti_aliasing=factor < 1) > 0.5)


coins, cell, tissue = data.coins(), data.cell(), data.immunohistochemistry()
blue = filters.gaussian(color.rgb2hed(tissue)[..., 0], 1.5)
nuclei = morphology.opening(blue > filters.threshold_otsu(blue), morphology.disk(4))
bright = morphology.opening(coins > filters.threshold_local(coins, 151, offset=-8), morphology.disk(1))

kinds = {
    "reference": {"square": shapes.square(2 * RADIUS), "disc": shapes.disc(1.41 * RADIUS)},
    "letters": {text: at_radius(glyph(text, weight="bold")) for text in "ILEOSg"},
    "signs": {name: at_radius(glyph(sign)) for name, sign in {"heart": "♥", "star": "★", "plane": "✈"}.items()},
    "leaves": {
        "plain leaf": at_radius(leaf(0, 0.0)),
        "wavy leaf": at_radius(leaf(5, 0.15)),
        "lobed leaf": at_radius(leaf(5, 0.45)),
    },
    "islands": {"smooth": at_radius(island(2.2, 1)), "rugged": at_radius(island(1.1, 1))},
    "from pictures": {
        "coin": piece(bright),
        "nucleus": piece(nuclei, solidity=0.95),
        "cell": piece(cell > filters.threshold_otsu(cell)),
        "horse": piece(~data.horse()),
    },
}
masks = {name: mask for members in kinds.values() for name, mask in members.items()}
color_of = {name: shade for members, shade in zip(kinds.values(), plot.COLOURS, strict=False) for name in members}
profiles = {name: torchlinf.complexity_profile(mask, spatial_ndim=2) for name, mask in masks.items()}

# %%
# All of them from the simplest on, with their complexity in bits and, below, their profiles.


def silhouette(ax: Axes, mask: Tensor, shade: str) -> None:
    """Draw a shape alone."""
    inside = np.pad(mask.numpy(), 2)
    ax.imshow(np.where(inside[..., None], to_rgb(shade), 1.0))
    ax.set(xticks=[], yticks=[], anchor="S")
    ax.spines[:].set_visible(False)


COLUMNS = 10
ranked = sorted(masks, key=lambda name: float(profiles[name].mean()))
fig = plt.figure(figsize=(9, 6.2), layout="constrained")
grid = fig.subplots(4, COLUMNS, gridspec_kw={"height_ratios": [1.2, 1, 1.2, 1]})
for i, name in enumerate(ranked):
    row, column = divmod(i, COLUMNS)
    above, below = grid[2 * row : 2 * row + 2, column]
    silhouette(above, masks[name], color_of[name])
    above.set_xlabel(f"{name}\n{float(profiles[name].mean()):.2f}", fontsize=8)
    plot.profile(profiles[name], color=color_of[name], ax=below)
    below.set(ylim=(-0.2, 8), yticks=[0, 4, 8], xticks=[0, 1], xlabel="", ylabel="")
    below.tick_params(labelsize=7)
    below.label_outer()
    below.set_xticklabels(["0", "1"])
for row in (1, 3):
    grid[row, 0].set_ylabel("bits", fontsize=8)
fig.supxlabel("scale t = d / D in each profile", fontsize=8)
handles = [plt.Rectangle((0, 0), 1, 1, color=shade) for shade in plot.COLOURS[: len(kinds)]]
fig.legend(handles, kinds, loc="outside upper center", ncols=len(kinds), frameon=False, fontsize=8)
plt.show()

# %%
# What the number says: how far a shape is from being made of one square. Straight strokes along the grid cost nothing
# but their joints (I, L, E); a curve, a slant or a taper costs at every scale (O, S, the heart). A rugged coast is no
# more complex than a plain leaf: its detail ends at small scales, and below it lies a compact form. The profiles show
# which it is.
#
# What it does not say: whether a shape is hard to recognise, to draw or to put into words. A disc is not the simplest
# shape, and O is more complex than E. And of two numbers, here the means over low scales and over all, one may
# contradict the other:

order = dominance(profiles)
pairs = incomparable_pairs(order)
print(f"{len(pairs)} of {len(order) * (len(order) - 1) // 2} pairs cannot be compared, among them")
for a, b in sorted(pairs, key=lambda pair: -np.ptp([order.nodes[node]["indicators"][0] for node in pair]))[:4]:
    for node in (a, b):
        low, overall = order.nodes[node]["indicators"]
        print(
            f"  {' = '.join(node):10} {low:.2f} at low scales, {overall:.2f} over all", end=";" if node == a else "\n"
        )

# %%
# The alphabet in five fonts: each letter stands at its complexity. Upright strokes of one width are simple, serifs and
# changing strokes cost more, and slanted letters cost most. The bar is the mean.

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
fonts: dict[str, tuple[str, dict[str, str]]] = {
    "sans, bold": ("DejaVu Sans", {"weight": "bold"}),
    "typewriter": ("DejaVu Sans Mono", {}),
    "serif": ("DejaVu Serif", {}),
    "STIX": ("STIXGeneral", {}),
    "STIX italic": ("STIXGeneral", {"style": "italic"}),
}
shades = [plot.COLOURS[i] for i in (0, 1, 2, 6, 4)]  # those that are dark enough for letters
fig, ax = plt.subplots(figsize=(8, 5), layout="constrained")
for row, (font, look) in enumerate(fonts.values()):
    values = [float(torchlinf.complexity(at_radius(glyph(text, font, **look), 12), spatial_ndim=2)) for text in LETTERS]
    for i, (text, value) in enumerate(sorted(zip(LETTERS, values, strict=True), key=lambda pair: pair[1])):
        ax.text(value, row + (i % 4 - 1.5) * 0.2, text, ha="center", va="center", fontsize=10, family=font,
                color=shades[row], **look)  # fmt: skip
    ax.plot([np.mean(values)] * 2, [row - 0.4, row + 0.4], color="#555555", linewidth=1)
ax.set(yticks=range(len(fonts)), ylim=(len(fonts) - 0.4, -0.6), xlim=(-0.2, 6), xlabel="complexity (bits)")
ax.set_yticklabels(fonts)
ax.spines[["top", "right"]].set_visible(False)
plt.show()

# %%
# The number belongs to a shape *on its grid*. Turned shapes are other shapes: E leaves the grid at once and comes back
# at a right angle, but for strokes that are rounded to another number of pixels; S changes little; the heart is
# simplest where its straight sides lie along the grid. And a larger picture of the same thing has more levels: what is
# straight along the grid stays where it is, while the stairs of a curve become finer and their entropy grows. So
# compare numbers at one orientation and at like radius.

fig, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", sharey=True)
angles, radii = range(0, 91, 10), [6, 9, 12, 18, 24, 36, 48]
seen = {"E": glyph("E", weight="bold"), "S": glyph("S", weight="bold"), "heart": glyph("♥"), "rugged": island(1.1, 1)}
for (name, outline), shade, marker in zip(seen.items(), plot.COLOURS, "osD^", strict=False):
    turned = [float(torchlinf.complexity(at_radius(outline, 16, angle), spatial_ndim=2)) for angle in angles]
    larger = [float(torchlinf.complexity(at_radius(outline, radius), spatial_ndim=2)) for radius in radii]
    for ax, at, values in ((left, angles, turned), (right, radii, larger)):
        ax.plot(at, values, "-", marker=marker, markersize=4, color=shade, label=name)
left.set(
    xlabel="turned by (degrees), at radius 16", ylabel="complexity (bits)", ylim=(0, None), xticks=range(0, 91, 15)
)
right.set(xlabel="radius D of the shape (pixels)", xscale="log")
right.set_xticks(radii, map(str, radii))
right.minorticks_off()
right.legend(frameon=False, fontsize=8)
for ax in (left, right):
    ax.spines[["top", "right"]].set_visible(False)
plt.show()
