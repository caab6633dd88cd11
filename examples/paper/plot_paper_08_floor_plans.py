"""
8. Floor plans
==============

The paper starts from the drawing of a floor plan and makes four simpler ones, with rooms 128 pixels wide: P0, four
closed rooms; P1, with apertures of 32 pixels; P2, with an obstacle of 32 by 4 pixels in the upper right room as well;
P3, with apertures of 80 pixels. The original drawing, P4, is shown in a figure and not described, so it cannot be
rebuilt here. The paper compares them with two bats of the MPEG-7 silhouettes. It says that the complexity of P3 falls
to zero at the scale 0.63, since 80 / 128 is 0.625; that P0 is the least complex; and that P2 and P3 cannot be ordered,
and the two bats cannot either.
"""

# %%
# The plans, True where one can stand. The text does not say how thick the walls are; here they are 4 pixels. It makes
# P3 from P2, which has an obstacle. It also says that P3 is simpler than P2 at low scales, and more complex only at
# scales where the effect of the obstacle is gone. That holds if P3 has no obstacle. So it has none here, and the other
# reading stands beside it, as P3 with the obstacle. The bats are read from the folder that the environment variable
# ``TORCHLINF_MPEG7`` names, since they may not be passed on. Without it a horse and a photographer of scikit-image
# stand in for them, and what is said of bats is not checked.

import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from skimage import data, filters, io, measure
from torch import Tensor

import torchlinf
from torchlinf import plot, shapes
from torchlinf.order import dominance, incomparable_pairs


def animals() -> dict[str, Tensor]:
    """Two silhouettes, with one pixel of outside around them."""
    if folder := os.environ.get("TORCHLINF_MPEG7"):
        found = {name: io.imread(Path(folder) / f"{name}.png") for name in ("bat-10", "bat-20")}
        found = {name: (image if image.ndim == 2 else image[..., 0]) > 0 for name, image in found.items()}
    else:
        parts = measure.label(filters.gaussian(data.camera(), 3) < 0.25)
        found = {"horse": ~data.horse(), "photographer": parts == np.bincount(parts.flat)[1:].argmax() + 1}
    return {name: torch.from_numpy(np.pad(mask, 1)) for name, mask in found.items()}


OTHER = "P3 with the obstacle"
plans = {f"P{number}": shapes.floor_plan(number, margin=1) for number in range(4)}
plans[OTHER] = shapes.rooms(2, 2, aperture=80, obstacle=(32, 4), margin=1)
bats = animals()
masks = plans | bats
colors = dict(zip(masks, plot.COLOURS, strict=False))
profiles = {name: torchlinf.complexity_profile(mask, spatial_ndim=2) for name, mask in masks.items()}

fig, axes = plt.subplots(2, 4, figsize=(8, 4.6), layout="constrained")
fig.get_layout_engine().set(h_pad=0.08)
for ax in axes.flat:
    ax.set_axis_off()
for ax, (name, mask) in zip([*axes[0], *axes[1]], masks.items(), strict=False):
    plot.levels(mask, color=colors[name], ax=ax)
    ax.set_title(f"{name}\n{float(profiles[name].mean()):.2f} bits", fontsize=10)
fig.supxlabel("level lines of f; above each the mean complexity over all scales", fontsize=10)
plt.show()

# %%
# The same against scale.

fig, ax = plt.subplots(figsize=(8, 4.2), layout="constrained")
for name, profile in profiles.items():
    plot.profile(profile, label=name, color=colors[name], style="-" if name in plans else "--", ax=ax)
for label, cutoff in {"32/128": 0.25, "80/128": 0.625}.items():
    ax.axvline(cutoff, color="#555555", linestyle=":", linewidth=1)
    ax.text(cutoff, 1.0, f" {label}", transform=ax.get_xaxis_transform(), va="top", color="#555555")
ax.legend(frameon=False, loc="center left", bbox_to_anchor=(1.01, 0.5))
plt.show()

# %%
# What the exact solution says. **P0 is zero** at every scale: closed rooms are so many squares. **P3 falls to zero at
# 0.63**: it is above zero at 0.62. The other plans follow the same rule. Apertures of 32 pixels end at 0.25. The
# obstacle ends with the deepest place beside it: in a room of 128 with a wall of 4 in the middle that is 31 of 64
# pixels from the walls, 0.484.

LAST = {"P0": 0, "P1": 16, "P2": 31, "P3": 40, OTHER: 40}
FINE = {"P0": 0.0, "P1": 0.683, "P2": 1.815, "P3": 0.792, OTHER: 2.990, "bat-10": 6.869, "bat-20": 6.549}
print("                       last scale above zero   mean (0, 1/4]     (0, 1]   (bits)")
for name, profile in profiles.items():
    levels = profile.levels()
    last = int((levels > 0).nonzero().max() + 1) if (levels > 0).any() else 0
    means = [float(profile.mean(*window)) for window in ((0, 0.25), (0, 1))]
    print(f"{name:22} {last / len(levels):14.3f} {means[0]:21.3f} {means[1]:12.3f}")
    assert round(means[0], 3) == FINE.get(name, round(means[0], 3)), "what docs/paper says"
    if name in plans:
        assert len(levels) == 64
        assert last == LAST[name]
        assert (levels[:last] > 0).all()
at = {
    round(float(scale), 2): float(value)
    for scale, value in zip(profiles["P3"].scales, profiles["P3"].values, strict=True)
}
assert round(at[0.62], 2) == 3.41
assert at[0.63] == 0

# %%
# **Which can be ordered**: by the means over low scales, (0, 1/4], and over all scales, as in the paper. P2 and P3
# cannot: P3 is simpler at low scales and more complex over all. With the obstacle P3 would be above P2 in both numbers,
# which is why the obstacle is left out. P0 is the least.

order = dominance({name: profiles[name] for name in ("P0", "P1", "P2", "P3", *bats)})
pairs = {frozenset(name for node in pair for name in node) for pair in incomparable_pairs(order)}
print("cannot be ordered:", *(" and ".join(sorted(pair)) for pair in pairs), sep="\n    ")
assert frozenset(("P2", "P3")) in pairs
assert all(order.has_edge(("P0",), node) for node in order if node != ("P0",)), "P0 is the least"
if "bat-10" in bats:
    assert pairs == {frozenset(("P2", "P3")), frozenset(("bat-10", "bat-20"))}
two = dominance({name: profiles[name] for name in ("P2", OTHER)})
assert two.has_edge(("P2",), (OTHER,))

# %%
# Apertures and the obstacle each add, at every scale at which they count, up to the last. The silhouettes are more
# complex than any plan at every scale at which these are not zero.

plan = {name: profiles[name].values for name in plans}
for fewer, more, end in (("P0", "P1", 25), ("P1", "P2", 48), ("P3", OTHER, 62)):
    assert (plan[fewer] <= plan[more]).all()
    assert (plan[fewer] < plan[more])[:end].all(), "scales 0.01, 0.02 ... up to the last that counts"
for name in bats:
    assert (profiles[name].values > torch.stack(list(plan.values())).amax(dim=0))[:62].all()
