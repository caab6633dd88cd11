"""Decision regions over several rotations of the grid: one row a class, with standard errors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf.measure import Measure, takes
from torchlinf.regions.decision_regions import Boundary, DecisionRegions, regions_on, regions_on_each
from torchlinf.regions.grids import Bounds, Grid
from torchlinf.regions.orientations import RegionOptions
from torchlinf.regions.responses import ResponseOptions


@dataclass(frozen=True, eq=False)
class RegionSummary:
    """The complexity of decision regions over the rotations of a grid; made by `decision_region_summary`.

    C is the number of classes, R that of the rotations. Standard errors are the sample standard deviation over the
    rotations, divided by the square root of their number: they say how much the number depends on the directions of the
    grid. They do not say how much it depends on the data.

    Attributes:
        regions: the `DecisionRegions` of every rotation, all of the same classes; `regions[i].orientation` is its
            angle, and `torchlinf.plot.decision_regions` draws it.
    """

    regions: tuple[DecisionRegions, ...]

    @property
    def classes(self) -> tuple[Any, ...]:
        """Names of the C classes."""
        return self.regions[0].classes

    @property
    def share(self) -> Tensor:
        """(C,) float64, the share of the points that is in each region: the mean over the rotations."""
        return torch.stack([regions.area for regions in self.regions]).mean(dim=0)

    def mean(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """Complexity of each class: the mean over the rotations.

        Args:
            low: lower end of the window of scales, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            (C,) float64, in the unit of the measure. Rotations whose grid has no point of a class are left out of its
            mean; NaN if none has.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.
        """
        return self._of_classes(low, high).nanmean(dim=0)

    def standard_error(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """Standard error of `mean(low, high)` over the rotations.

        Args:
            low: lower end of the window of scales, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            (C,) float64, in the unit of the measure; NaN for a class that fewer than two rotations have.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.
        """
        return torch.stack([error_of_mean(values) for values in self._of_classes(low, high).T])

    def overall(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """One number: the mean over the rotations of the mean over the classes, weighted by their areas.

        Args:
            low: lower end of the window of scales, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            Tensor without dimensions, float64, in the unit of the measure; NaN if all classes are nowhere.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.
        """
        return self._overall(low, high).nanmean()

    def overall_standard_error(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """Standard error of `overall(low, high)` over the rotations.

        Args:
            low: lower end of the window of scales, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            Tensor without dimensions, float64, in the unit of the measure; NaN for fewer than two rotations.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.
        """
        return error_of_mean(self._overall(low, high))

    def table(self, low: float = 0.0, high: float = 1.0) -> dict[str, NDArray[Any]]:
        """One row a class.

        Args:
            low: lower end of the window of scales, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            Columns by name, each with one entry a class; `pandas.DataFrame` takes them as they are.

            - "class": its name.
            - "complexity": as `mean(low, high)` gives it.
            - "standard_error": as `standard_error(low, high)` gives it.
            - "share": the share of the points that is in the region.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.
        """
        return {
            "class": names_of_classes(self.classes),
            "complexity": self.mean(low, high).numpy(),
            "standard_error": self.standard_error(low, high).numpy(),
            "share": self.share.numpy(),
        }

    def _of_classes(self, low: float, high: float) -> Tensor:
        """(R, C)."""
        return torch.stack([regions.mean(low, high) for regions in self.regions])

    def _overall(self, low: float, high: float) -> Tensor:
        """(R,)."""
        return torch.stack([regions.overall(low, high) for regions in self.regions])


@takes(RegionOptions, orientation="mean")
def decision_region_summary(
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
) -> RegionSummary:
    """Complexity of the decision regions of a classifier, as a mean over rotations of the grid.

    On one grid the number depends on the directions of the features: a straight boundary has 0 along a feature and
    several bits at a slant. The mean over rotations does not prefer these directions. Nothing is resampled. The grid is
    turned about its centre, and the classifier is asked at the points of the turned grid, which has the same number of
    points and the same steps. So every rotation sees the disc within the bounds; at the corners it sees other points
    than the grid itself, up to 21 % of a side beyond the bounds.

    Args:
        classifier: a `torch.nn.Module`, a scikit-learn estimator or a callable, as `decision_region_complexity` takes
            it. It must answer without NaN beyond the bounds too.
        bounds: (low, high) for each feature; `bounds_around(X)` makes them from data. Two features, unless the
            orientation is None or a matrix. A turn acts on the steps of the grid, not on the units of the features.
        resolution: points along every feature, or one number for each, 2 or more. Choose the same number for both: of a
            grid that is not square, the rotations are i * 180 / rotations degrees, and see less in common.
        boundary: the boundary condition at the edge of every turned grid, "background" or "open"; see
            `decision_region_complexity`.
        response_method: of an estimator: "auto", what it predicts, or "predict", "predict_proba" or
            "decision_function"; as `decision_region_complexity` takes it.
        threshold: None takes the class of the largest response; with a number each class is where its response is
            greater. One response a point needs it, unless it is a `decision_function`, which has 0.
        classes: names of the classes in the order of the responses, or all labels that may be answered; None takes
            those of the estimator, or counts from 0, or, of labels, takes those that are met on any of the grids.
        chunk_size: points asked for at a time; None means 16,384, fewer if they have very many features.
        {measure options}
            Here "own" is refused, since the edge of the grid cuts the regions. "least" keeps the one rotation with the
            smallest overall complexity over all scales. With one rotation, as of "least", None, degrees or a matrix,
            standard errors are NaN.

    Returns:
        `RegionSummary`: complexity, standard error and share of every class, and overall, for any window of scales. A
        class that is nowhere has complexity NaN. Not differentiable. It costs `rotations` times as much as
        `decision_region_complexity`. A `rho` is in steps of the grid.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value, the grid cannot be turned so, or the classifier answers NaN or in
            another shape; or "open" would take too much memory.
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020; docs/regions.

    Example:
        >>> def slanted(points):
        ...     return 2 * points[:, 0] + points[:, 1] > 0.3
        >>> summary = decision_region_summary(slanted, [(-1, 1)] * 2, resolution=48)
        >>> print(f"{summary.overall():.2f} ± {summary.overall_standard_error():.2f} bits")
        2.96 ± 0.13 bits
        >>> for name, column in summary.table().items():
        ...     print(f"{name:15}", column.round(2).tolist() if column.dtype == float else column.tolist())
        class           [False, True]
        complexity      [2.9, 3.04]
        standard_error  [0.17, 0.1]
        share           [0.57, 0.43]
    """
    measure = Measure.of({"orientation": "mean", **options}, RegionOptions)
    response = ResponseOptions(
        response_method=response_method, threshold=threshold, classes=classes, chunk_size=chunk_size
    )
    return summary_on(Grid.within(bounds, resolution), classifier, response, boundary, measure)


def summary_on(
    grid: Grid, classifier: Any, response: ResponseOptions, boundary: Boundary, measure: Measure
) -> RegionSummary:
    """The regions of a classifier on one grid, in every rotation that the measure keeps.

    Example:
        >>> response = ResponseOptions(response_method="auto", threshold=0.0, classes=None, chunk_size=None)
        >>> grid = Grid.within([(-1, 1), (-1, 1)], 8)
        >>> summary_on(grid, lambda points: points[:, 0], response, "background", Measure()).table()["share"]
        array([0.5, 0.5])
    """
    if measure.orientation == "least":
        return RegionSummary((regions_on(grid, classifier, response, boundary, measure),))
    return RegionSummary(tuple(regions_on_each(grid, classifier, response, boundary, measure)))


def error_of_mean(values: Tensor) -> Tensor:
    """Standard error of the mean of numbers (N,), those that are NaN left out; NaN if fewer than two are left.

    Example:
        >>> error_of_mean(torch.tensor([1.0, 3.0, torch.nan]))
        tensor(1.)
    """
    kept = values[~values.isnan()]
    return kept.std() / math.sqrt(len(kept)) if len(kept) > 1 else values.new_tensor(math.nan)


def names_of_classes(classes: tuple[Any, ...]) -> NDArray[Any]:
    """A column of names, of their own type if they have one in common.

    Example:
        >>> names_of_classes((0, 1)).dtype.kind, names_of_classes(("a", 1)).tolist()
        ('i', ['a', 1])
    """
    if len({type(name) for name in classes}) == 1:
        return np.array(classes)
    column = np.empty(len(classes), dtype=object)
    column[:] = classes
    return column
