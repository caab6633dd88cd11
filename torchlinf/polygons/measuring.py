"""The numbers of outlines that are drawn: of each alone, and of all polygons of one geometry together."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from torchlinf.measure import ComplexityProfile, Measure, ragged_profile, smallest_rectangle
from torchlinf.polygons.drawing import Edges, TooLargeError, draw, draw_at_radius, edges_of, turn

NOTHING = np.zeros((1, 1), dtype=np.bool_)
# Columns of no table.
BY_ROTATION, DRAWN = "by rotation", "drawn"

Column = NDArray[Any]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Drawing:
    """How large a pixel is.

    Attributes:
        resolution: side of a pixel, in the unit of the coordinates; None if `pixels_per_radius` says it.
        pixels_per_radius: the radius that every drawing is to have, or None.
        max_pixels: of a drawing.
    """

    resolution: float | None
    pixels_per_radius: int | None
    max_pixels: int

    def of(self, ends: NDArray[np.float64]) -> tuple[Mask, float]:
        """Draw the edges of a polygon; the mask, and its resolution."""
        if self.pixels_per_radius is not None:
            return draw_at_radius(ends, self.pixels_per_radius, self.max_pixels)
        assert self.resolution is not None
        return draw(ends, self.resolution, self.max_pixels), self.resolution


def measured(shapes: Column, broken: Column, drawing: Drawing, measure: Measure) -> dict[str, Column]:
    """Draw and measure shapes, each as one.

    Args:
        shapes: (N,) shapely polygons and multipolygons, None where `broken` says why.
        broken: (N,) texts, None for the others.
        drawing: how large a pixel is.
        measure: how complexity is measured, with its frame.

    Returns:
        The columns from "area" to "error", (N,) each; `DRAWN`, whether there was a drawing, if without a pixel; with
        orientation="mean" also `BY_ROTATION`, the complexities (N, windows, rotations).
    """
    import shapely

    edges, errors = edges_of(shapes), broken.copy()
    angles = angles_of(edges, len(shapes), measure)
    count, rotations = angles.shape
    pixels = np.zeros((count, rotations), dtype=np.int64)
    sides = np.full((count, rotations), np.nan)

    def draw_one(k: int) -> Mask:
        i, j = divmod(k, rotations)
        if errors[i] is not None:
            return NOTHING
        try:
            mask, sides[i, j] = drawing.of(turn(edges[i], angles[i, j]))
        except TooLargeError as error:
            errors[i] = str(error)
            return NOTHING
        pixels[i, j] = np.count_nonzero(mask)
        return mask if pixels[i, j] else NOTHING

    solved = _solved(draw_one, count * rotations, measure)
    numbers = {name: column.reshape(count, rotations) for name, column in solved.items() if name != "error"}
    unsolved = solved["error"].reshape(count, rotations)
    found = _of_one(numbers | {"angle": angles, "resolution": sides}, measure)
    # Of the rotations that "least" tries, one with pixels is enough.
    drawn = np.count_nonzero(pixels, axis=1) >= (1 if measure.orientation == "least" else rotations)
    bounds = shapely.bounds(shapes)
    for i in range(count):
        failures = [text for text in unsolved[i] if text is not None]
        if errors[i] is None and failures:
            errors[i] = failures[0]
        elif errors[i] is None and not drawn[i]:
            errors[i] = too_small(sides[i, 0], bounds[i])
    failed = np.array([error is not None for error in errors], dtype=np.bool_)
    for name, column in found.items():
        if name != "seconds":
            column[failed] = 0 if column.dtype.kind == "i" else np.nan
    found |= {"area": shapely.area(shapes), "pixels": pixels[:, 0], "error": errors, DRAWN: ~np.isnan(sides[:, 0])}
    return found


def pooled(
    found: Mapping[str, Column], owner: NDArray[np.int64], chosen: Mask, count: int, pool: str
) -> dict[str, Column]:
    """One row a geometry of the rows of its polygons.

    Args:
        found: the columns that `measured` gives of the polygons.
        owner: the geometry of each, ascending; every geometry has at least one row.
        chosen: which rows are large enough to count.
        count: how many geometries there are.
        pool: "mean", each polygon counts the same; or "area", each counts as its area.

    Returns:
        The columns of `found`, and "objects", (count,) each. A geometry without a polygon that could be measured has
        the first of their errors.
    """
    good = chosen & np.array([error is None for error in found["error"]], dtype=np.bool_)
    weight = np.where(good, found["area"] if pool == "area" else 1.0, 0.0)
    total = np.bincount(owner, weight, count)
    objects = np.bincount(owner[good], minlength=count)

    def sums(column: Column) -> Column:
        return np.bincount(owner[good], column[good], count)

    def common(column: Column) -> Column:
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(low, owner[good], column[good])
        np.maximum.at(high, owner[good], column[good])
        return np.where(low == high, low, np.nan)

    def largest(column: Column) -> Column:
        most = np.zeros(count, dtype=column.dtype)
        np.maximum.at(most, owner[good], column[good])
        return most

    rows: dict[str, Column] = {"objects": objects}
    for name, column in found.items():
        if name == "error":
            rows[name] = np.full(count, None)
            for i in np.flatnonzero(objects[owner] == 0)[::-1]:
                rows[name][owner[i]] = column[i] or "every polygon has fewer pixels than min_pixels"
        elif name in ("area", "seconds"):
            rows[name] = np.bincount(owner, column, count)
        elif name == "pixels":
            rows[name] = sums(column).astype(np.int64)
        elif name in ("angle", "resolution"):
            rows[name] = common(column)
        elif name in ("radius", "field_error_bound"):
            rows[name] = largest(column)
        elif name == BY_ROTATION:
            whole = np.zeros((count, *column.shape[1:]))
            np.add.at(whole, owner[good], weight[good, None, None] * column[good])
            rows["standard_error"] = _standard_error(whole / np.where(objects, total, np.nan)[:, None, None])
        elif name not in ("standard_error", DRAWN):
            rows[name] = sums(weight * column) / np.where(objects, total, np.nan)
    rows["field_error_bound"][objects == 0] = np.nan
    return rows


def angles_of(edges: Edges, count: int, measure: Measure) -> NDArray[np.float64]:
    """(N, rotations) degrees that each outline is turned by, once or several times."""
    orientation = measure.orientation
    if orientation == "own":
        own = [smallest_rectangle(hull).angle if len(hull) else 0.0 for hull in edges.hulls]
        return np.array(own, dtype=np.float64).reshape(count, 1)
    if isinstance(orientation, str):
        return np.tile(np.arange(measure.rotations) * (90 / measure.rotations), (count, 1))
    return np.full((count, 1), orientation or 0.0, dtype=np.float64)


def _solved(draw_one: Callable[[int], Mask], count: int, measure: Measure) -> dict[str, Column]:
    """The numbers of drawings, all in one go; if a field cannot be solved, one by one, so that the others go on."""
    plain = measure.plain()
    try:
        found = _numbers(ragged_profile(draw_one, count, plain), measure)
        return found | {"error": np.full(count, None)}
    except RuntimeError:
        rows = [_alone(draw_one, k, plain, measure) for k in range(count)]
        return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}


def _alone(draw_one: Callable[[int], Mask], k: int, plain: Measure, measure: Measure) -> dict[str, Column]:
    try:
        found = _numbers(ragged_profile(lambda _: draw_one(k), 1, plain), measure)
        return found | {"error": np.array([None])}
    except RuntimeError as error:
        found = _numbers(ragged_profile(lambda _: NOTHING, 1, plain), measure)
        return found | {"error": np.array([f"{type(error).__name__}: {error}"], dtype=object)}


def _numbers(profile: ComplexityProfile, measure: Measure) -> dict[str, Column]:
    windows = measure.named_windows()
    bounds = torch.stack([profile.error_bound(*ends) for ends in windows.values()]).amax(dim=0)
    numbers: dict[str, Column] = {
        "radius": profile.radius.numpy(),
        **{name: profile.mean(*ends).numpy() for name, ends in windows.items()},
        "error_bound": bounds.numpy(),
        "field_error_bound": profile.field_error_bound.numpy(),
        "seconds": profile.seconds.numpy(),
    }
    if measure.orientation == "least":
        numbers["chosen by"] = profile.mean(measure.low, measure.high).numpy()
    return numbers


def _of_one(numbers: dict[str, Column], measure: Measure) -> dict[str, Column]:
    """One number an outline of those (N, rotations) of its drawings."""
    found: dict[str, Column] = {}
    if measure.orientation == "least":
        by = numbers.pop("chosen by")
        least = np.argmin(np.where(np.isnan(by), np.inf, by), axis=1)[:, None]
        found = {name: np.take_along_axis(column, least, axis=1)[:, 0] for name, column in numbers.items()}
    elif measure.orientation == "mean":
        for name, column in numbers.items():
            if name in ("radius", "field_error_bound"):
                found[name] = column.max(axis=1)
            elif name in ("angle", "resolution"):
                same = (column == column[:, :1]).all(axis=1)
                found[name] = np.where(same, column[:, 0], np.nan)
            elif name != "seconds":
                found[name] = column.mean(axis=1)
        del found["angle"]
        found[BY_ROTATION] = np.stack([numbers[name] for name in measure.named_windows()], axis=1)
        found["standard_error"] = _standard_error(found[BY_ROTATION])
    else:
        found = {name: column[:, 0].copy() for name, column in numbers.items()}
    found["seconds"] = numbers["seconds"].sum(axis=1)
    return found


def _standard_error(by_rotation: Column) -> Column:
    """(N,) of complexities (N, windows, rotations), the largest of the windows; NaN for one rotation."""
    rotations = by_rotation.shape[2]
    if rotations == 1:
        return np.full(len(by_rotation), np.nan)
    errors: Column = by_rotation.std(axis=2, ddof=1).max(axis=1) / np.sqrt(rotations)
    return errors


def too_small(resolution: float, bounds: Column) -> str:
    """No pixel is inside: the outline is too small, perhaps since its unit is another one than meant."""
    text = f"no pixel's centre is inside at a resolution of {resolution:g}; pass a finer one"
    if (np.abs(bounds) <= (180, 90, 180, 90)).all():
        text += ", or if the coordinates are degrees, project them to metres first"
    return text
