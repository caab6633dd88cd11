"""Grids of points at which a classifier is asked: a box of its input space, or a plane through three data points."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from torchlinf._helpers.checks import MAX_SPATIAL_NDIM, count, not_negative

FLAT = 1e-6  # height of a triangle as a share of its longest side below which it spans no plane: rounding in float32

Bounds = Sequence[tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane through three data points, with coordinates in the unit of the input space.

    The first axis runs along the longest side of the triangle. The second is perpendicular to it, towards the third
    point. So the order of the points only decides which end of that side is the origin.

    Attributes:
        origin: (*features) float64, the point with the coordinates (0, 0).
        directions: (2, *features) float64, of length 1 and perpendicular to each other.
        corners: (3, 2) float64, coordinates of the three points, in the order they came in.

    Example:
        >>> Plane.through(torch.tensor([[0.0, 0.0, 5.0], [3.0, 0.0, 5.0], [0.0, 4.0, 5.0]])).corners
        tensor([[1.8000, 2.4000],
                [0.0000, 0.0000],
                [5.0000, 0.0000]], dtype=torch.float64)
    """

    origin: Tensor
    directions: Tensor
    corners: Tensor

    @classmethod
    def through(cls, points: Tensor | ArrayLike) -> "Plane":
        """The plane of three points.

        Args:
            points: (3, *features), finite.

        Raises:
            TypeError: `points` is no array of real numbers.
            ValueError: there are not three points, or they are on one line.
        """
        given = as_points(points, "points")
        if len(given) != 3:
            raise ValueError(f"points must be three, (3, *features); got {tuple(given.shape)}. Pass X[:3] for example.")
        i, j, k = _longest_first(given)
        flat = given.flatten(1)
        longest, offset = flat[j] - flat[i], flat[k] - flat[i]
        length = longest.norm()
        if not spans_plane(given):
            raise ValueError(
                "points must span a plane; got three on one line, or some twice. Pass others, such as rows of "
                "numpy.unique(X, axis=0)."
            )
        first = longest / length
        upright = offset - (offset @ first) * first
        directions = torch.stack([first, upright / upright.norm()])
        corners = (flat - flat[i]) @ directions.T
        # What is 0 by construction must not be drawn, or printed, as rounding.
        corners[i], corners[j, 1] = 0.0, 0.0
        return cls(given[i], directions.reshape(2, *given.shape[1:]), corners)

    def points(self, coordinates: Tensor) -> Tensor:
        """Points of the input space, (P, *features) float64, from coordinates (P, 2) in the plane."""
        return self.origin + torch.tensordot(coordinates, self.directions, dims=1)


