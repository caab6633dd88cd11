"""Complexity of the decision regions of a classifier, on grids and on planes through data points."""

from collections.abc import Sequence
from typing import Any

import torch
from numpy.typing import ArrayLike
from torch import Tensor

from torchlinf._checks import window
from torchlinf.regions.grids import Bounds, Grid, Plane, bounds_around
from torchlinf.regions.loss import DecisionRegionLoss
from torchlinf.regions.planes import PlaneComplexity, random_planes
from torchlinf.regions.result import Asked, DecisionRegions, Measured, regions_on

__all__ = [
    "DecisionRegionLoss",
    "DecisionRegions",
    "Plane",
    "PlaneComplexity",
    "bounds_around",
    "decision_plane",
    "decision_plane_complexity",
    "decision_region_complexity",
]


def decision_region_complexity(
    classifier: Any,
    bounds: Bounds,
    resolution: int | Sequence[int] = 128,
    *,
    frame: str = "background",
    response_method: str = "auto",
    threshold: float | None = None,
    classes: Sequence[Any] | None = None,
    chunk_size: int | None = None,
    bins: int = 1024,
    estimator: str = "entropy",
    tol: float = 1e-9,
) -> DecisionRegions:
    """Complexity of the decision regions of a classifier on a grid over 1 to 4 features.

    0 is what boxes along the axes have: constant classifiers, thresholds of one feature, small trees. A straight
    boundary at a slant is not simple in this sense, and numbers change with the units and a rotation of the features.

    Args:
        classifier: one of these, which must answer without NaN:

            - a `torch.nn.Module` from (P, features) in its own dtype and device to (P, classes) logits or
              probabilities, or (P,) or (P, 1) of class 1; it is put in evaluation mode for the call;
            - a scikit-learn estimator, or what has its methods; it gets float64 NumPy arrays;
            - a callable from tensors of torch's default dtype to a tensor or array like those of a module, or to
              integer or string labels (P,).
        bounds: (low, high) for each feature; `bounds_around(X)` makes them from data.
        resolution: points along every feature, or one number for each, 2 or more; scikit-learn's `grid_resolution`.
        frame: what the edge of the grid is. "background": what is beyond belongs to no class, so the edge is a part of
            the boundary of every region that touches it. "open": the edge is no boundary. Distances count to points of
            other classes on the grid only, and neighbourhoods end at the edge, as if the grid were mirrored there. It
            takes several times as long.
        response_method: of an estimator, as in scikit-learn's `DecisionBoundaryDisplay`: "predict",
            "predict_proba", "decision_function", or "auto", the last of these that it has.
        threshold: None takes the class of the largest response, the first of those that tie. With a number each class
            is where its response is larger, so that regions may overlap or leave gaps. With one response a point, it
            parts class 1 from class 0, and is needed unless it is a `decision_function`, which has 0.
        classes: names of the classes in the order of the responses, or all labels that may be answered; None takes
            those of the estimator, or counts from 0, or, of labels, takes those that are met.
        chunk_size: points asked for at a time; None means 16,384, fewer if they have very many features.
        bins: as in `torchlinf.complexity_profile`.
        estimator: as there.
        tol: as there.

    Returns:
        `DecisionRegions`. A class that is nowhere has complexity NaN and is counted by `num_empty`; one that is
        everywhere has 0, in either frame. Not differentiable, see `DecisionRegionLoss`; computed on the CPU but for the
        classifier itself.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value, or the classifier answers NaN or in another shape; or "open" would
            take too much memory, as large grids of 3 or 4 features may.
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020; docs/regions.

    Example:
        >>> def in_a_disc(points):
        ...     return points.square().sum(dim=1) < 1
        >>> regions = decision_region_complexity(in_a_disc, [(-1.5, 1.5)] * 2, 25)
        >>> regions.classes, regions.mean(), regions.overall()
        ((False, True), tensor([2.0490, 0.5755], dtype=torch.float64), tensor(1.5940, dtype=torch.float64))
    """
    grid = Grid.within(bounds, resolution)
    asked = Asked(response_method=response_method, threshold=threshold, classes=classes, chunk_size=chunk_size)
    return regions_on(classifier, grid, frame, asked, Measured(bins=bins, estimator=estimator, tol=tol))


