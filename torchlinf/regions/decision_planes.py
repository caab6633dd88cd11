"""Complexity of decision regions on planes through three data points, in inputs of any number of features."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Unpack

import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from torchlinf._helpers.checks import count, integer
from torchlinf.measure import Measure, takes
from torchlinf.regions.decision_regions import Boundary, DecisionRegions, regions_on
from torchlinf.regions.grids import Grid, Plane, as_points, spans_plane
from torchlinf.regions.orientations import PlaneOptions, RegionOptions
from torchlinf.regions.responses import ResponseOptions
from torchlinf.regions.summary import RegionSummary, error_of_mean, names_of_classes, summary_on

TRIES = 10  # triples drawn for each plane at most


@dataclass(frozen=True, eq=False)
class PlaneComplexity:
    """Complexity of decision regions on planes through random triples; made by `decision_plane_complexity`.

    T is the number of planes, C that of the classes.

    Attributes:
        values: (T,) float64, the overall complexity on each plane. NaN where no class has any point of it, which only
            happens with a threshold.
        triples: (T, 3) int64, the points that each plane goes through, as indices of the data.
        measure: how complexity was measured.
        classes: names of the C classes.
        class_values: (T, C) float64, the complexity of each class on each plane; NaN where it has no point.
        share: (T, C) float64, the share of the points of each plane that is in each region.
    """

    values: Tensor
    triples: Tensor
    measure: Measure
    classes: tuple[Any, ...]
    class_values: Tensor
    share: Tensor

    @property
    def num_empty(self) -> int:
        """Planes without any region; they are left out of the mean and its error."""
        return int(self.values.isnan().sum())

    def mean(self) -> float:
        """Mean over the planes that have a region, in the unit of the measure; NaN if none has."""
        return float(self.values.nanmean())

    def standard_error(self) -> float:
        """Standard error of the mean: the sample standard deviation over the square root of the number of planes.

        Planes without any region are left out; NaN if fewer than two are left.
        """
        return float(error_of_mean(self.values))

    def table(self) -> dict[str, NDArray[Any]]:
        """One row a class.

        Returns:
            Columns by name, each with one entry a class; `pandas.DataFrame` takes them as they are.

            - "class": its name.
            - "complexity": mean over the planes that have a point of the class, in the unit of the measure; NaN if none
              has.
            - "standard_error": standard error of that mean; NaN if fewer than two planes have a point of the class.
            - "share": the share of the points that is in the region, mean over all planes.
        """
        return {
            "class": names_of_classes(self.classes),
            "complexity": self.class_values.nanmean(dim=0).numpy(),
            "standard_error": torch.stack([error_of_mean(values) for values in self.class_values.T]).numpy(),
            "share": self.share.mean(dim=0).numpy(),
        }


@takes(RegionOptions)
def decision_plane(
    classifier: Any,
    points: Tensor | ArrayLike,
    *,
    resolution: int = 128,
    relative_margin: float = 0.25,
    boundary: Boundary = "background",
    response_method: str = "auto",
    threshold: float | None = None,
    classes: Sequence[Any] | None = None,
    chunk_size: int | None = None,
    **options: Unpack[RegionOptions],
) -> DecisionRegions:
    """Complexity of the decision regions on the plane through three data points, in inputs of any number of features.

    The grid is a square around the triangle, with equal steps along both axes. The first axis is along the triangle's
    longest side, so that the order of the points does not matter.

    Args:
        classifier: a `torch.nn.Module`, a scikit-learn estimator or a callable, as `decision_region_complexity` takes
            it. It gets points of the shape of the data, (P, *features), and must answer without NaN.
        points: the three points, (3, *features), finite, not on one line.
        resolution: points along both axes, 2 or more.
        relative_margin: by how much the grid extends the longest side at either end, as a share of that side, 0 or
            more.
        boundary: the boundary condition at the edge of the grid. "background": beyond the grid is no class. "open": the
            edge is no boundary; it takes several times as long.
        response_method: of an estimator: "auto", what it predicts, or "predict", "predict_proba" or
            "decision_function"; as `decision_region_complexity` takes it.
        threshold: None takes the class of the largest response; with a number each class is where its response is
            greater. One response a point needs it, unless it is a `decision_function`, which has 0.
        classes: names of the classes in the order of the responses, or all labels that may be answered; None takes
            those of the estimator, or counts from 0, or, of labels, takes those that are met.
        chunk_size: points asked for at a time; None means 16,384, fewer if they have very many features.
        {measure options}
            Here the grid is turned about its centre, not the regions, so that nothing is resampled; the plot turns it
            back. "own" and "mean" are refused. "least": the rotation with the smallest overall complexity.

    Returns:
        `DecisionRegions` with the coordinates of the three points in `plane.corners`. A class that is nowhere on the
        plane has complexity NaN and is counted by `num_empty`; one that is everywhere has 0. Not differentiable;
        computed on the CPU but for the classifier itself. A `rho` is in steps of the grid.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value, the points are on one line, or the classifier answers NaN or in
            another shape.
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020; docs/regions.

    Example:
        >>> corners = torch.tensor([[0.0, 0.0, 1.0], [5.0, 0.0, 1.0], [1.8, 2.4, 1.0]])
        >>> larger_of_two = lambda points: points[:, :2]
        >>> regions = decision_plane(larger_of_two, corners, resolution=33)
        >>> regions.plane.corners[2], regions.overall()
        (tensor([1.8000, 2.4000], dtype=torch.float64), tensor(2.3447, dtype=torch.float64))
    """
    measure = Measure.of(options, RegionOptions)
    response = ResponseOptions(
        response_method=response_method, threshold=threshold, classes=classes, chunk_size=chunk_size
    )
    grid = Grid.around(Plane.through(points), resolution, relative_margin)
    return regions_on(grid, classifier, response, boundary, measure)


@takes(PlaneOptions)
def decision_plane_complexity(
    classifier: Any,
    X: Tensor | ArrayLike,
    *,
    num_planes: int = 32,
    resolution: int = 64,
    relative_margin: float = 0.25,
    seed: int = 0,
    boundary: Boundary = "background",
    response_method: str = "auto",
    threshold: float | None = None,
    classes: Sequence[Any] | None = None,
    chunk_size: int | None = None,
    **options: Unpack[PlaneOptions],
) -> PlaneComplexity:
    """Mean complexity of decision regions over planes through random triples of data points.

    The triples are drawn independently of each other, each of three different points; a triple on one line is drawn
    again. So the standard error is that of the mean over all triples of these data. The axes of a plane come from its
    triangle alone: the mean does not depend on a rotation of the data, but for rounding.

    Args:
        classifier: a `torch.nn.Module`, a scikit-learn estimator or a callable, as `decision_region_complexity` takes
            it. It gets points of the shape of the data, (P, *features), and must answer without NaN.
        X: the data, (N, *features), 3 points or more, finite.
        num_planes: how many triples, 2 or more.
        resolution: points along both axes of each plane, 2 or more.
        relative_margin: by how much each grid extends the longest side of its triangle at either end, as a share of
            that side, 0 or more.
        seed: of the triples, 0 or more. The same data and seed give the same planes, for whatever classifier: compare
            two classifiers by the differences of their `values`.
        boundary: the boundary condition at the edge of each grid. "background": beyond the grid is no class. "open":
            the edge is no boundary; it takes several times as long.
        response_method: of an estimator: "auto", what it predicts, or "predict", "predict_proba" or
            "decision_function"; as `decision_region_complexity` takes it.
        threshold: None takes the class of the largest response; with a number each class is where its response is
            greater. One response a point needs it, unless it is a `decision_function`, which has 0.
        classes: names of the classes in the order of the responses, or all labels that may be answered; None takes
            those of the estimator, or counts from 0, or, of labels, takes those that are met.
        chunk_size: points asked for at a time; None means 16,384, fewer if they have very many features.
        {measure options}
            Here the grid of each plane is turned about its centre, not the regions, so that nothing is resampled. "own"
            is refused. "mean" takes the mean over the rotations on each plane and "least" the one with the smallest
            overall complexity over all scales; both cost `rotations` times as much.

    Returns:
        `PlaneComplexity`: the value of `DecisionRegions.overall(low, high)` on each plane, their mean and its standard
        error, which is that over the planes; and the same for every class. Planes where no class has a point are NaN,
        left out of the mean, and counted by `num_empty`. Not differentiable. A `rho` is in steps of each grid.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value, hardly any triple spans a plane, or the classifier answers NaN or in
            another shape.
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020; docs/regions.

    Example:
        >>> X = torch.randn(50, 6, generator=torch.Generator().manual_seed(0))
        >>> planes = decision_plane_complexity(lambda points: points[:, :3], X, num_planes=8, resolution=24)
        >>> planes.values.shape, planes.mean() > 5 * planes.standard_error()
        (torch.Size([8]), True)
    """
    measure = Measure.of(options, PlaneOptions)
    response = ResponseOptions(
        response_method=response_method, threshold=threshold, classes=classes, chunk_size=chunk_size
    )
    found, triples = [], []
    for triple, plane in random_planes(X, num_planes, seed):
        grid = Grid.around(plane, resolution, relative_margin)
        found.append(summary_on(grid, classifier, response, boundary, measure))
        triples.append(triple)
    values = torch.stack([summary.overall(measure.low, measure.high) for summary in found])
    names = classes_of(found)
    class_values = [_in_order(names, summary, summary.mean(measure.low, measure.high), torch.nan) for summary in found]
    share = [_in_order(names, summary, summary.share, 0.0) for summary in found]
    return PlaneComplexity(values, torch.stack(triples), measure, names, torch.stack(class_values), torch.stack(share))


def classes_of(summaries: Sequence[RegionSummary]) -> tuple[Any, ...]:
    """All classes: those of labels that are met on some planes alone are in order, if they can be compared.

    Example:
        >>> from types import SimpleNamespace
        >>> classes_of([SimpleNamespace(classes=(2, 7)), SimpleNamespace(classes=(1, 2))])
        (1, 2, 7)
    """
    met = tuple(dict.fromkeys(name for summary in summaries for name in summary.classes))
    if met == summaries[0].classes:
        return met
    try:
        return tuple(sorted(met))
    except TypeError:
        return met


def _in_order(names: tuple[Any, ...], summary: RegionSummary, values: Tensor, otherwise: float) -> Tensor:
    """Numbers of the classes of one plane, (C,) as they stand among all classes."""
    known = dict(zip(summary.classes, values.tolist(), strict=True))
    return torch.tensor([known.get(name, otherwise) for name in names], dtype=torch.float64, device="cpu")


def random_planes(X: Tensor | ArrayLike, num_planes: int, seed: int) -> Iterator[tuple[Tensor, Plane]]:
    """Triples (3,) of indices, and the planes through these points.

    Example:
        >>> X = torch.tensor([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 1.0]])
        >>> [int((triple == 3).sum()) for triple, _ in random_planes(X, 4, seed=0)]  # the others are on a line
        [1, 1, 1, 1]
    """
    data = as_points(X, "X")
    if len(data) < 3:
        raise ValueError(f"X must hold 3 points or more; got {len(data)}. Pass (N, *features).")
    if count(num_planes, "num_planes") < 2:
        raise ValueError("num_planes must be 2 or more, for a standard error; got 1. Use decision_plane for one.")
    generator = torch.Generator("cpu").manual_seed(integer(seed, "seed", 0))
    spanned = 0
    for _ in range(TRIES * num_planes):
        triple = torch.randperm(len(data), generator=generator, device="cpu")[:3]
        if spans_plane(data[triple]):
            yield triple, Plane.through(data[triple])
            spanned += 1
            if spanned == num_planes:
                return
    raise ValueError(
        f"X must hold triples that span planes; got {spanned} in {TRIES * num_planes} tries. Pass data of two "
        "dimensions or more, without copies, such as numpy.unique(X, axis=0)."
    )
