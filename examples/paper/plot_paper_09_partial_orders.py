"""
Partial orders: which of ten shapes are simpler in every respect
================================================================

One number puts all shapes in a line, and hides that two shapes may be complex in different ways. Arslan and Tari
compare by two numbers at once: the complexity at low scales, t in (0, 1/4], and that over all scales. A shape is
simpler than another if neither number says the contrary; some pairs then cannot be compared. This page draws such
orders with ``plot.hasse`` and takes them apart into chains.

The paper's shapes are ten of the twenty silhouettes "device3" of MPEG-7. Their numbers are not in the text. Of those
with cuts it says that they are more complex than all others, and that the one with curvy cuts is the most complex. Here
the ten are five without cuts and five with. They are read from the folder that the environment variable
``TORCHLINF_MPEG7`` names; without it, ten generated shapes of a like kind stand in for them.
"""

# %%
# Ten shapes: blocks with bent sides, round corners, lobes and slits.

import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.colors import to_rgb
from matplotlib.offsetbox import AnnotationBbox, OffsetImage
from torch import Tensor

import torchlinf
from torchlinf import plot, shapes
from torchlinf.order import chains, dominance, hasse_diagram, incomparable_pairs, largest_antichain, longest_chain
from torchlinf.scoring import read_mask


def device_like(bend: float, corner: float, lobes: float, slits: int, side: int = 128) -> Tensor:
    """A block: sides bent in or out, a superellipse's corners, waves on its outline, slanted slits."""
    axis = torch.linspace(-1.2, 1.2, int(1.2 * side), dtype=torch.float64)
    y, x = axis[:, None], axis[None, :]
    angle = torch.atan2(y, x)
    reach = 1 + bend * torch.cos(4 * angle) + lobes * torch.cos(12 * angle)
    inside = (x.abs() ** corner + y.abs() ** corner) ** (1 / corner) <= reach
    for k in range(slits):
        line = y + 0.35 * x + 0.6 - 0.5 * k
        inside &= ~((line.abs() < 0.05) & (x < 0.75))
    return inside


TEN = (11, 20, 15, 4, 6, 3, 8, 13, 18, 5)
CUT = (5, 8, 13, 14, 18)


def ten_shapes() -> dict[str, Tensor]:
    """Ten device3 silhouettes, or shapes of a like kind."""
    folder = os.environ.get("TORCHLINF_MPEG7")
    if folder:
        paths = [Path(folder, f"device3-{number}.png") for number in TEN]
        return {path.stem: torch.from_numpy(read_mask(path)) for path in paths}
    return {
        "rounded": device_like(0.0, 10, 0.0, 0),
        "rounder": device_like(0.0, 5, 0.0, 0),
        "bulging": device_like(0.06, 12, 0.0, 0),
        "pinched": device_like(-0.08, 12, 0.0, 0),
        "star": device_like(-0.25, 12, 0.0, 0),
        "lobed": device_like(0.0, 10, 0.04, 0),
        "lobed star": device_like(-0.15, 10, 0.08, 0),
        "one slit": device_like(0.0, 10, 0.0, 1),
        "slits": device_like(0.0, 10, 0.0, 3),
        "lobed slits": device_like(-0.05, 10, 0.06, 2),
    }


masks = ten_shapes()
profiles = {name: torchlinf.complexity_profile(mask, spatial_ndim=2) for name, mask in masks.items()}
order = dominance(profiles)  # by the means over (0, 1/4] and (0, 1]
steps = hasse_diagram(order)

# %%
# The two numbers as coordinates. What lies below *and* to the left of a shape is simpler; a line joins it to the next
# ones up, between which and it no other shape lies. Two of which one is further right and the other higher up cannot be
# compared.

fig, ax = plt.subplots(figsize=(7, 5), layout="constrained")
at = {node: order.nodes[node]["indicators"] for node in order}
for a, b in steps.edges:
    ax.plot(*zip(at[a], at[b], strict=True), color="#bbbbbb", linewidth=0.9, zorder=1)
for node, (low, overall) in at.items():
    mask = masks[node[0]].numpy()
    ink = np.dstack([*(np.full(mask.shape, value) for value in to_rgb(plot.COLOURS[0])), mask])
    ax.add_artist(AnnotationBbox(OffsetImage(ink, zoom=22 / max(mask.shape)), (low, overall), frameon=False))
    ax.annotate(" = ".join(node), (low, overall), (13, -4), textcoords="offset points", va="top", fontsize=8, zorder=9)
ax.margins(0.12)
ax.set(xlabel="complexity over the low scales (0, 1/4] (bits)", ylabel="complexity over all scales (0, 1] (bits)")
ax.spines[["top", "right"]].set_visible(False)
plt.show()

# %%
# The same order as a Hasse diagram, its longest chain in red. Each line leads up to a shape that is more complex in
# both numbers; where no path leads up, there is no order.

