"""The objects of masks, and shapes in their own frames: a mask becomes parts, and their numbers become one.

A part is one shape in one frame: an object of a mask, or all of it; along the grid's axes, or turned. Each part goes
through the plain pipeline alone. So nothing depends on what else is in a mask or a batch.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from math import prod
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.checks import positive_tensor
from torchlinf.kernels import has_compiler
from torchlinf.measure.frames import in_own_frame, turned
from torchlinf.measure.levels import Levels, MaskAt, levels_of_each
from torchlinf.measure.options import SEVERAL, Measure
from torchlinf.measure.profile import ComplexityProfile, Parts, profile_of_levels

AT_A_TIME = 2**22  # pixels whose components are known at a time: four bytes each

Grid = tuple[Tensor, Tensor]
Batch = tuple[MaskAt, Sequence[int]]  # shapes, and the numbers of the masks that they are of


@dataclass(frozen=True, eq=False)
class Component:
    """A connected component of a mask.

    Attributes:
        box: one slice an axis, the smallest box that holds it.
        pixels: how many it has.
        numbers: of the size of the box, the numbers of all components in it.
        number: its own.
    """

    box: tuple[slice, ...]
    pixels: int
    numbers: NDArray[np.int32]
    number: int

    def mask(self) -> NDArray[np.bool_]:
        """The component alone, bool, of the size of its box."""
        inside: NDArray[np.bool_] = self.numbers == self.number
        return inside


def components(mask: NDArray[np.bool_], *, connectivity: int | None = None, min_pixels: int = 1) -> list[Component]:
    """The connected components of a mask, in the order of their first pixels.

    Args:
        mask: bool, of 1 to 4 dimensions.
        connectivity: along how many axes neighbours may differ, 1 for a common face; None for all that touch.
        min_pixels: components of fewer pixels are left out.

    Returns:
        The components; none of an empty mask.

    Raises:
        ValueError: `connectivity` is more than the mask has dimensions.

    Example:
        >>> mask = np.array([[1, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=bool)
        >>> [one.pixels for one in components(mask)]
        [4]
        >>> [one.box for one in components(mask, connectivity=1, min_pixels=2)]
        [(slice(0, 1, None), slice(0, 2, None))]
    """
    from scipy import ndimage

    require_connectivity(connectivity, mask.ndim)
    outer = bounding_box(mask)
    if not mask[outer].size:
        return []
    structure = ndimage.generate_binary_structure(mask.ndim, connectivity or mask.ndim)
    numbers, _ = ndimage.label(mask[outer], structure)
    pixels = np.bincount(numbers.ravel()).tolist()
    found = []
    for number, box in enumerate(ndimage.find_objects(numbers), start=1):
        if pixels[number] >= min_pixels:
            place = tuple(slice(o.start + b.start, o.start + b.stop) for o, b in zip(outer, box, strict=True))
            found.append(Component(place, pixels[number], numbers[box], number))
    return found


def require_connectivity(connectivity: int | None, ndim: int) -> None:
    """Raise if pixels of so many dimensions have no such neighbours."""
    if connectivity is not None and connectivity > ndim:
        raise ValueError(
            f"connectivity must be at most the number of spatial dimensions, {ndim}; got {connectivity}. "
            "Pass None for all pixels that touch."
        )


def require_frame(measure: Measure, ndim: int) -> None:
    """Raise if shapes of so many dimensions cannot be turned as the measure says."""
    orientation = measure.orientation
    if ndim == 2 and orientation is not None and not has_compiler():
        raise ImportError(
            "orientation turns images by kernels that numba compiles, which is not installed. Run: pip install numba"
        )
    if orientation is None or ndim == (3 if isinstance(orientation, tuple) else 2):
        return
    if isinstance(orientation, tuple):
        raise ValueError(
            f"orientation must not be a 3 x 3 matrix for masks of {ndim} dimensions; got one. "
            "Pass spatial_ndim=3 for volumes, degrees for images."
        )
    remedy = "Pass a 3 x 3 rotation matrix." if ndim == 3 else "Pass None."
    raise ValueError(f"orientation must be None for masks of {ndim} dimensions; got {orientation!r}. {remedy}")


def rotations_of(measure: Measure) -> int:
    """How many frames every shape is measured in."""
    return measure.rotations if measure.orientation in SEVERAL else 1


def in_frame(shape: NDArray[np.bool_], measure: Measure, number: int) -> tuple[NDArray[np.bool_], float]:
    """A shape turned as the measure asks for, and by how many degrees.

    Args:
        shape: bool, cropped to its box, with a pixel inside.
        measure: its `orientation` and `rotations` are used.
        number: which of its `rotations_of(measure)` frames.

    Returns:
        The turned shape, cropped; as it was where no pixel would be left. The angle is NaN for a matrix.

    Example:
        >>> in_frame(np.eye(3, dtype=bool), Measure(orientation="mean", rotations=2), 1)[1]
        45.0
    """
    orientation = measure.orientation
    if orientation is None:
        return shape, 0.0
    if isinstance(orientation, tuple):
        found, angle = turned(shape, orientation), float("nan")
    else:
        angle = number * 90 / measure.rotations if isinstance(orientation, str) else orientation
        found, angle = in_own_frame(shape) if orientation == "own" else (turned(shape, angle), angle)
    return (found, angle) if found.size else (shape, 0.0)


def profile_of_parts(
    mask_at: MaskAt, lead: tuple[int, ...], measure: Measure, grid: Grid | None = None
) -> ComplexityProfile:
    """What `ragged_profile` gives, for a measure that is not plain; on the CPU.

    Args:
        mask_at: the i-th mask, a bool array, called on several threads.
        lead: leading shape of the profile; its product is how many masks there are.
        measure: how complexity is measured.
        grid: what `scale_grid` gives, None its default.

    Raises:
        ValueError: masks of this many dimensions cannot be measured like this.
        RuntimeError: a field could not be solved.

    Example:
        >>> mask = np.array([[1, 1, 0, 1], [1, 1, 0, 1]], dtype=bool)
        >>> profile = profile_of_parts([mask].__getitem__, (1,), Measure(per="object"))
        >>> profile.objects, profile.mean()
        (tensor([2]), tensor([0.], dtype=torch.float64))
    """
    count = prod(lead)
    ndim = mask_at(0).ndim if count else 0
    if count:
        require_frame(measure, ndim)
        require_connectivity(measure.connectivity, ndim)
    rho = measure.rho
    rhos = positive_tensor(rho, lead, "rho").flatten().tolist() if isinstance(rho, Tensor) else None
    if measure.per == "mask":
        return _in_frames([(mask_at, range(count))], rhos, measure, lead, grid)
    found = _Found()
    alone = _in_frames(_batches(mask_at, count, measure, found), rhos, measure.of_objects(), None, grid)
    pixels = _integers(found.pixels)
    parts = Parts(
        profile=alone,
        owner=_integers(found.owner),
        weight=pixels if measure.pool == "area" else torch.ones_like(pixels),
        pixels=pixels,
        box=_integers(found.boxes).reshape(len(pixels), ndim, 2),
    )
    return pooled(parts, lead, measure)


class _Found:
    """What is kept of the objects once their masks are gone."""

    def __init__(self) -> None:
        self.owner: list[int] = []
        self.pixels: list[int] = []
        self.boxes: list[list[list[int]]] = []


def _batches(mask_at: MaskAt, count: int, measure: Measure, found: _Found) -> Iterator[Batch]:
    """The objects of the masks, of so many masks at a time as memory allows."""
    waiting: list[Component] = []
    masks: list[int] = []
    size = 0
    for i in range(count):
        mask = mask_at(i)
        here = components(mask, connectivity=measure.connectivity, min_pixels=measure.min_pixels)
        waiting += here
        masks += [i] * len(here)
        found.pixels += [one.pixels for one in here]
        found.boxes += [[[side.start, side.stop] for side in one.box] for one in here]
        size += mask.size
        found.owner += [i] * len(here)
        if size >= AT_A_TIME:
            yield _masks_of(waiting), masks
            waiting, masks, size = [], [], 0
    yield _masks_of(waiting), masks


def _masks_of(objects: list[Component]) -> MaskAt:
    return lambda i: objects[i].mask()


def _in_frames(
    batches: Iterable[Batch],
    rhos: Sequence[float] | None,
    measure: Measure,
    lead: tuple[int, ...] | None,
    grid: Grid | None,
) -> ComplexityProfile:
    """The profile of shapes, each in the frames that the measure asks for.

    Args:
        batches: shapes, and the numbers of the masks that they are of.
        rhos: screening length of each mask; None if it is that of the measure.
        measure: how each shape is measured.
        lead: leading shape of the profile; None for one dimension.
        grid: what `scale_grid` gives.
    """
    several = rotations_of(measure)
    levels, turns, lengths = [], [np.zeros(0)], [np.zeros(0)]
    for shape_at, masks in batches:
        turned_by = np.zeros(len(masks) * several)
        rho: Any = measure.rho
        if rhos is not None:
            lengths.append(np.array([rhos[i] for i in masks for _ in range(several)], dtype=np.float64))
            rho = torch.from_numpy(lengths[-1])
        levels.append(_solved(shape_at, turned_by, replace(measure.plain(), rho=rho), measure))
        turns.append(turned_by)
    found, angle, count = _joined(levels), torch.from_numpy(np.concatenate(turns)), len(np.concatenate(turns))
    length: Any = measure.rho if rhos is None else torch.from_numpy(np.concatenate(lengths))
    whole = (count // several,) if lead is None else lead
    if rhos is not None and lead is None:
        measure = replace(measure, rho=length[::several])
    has_angle = measure.orientation is not None and not isinstance(measure.orientation, tuple)
    if measure.orientation not in SEVERAL:
        profile = profile_of_levels(found, whole, measure, grid)
        return replace(profile, angle=angle.reshape(whole)) if has_angle else profile
    each = replace(profile_of_levels(found, (count,), replace(measure.plain(), rho=length), grid), angle=angle)
    first = np.arange(0, count, several)
    if measure.orientation == "mean":
        owner = torch.from_numpy(np.arange(count) // several)
        return pooled(Parts(each, owner, torch.from_numpy(np.ones(count, np.int64)), None, None), whole, measure)
    means = np.nan_to_num(each.mean(measure.low, measure.high).numpy(), nan=np.inf).reshape(-1, several)
    least = torch.from_numpy(first + means.argmin(axis=1) if count else first).reshape(whole)
    seconds = torch.from_numpy(each.seconds.numpy().reshape(-1, several).sum(axis=1)).reshape(whole)
    return replace(each[least], measure=measure, seconds=seconds)


def _solved(shape_at: MaskAt, turns: NDArray[np.float64], plain: Measure, measure: Measure) -> Levels:
    """The levels of every shape in each of its frames; fills in by how many degrees each is turned."""
    several = rotations_of(measure)

    def part_at(i: int) -> NDArray[np.bool_]:
        shape = shape_at(i // several)
        shape = shape[bounding_box(shape)]
        if shape.size:
            shape, turns[i] = in_frame(shape, measure, i % several)
        return shape

    return levels_of_each(part_at, len(turns), (len(turns),), plain)


def pooled(parts: Parts, lead: tuple[int, ...], measure: Measure) -> ComplexityProfile:
    """The profile that is the mean of parts, of the leading shape `lead`."""
    count, each = prod(lead), parts.profile
    none = each.level_values.new_zeros(0)
    return ComplexityProfile(
        scales=each.scales,
        values=torch.from_numpy(parts.pooled(each.values.numpy(), count)).reshape(*lead, len(each.scales)),
        radius=parts.largest(each.radius, count).reshape(lead),
        field_error_bound=parts.largest(each.field_error_bound, count).reshape(lead),
        level_values=none,
        level_error_bound=none,
        measure=measure,
        seconds=parts.total(each.seconds, count).reshape(lead),
        parts=parts,
    )


def _joined(levels: list[Levels]) -> Levels:
    if len(levels) == 1:
        return levels[0]
    names = [one.name for one in fields(Levels)]
    return Levels(
        **{name: torch.from_numpy(np.concatenate([getattr(one, name).numpy() for one in levels])) for name in names}
    )


def _integers(values: Sequence[Any]) -> Tensor:
    return torch.tensor(values, dtype=torch.int64, device="cpu")
