"""Complexity of the decision regions of a classifier on a grid over its features."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Unpack

import torch
from torch import Tensor

from torchlinf._helpers.checks import choice
from torchlinf.measure import ComplexityProfile, LevelOptions, Measure, complexity_profile, takes
from torchlinf.regions.grids import Bounds, Grid, Plane, Stack
from torchlinf.regions.open_boundary import open_profile
from torchlinf.regions.orientations import Angle, RegionOptions, turned_grids
from torchlinf.regions.responses import ResponseOptions, class_masks

Boundary = Literal["background", "open"]
BOUNDARIES = ("background", "open")


@dataclass(frozen=True, eq=False)
class DecisionRegions:
    """The regions that a classifier gives its classes on a grid, and their complexity.

    C is the number of classes. The region of a class is one shape, in one piece or in several. Made by
    `decision_region_complexity` and `decision_plane`; `torchlinf.plot.decision_regions` draws it without another solve.

    Attributes:
        classes: names of the C classes, those of the classifier or 0, 1, ...
        masks: (C, *resolution) bool, where each class is; the i-th dimension is the i-th feature.
        axes: coordinates of the points along each dimension, 1-D float64; of a grid that is turned, those before the
            turn.
        profile: the complexity against scale, batch shape (C,); NaN for a class that is nowhere on the grid.
        area: (C,) float64, the share of the grid's points that is in each region.
        plane: for `decision_plane`, where the grid lies in the input space; else None.
        orientation: by how many degrees, or by which matrix, the masks show the regions turned; None if they are not.
    """

    classes: tuple[Any, ...]
    masks: Tensor
    axes: tuple[Tensor, ...]
    profile: ComplexityProfile
    area: Tensor
    plane: Plane | None = None
    orientation: Angle | None = None

    @property
    def num_empty(self) -> int:
        """Number of classes that are nowhere on the grid."""
        return int((self.profile.radius == 0).sum())

    def mean(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """Complexity of each class: the exact mean over the scales in (low, high].

        Args:
            low: lower end of the window of scales, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            (C,) float64, in the unit of the profile; NaN for a class that is nowhere.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.
        """
        return self.profile.mean(low, high)

    def overall(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """One number: the mean over the classes, each weighted by its area.

        It is the expected complexity of the region that a random point of the grid falls into. So a class of a few
        points changes it little, whether it is there or not; it would change an unweighted mean by much.

        Args:
            low: lower end of the window of scales, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            Tensor without dimensions, float64, in the unit of the profile. Classes that are nowhere have no weight;
            NaN if all classes are nowhere.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.
        """
        return self._weighted(self.mean(low, high)[:, None])[0]

    def error_bound(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """How far `mean(low, high)` of each class can be from that of the exact field, proven.

        Args:
            low: lower end of the window of scales, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            (C,) float64, in the unit of the profile, 0 or more; NaN for a class that is nowhere. It is that of the
            regions on the grid: how well the grid shows the classifier is not in it.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.
        """
        return self.profile.error_bound(low, high)

    def overall_error_bound(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """How far `overall(low, high)` can be from that of the exact fields, proven: the bounds, weighted by area.

        Args:
            low: lower end of the window of scales, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            Tensor without dimensions, float64, in the unit of the profile; NaN if all classes are nowhere.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.
        """
        return self._weighted(self.error_bound(low, high)[:, None])[0]

    def overall_values(self) -> Tensor:
        """The mean over the classes, weighted by their areas, at each of `profile.scales`: (L,) float64."""
        return self._weighted(self.profile.values)

    def _weighted(self, values: Tensor) -> Tensor:
        return (values.nan_to_num() * self.area[:, None]).sum(dim=0) / self.area.sum()


@takes(RegionOptions)
def decision_region_complexity(
    classifier: Any,
    bounds: Bounds,
    *,
    resolution: int | Sequence[int] = 128,
    boundary: Boundary = "background",
    response_method: str = "auto",
    threshold: float | None = None,
    classes: Sequence[Any] | None = None,
    chunk_size: int | None = None,
    **options: Unpack[RegionOptions],
) -> DecisionRegions:
    """Complexity of the decision regions of a classifier on a grid over 1 to 4 features.

    Regions that are boxes along the axes have 0: those of a constant classifier, of a threshold of one feature, of some
    small trees. A straight boundary at a slant does not have 0, and the numbers change with the units of the features
    and with a rotation of them. `orientation` turns the grid; `decision_region_summary` has the mean over rotations.

    Args:
        classifier: one of these, which must answer without NaN:

            - a `torch.nn.Module` from (P, features) in its own dtype and device to (P, classes) logits or
              probabilities, or (P,) or (P, 1) of class 1; it is put in evaluation mode for the call;
            - a scikit-learn estimator, or an object with its methods, that predicts one class a point (one-class
              estimators: 1 and -1); it gets float64 NumPy arrays, or a pandas table if it was fitted on named columns;
            - a callable from tensors of torch's default dtype to a tensor or array like those of a module, or to
              integer or string labels (P,).
        bounds: (low, high) for each feature; `bounds_around(X)` makes them from data.
        resolution: points along every feature, or one number for each, 2 or more; scikit-learn's `grid_resolution`.
        boundary: the boundary condition at the edge of the grid. "background": beyond the grid is no class, so the edge
            is a part of the boundary of every region that touches it. "open": the edge is no boundary. Distances count
            to points of other classes on the grid only, and neighbourhoods end at the edge, as if the grid were
            mirrored there. It takes several times as long.
        response_method: of an estimator: "auto", what it predicts; or, with a `threshold`, the first of
            `decision_function`, `predict_proba` and `predict` that it has. Or one of these by name: then the class is
            that of the largest score, which need not be the one that is predicted.
        threshold: None takes the class of the largest response, the first of those that tie. With a number each class
            is where its response is greater, so that regions may overlap or leave gaps. With one response a point, it
            parts class 1 from class 0, and is needed unless it is a `decision_function`, which has 0.
        classes: names of the classes in the order of the responses, or all labels that may be answered; None takes
            those of the estimator, or counts from 0, or, of labels, takes those that are met.
        chunk_size: points asked for at a time; None means 16,384, fewer if they have very many features.
        {measure options}
            Here the grid is turned about its centre, not the regions: the classifier is asked at the points of the
            turned grid, up to 21 % of a side beyond the bounds, and nothing is resampled. "own" is refused, since the
            edge of the grid cuts the regions, and so is "mean", which `decision_region_summary` takes. "least": the
            rotation with the smallest overall complexity over all scales; with unequal resolutions the rotations are
            i * 180 / rotations degrees.

    Returns:
        `DecisionRegions`. A class that is nowhere has complexity NaN and is counted by `num_empty`; one that is
        everywhere has 0, with either boundary condition. Not differentiable: for a gradient use `DecisionRegionLoss`.
        Computed on the CPU but for the classifier itself. A `rho` is in steps of the grid.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value, or the classifier answers NaN or in another shape; or "open" would
            take too much memory, as large grids of 3 or 4 features may.
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020; docs/regions.

    Example:
        >>> def in_a_disc(points):
        ...     return points.square().sum(dim=1) < 1
        >>> regions = decision_region_complexity(in_a_disc, [(-1.5, 1.5)] * 2, resolution=25)
        >>> regions.classes, regions.mean(), regions.overall()
        ((False, True), tensor([2.0490, 0.5755], dtype=torch.float64), tensor(1.5940, dtype=torch.float64))
    """
    measure = Measure.of(options, RegionOptions)
    response = ResponseOptions(
        response_method=response_method, threshold=threshold, classes=classes, chunk_size=chunk_size
    )
    return regions_on(Grid.within(bounds, resolution), classifier, response, boundary, measure)


def regions_on(
    grid: Grid, classifier: Any, response: ResponseOptions, boundary: Boundary, measure: Measure
) -> DecisionRegions:
    """The regions of a classifier on one grid, which the orientation of the measure turns.

    Example:
        >>> response = ResponseOptions(response_method="auto", threshold=0.0, classes=None, chunk_size=None)
        >>> grid = Grid.within([(-1, 1)], 5)
        >>> regions_on(grid, lambda points: points, response, "open", Measure()).area
        tensor([0.6000, 0.4000], dtype=torch.float64)
    """
    if measure.orientation == "mean":
        raise ValueError(
            'orientation must be None, a rotation or "least" for the regions on one grid; got "mean". '
            "Pass it to decision_region_summary or decision_plane_complexity."
        )
    found = regions_on_each(grid, classifier, response, boundary, measure)
    return min(found, key=_least_first) if measure.orientation == "least" else found[0]


def _least_first(regions: DecisionRegions) -> float:
    """The overall complexity, infinite where no class has a point."""
    return float(regions.overall().nan_to_num(nan=torch.inf))


def regions_on_each(
    grid: Grid, classifier: Any, response: ResponseOptions, boundary: Boundary, measure: Measure
) -> list[DecisionRegions]:
    """The regions of a classifier, of the same classes, on the grid of every rotation that the measure asks for.

    Example:
        >>> response = ResponseOptions(response_method="auto", threshold=0.0, classes=None, chunk_size=None)
        >>> found = regions_on_each(
        ...     Grid.within([(-1, 1), (-1, 1)], 8), lambda points: points[:, 0], response, "background",
        ...     Measure(orientation="mean", rotations=2),
        ... )
        >>> [(regions.orientation, round(regions.overall().item(), 3)) for regions in found]
        [(0.0, 0.0), (45.0, 0.52)]
    """
    choice(boundary, BOUNDARIES, "boundary")
    angles, grids = zip(*turned_grids(grid, measure), strict=True)
    masks, names = class_masks(classifier, Stack(grids), **response)
    found = []
    for angle, of_angle in zip(angles, masks.unbind(dim=1), strict=True):
        if boundary == "open":
            profile = open_profile(of_angle, measure.plain())
        else:
            levels = measure.plain().options(LevelOptions)
            profile = complexity_profile(of_angle, spatial_ndim=of_angle.ndim - 1, **levels)
        area = of_angle.flatten(1).double().mean(dim=1)
        found.append(DecisionRegions(names, of_angle, grid.axes, profile, area, grid.plane, angle))
    return found
