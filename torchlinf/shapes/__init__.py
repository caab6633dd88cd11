"""Shapes of the paper as boolean tensors `(*spatial)`, True inside.

They carry no batch dimensions: pass `spatial_ndim=2` (or 1, 3) beside them, or `torch.stack` several of one size. All
are deterministic, on the CPU, and hold no more than their bounding box unless a `margin` of outside pixels is asked
for; the library counts everything beyond the array as outside anyway.
"""

from torchlinf.shapes.appendages import FACES, Appendage, cube_with_appendages, with_appendages
from torchlinf.shapes.basic import box, disc, square, superellipse

__all__ = [
    "FACES",
    "Appendage",
    "box",
    "cube_with_appendages",
    "disc",
    "square",
    "superellipse",
    "with_appendages",
]
