"""
Footprints of a town: the simplest and the most complex houses
==============================================================

``polygons.complexity_table`` measures outlines, one row for each. Every outline is drawn anew in the frame of its own
smallest rectangle, so that it does not matter how the street runs. Here it is compared with measures of urban
morphology from momepy, on a town that this page makes up. With ``TORCHLINF_FOOTPRINTS`` set to a file of outlines the
page shows those.
"""

# %%
# A town of bent streets: boxes, houses with wings, courtyards, crosses and staircases, and a few round ones.

import os
import warnings

import geopandas
import matplotlib.pyplot as plt
import momepy
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from scipy.stats import rankdata, spearmanr
from shapely import Polygon, affinity, box

from torchlinf.polygons import complexity_table

generator = np.random.default_rng(7)


def house(form: str) -> Polygon:
    """A house of a form, about 12 metres long, with its middle in the origin."""
    length, depth, wing, width = generator.uniform((9, 7, 3, 3), (18, 11, 8, 6))
    main = box(0, 0, length, depth)
    parts = {
        "box": [],
        "L": [box(0, -wing, width, 0)],
        "T": [box(length / 2 - width / 2, -wing, length / 2 + width / 2, 0)],
        "U": [box(0, -wing, width, 0), box(length - width, -wing, length, 0)],
        "cross": [box(length / 2 - width / 2, -wing, length / 2 + width / 2, depth + wing)],
        "bays": [box(x, -1, x + 2, 0) for x in np.arange(1, length - 2, 4)],
        "stairs": [box(0, -2.5 * step, 2.5 * (4 - step), depth) for step in range(1, 4)],
        "oblique": [affinity.rotate(box(0, -wing, width, depth), 35, origin=(0, 0))],
        "tower": [shapely.Point(length, 0).buffer(width)],
    }
    if form == "round":
        shape = shapely.Point(0, 0).buffer(depth / 1.5)
    elif form == "courtyard":
        shape = box(0, 0, 20, 10 + wing).difference(box(width, width, 20 - width, 10 + wing - width))
    else:
        shape = shapely.union_all([main, *parts[form]])
    return affinity.translate(shape, -shape.centroid.x, -shape.centroid.y)


FORMS = {
    "box": 9, "L": 5, "T": 3, "U": 3, "cross": 1, "bays": 2, "stairs": 2, "oblique": 2, "tower": 2, "round": 1,
    "courtyard": 2,
}  # fmt: skip


def town(columns: int = 16, rows: int = 12) -> geopandas.GeoDataFrame:
    """Houses in rows, which turn as the streets do."""
    share = np.array(list(FORMS.values())) / sum(FORMS.values())
    forms, shapes = [], []
    for x in np.arange(columns) * 27.0:
        for y in np.arange(rows) * 27.0:
            forms.append(str(generator.choice(list(FORMS), p=share)))
            angle = 35 * np.sin(x / 150) + 25 * np.cos(y / 90)
            at = np.array((x, y + 35 * np.sin(x / 150))) + generator.uniform(-1, 1, 2)
            shapes.append(affinity.translate(affinity.rotate(house(forms[-1]), angle), *at))
    return geopandas.GeoDataFrame({"form": forms}, geometry=shapes)


file = os.environ.get("TORCHLINF_FOOTPRINTS")
if file is None:
    houses = town()
else:
    houses = geopandas.read_file(file)
    if houses.crs is not None and houses.crs.is_geographic:
        houses = houses.to_crs(houses.estimate_utm_crs())
    houses = houses[houses.is_valid & ~houses.is_empty]
    # The two thousand that are nearest to the middle of the town.
    away = houses.centroid.distance(shapely.union_all(houses.centroid.values).centroid)
    houses = houses.loc[away.nsmallest(2000).index]
    houses = houses.assign(geometry=[shapely.get_parts(one)[0] for one in houses.geometry], form="house")
houses = houses.reset_index(drop=True)
print(len(houses), "houses")

# %%
# The table, on the grid of the map and in the frame of each house. A pixel is a quarter of a metre. The dictionary of
# columns is what ``pandas.DataFrame`` takes; here two of them become columns of the town.

table = complexity_table(houses, resolution=0.25, orientation="own")
houses["complexity"], houses["angle"] = table["complexity"], table["angle"]
houses["on the grid"] = complexity_table(houses, resolution=0.25)["complexity"]
# Real data hold slivers and sheds. In a drawing with a radius below 5 pixels there are too few levels to say much.
houses = houses[table["radius"] >= 5].reset_index(drop=True)
print(houses.groupby("form")[["on the grid", "complexity"]].median().sort_values("complexity").round(2).to_string())

# %%
# The town in the colours of both. Along the axes of the map the number says how the street runs: a box has 0 bits where
# the street runs along the axes, and up to 3 where it does not. In its own frame a box has exactly 0 everywhere.

limit = houses["on the grid"].quantile(0.98)
fig, axes = plt.subplots(1, 2, figsize=(11, 6.2), layout="constrained", sharex=True, sharey=True)
for ax, column in zip(axes, ("on the grid", "complexity"), strict=True):
    houses.plot(column, ax=ax, cmap="viridis", vmin=0, vmax=limit)
    ax.set_title({"on the grid": "along the axes of the map", "complexity": "each in its own frame"}[column])
    ax.set(xlabel="metres", ylabel="metres" if ax is axes[0] else "", aspect="equal")
    ax.spines[["top", "right"]].set_visible(False)
mapped = plt.cm.ScalarMappable(plt.Normalize(0, limit), "viridis")
fig.colorbar(mapped, ax=axes, label="complexity (bits)", shrink=0.7, extend="max", location="bottom", aspect=40)
plt.show()

