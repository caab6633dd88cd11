"""
Decision regions of classifiers
===============================

What a classifier gives to each class is a shape, and ``torchlinf.regions`` measures it: on a grid over one to four
features, or on planes through three data points where there are more. This page asks what the number says, of
classifiers from linear to 1-nearest-neighbour, and of networks early and late in training.

Run with ``--full`` for more planes and longer training.
"""

# %%
# Two moons, with noise. Every classifier is asked on the same grid, and on five more that are the same grid turned
# about its centre: ``decision_region_summary`` has the mean of them and its standard error.

import copy
import sys

import matplotlib.pyplot as plt
import numpy as np
import torch
from sklearn.datasets import load_digits, make_moons
from sklearn.linear_model import LogisticRegression
from sklearn.neighbors import KNeighborsClassifier
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier
from torch import Tensor, nn

from torchlinf import plot
from torchlinf.regions import (
    bounds_around,
    decision_plane,
    decision_plane_complexity,
    decision_region_complexity,
    decision_region_summary,
)

FULL = "--full" in sys.argv
PLANES, STEPS = (100, 4000) if FULL else (12, 600)
X, y = make_moons(200, noise=0.3, random_state=0)
bounds = bounds_around(X, eps=0.5)

classifiers = {
    "one threshold": DecisionTreeClassifier(max_depth=1, random_state=0),
    "tree of depth 3": DecisionTreeClassifier(max_depth=3, random_state=0),
    "full tree": DecisionTreeClassifier(random_state=0),
    "linear": LogisticRegression(),
    "kernel, wide": SVC(gamma=1.0),
    "kernel, narrow": SVC(gamma=50.0, C=10.0),
    "15 neighbours": KNeighborsClassifier(15),
    "1 neighbour": KNeighborsClassifier(1),
}
found = {
    name: decision_region_summary(classifier.fit(X, y), bounds, resolution=96)
    for name, classifier in classifiers.items()
}

print("                 grid   mean of six rotations (bits)")
for name, summary in found.items():
    grid = float(summary.regions[0].overall())
    print(f"{name:16} {grid:.2f}   {float(summary.overall()):.2f} ± {float(summary.overall_standard_error()):.2f}")

# %%
# What the number on one grid says: how far the regions are from boxes along the features. A threshold has 0, trees
# little. A straight line at a slant is *not* simple in this sense. The mean of rotations takes that preference away:
# the threshold and the line are 0.5 bits apart, not 4, which is less than their standard errors explain. The mean still
# says how far the regions are from boxes, now along many directions. It is neither the number of parameters, nor how
# much a curve wiggles, nor how well a classifier fits. :doc:`A study </regions_study>` has what it foretells on real
# data.


def scatter(ax: plt.Axes) -> None:
    """Draw the data over the regions."""
    for i in (0, 1):
        ax.scatter(*X[y == i].T, s=3, color=plot.COLOURS[i], linewidths=0)


fig, axes = plt.subplots(2, 4, figsize=(10, 5.2), layout="constrained", sharex=True, sharey=True)
for ax, (name, summary) in zip(axes.flat, found.items(), strict=True):
    plot.decision_regions(summary.regions[0], ax=ax)
    scatter(ax)
    ax.get_legend().remove()
    value, error = float(summary.overall()), float(summary.overall_standard_error())
    ax.set(title=f"{name}\n{value:.2f} ± {error:.2f} bits", aspect="auto")
    ax.label_outer()
plt.show()

# %%
# Three of the six rotations of the nearest neighbour, ``regions[i]`` of its summary. The windows turn about one centre,
# so they see different corners. The classifier is asked at the points of each, and nothing is resampled. The picture
# turns each window back to where it lies.

fig, axes = plt.subplots(1, 3, figsize=(10, 3.6), layout="constrained", sharex=True, sharey=True)
for ax, regions in zip(axes, found["1 neighbour"].regions[::2], strict=True):
    plot.decision_regions(regions, ax=ax)
    scatter(ax)
    ax.get_legend().remove()
    ax.set(title=f"{regions.orientation:.0f} degrees\n{float(regions.overall()):.2f} bits", aspect="auto")
plt.show()

# %%
# The profiles tell at which scale: of the boundary (small scales), or of the gross form. What parts flexible
# classifiers from stiff ones is at small scales: up to a quarter of the radius the narrow kernel, the full tree and the
# nearest neighbour are on top.

fig, ax = plt.subplots(figsize=(8, 3.6), layout="constrained")
for number, (name, summary) in enumerate(found.items()):
    values = torch.stack([regions.overall_values() for regions in summary.regions]).mean(dim=0)
    ax.plot(summary.regions[0].profile.scales, values, color=plot.COLOURS[number], label=name)
ax.set(
    xlabel="scale t = d / D (share of each region's radius)", ylabel="complexity, mean by area\nand rotations (bits)"
)
ax.set_xlim(0, 1)
ax.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5))
ax.spines[["top", "right"]].set_visible(False)
plt.show()

# %%
# A straight boundary, turned: 0 along a feature, several bits at a few degrees. The mean of six rotations of the grid
# depends on the angle much less: it comes again every 15 degrees, and is least where one of the six meets the boundary.
# Both depend on the boundary condition at the edge of the grid. With ``boundary="background"`` the edge is a part of
# the boundary of every region, with ``boundary="open"`` it is not, since where one looks is an accident.


