"""
Quickstart: a square, a disc, and what an appendage adds
========================================================

A square has complexity zero, at every scale. A disc of pixels has not: on the grid it is a staircase. An appendage on a
square shows at the scales up to the ratio of widths, and at none above.
"""

# %%
# Three shapes, as boolean tensors. They have different sizes, and each is scored on its own: ``spatial_ndim=2`` says
# that there are no batch dimensions.

import matplotlib.pyplot as plt

import torchlinf
from torchlinf import plot, shapes

bump = shapes.Appendage("right", width=64, depth=48)
masks = {
    "square": shapes.square(128, margin=8),
    "disc": shapes.disc(64, margin=8),
    "square with a bump": shapes.with_appendages((128, 128), [bump], margin=8),
}
for name, mask in masks.items():
    print(f"{name:20} {torchlinf.complexity(mask, spatial_ndim=2):.4f} bits")

# %%
# The measure compares two functions on the shape: the scale *t*, the chessboard distance to the outside as a fraction
# of the radius, and the field *f*, which solves a screened equation with zero outside. On a square their level lines
# have the same form. Where they part, a level of *t* holds different values of *f*, and the entropy of those values is
# the complexity at that scale.

fig, axes = plt.subplots(2, 3, figsize=(9, 6.5), layout="constrained")
for column, (name, mask) in zip(axes.T, masks.items(), strict=True):
    for ax, of in zip(column, ("distance", "field"), strict=True):
        plot.levels(mask, of=of, ax=ax)
        ax.set_axis_off()
        ax.set_title(f"{name}: {'t' if of == 'distance' else 'f'}")
plt.show()

# %%
# The bump touches the square along half of its side, so its effect ends at scale 0.5, exactly.

profiles = {name: torchlinf.complexity_profile(mask, spatial_ndim=2) for name, mask in masks.items()}
fig, ax = plt.subplots(figsize=(7, 3.5), layout="constrained")
for name, profile in profiles.items():
    plot.profile(profile, label=name, ax=ax)
ax.legend()
plt.show()

# %%
# A profile answers questions about windows of scales without solving anything again, and has a proven bound on the
# error of every answer, in bits.

profile = profiles["square with a bump"]
print(f"scales up to 0.5: {profile.mean(0.0, 0.5):.4f} bits")
print(f"scales above 0.5: {profile.mean(0.5, 1.0):.4f} bits")
print(f"error of the mean over all scales: at most {profile.error_bound():g} bits")
