"""The measure: how complex a shape is at every scale, and the options that say how it is measured."""

from torchlinf.measure.frames import Rectangle, own_angle, smallest_rectangle, turned
from torchlinf.measure.levels import Levels, level_values
from torchlinf.measure.options import (
    FrameOptions,
    LevelOptions,
    Measure,
    MeasureOptions,
    ObjectOptions,
    SoftOptions,
    WindowOptions,
    takes,
)
from torchlinf.measure.pixel_map import complexity_map
from torchlinf.measure.profile import (
    ComplexityProfile,
    complexity,
    complexity_profile,
    profile_of_field,
    profile_of_levels,
    ragged_profile,
)
from torchlinf.measure.soft import soft_complexity

__all__ = [
    "ComplexityProfile",
    "FrameOptions",
    "LevelOptions",
    "Levels",
    "Measure",
    "MeasureOptions",
    "ObjectOptions",
    "Rectangle",
    "SoftOptions",
    "WindowOptions",
    "complexity",
    "complexity_map",
    "complexity_profile",
    "level_values",
    "own_angle",
    "profile_of_field",
    "profile_of_levels",
    "ragged_profile",
    "smallest_rectangle",
    "soft_complexity",
    "takes",
    "turned",
]
