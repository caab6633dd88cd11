"""What a figure shows of a shape: its field, its distance and its profile, all from one solve."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.checks import as_mask
from torchlinf.field import FieldSolution, chessboard_distance, solve_field
from torchlinf.measure import (
    ComplexityProfile,
    Measure,
    ProfileOptions,
    complexity_profile,
    profile_of_field,
)


@dataclass(frozen=True, eq=False)
class SolvedShape:
    """An image or a volume with its field.

    Attributes:
        distance: like the mask, the chessboard distance in pixels.
        solution: the field and its certified error.
    """

    distance: Tensor
    solution: FieldSolution

    def field_slice(self) -> NDArray[np.float64]:
        """f / max f of an image, or of the slice of a volume through its deepest voxel."""
        field = self.solution.value.double()
        return (field / field.max())[deepest(self.distance)].numpy(force=True)

    def scale_slice(self) -> NDArray[np.float64]:
        """The scale t = d / D of an image, or of the slice of a volume through its deepest voxel."""
        return scale_slice(self.distance)

    def profile(self, measure: Measure) -> ComplexityProfile:
        """The profile, of the field that is solved already."""
        return profile_of_field(self.solution.value, self.distance, self.solution.error_bound, measure)


def solved_shape(
    mask: Tensor, measure: Measure, solution: FieldSolution | None = None, name: str = "mask"
) -> SolvedShape:
    """Solve the field of one image or volume, unless there is a solution already."""
    distance = distance_of(mask, name)
    if solution is None:
        solution = solve_field(mask, rho=measure.rho, tol=measure.tol, spatial_ndim=mask.ndim)
    elif not isinstance(solution, FieldSolution):
        got = type(solution).__name__
        raise TypeError(f"solution must be a FieldSolution; got {got}. Pass solve_field({name}, spatial_ndim=2).")
    elif solution.value.shape != mask.shape:
        raise ValueError(
            f"solution must be that of {name}; got values {tuple(solution.value.shape)} for {tuple(mask.shape)}. "
            f"Pass solve_field({name}, spatial_ndim={mask.ndim})."
        )
    return SolvedShape(distance.to(solution.value.device), solution)


def solved_shapes(
    masks: Mapping[str, Tensor], measure: Measure, solutions: Mapping[str, FieldSolution] | None
) -> dict[str, SolvedShape]:
    """Solve the fields of shapes by name, at least one, unless there are solutions already."""
    require_masks(masks)
    if solutions is None:
        return {name: solved_shape(mask, measure, name=f"masks[{name!r}]") for name, mask in masks.items()}
    if not isinstance(solutions, Mapping) or set(solutions) != set(masks):
        raise ValueError(
            "solutions must map the names of all masks to solutions; got other names. "
            "Pass {name: solve_field(mask, spatial_ndim=2) for name, mask in masks.items()}."
        )
    return {name: solved_shape(mask, measure, solutions[name], f"masks[{name!r}]") for name, mask in masks.items()}


def profile_of(mask: Tensor | ComplexityProfile, options: ProfileOptions, name: str = "mask") -> ComplexityProfile:
    """The profile of one shape, of any number of dimensions, unless it is one already."""
    if not isinstance(mask, ComplexityProfile):
        require_inside(mask, name)
        return complexity_profile(mask, spatial_ndim=mask.ndim, **options)
    refuse_beside(options, "profile")
    if mask.radius.numel() != 1 or not bool(mask.radius.all()):
        raise ValueError(
            f"a profile must be that of one shape with a pixel inside; got {mask.radius.numel()} shapes of radius "
            f"{mask.radius.tolist()}. Pass complexity_profile(mask, spatial_ndim=2) of one mask."
        )
    return mask


def distance_of(mask: Tensor, name: str = "mask") -> Tensor:
    """The chessboard distance of one image or volume that is not empty."""
    require_inside(mask, name)
    require_drawable(mask, name)
    return chessboard_distance(mask, spatial_ndim=mask.ndim)


def scale_slice(distance: Tensor) -> NDArray[np.float64]:
    """The scale t = d / D of an image, or of the slice of a volume through its deepest voxel."""
    return (distance.double() / distance.max())[deepest(distance)].numpy(force=True)


def silhouette(mask: Tensor, name: str = "mask") -> NDArray[np.bool_]:
    """An image, or the slice of a volume through its deepest voxel, cut to what is inside."""
    require_inside(mask, name)
    require_drawable(mask, name)
    place = deepest(chessboard_distance(mask, spatial_ndim=3)) if mask.ndim == 3 else ()
    inside: NDArray[np.bool_] = (mask[place] != 0).numpy(force=True)
    return inside[bounding_box(inside)]


def deepest(distance: Tensor) -> tuple[int, ...]:
    """The index of the slice to draw: none of an image, of a volume that of its deepest voxel."""
    return (int(distance.flatten(1).amax(dim=1).argmax()),) if distance.ndim == 3 else ()


def require_masks(masks: Mapping[str, Tensor]) -> None:
    """Raise unless it is a mapping that is not empty."""
    remedy = "Pass for example {'disc': shapes.disc(32)}."
    if not isinstance(masks, Mapping):
        raise TypeError(f"masks must map names to masks; got {type(masks).__name__}. {remedy}")
    if not masks:
        raise ValueError(f"masks must hold at least one mask; got none. {remedy}")


def require_inside(mask: Tensor, name: str) -> None:
    """Raise unless it is a mask with a pixel inside."""
    inside, _ = as_mask(mask, getattr(mask, "ndim", None), name)
    if not inside.any():
        raise ValueError(f"{name} must have at least one pixel inside; got an empty one. Leave it out.")


def require_drawable(mask: Tensor, name: str) -> None:
    """Raise unless it is an image or a volume."""
    if mask.ndim not in (2, 3):
        raise ValueError(
            f"{name} must be (H, W) or (D, H, W); got {tuple(mask.shape)}. Pass one shape, without a batch."
        )


def refuse_beside(options: Mapping[str, Any], given: str) -> None:
    """Raise if there are options for a measurement that is done already."""
    if options:
        name, value = next(iter(options.items()))
        raise ValueError(f"{name} must be left out beside a computed {given}; got {name}={value!r}. Leave it out.")
