"""Label maps to tables: one row per object, beside any of scikit-image's `regionprops_table`."""

from collections.abc import Iterable, Sequence
from typing import Any, Unpack

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from torchlinf import __version__
from torchlinf._helpers.axes import image_shape
from torchlinf._helpers.checks import number_of_axes
from torchlinf.measure import (
    ComplexityProfile,
    Measure,
    MeasureOptions,
    checked_spacing,
    components,
    equal_spacing,
    ragged_profile,
    require_connectivity,
    require_frame,
    spacing_words,
    takes,
)  # fmt: skip

__all__ = ["complexity_table"]

Box = tuple[slice, ...]
LARGEST = 2**20  # find_objects makes a list as long as the largest label; beyond this, renumbering costs less
COLUMNS = (
    "label",
    "object",
    "objects",
    "radius",
    "angle",
    "standard_error",
    "touches_border",
    "error_bound",
    "field_error_bound",
    "seconds",
    "version",
    "measure",
    "spacing",
)


@takes(MeasureOptions)
def complexity_table(
    label_map: Tensor | ArrayLike,
    *,
    properties: Sequence[str] = (),
    intensity_image: Tensor | ArrayLike | None = None,
    spacing: Sequence[float] | None = None,
    voxel: float | None = None,
    spatial_ndim: int | None = None,
    **options: Unpack[MeasureOptions],
) -> dict[str, NDArray[Any]]:
    """Measure the complexity of every object of a label map.

    Every object is cropped to its own box and measured there, alone: what a neighbour or the size of the map is does
    not change its numbers. All pixels of one label are one object, connected or not; with `per="object"` each connected
    component of a label is one.

    Args:
        label_map: (H, W), or any number of dimensions from 1 to 4 that `spatial_ndim` names; integers, 0 is background,
            all else is the label of an object; masked pixels of a masked array are background. Labels may be huge and
            have gaps; memory grows with the map alone. Axes of length 1 before and behind the map, as in (1, H, W) and
            (H, W, 1), are dropped.
        properties: names of properties of `skimage.measure.regionprops_table`, such as "area", "eccentricity" or
            "centroid", whose columns stand beside; 2-D and 3-D only.
        intensity_image: like the map, or with a last dimension of channels, for properties that need it, such as
            "intensity_mean".
        spacing: size of a pixel along each axis, in any one unit. Where the sizes differ, every object is brought to
            squares or cubes before it is measured: see `torchlinf.equal_spacing`. `properties` take it as they are.
            None measures the pixels as squares.
        voxel: size of the cubes, in the unit of `spacing`; None takes the finest. Objects that are thinner than it may
            vanish.
        spatial_ndim: dimensions of the map: 3 for a volume (D, H, W), also for one that is a voxel thick. None means an
            image or a line; then three axes raise, since they may be a volume, a stack of maps, or colours.
        {measure options}
            Here rho must be None or one number, not a tensor.

    Returns:
        Columns by name, each with one entry per object, in ascending order of the labels; a map without objects gives
        the same columns with no entries. No object is empty, so no value is NaN. `pandas.DataFrame` takes the columns
        as they are. With `per="object"` there is one entry per component, and the columns of `properties` are those of
        the components; with `pool` too, one per label, NaN where no component has `min_pixels`.

        - "label": as in the map, in its dtype.
        - "object": int64, with `per="object"` alone: the number of the component within its label, from 1.
        - "objects": int64, with `pool` alone: how many components the label has.
        - the columns of `properties`, as scikit-image names them ("centroid-0", "centroid-1").
        - "radius": int64, largest chessboard distance to the outside of the object, pixels, or the cubes of `spacing`;
          after the turn, if there is one.
        - "angle": float64, with an `orientation` in degrees, "own" or "least" alone: degrees that the object was turned
          by, counter-clockwise; NaN where `pool` makes one of several.
        - "complexity", or the names of `windows`: float64, bits (or share, for "std"). A box has exactly 0.0.
        - "touches_border": bool, whether the object reaches the border of the map, so that part of it may be cut off.
        - "error_bound": float64, how far any of the object's complexities can be from that of the exact field, proven;
          see `ComplexityProfile.error_bound`.
        - "standard_error": float64, with orientation="mean" alone: the largest of the complexities' standard errors;
          see `ComplexityProfile.standard_error`.
        - "field_error_bound": float64, the certified relative error of the object's field.
        - "seconds": float64, the time that the object took.
        - "version" and "measure": the version of torchlinf and `Measure.settings()`, in every row, so that rows of
          several tables can stand in one.
        - "spacing", if it is given: what it was and what was measured, as "3 x 0.9 x 0.9 in cubes of 0.9".

    Not differentiable. The objects are measured on the CPU, on torch's number of threads.

    Raises:
        TypeError: the map is not of integers, or an argument is of the wrong type.
        ValueError: the map has a wrong rank, a rank that `spatial_ndim` does not explain, or a negative label; an
            argument has a wrong value, such as the name of a property that scikit-image does not have; or an object
            would have too many cubes, or none at all.
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020.

    Example:
        >>> label_map = np.zeros((12, 20), dtype=int)
        >>> label_map[2:8, 1:7] = 3  # a square
        >>> label_map[0:9, 10:19] = 70 * np.tri(9, dtype=int)  # a triangle
        >>> table = complexity_table(label_map, properties=["area"])
        >>> for name in ("label", "area", "radius", "complexity", "touches_border"):
        ...     print(f"{name:14}", *table[name].tolist())
        label          3 70
        area           36.0 45.0
        radius         3 3
        complexity     0.0 1.161...
        touches_border False True
    """
    measure = Measure.of(options, MeasureOptions)
    measure.scalar_rho()
    whole = _label_map(label_map)
    axes = None if spatial_ndim is None else number_of_axes(spatial_ndim)
    labels = whole.reshape(image_shape(whole.shape, axes, "label_map"))
    sizes = None if spacing is None else _sizes(spacing, labels.ndim)
    if voxel is not None and sizes is None:
        raise ValueError(f"voxel must stand beside spacing; got voxel={voxel} alone. Pass spacing=(1.0, 1.0) too.")
    require_connectivity(measure.connectivity, labels.ndim)
    require_frame(measure, labels.ndim)
    numbered, boxes, names = _objects(labels)
    one_row_an_object = measure.per == "object" and measure.pool is None
    of_label = np.arange(len(names))
    if one_row_an_object:
        numbered, boxes, of_label = _components(numbered, boxes, measure)
    beside = _properties(numbered, whole.shape, _names(properties), intensity_image, sizes)
    windows = measure.windows_beside({*COLUMNS, *beside})
    objects = list(boxes.items())

    def crop(i: int) -> NDArray[np.bool_]:
        number, box = objects[i]
        inside: NDArray[np.bool_] = numbered[box] == number
        if sizes is None:
            return inside
        cubes = equal_spacing(inside, sizes, voxel=voxel)
        if not cubes.any():
            raise ValueError(
                f"voxel must leave something of every object; got {voxel}, and nothing is left of label "
                f"{names[of_label[i]]}. Pass a smaller voxel."
            )
        return cubes

    profile = ragged_profile(crop, len(objects), measure.of_objects() if one_row_an_object else measure)
    ends = windows.values()
    return {
        "label": names[of_label],
        **_counts(profile, of_label, measure),
        **beside,
        "radius": profile.radius.numpy(),
        **_angles(profile),
        **{name: profile.mean(*one).numpy() for name, one in windows.items()},
        "touches_border": np.array([_touches(box, labels.shape) for box in boxes.values()], dtype=np.bool_),
        "error_bound": torch.stack([profile.error_bound(*one) for one in ends]).amax(dim=0).numpy(),
        **_standard_errors(profile, ends),
        "field_error_bound": profile.field_error_bound.numpy(),
        "seconds": profile.seconds.numpy(),
        "version": np.full(len(objects), __version__),
        "measure": np.full(len(objects), measure.settings()),
        **({} if sizes is None else {"spacing": np.full(len(objects), spacing_words(sizes, voxel))}),
    }


