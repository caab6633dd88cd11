"""Grids that are turned: which rotations an orientation asks for, and the grids that show them."""

import math
from dataclasses import replace

import torch
from torch import Tensor

from torchlinf.measure import FrameOptions, LevelOptions, Measure, WindowOptions
from torchlinf.regions.grids import Grid

Angle = float | tuple[tuple[float, ...], ...]


class RegionOptions(LevelOptions, FrameOptions, total=False):
    """Options of what is found on every level of each region, on a grid that may be turned."""


class PlaneOptions(WindowOptions, FrameOptions, total=False):
    """Options of one number a plane, on a grid that may be turned."""


def turned_grids(grid: Grid, measure: Measure) -> list[tuple[Angle | None, Grid]]:
    """Every rotation that the orientation asks for, degrees or a matrix, and the grid that shows it.

    Example:
        >>> grid = Grid.within([(0, 1), (0, 1)], 9)
        >>> [angle for angle, _ in turned_grids(grid, Measure(orientation="mean", rotations=3))]
        [0.0, 30.0, 60.0]
        >>> oblong = Grid.within([(0, 1), (0, 1)], (9, 5))
        >>> [angle for angle, _ in turned_grids(oblong, Measure(orientation="mean", rotations=3))]
        [0.0, 60.0, 120.0]
    """
    orientation, ndim = measure.orientation, len(grid.axes)
    if orientation is None:
        return [(None, grid)]
    if orientation == "own":
        raise ValueError(
            'orientation must be None, a rotation, "mean" or "least" for regions, which the edge of the grid cuts; got '
            '"own". Pass "least".'
        )
    if isinstance(orientation, tuple):
        if ndim != 3:
            raise ValueError(
                f"orientation must be a 3 x 3 matrix on grids of three axes alone; got one on {ndim}. Pass degrees."
            )
        return [(orientation, replace(grid, turn=torch.tensor(orientation, dtype=torch.float64, device="cpu")))]
    if ndim != 2:
        raise ValueError(
            f"orientation must be None{' or a 3 x 3 matrix' if ndim == 3 else ''} on a grid of {ndim} axes; got "
            f"{orientation!r}. Pass orientation=None."
        )
    if isinstance(orientation, str):
        # The angle after which the grid has the same points again.
        period = 90.0 if grid.shape[0] == grid.shape[1] else 180.0
        angles = [i * period / measure.rotations for i in range(measure.rotations)]
    else:
        angles = [orientation]
    return [(angle, _turned(grid, angle)) for angle in angles]


def _turned(grid: Grid, degrees: float) -> Grid:
    # A full turn changes nothing, in no digit.
    return grid if degrees % 360 == 0 else replace(grid, turn=rotation(degrees))


def rotation(degrees: float) -> Tensor:
    """(2, 2) float64, which turns (first axis, second axis) counter-clockwise, as seen in an image with rows downward.

    It is counter-clockwise too where the first axis points right and the second up, as in a plot of two features.

    Example:
        >>> rotation(90) @ torch.tensor([1.0, 0.0], dtype=torch.float64)  # from down to right
        tensor([0., 1.], dtype=torch.float64)
    """
    quarters, rest = divmod(degrees, 90)
    cosine, sine = math.cos(math.radians(rest)), math.sin(math.radians(rest))
    for _ in range(int(quarters) % 4):
        cosine, sine = 0.0 - sine, cosine
    return torch.tensor([[cosine, -sine], [sine, cosine]], dtype=torch.float64, device="cpu")
