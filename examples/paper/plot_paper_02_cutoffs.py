"""
2. Appendages, and the scales at which they end
===============================================

S0 is a square. S1 has a wide appendage on it, S2 a narrower one more, S3 a still narrower one more. The paper says that
an appendage counts up to one scale, the width of its contact as a share of the width of the body: 3/4 for the first,
1/2 for the second, 1/4 for the third. Above it the fields are identical. It also observes that its two measures of
uniformity, entropy and standard deviation, seem to behave alike with respect to scale.
"""

# %%
# The shapes: a square of 128 pixels, and appendages of width 96, 64 and 32, all of depth 48. Each is drawn twice. Above
# are level lines of the field *f*, which is solved for; below those of the scale *t*, the chessboard distance to the
# outside as a share of its maximum. On the square the two agree. On the others they part inside the appendages, where a
# line of *t* runs around the tip while *f* still rises towards the body.

import matplotlib.pyplot as plt
import numpy as np
import torch

import torchlinf
from torchlinf import plot, shapes

family = shapes.nested_appendages()
looks = dict(zip(family, plot.COLOURS, strict=False))

fig, axes = plt.subplots(2, 4, figsize=(8, 4.4), layout="constrained", sharex=True, sharey=True)
for column, (name, mask) in zip(axes.T, family.items(), strict=True):
    for ax, of in zip(column, ("field", "distance"), strict=True):
        plot.levels(mask, of=of, color=looks[name], ax=ax)
        ax.set(title=f"{name}: {'f' if of == 'field' else 't'}", xlabel="", ylabel="")
        ax.set(xlim=(-8, 232), ylim=(184, -8))
        ax.label_outer()
fig.supxlabel("column (pixels)", fontsize=10)
fig.supylabel("row (pixels)", fontsize=10)
plt.show()

# %%
# What is measured, on S3, as a figure of the paper has it: level lines of *f* at 0.01, 0.3, 0.6 and 0.9 (black), and of
# *t* at 0.2, 0.5 and 0.8 (dotted). Each dotted line crosses some black ones; the entropy of *f* on it says how many.
# Near the middle the two agree, and the entropy is zero.

mask = np.pad(family["S3"].numpy(), 4)
f = torchlinf.linf_field(torch.from_numpy(mask), spatial_ndim=2).numpy()
distance = torchlinf.chessboard_distance(torch.from_numpy(mask), spatial_ndim=2).numpy()
entropies = torchlinf.complexity_profile(family["S3"], scales=[0.2, 0.5, 0.8], spatial_ndim=2).values.tolist()
fig, ax = plt.subplots(figsize=(6, 4.2), layout="constrained")
ax.contour(mask, levels=[0.5], colors="#999999", linewidths=0.8)
ax.contour(f, levels=[0.01, 0.3, 0.6, 0.9], colors="black", linewidths=1)
ax.contour(distance / 64, levels=[0.2, 0.5, 0.8], colors="tab:blue", linestyles="dotted", linewidths=1.6)
ax.set(aspect="equal", ylim=(mask.shape[0], 0), xlabel="column (pixels)", ylabel="row (pixels)")
ax.set_title("   ".join(f"t = {t}: {e:.2f} bits" for t, e in zip((0.2, 0.5, 0.8), entropies, strict=True)), fontsize=10)
plt.show()
assert entropies[0] > entropies[1] > entropies[2] == 0

# %%
# The two measures against scale. The earlier a shape comes in the row, the wider its line, so that lines on top of each
# other can still be seen. Dotted: where the appendages should end.

CUTOFFS = {"1/4": 0.25, "1/2": 0.5, "3/4": 0.75}
fig, axes = plt.subplots(2, 1, figsize=(8, 6), layout="constrained", sharex=True)
for ax, estimator in zip(axes, ("entropy", "std"), strict=True):
    for width, (name, mask) in zip((7, 5, 3, 1.2), family.items(), strict=True):
        plot.profile(mask, label=name, color=looks[name], estimator=estimator, ax=ax)
        ax.patches[-1].set_linewidth(width)
    for label, cutoff in CUTOFFS.items():
        ax.axvline(cutoff, color="#555555", linestyle=":", linewidth=1)
        ax.text(cutoff, 1.0, f" {label}", transform=ax.get_xaxis_transform(), va="top", color="#555555")
axes[0].set_xlabel("")
axes[0].legend(frameon=False, loc="center right")
plt.show()

# %%
# What the exact solution says: **all of it holds.** S1, S2 and S3 are equal above 1/2, S2 and S3 above 1/4, and all are
# zero above 3/4: the entropy to the last digit, the standard deviation up to rounding.