def _label_map(label_map: Tensor | ArrayLike) -> NDArray[Any]:
    if np.ma.isMaskedArray(label_map):
        label_map = np.ma.filled(label_map, 0)  # what is masked is background
    labels = label_map.numpy(force=True) if isinstance(label_map, Tensor) else np.asarray(label_map)
    if labels.dtype.kind not in "iu":
        remedy = (
            "Number the components first, with skimage.measure.label(mask)"
            if labels.dtype == np.bool_
            else "Pass label_map.astype(int)"
        )
        raise TypeError(f"label_map must hold integers; got {labels.dtype}. {remedy}.")
    if labels.size and labels.min() < 0:
        raise ValueError(
            f"label_map must hold no negative labels; got {labels.min()}. "
            "Pass label_map.clip(0) if they mean background, or skimage.measure.label(label_map) for new labels."
        )
    return labels


def _objects(label_map: NDArray[Any]) -> tuple[NDArray[Any], dict[int, Box], NDArray[Any]]:
    """A map with labels small enough for tables, the box of each of its labels, and what these are called."""
    from scipy.ndimage import find_objects
    from skimage.segmentation import relabel_sequential

    if not label_map.size:
        return label_map, {}, label_map.reshape(-1)
    usable = np.require(label_map, label_map.dtype.newbyteorder("="), ["C", "W"])  # the compiled code is particular
    names = None
    if usable.max() > LARGEST:
        usable, _, back = relabel_sequential(usable)  # type: ignore[no-untyped-call]
        usable, names = usable.astype(np.int32, copy=False), back.out_values[back.out_values != 0]
    boxes = {number: box for number, box in enumerate(find_objects(usable), start=1) if box is not None}
    labels = np.fromiter(boxes, dtype=np.int64) if names is None else names
    return usable, boxes, labels.astype(label_map.dtype)


