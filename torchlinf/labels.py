"""Label maps to tables: one row per object, beside any of scikit-image's `regionprops_table`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from torchlinf._checks import MAX_SPATIAL_NDIM, positive, window
from torchlinf.measure import Measure, ragged_profile

__all__ = ["complexity_table"]

Box = tuple[slice, ...]
Windows = Mapping[str, tuple[float, float]]

LARGEST = 2**20  # find_objects makes a list as long as the largest label; beyond this, renumbering costs less
COLUMNS = ("label", "radius", "touches_frame", "error_bound")


def complexity_table(
    label_map: Tensor | ArrayLike,
    *,
    windows: Windows | None = None,
    properties: Sequence[str] = (),
    intensity_image: Tensor | ArrayLike | None = None,
    spacing: Sequence[float] | None = None,
    bins: int = 1024,
    estimator: str = "entropy",
    tol: float = 1e-9,
) -> dict[str, NDArray[Any]]:
    """Measure the complexity of every object of a label map.

    Every object is cropped to its own box and measured there, alone: what a neighbour or the size of the map is does
    not change its numbers. All pixels of one label are one object, connected or not.

    Args:
        label_map: (H, W) or (D, H, W), or any other number of dimensions from 1 to 4; integers, 0 is background, all
            else is the label of an object. Labels may be huge and have gaps; memory grows with the map alone.
        windows: windows of scales (low, high] by the names of their columns, 0 <= low < high <= 1; all of them come
            from one solve. None means one column "complexity" over all scales.
        properties: names of properties of `skimage.measure.regionprops_table`, such as "area", "eccentricity" or
            "centroid", whose columns stand beside; 2-D and 3-D only.
        intensity_image: for properties that need one, such as "intensity_mean"; as there.
        spacing: size of a pixel along each axis, for `properties` alone: the complexity counts in pixels.
        bins: as in `torchlinf.complexity`.
        estimator: "entropy" (bits) or "std" (share of the field's maximum), as there.
        tol: relative error the fields are certified to.

    Returns:
        Columns by name, each with one entry per object, in ascending order of the labels; none for a map without
        objects. `pandas.DataFrame` takes it as it is.

        - "label": as in the map, in its dtype.
        - the columns of `properties`, as scikit-image names them ("centroid-0", "centroid-1").
        - "radius": int64, largest chessboard distance to the outside of the object, pixels.
        - "complexity", or the names of `windows`: float64, bits (or share, for "std"). A box has exactly 0.0.
        - "touches_frame": bool, whether the object reaches the border of the map, so that part of it may be cut off.
        - "error_bound": float64, the certified relative error of the object's field.

    Not differentiable. The objects are measured on the CPU, on torch's number of threads.

    Raises:
        TypeError: the map is not of integers, or an argument is of the wrong type.
        ValueError: the map has a wrong rank or a negative label, or an argument a wrong value.
        AttributeError: scikit-image has no such property.
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020.

    Example:
        >>> label_map = np.zeros((12, 20), dtype=int)
        >>> label_map[2:8, 1:7] = 3  # a square
        >>> label_map[0:9, 10:19] = 70 * np.tri(9, dtype=int)  # a triangle
        >>> table = complexity_table(label_map, properties=["area"])
        >>> for name, column in table.items():
        ...     print(f"{name:13}", *column.tolist())
        label         3 70
        area          36.0 45.0
        radius        3 3
        complexity    0.0 1.161...
        touches_frame False True
        error_bound   ...
    """
    positive(tol, "tol")
    windows = {"complexity": (0.0, 1.0)} if windows is None else _windows(windows, properties)
    found = _label_map(label_map)
    numbered, boxes, names = _objects(found)
    objects = list(boxes.items())

    def crop(i: int) -> NDArray[np.bool_]:
        number, box = objects[i]
        inside: NDArray[np.bool_] = numbered[box] == number
        return inside

    profile = ragged_profile(crop, len(objects), Measure(bins=bins, estimator=estimator, tol=tol))
    return {
        "label": names,
        **_properties(numbered, properties, intensity_image, spacing),
        "radius": profile.radius.numpy(),
        **{name: profile.mean(*ends).numpy() for name, ends in windows.items()},
        "touches_frame": np.array([_touches(box, found.shape) for box in boxes.values()], dtype=np.bool_),
        "error_bound": profile.field_error_bound.numpy(),
    }


def _windows(windows: Windows, properties: Sequence[str]) -> Windows:
    taken = {*COLUMNS, *properties} & set(windows)
    if taken or not windows:
        raise ValueError(
            f"windows must name one column or more, other than {', '.join(COLUMNS)} and the properties; got "
            f"{list(windows)}. Pass for example windows={{'fine': (0.0, 0.25)}}."
        )
    return {name: window(*ends) for name, ends in windows.items()}


def _label_map(label_map: Tensor | ArrayLike) -> NDArray[Any]:
    found = label_map.numpy(force=True) if isinstance(label_map, Tensor) else np.asarray(label_map)
    if found.dtype.kind not in "iu":
        remedy = (
            "Number the components first, with skimage.measure.label(mask)"
            if found.dtype == np.bool_
            else "Pass label_map.astype(int)"
        )
        raise TypeError(f"label_map must hold integers; got {found.dtype}. {remedy}.")
    if not 1 <= found.ndim <= MAX_SPATIAL_NDIM:
        raise ValueError(
            f"label_map must have 1 to {MAX_SPATIAL_NDIM} dimensions; got {found.shape}. "
            "Pass one map at a time, without batch or channels."
        )
    if found.size and found.min() < 0:
        raise ValueError(
            f"label_map must hold no negative labels; got {found.min()}. "
            "Pass label_map.clip(0) if they mean background, or skimage.measure.label(label_map) for new labels."
        )
    return found


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


def _touches(box: Box, shape: tuple[int, ...]) -> bool:
    return any(side.start == 0 or side.stop == size for side, size in zip(box, shape, strict=True))


def _properties(
    numbered: NDArray[Any],
    properties: Sequence[str],
    intensity_image: Tensor | ArrayLike | None,
    spacing: Sequence[float] | None,
) -> dict[str, NDArray[Any]]:
    names = [name for name in properties if name != "label"]
    if not names:
        return {}
    from skimage.measure import regionprops_table

    if numbered.ndim not in (2, 3):
        raise ValueError(
            f"properties need a label_map of 2 or 3 dimensions; got {numbered.shape}. Leave properties empty."
        )
    if isinstance(intensity_image, Tensor):
        intensity_image = intensity_image.numpy(force=True)
    spacing = None if spacing is None else tuple(spacing)
    table: dict[str, NDArray[Any]] = regionprops_table(  # type: ignore[no-untyped-call]
        numbered, intensity_image, properties=names, spacing=spacing
    )
    return table