def decision_plane(
    classifier: Any,
    points: Tensor | ArrayLike,
    resolution: int = 128,
    *,
    margin: float = 0.25,
    frame: str = "background",
    response_method: str = "auto",
    threshold: float | None = None,
    classes: Sequence[Any] | None = None,
    chunk_size: int | None = None,
    bins: int = 1024,
    estimator: str = "entropy",
    tol: float = 1e-9,
) -> DecisionRegions:
    """Complexity of the decision regions on the plane through three data points, in inputs of any number of features.

    The grid is a square around the triangle, with equal steps along both axes. The first axis is along the triangle's
    longest side, so that the order of the points does not matter.

    Args:
        classifier: as in `decision_region_complexity`, but points have the shape of the data, (P, *features).
        points: the three points, (3, *features), not on one line.
        resolution: points along both axes, 2 or more.
        margin: by how much the grid extends the longest side at either end, as a share of it, 0 or more.
        frame: as there.
        response_method: as there.
        threshold: as there.
        classes: as there.
        chunk_size: as there.
        bins: as there.
        estimator: as there.
        tol: as there.

    Returns:
        `DecisionRegions` with the coordinates of the three points in `plane.corners`.

    Raises:
        TypeError, ValueError, RuntimeError: as there; also if the points are on one line.

    Example:
        >>> corners = torch.tensor([[0.0, 0.0, 1.0], [5.0, 0.0, 1.0], [1.8, 2.4, 1.0]])
        >>> regions = decision_plane(lambda points: points[:, :2], corners, 33)  # which of two features is larger
        >>> regions.plane.corners[2], regions.overall()
        (tensor([1.8000, 2.4000], dtype=torch.float64), tensor(2.3447, dtype=torch.float64))
    """
    grid = Grid.around(Plane.through(points), resolution, margin)
    asked = Asked(response_method=response_method, threshold=threshold, classes=classes, chunk_size=chunk_size)
    return regions_on(classifier, grid, frame, asked, Measured(bins=bins, estimator=estimator, tol=tol))


def decision_plane_complexity(
    classifier: Any,
    X: Tensor | ArrayLike,
    num_planes: int = 32,
    resolution: int = 64,
    *,
    low: float = 0.0,
    high: float = 1.0,
    margin: float = 0.25,
    seed: int = 0,
    frame: str = "background",
    response_method: str = "auto",
    threshold: float | None = None,
    classes: Sequence[Any] | None = None,
    chunk_size: int | None = None,
    bins: int = 1024,
    estimator: str = "entropy",
    tol: float = 1e-9,
) -> PlaneComplexity:
    """Mean complexity of decision regions over planes through random triples of data points.

    The triples are drawn independently of each other, each of three different points; one whose points are on one line
    is drawn again. So the standard error is that of the mean over all triples of these data. Planes lie at all angles
    to the features: the mean does not depend on a rotation of the data.

    Args:
        classifier: as in `decision_plane`.
        X: the data, (N, *features), 3 points or more.
        num_planes: how many triples, 2 or more.
        resolution: points along both axes of each plane.
        low: lower end of the window of scales, excluded.
        high: upper end, included; 0 <= low < high <= 1.
        margin: as in `decision_plane`.
        seed: of the triples. The same data and seed give the same planes, for whatever classifier: compare two
            classifiers by the differences of their `values`.
        frame: as in `decision_region_complexity`.
        response_method: as there.
        threshold: as there.
        classes: as there.
        chunk_size: as there.
        bins: as there.
        estimator: as there.
        tol: as there.

    Returns:
        `PlaneComplexity`, with the mean of `DecisionRegions.overall(low, high)` and its standard error.

    Raises:
        TypeError, ValueError, RuntimeError: as there; also if hardly any triple spans a plane.

    Example:
        >>> X = torch.randn(50, 6, generator=torch.Generator().manual_seed(0))
        >>> found = decision_plane_complexity(lambda points: points[:, :3], X, 8, 24)
        >>> found.values.shape, found.mean > 5 * found.standard_error
        (torch.Size([8]), True)
    """
    low, high = window(low, high)
    asked = Asked(response_method=response_method, threshold=threshold, classes=classes, chunk_size=chunk_size)
    measured = Measured(bins=bins, estimator=estimator, tol=tol)
    values, triples = [], []
    for triple, plane in random_planes(X, num_planes, seed):
        regions = regions_on(classifier, Grid.around(plane, resolution, margin), frame, asked, measured)
        values.append(regions.overall(low, high))
        triples.append(triple)
    return PlaneComplexity(torch.stack(values), torch.stack(triples))