def _sizes(spacing: Sequence[float], ndim: int) -> tuple[float, ...]:
    sizes = checked_spacing(spacing)
    if len(sizes) != ndim:
        raise ValueError(
            f"spacing must hold one number for each of the {ndim} axes; got {spacing!r}. Pass for example (0.5, 0.5)."
        )
    return sizes


def _components(
    numbered: NDArray[Any], boxes: dict[int, Box], measure: Measure
) -> tuple[NDArray[Any], dict[int, Box], NDArray[np.int64]]:
    """The same for the components: a map of their numbers, their boxes, and the place of the label of each."""
    found = np.zeros(numbered.shape, dtype=np.int32)
    places: dict[int, Box] = {}
    of_label = []
    for label, (number, box) in enumerate(boxes.items()):
        inside = numbered[box] == number
        for one in components(inside, connectivity=measure.connectivity, min_pixels=measure.min_pixels):
            place = tuple(
                slice(outer.start + side.start, outer.start + side.stop)
                for outer, side in zip(box, one.box, strict=True)
            )
            places[len(places) + 1] = place
            found[place][one.mask()] = len(places)
            of_label.append(label)
    return found, places, np.array(of_label, dtype=np.int64)


def _counts(profile: ComplexityProfile, of_label: NDArray[np.int64], measure: Measure) -> dict[str, NDArray[Any]]:
    """The number of the object in its label, or how many objects a label has."""
    if measure.per == "mask":
        return {}
    if measure.pool is not None:
        return {"objects": profile.objects.numpy()}
    return {"object": np.arange(len(of_label)) - np.searchsorted(of_label, of_label) + 1}


def _angles(profile: ComplexityProfile) -> dict[str, NDArray[Any]]:
    if profile.measure.orientation in (None, "mean") or isinstance(profile.measure.orientation, tuple):
        return {}
    angle = torch.full(profile.radius.shape, torch.nan) if profile.angle is None else profile.angle
    return {"angle": angle.double().numpy()}


def _standard_errors(profile: ComplexityProfile, windows: Iterable[tuple[float, float]]) -> dict[str, NDArray[Any]]:
    if profile.measure.orientation != "mean":
        return {}
    errors = torch.stack([profile.standard_error(*ends) for ends in windows])
    return {"standard_error": errors.amax(dim=0).numpy()}


def _touches(box: Box, shape: tuple[int, ...]) -> bool:
    return any(side.start == 0 or side.stop == size for side, size in zip(box, shape, strict=True))


def _names(properties: Sequence[str]) -> list[str]:
    if hasattr(properties, "tolist"):  # an array, or the columns of a table
        properties = properties.tolist()
    if (
        isinstance(properties, str)
        or not isinstance(properties, Sequence)
        or not all(isinstance(name, str) for name in properties)
    ):
        raise TypeError(f"properties must be a list of names; got {properties!r}. Pass for example ['area'].")
    return [name for name in properties if name != "label"]


def _properties(
    numbered: NDArray[Any],
    given: tuple[int, ...],
    names: list[str],
    intensity_image: Tensor | ArrayLike | None,
    spacing: Sequence[float] | None,
) -> dict[str, NDArray[Any]]:
    if isinstance(intensity_image, Tensor):
        intensity_image = intensity_image.numpy(force=True)
    elif np.ma.isMaskedArray(intensity_image) and np.ma.getmaskarray(intensity_image).any():
        raise ValueError(
            "intensity_image must have no masked pixels; got some. Set label_map to 0 there, and pass "
            "intensity_image.data."
        )
    elif intensity_image is not None:
        intensity_image = np.asarray(intensity_image)
    if intensity_image is not None and np.shape(intensity_image) == given:
        intensity_image = np.reshape(intensity_image, numbered.shape)  # without the axes that the map was given with
    if intensity_image is not None and np.shape(intensity_image)[: numbered.ndim] != numbered.shape:
        raise ValueError(
            f"intensity_image must have the shape of label_map, {numbered.shape}; got {np.shape(intensity_image)}. "
            "Resize one of them."
        )
    if not names:
        return {}
    from skimage.measure import regionprops_table

    if numbered.ndim not in (2, 3):
        raise ValueError(
            f"properties need a label_map of 2 or 3 dimensions; got {numbered.shape}. Leave properties empty."
        )
    try:
        table: dict[str, NDArray[Any]] = regionprops_table(  # type: ignore[no-untyped-call]
            numbered, intensity_image, properties=names, spacing=spacing
        )
    except AttributeError as error:
        raise ValueError(
            f"properties must be names that regionprops_table of scikit-image knows, and intensity_image stand beside "
            f"those of intensity; got {names}: {error}. Pass for example ['area', 'solidity']."
        ) from error
    return table
