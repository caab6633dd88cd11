"""
Coins and nuclei: one row for each object of a label map
========================================================

A segmentation gives a label map: an integer for every pixel, 0 for the background. ``labels.complexity_table`` makes a
table of it, one row for each object, beside any property that scikit-image's ``regionprops_table`` knows.
"""

# %%
# The coins of scikit-image, segmented by its watershed. Uneven light leaves some of them ragged, and those are to be
# found without looking.

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from numpy.typing import NDArray
from scipy import ndimage
from skimage import color, data, feature, filters, measure, morphology, segmentation

from torchlinf.labels import complexity_table

coins = data.coins()
markers = np.where(coins < 30, 1, np.where(coins > 150, 2, 0))
filled = ndimage.binary_fill_holes(segmentation.watershed(filters.sobel(coins), markers) == 2)
coin_map = measure.label(morphology.opening(filled, morphology.disk(2)))

# %%
# Two windows of scales from one solve: all scales, and those up to a quarter of the radius, where the rim is. The
# dictionary of columns is what ``pandas.DataFrame`` takes.

windows = {"complexity": (0.0, 1.0), "rim": (0.0, 0.25)}
table = complexity_table(coin_map, windows=windows, properties=["area", "solidity", "centroid"])
print("label  area  solidity  radius  complexity   rim")
for i in np.argsort(table["complexity"])[[0, 1, 2, -3, -2, -1]]:
    print(
        f"{table['label'][i]:5} {table['area'][i]:5.0f} {table['solidity'][i]:9.3f} {table['radius'][i]:7} "
        f"{table['complexity'][i]:11.2f} {table['rim'][i]:5.2f}"
    )

# %%
# Every object in the colour of its number. Of digital discs the larger ones have the higher complexity, since there are
# more levels to depart from a square on; so the three numbers printed are two of the largest coins, and a small one
# that is nicked. What touches the border of the map is flagged in the table, and hatched here: part of
# it may be cut off, and a straight cut makes a shape simpler or more complex than it is.


def paint(
    ax: Axes, image: NDArray[np.uint8], label_map: NDArray[np.int64], table: dict[str, NDArray]
) -> ScalarMappable:
    """Draw the objects over their image."""
    values = np.full(label_map.max() + 1, np.nan)
    values[table["label"]] = table["complexity"]
    ax.imshow(image, cmap="gray")
    drawn = ax.imshow(np.ma.masked_invalid(values[label_map]), cmap="viridis", alpha=0.75, interpolation="nearest")
    cut = np.isin(label_map, table["label"][table["touches_border"]])
    if cut.any():
        ax.contourf(cut, levels=[0.5, 1.5], colors="none", hatches=["////"])
    ax.contour(label_map > 0, levels=[0.5], colors="white", linewidths=0.5)
    ax.set(xlabel="column (pixels)", ylabel="row (pixels)")
    return drawn


fig, ax = plt.subplots(figsize=(7, 5), layout="constrained")
fig.colorbar(paint(ax, coins, coin_map, table), ax=ax, label="complexity (bits)", shrink=0.9)
for i in np.argsort(table["complexity"])[-3:]:
    ax.annotate(f"{table['complexity'][i]:.1f}", (table["centroid-1"][i], table["centroid-0"][i]), color="white",
                ha="center", va="center", fontsize=9, weight="bold")  # fmt: skip
plt.show()

# %%
# Nuclei in a stained tissue: the blue dye is unmixed from the brown one, thresholded, and cut into nuclei by the
# watershed of the distance.

tissue = data.immunohistochemistry()
blue = filters.gaussian(color.rgb2hed(tissue)[..., 0], 1.5)
mask = morphology.opening(blue > filters.threshold_otsu(blue), morphology.disk(3))
depth = ndimage.gaussian_filter(ndimage.distance_transform_edt(mask), 1.5)
seeds = feature.peak_local_max(depth, min_distance=7, labels=measure.label(mask))
seed_map = np.zeros(mask.shape, dtype=int)
seed_map[tuple(seeds.T)] = np.arange(1, len(seeds) + 1)
nucleus_map = segmentation.watershed(-depth, seed_map, mask=mask)
nuclei = complexity_table(nucleus_map, windows=windows, properties=["area", "solidity"])
print(f"{len(nuclei['label'])} nuclei, {nuclei['touches_border'].sum()} of them at the border")

# %%
# Solidity, the share that a shape fills of its convex hull, sees dents. The complexity sees every departure from a
# square, and a disc has some: the two are related, but neither tells the other. Objects of the highest complexity are
# clumps that the watershed failed to cut into nuclei.

fig, (left, right) = plt.subplots(1, 2, figsize=(11, 5), layout="constrained", width_ratios=[1.15, 1])
fig.colorbar(paint(left, tissue, nucleus_map, nuclei), ax=left, label="complexity (bits)", shrink=0.9)
whole = ~nuclei["touches_border"] & (nuclei["radius"] >= 5)
for chosen, look in ((whole, {"color": "#332288"}), (nuclei["touches_border"], {"color": "#999933", "marker": "x"})):
    right.scatter(nuclei["solidity"][chosen], nuclei["complexity"][chosen], s=18, **look)
right.legend(["whole, radius 5 pixels or more", "at the border"], frameon=False)
right.set(xlabel="solidity (share of the convex hull)", ylabel="complexity (bits)")
right.spines[["top", "right"]].set_visible(False)
plt.show()
