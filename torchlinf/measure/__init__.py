"""The measure: how complex a shape is at every scale, and the options that say how it is measured."""

from torchlinf.measure.frames import Rectangle, own_angle, smallest_rectangle, turned
from torchlinf.measure.levels import Levels, level_values
from torchlinf.measure.options import LevelOptions, Measure, MeasureOptions, SoftOptions, WindowOptions, takes
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
from torchlinf.measure.spacing import checked_spacing, cube_size, equal_spacing
from torchlinf.measure.spacing import of_words as spacing_of_words
from torchlinf.measure.spacing import words as spacing_words

__all__ = [
    "ComplexityProfile",
    "LevelOptions",
    "Levels",
    "Measure",
    "MeasureOptions",
    "Rectangle",
    "SoftOptions",
    "WindowOptions",
    "checked_spacing",
    "complexity",
    "complexity_map",
    "complexity_profile",
    "cube_size",
    "equal_spacing",
    "level_values",
    "own_angle",
    "profile_of_field",
    "profile_of_levels",
    "ragged_profile",
    "smallest_rectangle",
    "soft_complexity",
    "spacing_of_words",
    "spacing_words",
    "takes",
    "turned",
]
