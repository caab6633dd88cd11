"""The measure: how complex a shape is at every scale, and the options that say how it is measured."""

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
    "SoftOptions",
    "WindowOptions",
    "complexity",
    "complexity_map",
    "complexity_profile",
    "level_values",
    "profile_of_field",
    "profile_of_levels",
    "ragged_profile",
    "soft_complexity",
    "takes",
]