# %%
# The ten simplest and the ten most complex. All boxes have 0 bits, so of the simple ones those are shown that do not
# fill their rectangle. Each house is drawn in the frame that it was measured in, to a scale of its own.

unfilled = 1 - momepy.rectangularity(houses)


def show(ax: Axes, i: int, title: str, colour: str) -> None:
    """Draw a house in its own frame."""
    shape = affinity.rotate(houses.geometry[i], houses["angle"][i])
    west, south, east, north = shape.bounds
    side = max(east - west, north - south) * 1.1
    # GeoSeries.plot would do, but draws the whole figure anew for every house.
    rings = shapely.get_rings(shapely.get_parts(shapely.orient_polygons(shape)))
    outline = Path.make_compound_path(*(Path(shapely.get_coordinates(ring), closed=True) for ring in rings))
    ax.add_patch(PathPatch(outline, facecolor=colour, edgecolor="black", linewidth=0.8))
    ax.set(
        aspect="equal",
        xlim=((west + east - side) / 2, (west + east + side) / 2),
        ylim=((south + north - side) / 2, (south + north + side) / 2),
    )
    ax.set_axis_off()
    ax.set_title(title, fontsize=9)


order = houses["complexity"].sort_values(kind="stable").index
simplest, most_complex = [i for i in order if unfilled[i] > 0.01][:10], order[:-11:-1]
fig, axes = plt.subplots(4, 5, figsize=(9, 7.6), layout="constrained")
for ax, i, colour in zip(axes.flat, [*simplest, *most_complex], [*["#9ecae1"] * 10, *["#fdae6b"] * 10], strict=True):
    show(ax, i, f"{houses['complexity'][i]:.2f} bits", colour)
plt.show()

# %%
# Measures of momepy beside: how much of its smallest rectangle a house fills, the same with the circumference
# (equivalent rectangular index), how far its corners are from right angles on average, and how many corners it has.
# Spearman's rank correlation stands above each. A round house has no corners, so its squareness is left out.

with warnings.catch_warnings():
    warnings.filterwarnings("ignore", module="momepy")  # of round houses, which have no corners
    others = {
        "unfilled share": unfilled,
        "1 - rectangular index": 1 - momepy.equivalent_rectangular_index(houses),
        "degrees off square": momepy.squareness(houses, eps=10),
        "corners": momepy.corners(houses, eps=10),
    }
fig, axes = plt.subplots(2, 2, figsize=(9, 7), layout="constrained", sharey=True)
forms = list(dict.fromkeys(houses["form"]))
for ax, (name, values) in zip(axes.flat, others.items(), strict=True):
    for k, form in enumerate(forms):
        chosen = houses["form"] == form
        marker, colour = "osv^DPX<>*h"[k % 11], plt.cm.tab20(k % 20)
        ax.scatter(
            values[chosen], houses["complexity"][chosen], s=22, marker=marker, color=colour, alpha=0.8, label=form
        )
    rank = spearmanr(values, houses["complexity"], nan_policy="omit").statistic
    ax.set(xlabel=name, ylabel="complexity (bits)" if ax in axes[:, 0] else "")
    ax.set_title(f"rank correlation {rank:.2f}", fontsize=10)
    ax.spines[["top", "right"]].set_visible(False)
if len(forms) > 1:
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False)
plt.show()

# %%
# What each sees that the other does not: two houses that hardly differ in one of them, and most in the other.


def apart(same: np.ndarray, other: np.ndarray) -> tuple[int, int]:
    """Two houses within a fiftieth of each other in the ranks of one number, as far apart as can be in the other."""
    same, other = (rankdata(np.round(values, 6), nan_policy="omit") / len(values) for values in (same, other))
    far = np.where(np.abs(same[:, None] - same) <= 0.02, other[None, :] - other[:, None], -1)
    low, high = np.unravel_index(np.nanargmax(far), far.shape)
    return int(low), int(high)


fig = plt.figure(figsize=(9, 9.6), layout="constrained")
complexities = houses["complexity"].to_numpy()
halves = fig.subfigures(1, 2, wspace=0.06)
for half, title, colour in zip(
    halves, ("alike in the other measure, apart in bits", "alike in bits, apart in the other measure"),
    ("#9ecae1", "#fdae6b"), strict=True,
):  # fmt: skip
    half.suptitle(title, fontsize=10)
    for row, (name, values) in zip(half.subplots(4, 2), others.items(), strict=True):
        known = values.to_numpy()
        pair = apart(known, complexities) if half is halves[0] else apart(complexities, known)
        for ax, i in zip(row, pair, strict=True):
            show(ax, i, f"{complexities[i]:.2f} bits\n{name} {round(known[i], 2) + 0:g}", colour)
plt.show()

# %%
# The unfilled share counts a courtyard as empty; to the complexity, walls of one thickness are as simple as a box. The
# rectangular index compares area and circumference with those of the rectangle; a disc beats its rectangle there, and
# stairs of any number of steps have the circumference of their rectangle. Right angles alone do not make a form simple,
# and every bay adds four corners, however small it is: in bits it counts at the finest scales alone. The other way
# round, the complexity says nothing of proportions: all boxes have 0 bits, long or square. For that,
# ``momepy.elongation`` is the measure.
#
# One courtyard of the made-up town has 1.6 bits, where the others have 0. Its walls of 5.1 metres are 20 and 21 pixels
# thick, as the grid falls, and two thicknesses are two values on every level. So ask whether a number holds at another
# resolution, too.