def levels_of(estimator: str) -> dict[str, np.ndarray]:
    """Values of the levels 1 to 64 of each shape."""
    return {
        name: torchlinf.complexity_profile(mask, estimator=estimator, spatial_ndim=2).levels().numpy()
        for name, mask in family.items()
    }


for estimator, rounding in (("entropy", 0.0), ("std", 1e-12)):
    S0, S1, S2, S3 = levels_of(estimator).values()
    assert len(S0) == len(S3) == 64, "the radius is that of the square"
    assert (S0 == 0).all(), "a square is zero"
    for first, *others in ((0 * S1, S1, S2, S3), (S1, S2, S3), (S2, S3)):
        end = {3: 48, 2: 32, 1: 16}[len(others)]  # 3/4, 1/2 and 1/4 of 64 levels
        for other in others:
            assert (abs(other - first)[end:] <= rounding).all(), "no trace above the cutoff"
        assert (abs(others[0] - first)[:end] > 1e-4).all(), "it counts at every scale up to the cutoff"
    print(f"{estimator:8} largest difference above the cutoffs: {max(abs(S1[48:]).max(), abs(S3 - S2)[16:].max()):.0e}")

# %%
# The fields themselves are identical above the cutoffs, up to the last digits of floating point: the largest difference
# of *f* between two shapes at a pixel of the square whose scale is above the cutoff.

CORNERS = {"S0": (0, 0), "S1": (0, 0), "S2": (48, 0), "S3": (48, 48)}  # where the square begins
square = {
    name: torchlinf.linf_field(family[name], spatial_ndim=2)[row : row + 128, column : column + 128]
    for name, (row, column) in CORNERS.items()
}
t = torchlinf.chessboard_distance(family["S0"], spatial_ndim=2) / 64
for one, other, cutoff in (("S0", "S1", 0.75), ("S1", "S2", 0.5), ("S1", "S3", 0.5), ("S2", "S3", 0.25)):
    difference = (square[one] - square[other]).abs()
    print(f"{one} and {other}: {difference[t > cutoff].max():.0e} above {cutoff}, {difference.max():.2f} below")
    assert difference[t > cutoff].max() <= 1e-14
    assert difference.max() > 0.2

# %%
# The entropy rises with every appendage, at every scale where it counts; so does the mean of either measure over these
# scales.

entropy = levels_of("entropy")
assert (entropy["S1"] < entropy["S2"])[:32].all()
assert (entropy["S2"] < entropy["S3"])[:16].all()
LEVELS = {
    "S0": [0, 0, 0, 0, 0, 0],
    "S1": [1.34, 2.16, 2.32, 2.74, 3.33, 0],
    "S2": [2.35, 3.54, 3.71, 2.74, 3.33, 0],
    "S3": [3.08, 4.40, 3.71, 2.74, 3.33, 0],
}
for name, expected in {"S0": 0.0, "S1": 1.997, "S2": 3.308, "S3": 4.164}.items():
    rims = torchlinf.complexity_profile(family[name], levels="rim", spatial_ndim=2)
    assert abs(float(rims.mean(0.0, 0.25)) - expected) < 5e-4, "what docs/paper says of rims"
print("level k (of 64)       1     11     17     33     48     49")
for name, values in entropy.items():
    chosen = values[[0, 10, 16, 32, 47, 48]]
    print(f"{name}: entropy (bits)" + "".join(f"{value:7.2f}" for value in chosen))
    assert np.allclose(chosen, LEVELS[name], rtol=0, atol=0.005), "what docs/method says"
EXPECTED = {
    "entropy": {"S0": 0.0, "S1": 1.991, "S2": 3.294, "S3": 4.141},
    "std": {"S0": 0.0, "S1": 0.0129, "S2": 0.0292, "S3": 0.0524},
}
print("\nmean over scales     (0, 1/4]   (1/4, 1/2]   (1/2, 3/4]   (3/4, 1]")
for estimator, decimals in (("entropy", 3), ("std", 4)):
    for name, mask in family.items():
        profile = torchlinf.complexity_profile(mask, estimator=estimator, spatial_ndim=2)
        means = [float(profile.mean(low / 4, (low + 1) / 4)) for low in range(4)]
        assert np.allclose(means[0], EXPECTED[estimator][name], rtol=0, atol=10**-decimals), "what docs/paper says"
        print(f"{name}: {estimator:8}    " + "     ".join(f"{mean:8.{decimals}f}" for mean in means))
