"""The measure: how complex a shape is at every scale, and the options that say how it is measured."""

from torchlinf.measure.levels import Levels, level_values
from torchlinf.measure.options import LevelOptions, Measure, MeasureOptions, SoftOptions, WindowOptions, takes
from torchlinf.measure.pixel_map import complexity_map
from torchlinf.measure.profile import (
    ComplexityProfile,
    complexity,
    complexity_profile,
    mean_of_levels,
    profile_of_field,
    profile_of_levels,
    ragged_profile,
)
from torchlinf.measure.soft import soft_complexity
from torchlinf.measure.solved_shape import SolvedShape, complexities_after_flips

__all__ = [
    "ComplexityProfile",
    "LevelOptions",
    "Levels",
    "Measure",
    "MeasureOptions",
    "SoftOptions",
    "SolvedShape",
    "WindowOptions",
    "complexities_after_flips",
    "complexity",
    "complexity_map",
    "complexity_profile",
    "level_values",
    "mean_of_levels",
    "profile_of_field",
    "profile_of_levels",
    "ragged_profile",
    "soft_complexity",
    "takes",
]