@dataclass(frozen=True, eq=False)
class Grid:
    """A rectangular grid of points.

    Attributes:
        axes: the coordinates along each axis before any turn, 1-D float64, ascending, both ends of the bounds included.
        plane: where the coordinates lie in the input space; None if they are the features themselves.
        turn: (n, n) float64, the rotation by which the grid shows the input space turned; None if it is not. It acts on
            steps of the grid from the centre. So the units of the axes play no part, and the picture is turned as it
            is seen on the grid.

    Example:
        >>> grid = Grid.within([(0, 1), (5, 9)], (2, 3))
        >>> grid.shape, grid.points(2, 4)
        ((2, 3), tensor([[0., 9.],
                [1., 5.]], dtype=torch.float64))
        >>> quarter = torch.tensor([[0.0, -1.0], [1.0, 0.0]], dtype=torch.float64)
        >>> Grid(Grid.within([(0, 1), (5, 9)], 2).axes, turn=quarter).points(0, 4)  # the point of (0, 1) is now first
        tensor([[0., 9.],
                [1., 9.],
                [0., 5.],
                [1., 5.]], dtype=torch.float64)
    """

    axes: tuple[Tensor, ...]
    plane: Plane | None = None
    turn: Tensor | None = None

    @classmethod
    def within(cls, bounds: Bounds, resolution: int | Sequence[int]) -> "Grid":
        """The grid that fills the bounds, one (low, high) for each feature."""
        ends = _check_bounds(bounds)
        numbers = [resolution] * len(ends) if not isinstance(resolution, Sequence) else list(resolution)
        if len(numbers) != len(ends):
            raise ValueError(
                f"resolution must be one number or one for each of the {len(ends)} features; got {len(numbers)}. "
                "Pass for example resolution=128."
            )
        return cls(tuple(_axis(*end, number) for end, number in zip(ends, numbers, strict=True)))

    @classmethod
    def around(cls, plane: Plane, resolution: int, relative_margin: float) -> "Grid":
        """A square grid around the three points of a plane, so that a step is of the same length along both axes."""
        relative_margin = not_negative(relative_margin, "relative_margin")
        low, high = plane.corners.amin(dim=0), plane.corners.amax(dim=0)
        reach = (high[0] - low[0]) * (0.5 + relative_margin)
        ends = [(float(centre - reach), float(centre + reach)) for centre in (low + high) / 2]
        return cls(tuple(_axis(*end, resolution) for end in ends), plane)

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each axis."""
        return tuple(len(axis) for axis in self.axes)

    def points(self, start: int, stop: int) -> Tensor:
        """The points of these numbers, counted with the last axis running fastest, (stop - start, *features)."""
        place = torch.unravel_index(torch.arange(start, stop, device="cpu"), self.shape)
        coordinates = torch.stack([axis[index] for axis, index in zip(self.axes, place, strict=True)], dim=1)
        if self.turn is not None:
            coordinates = self._turned(torch.stack(place, dim=1))
        return coordinates if self.plane is None else self.plane.points(coordinates)

    def _turned(self, place: Tensor) -> Tensor:
        """Coordinates (P, n) of the points at these places (P, n) of the turned grid."""
        assert self.turn is not None
        first, last = (torch.stack([axis[end] for axis in self.axes]) for end in (0, -1))
        most = torch.tensor([size - 1 for size in self.shape], dtype=torch.float64, device="cpu")
        # What is seen at a place p of the turned picture was at R^-1 p, and R^-1 p is p R for rows.
        steps = (place - most / 2) @ self.turn
        return (first + last) / 2 + steps * ((last - first) / most)


@dataclass(frozen=True, eq=False)
class Stack:
    """Grids of one shape, asked for one after the other as if they were one grid with a first axis more.

    Example:
        >>> grid = Grid.within([(0, 1), (5, 9)], 2)
        >>> stack = Stack((grid, grid))
        >>> stack.shape, stack.points(3, 5)
        ((2, 2, 2), tensor([[1., 9.],
                [0., 5.]], dtype=torch.float64))
    """

    grids: tuple[Grid, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of grids, then points along each axis of one."""
        return (len(self.grids), *self.grids[0].shape)

    def points(self, start: int, stop: int) -> Tensor:
        """The points of these numbers, counted through all grids, (stop - start, *features)."""
        size = math.prod(self.grids[0].shape)
        parts = [
            self.grids[i].points(max(start - i * size, 0), min(stop - i * size, size))
            for i in range(start // size, -(-stop // size))
        ]
        return torch.cat(parts)


def bounds_around(X: Tensor | ArrayLike, *, eps: float = 1.0) -> list[tuple[float, float]]:
    """Bounds of a grid around data: their minimum and maximum, extended by `eps` on every side.

    The default is that of scikit-learn's `DecisionBoundaryDisplay`.

    Args:
        X: (samples, features), 1 to 4 features, finite.
        eps: by how much to extend, in the unit of the features, 0 or more.

    Returns:
        (low, high) for each feature.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: `X` has another shape or no samples, or is not finite, or `eps` is below 0.

    Example:
        >>> bounds_around(torch.tensor([[0.0, 2.0], [1.0, 7.0]]), eps=0.5)
        [(-0.5, 1.5), (1.5, 7.5)]
    """
    given = as_points(X, "X")
    if given.ndim != 2 or len(given) == 0 or not 1 <= given.shape[1] <= MAX_SPATIAL_NDIM:
        raise ValueError(
            f"X must be (samples, features) with 1 sample or more and 1 to {MAX_SPATIAL_NDIM} features; got "
            f"{tuple(given.shape)}. Choose features, or use decision_plane for more."
        )
    eps = not_negative(eps, "eps")
    return list(zip((given.amin(dim=0) - eps).tolist(), (given.amax(dim=0) + eps).tolist(), strict=True))


def as_points(points: Tensor | ArrayLike, name: str) -> Tensor:
    """Data points as float64 (N, *features) on the CPU, finite."""
    given = points.detach().cpu() if isinstance(points, Tensor) else _from_array(points, name)
    if given.is_complex():
        raise TypeError(f"{name} must be real; got {given.dtype}. Pass {name}.real.")
    if given.ndim < 2:
        raise ValueError(f"{name} must be (N, *features); got {tuple(given.shape)}. Pass one row for each point.")
    if not bool(given.isfinite().all()):
        raise ValueError(f"{name} must be finite; got NaN or infinity. Leave such points out.")
    return given.double()


def _from_array(points: Any, name: str) -> Tensor:
    """A tensor of anything that NumPy makes an array of, tables of pandas and read-only arrays among them."""
    if np.ma.isMaskedArray(points) and np.ma.getmaskarray(points).any():
        raise ValueError(f"{name} must have no masked entries; got some. Leave such points out, or pass {name}.data.")
    try:
        array = np.asarray(points)
        if array.dtype.kind == "O":  # as of a table whose columns are of several types
            array = array.astype(np.float64)
    except (TypeError, ValueError, RuntimeError):
        array = np.empty(0, dtype=str)
    if array.dtype.kind not in "biufc":
        got = type(points).__name__
        raise TypeError(f"{name} must be an array of numbers; got {got}. Pass a tensor (N, *features).")
    # The copy may be written to, and is in this machine's byte order.
    return torch.from_numpy(array.astype(np.complex128 if array.dtype.kind == "c" else np.float64))


def spans_plane(points: Tensor) -> bool:
    """Whether three points (3, *features) are not on one line.

    Example:
        >>> spans_plane(torch.tensor([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]))
        False
    """
    i, j, k = _longest_first(points)
    flat = points.flatten(1)
    longest, offset = flat[j] - flat[i], flat[k] - flat[i]
    length = longest.norm()
    height = (offset - (offset @ longest) / length**2 * longest).norm()  # NaN if all three are the same
    return bool(height > FLAT * length)


def _longest_first(points: Tensor) -> tuple[int, int, int]:
    """The two ends of the longest side, in ascending order, and the third point."""
    flat = points.flatten(1)
    i, j = max(((0, 1), (0, 2), (1, 2)), key=lambda pair: float((flat[pair[0]] - flat[pair[1]]).norm()))
    return i, j, 3 - i - j


def _check_bounds(bounds: Bounds) -> list[tuple[float, float]]:
    try:
        ends = [tuple(float(end) for end in pair) for pair in bounds]
    except (TypeError, ValueError):
        raise TypeError(
            f"bounds must be one (low, high) for each feature; got {bounds!r}. "
            "Pass bounds_around(X), or [(-1.0, 1.0)] * 2, say."
        ) from None
    if not 1 <= len(ends) <= MAX_SPATIAL_NDIM:
        raise ValueError(
            f"bounds must be one (low, high) for each of 1 to {MAX_SPATIAL_NDIM} features; got {len(ends)}. "
            "Pass bounds_around(X), or use decision_plane for more features."
        )
    for pair in ends:
        if len(pair) != 2 or not -math.inf < pair[0] < pair[1] < math.inf:
            raise ValueError(
                f"bounds must be finite pairs with low < high; got {pair}. Pass [(-1.0, 1.0)] * {len(ends)}, say."
            )
    return [(low, high) for low, high in ends]


def _axis(low: float, high: float, resolution: int) -> Tensor:
    if count(resolution, "resolution") < 2:
        raise ValueError(f"resolution must be 2 or more; got {resolution}. Pass for example 128.")
    return torch.linspace(low, high, resolution, dtype=torch.float64, device="cpu")
