"""The measure: how complex a shape is at every scale, and the options that say how it is measured."""

from torchlinf.measure.frames import Rectangle, own_angle, smallest_rectangle, turned
from torchlinf.measure.levels import Levels, level_values
from torchlinf.measure.masks import complexity, complexity_profile, ragged_profile
from torchlinf.measure.objects import (
    Component,
    components,
    in_frame,
    require_connectivity,
    require_frame,
    rotations_of,
)
from torchlinf.measure.options import (
    FrameOptions,
    GridOptions,
    LevelOptions,
    MeanOptions,
    Measure,
    MeasureOptions,
    ObjectOptions,
    ProfileOptions,
    SoftOptions,
    WindowOptions,
    takes,
)
from torchlinf.measure.pixel_map import complexity_map
from torchlinf.measure.profile import ComplexityProfile, Parts, mean_of_levels, profile_of_field, profile_of_levels
from torchlinf.measure.soft import soft_complexity
from torchlinf.measure.solved_shape import SolvedLevels, SolvedShape, complexities_after_flips
from torchlinf.measure.spacing import checked_spacing, cube_size, equal_spacing
from torchlinf.measure.spacing import of_words as spacing_of_words
from torchlinf.measure.spacing import words as spacing_words

__all__ = [
    "ComplexityProfile",
    "Component",
    "FrameOptions",
    "GridOptions",
    "LevelOptions",
    "Levels",
    "MeanOptions",
    "Measure",
    "MeasureOptions",
    "ObjectOptions",
    "Parts",
    "ProfileOptions",
    "Rectangle",
    "SoftOptions",
    "SolvedLevels",
    "SolvedShape",
    "WindowOptions",
    "checked_spacing",
    "complexities_after_flips",
    "complexity",
    "complexity_map",
    "complexity_profile",
    "components",
    "cube_size",
    "equal_spacing",
    "in_frame",
    "level_values",
    "mean_of_levels",
    "own_angle",
    "profile_of_field",
    "profile_of_levels",
    "ragged_profile",
    "require_connectivity",
    "require_frame",
    "rotations_of",
    "smallest_rectangle",
    "soft_complexity",
    "spacing_of_words",
    "spacing_words",
    "takes",
    "turned",
]