def complexity_at(angle: float, boundary: str) -> tuple[float, float]:
    """Of a boundary at that angle in degrees: on the grid, and the mean of rotations."""
    normal = torch.tensor([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))]).float()
    summary = decision_region_summary(lambda p: p @ normal > 0.1, [(-1, 1)] * 2, resolution=48, boundary=boundary)
    return float(summary.regions[0].overall()), float(summary.overall())


angles = np.arange(0, 91, 5)
fig, ax = plt.subplots(figsize=(8, 3.2), layout="constrained")
for number, boundary in enumerate(("background", "open")):
    values = np.array([complexity_at(angle, boundary) for angle in angles])
    for column, (line, words) in enumerate((("o-", "grid"), ("s--", "mean of rotations"))):
        label = f'boundary="{boundary}", {words}'
        ax.plot(angles, values[:, column], line, markersize=4, color=plot.COLOURS[number], label=label)
ax.set(xlabel="angle between the boundary and a feature (degrees)", ylabel="complexity (bits)")
ax.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5))
ax.spines[["top", "right"]].set_visible(False)
plt.show()

# %%
# A network while it learns the moons, plain and with weight decay: the same start, the same steps.


def network(inputs: int, outputs: int) -> nn.Sequential:
    """Two hidden layers."""
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


def train(inputs: Tensor, target: Tensor, weight_decay: float, stops: list[int]) -> dict[int, nn.Sequential]:
    """The network after each of these numbers of steps."""
    model = network(inputs.shape[1], int(target.max()) + 1)
    optimiser = torch.optim.AdamW(model.parameters(), lr=1e-2, weight_decay=weight_decay)
    kept = {}
    for step in range(1, max(stops) + 1):
        optimiser.zero_grad()
        nn.functional.cross_entropy(model(inputs), target).backward()
        optimiser.step()
        if step in stops:
            kept[step] = copy.deepcopy(model)
    return kept


stops = [10, 50, 200, STEPS]
moons = torch.from_numpy(X).float(), torch.from_numpy(y)
DECAYS = {"no weight decay": 0.0, "weight decay 1": 1.0}
fig, axes = plt.subplots(2, 4, figsize=(10, 5), layout="constrained", sharex=True, sharey=True)
for row, (title, weight_decay) in zip(axes, DECAYS.items(), strict=True):
    for ax, (step, model) in zip(row, train(*moons, weight_decay, stops).items(), strict=True):
        regions = decision_region_complexity(model, bounds, resolution=96)
        plot.decision_regions(regions, ax=ax)
        scatter(ax)
        ax.get_legend().remove()
        ax.set(title=f"{title}, step {step}\n{float(regions.overall()):.2f} bits", aspect="auto")
        ax.title.set_fontsize(9)
        ax.label_outer()
plt.show()

# %%
# Without decay the network comes to follow single points, and the number rises; with it the boundary, and the number,
# stay where they were. Here early, late and decayed are told apart on one grid.
#
# Digits have 64 features. A plane through three of them is a picture of the regions of ten classes.

digits = load_digits()
pixels, classes = torch.from_numpy(digits.data / 16).float(), torch.from_numpy(digits.target)
runs = {title: train(pixels[:400], classes[:400], decay, [5, 20, 100, STEPS // 2]) for title, decay in DECAYS.items()}
fig, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
for ax, (title, models) in zip(axes, runs.items(), strict=True):
    step, model = list(models.items())[-1]
    plot.decision_regions(decision_plane(model, pixels[:3], resolution=96), ax=ax)
    ax.set_title(f"{title}, step {step}\n{ax.get_title()}", fontsize=9)
plt.show()

# %%
# One plane says little; the mean over many triples, the same for every network, has a standard error. Planes lie at all
# angles to the features, so the mean does not depend on how these are turned.

fig, ax = plt.subplots(figsize=(6, 3.2), layout="constrained")
found_on = {}
print("                   step  complexity (bits)  accuracy on unseen digits")
for number, (title, models) in enumerate(runs.items()):
    found_on[title] = means = [
        decision_plane_complexity(model, pixels[:400], num_planes=PLANES, resolution=32) for model in models.values()
    ]
    ax.errorbar(list(models), [m.mean() for m in means], [m.standard_error() for m in means], marker="o", markersize=4,
                capsize=3, color=plot.COLOURS[number], label=title)  # fmt: skip
    for (step, model), m in zip(models.items(), means, strict=True):
        accuracy = (model(pixels[400:]).argmax(dim=1) == classes[400:]).float().mean()
        print(f"{title:17} {step:5}  {m.mean():9.3f} ± {m.standard_error():.3f}  {accuracy:10.3f}")
ax.set(xscale="log", xlabel="training step", ylabel="complexity (bits),\nmean over planes ± standard error")
ax.legend(frameon=False)
ax.spines[["top", "right"]].set_visible(False)
plt.show()

# %%
# On the digits the bars overlap: the networks differ by less than one plane from the next. The planes are the same for
# all networks, so that differences plane by plane say more.

plain, decayed = (means[-1].values for means in found_on.values())
difference = decayed - plain
error = float(difference.std() / len(difference) ** 0.5)
print(f"weight decay minus none, last step: {float(difference.mean()):.3f} ± {error:.3f} bits")
