"""Shapes of the paper as boolean tensors `(*spatial)`, True inside.

They have no batch dimensions: pass `spatial_ndim=2` (or 1, 3) beside them, or `torch.stack` several of one size. All
are on the CPU. The same arguments give the same shape; noise has a `seed`. A shape fills its bounding box, unless a
`margin` of outside pixels is asked for. The library counts everything beyond the array as outside, so a margin
changes no result.
"""

from torchlinf.shapes.appendages import FACES, Appendage, cube_with_appendages, with_appendages
from torchlinf.shapes.bands import band, diagonal_pair
from torchlinf.shapes.basic import box, disc, rectangle, square, superellipse
from torchlinf.shapes.families import (
    appendage_dictionary,
    appendage_places,
    cube_family,
    nested_appendages,
    zero_complexity,
)
from torchlinf.shapes.floor_plans import floor_plan, rooms
from torchlinf.shapes.noise import add_noise

__all__ = [
    "FACES",
    "Appendage",
    "add_noise",
    "appendage_dictionary",
    "appendage_places",
    "band",
    "box",
    "cube_family",
    "cube_with_appendages",
    "diagonal_pair",
    "disc",
    "floor_plan",
    "nested_appendages",
    "rectangle",
    "rooms",
    "square",
    "superellipse",
    "with_appendages",
    "zero_complexity",
]