plot.hasse(masks, order=order, highlight=longest_chain(order))
plt.show()


def in_line(nodes: list[tuple[str, ...]], sign: str) -> str:
    """Nodes as text."""
    return sign.join(" = ".join(node) for node in nodes)


pairs = incomparable_pairs(order)
print(f"incomparable: {len(pairs)} of {len(order) * (len(order) - 1) // 2} pairs")
assert pairs
for a, b in pairs:
    print("   ", in_line([a, b], " | "))
print(f"longest chain: {in_line(longest_chain(order), ' < ')}")
print(f"largest antichain: {in_line(largest_antichain(order), ', ')}")
print("fewest chains that hold all, as many as the antichain has members:")
for chain in chains(order):
    print("   ", in_line(chain, " < "))
assert len(chains(order)) == len(largest_antichain(order))
if "device3-5" in masks:
    assert (len(pairs), len(longest_chain(order)), len(largest_antichain(order)), len(steps.edges)) == (6, 5, 3, 16)

# %%
# **All uncut shapes below all cut ones, and one on top**: of all twenty silhouettes. What makes one the top is for the
# eye to see: device3-5 is the one with curved cuts.

if folder := os.environ.get("TORCHLINF_MPEG7"):
    twenty = {n: torch.from_numpy(read_mask(Path(folder, f"device3-{n}.png"))) for n in range(1, 21)}
    solved = {n: torchlinf.complexity_profile(mask, spatial_ndim=2) for n, mask in twenty.items()}
    two = {n: np.array([float(profile.mean(0.0, 0.25)), float(profile.mean())]) for n, profile in solved.items()}
    for n, numbers in sorted(two.items(), key=lambda item: item[1][1]):
        print(f"device3-{n:2} {'cut' if n in CUT else '   '} {numbers[0]:8.3f} {numbers[1]:8.3f}")
    assert all((two[n] < two[c]).all() for n in two if n not in CUT for c in CUT)
    assert all((two[c] < two[5]).all() for c in CUT if c != 5)

# %%
# Why a pair cannot be compared: its profiles cross, so the answer depends on the scale at which one looks. This is the
# pair that disagrees most.


def disagreement(pair: tuple[tuple[str, ...], tuple[str, ...]]) -> float:
    """The smaller of the two differences, which have opposite signs."""
    low, overall = np.subtract(at[pair[0]], at[pair[1]])
    return float(min(abs(low), abs(overall)))


worst = max(pairs, key=disagreement)
fig, ax = plt.subplots(figsize=(7, 3.4), layout="constrained")
for node, color in zip(worst, plot.COLOURS, strict=False):
    name = node[0]
    low, overall = at[node]
    plot.profile(profiles[name], label=f"{name}: {low:.2f} at low scales, {overall:.2f} overall", color=color, ax=ax)
ax.axvspan(0, 0.25, color="#dddddd", zorder=0)
ax.legend(frameon=False, fontsize=8)
plt.show()

# %%
# Comparing at *every* scale asks for more: one profile must nowhere lie below the other. Hardly anything is comparable
# then; what is left is beyond doubt.

everywhere = dominance(profiles, every_scale=True)
plot.hasse(masks, order=everywhere)
plt.show()
print(f"incomparable at all scales: {len(incomparable_pairs(everywhere))} pairs, by two numbers: {len(pairs)}")

# %%
# A finer partial order has fewer pairs: whatever is simpler at every scale is so in every mean.

implied = all(order.has_edge(a, b) for a, b in everywhere.edges)
print(f"every step at all scales is a step by the two means: {implied}")
assert implied

# %%
# Values count as equal if the intervals meet that are proven to hold them: each value plus or minus its error bound,
# which is 0 on all shapes of this page. Squares with one, two and four appendages, narrow and wide, centred on their
# sides or flush with a corner: on sets of equal distance their place makes no difference at any scale. So the twelve
# shapes are six nodes, in pairs. On rims they are twelve.

twelve = shapes.appendage_dictionary(64, 16, widths=(16, 40))
of_twelve = {name: torchlinf.complexity_profile(mask, spatial_ndim=2) for name, mask in twelve.items()}
print(f"largest error bound: {max(float(profile.error_bound()) for profile in of_twelve.values())} bits")
assert all(profile.error_bound() == 0 for profile in [*of_twelve.values(), *profiles.values()])
order_of_twelve = dominance(of_twelve, windows={"fine": (0.0, 0.25), "medium": (0.25, 0.625)})
plot.hasse(twelve, order=order_of_twelve)
plt.show()
assert [len(node) for node in order_of_twelve] == [2] * 6
on_rims = {name: torchlinf.complexity_profile(mask, levels="rim", spatial_ndim=2) for name, mask in twelve.items()}
assert len(dominance(on_rims)) == 12
