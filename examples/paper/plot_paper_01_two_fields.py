"""
1. The field, and its Euclidean counterpart
===========================================

The paper solves a screened equation with the infinity Laplacian: the largest plus the smallest neighbour minus twice
the pixel. It shows the level curves beside those of the solution in L2, the usual Laplacian. It observes that the level
curves of *f* become locally flat, and that in the other case the level sets get rounder.
"""

# %%
# Three shapes: a square, one with appendages, and the silhouette of a horse (from scikit-image, at a third of its
# size).

import matplotlib.pyplot as plt
import numpy as np
import torch
from scipy import sparse
from scipy.sparse.linalg import spsolve
from skimage import data, measure
from torch import Tensor

import torchlinf
from torchlinf import plot, shapes
from torchlinf.measure import Measure, profile_of_field

horse = ~torch.from_numpy(data.horse())[None, None]
masks = {
    "square": shapes.square(128, margin=4),
    "square with appendages": shapes.nested_appendages(margin=4)["S3"],
    "horse": torch.nn.functional.interpolate(horse.float(), size=(110, 133), mode="area")[0, 0] > 0.5,
}

# %%
# Both fields are 0 outside the shape and have the same screening length, its radius *D* in pixels. The infinity field
# solves ``max f + min f - (2 + 1/D^2) f + 1 = 0`` with the maximum and the minimum over the block of 9 pixels, by
# :func:`torchlinf.solve_field`. The usual one solves the screened Poisson equation ``(Laplacian - 1/D^2) v = -1``, a
# sparse linear system with five entries a row.


def euclidean_field(mask: Tensor, rho: float) -> Tensor:
    """Solution v of (Laplacian - 1/rho^2) v = -1 on the mask, with v = 0 outside: (H, W) float64."""
    height, width = mask.shape
    second = [sparse.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(n, n)) for n in (height, width)]
    laplacian = sparse.kron(second[0], sparse.eye_array(width)) + sparse.kron(sparse.eye_array(height), second[1])
    inside = mask.flatten().numpy()
    system = sparse.eye_array(int(inside.sum())) / rho**2 - laplacian.tocsr()[inside][:, inside]
    v = np.zeros(inside.size)
    v[inside] = spsolve(system.tocsc(), np.ones(int(inside.sum())))
    return torch.from_numpy(v).reshape(height, width)


distances = {name: torchlinf.chessboard_distance(mask, spatial_ndim=2) for name, mask in masks.items()}
fields = {
    "f": {name: torchlinf.solve_field(mask, spatial_ndim=2).value for name, mask in masks.items()},
    "v": {name: euclidean_field(mask, float(distances[name].max())) for name, mask in masks.items()},
}

# %%
# Level lines at a tenth, two tenths ... of the maximum: *f* above, its Euclidean counterpart *v* below.

TITLES = {"f": "f, infinity Laplacian", "v": "v, Laplacian"}
fig, axes = plt.subplots(2, 3, figsize=(8, 4.9), layout="constrained", width_ratios=[136, 232, 190])
for row, (kind, solved) in zip(axes, fields.items(), strict=True):
    for number, (ax, (name, field)) in enumerate(zip(row, solved.items(), strict=True)):
        plot.levels(masks[name], of=field, color=plot.COLOURS[number], ax=ax)
        ax.set(title=name if kind == "f" else "", xlabel="column (pixels)" if kind == "v" else "", ylabel="")
    row[0].set_ylabel(f"{TITLES[kind]}\nrow (pixels)")
plt.show()

# %%
# A corner of the second shape, enlarged, where an appendage meets the body. The lines of *f* turn at once and run
# straight on, with the sides of the shape; those of *v* turn slowly.

fig, axes = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained", sharey=True)
for ax, (kind, solved) in zip(axes, fields.items(), strict=True):
    plot.levels(masks["square with appendages"], of=solved["square with appendages"], color=plot.COLOURS[1], ax=ax)
    ax.set(xlim=(80, 180), ylim=(70, 0), title=TITLES[kind])
axes[1].set_ylabel("")
plt.show()

# %%
# What the exact solution says: **it holds.** As a number: the share of the length of all nine lines that runs within 5
# degrees of an axis. On the square that is all of *f* but the corners. Inside the appendages the lines of *f* are
# straight too, but at a slant, and the outline of a horse follows no axis; still *f* has more of such lines.


def flatness(field: Tensor) -> float:
    """Share of the length of the nine level lines within 5 degrees of an axis."""
    normalised = (field / field.max()).numpy()
    lines = [line for k in range(1, 10) for line in measure.find_contours(normalised, k / 10)]
    # Steps across four points of a line: from one point to the next there are few directions on a grid.
    steps = np.concatenate([line[4:] - line[:-4] for line in lines if len(line) > 4])
    length = np.hypot(*steps.T)
    return float(length[abs(steps).min(axis=1) <= np.sin(np.deg2rad(5)) * length].sum() / length.sum())


# %%
# And what the paper's measure would say if it were built on *v*: the entropy of the values on each level of the
# distance, in the mean over all scales. The square would not be simple any more.


def entropy(field: Tensor, distance: Tensor) -> float:
    """Mean over scales of the entropy of the field on the levels of the distance, in bits."""
    return float(profile_of_field(field, distance, torch.tensor(0.0), Measure()).mean())


EXPECTED = {
    "square": (0.98, 0.40, 0.0, 4.41),
    "square with appendages": (0.79, 0.16, 2.76, 7.00),
    "horse": (0.36, 0.21, 4.79, 6.68),
}
print("                         flat lines (%)     complexity (bits)")
print("                            f      v           f      v")
for name in masks:
    flat = {kind: flatness(solved[name]) for kind, solved in fields.items()}
    bits = {kind: entropy(solved[name], distances[name]) for kind, solved in fields.items()}
    print(f"{name:24} {flat['f']:6.0%} {flat['v']:6.0%}       {bits['f']:6.2f} {bits['v']:6.2f}")
    found = [flat["f"], flat["v"], bits["f"], bits["v"]]
    assert np.allclose(found, EXPECTED[name], rtol=0, atol=0.01), "what docs/paper says"
assert entropy(fields["f"]["square"], distances["square"]) == 0.0, "f depends on the distance alone"
