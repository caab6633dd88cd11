"""What is measured of one fitted classifier: complexity, its rivals, and what they are to foretell."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import cdist

from benchmarks.regions_study.data import Split
from torchlinf.regions import DecisionRegions, RegionSummary, bounds_around, decision_region_summary

ROTATIONS = 6
EPS = 0.5  # standard deviations by which the grid extends the data
NOISE = 0.1  # standard deviation of a perturbation, in those of the features
DRAWS = 20  # perturbations of every test point
FINE = 0.25  # upper end of the window of small scales

Array = NDArray[Any]


def measured(classifier: Any, halves: Split, resolution: int, seed: int) -> dict[str, float]:
    """All numbers of one classifier that is fitted to the half to train on."""
    bounds = bounds_around(halves.train, eps=EPS)
    summary = decision_region_summary(classifier, bounds, resolution=resolution, rotations=ROTATIONS)
    return {**complexities(summary), **rivals(summary, classifier, halves), **targets(classifier, halves, seed)}


def complexities(summary: RegionSummary) -> dict[str, float]:
    """On the grid of the features, the mean over rotations, and the least of them."""
    overall = [float(regions.overall()) for regions in summary.regions]
    fine = [float(regions.overall(0.0, FINE)) for regions in summary.regions]
    return {
        "grid": overall[0],
        "mean": float(np.mean(overall)),
        "least": min(overall),
        "standard error": float(summary.overall_standard_error()),
        "fine, grid": fine[0],
        "fine, mean": float(np.mean(fine)),
    }


def rivals(summary: RegionSummary, classifier: Any, halves: Split) -> dict[str, float]:
    """Simple numbers of the same regions, and one of the predictions at the data alone."""
    points = np.concatenate([halves.train, halves.test])
    return {
        "length": float(np.mean([boundary_length(regions) for regions in summary.regions])),
        "regions": float(np.mean([number_of_regions(regions) for regions in summary.regions])),
        "N1": n1(points, classifier.predict(points)),
    }


def boundary_length(regions: DecisionRegions) -> float:
    """Length of the boundary between classes, in sides of the grid.

    Neighbours of different classes are counted along both axes. By Cauchy and Crofton pi/4 of that count, in steps, is
    the length of a curve whose directions are evenly spread; the mean over rotations makes them nearly so.
    """
    labels = regions.masks.numpy().argmax(axis=0)
    crossings = sum(int((np.diff(labels, axis=axis) != 0).sum()) for axis in (0, 1))
    return np.pi / 4 * crossings / (len(labels) - 1)


def number_of_regions(regions: DecisionRegions) -> int:
    """Connected parts of all classes, of pixels that share a side."""
    return sum(int(label(mask)[1]) for mask in regions.masks.numpy())


def n1(points: Array, classes: Array) -> float:
    """Ho and Basu's N1: the share of points that the minimum spanning tree joins to a point of another class.

    The classes are those that the classifier predicts, not the true ones.
    """
    # An edge of length 0, or of less than 1e-8, would be taken for no edge.
    tree = minimum_spanning_tree(cdist(points, points) + 1e-6).tocoo()
    apart = classes[tree.row] != classes[tree.col]
    return len(np.unique([tree.row[apart], tree.col[apart]])) / len(points)


def targets(classifier: Any, halves: Split, seed: int) -> dict[str, float]:
    """Accuracy on either half, the gap between them, and how many test points flip under small noise."""
    train = float((classifier.predict(halves.train) == halves.train_classes).mean())
    answers = classifier.predict(halves.test)
    test = float((answers == halves.test_classes).mean())
    noise = np.random.default_rng(seed).normal(scale=NOISE, size=(DRAWS, *halves.test.shape))
    moved = classifier.predict((halves.test + noise).reshape(-1, 2)).reshape(DRAWS, -1)
    return {"train": train, "test": test, "gap": train - test, "flips": float((moved != answers).mean())}
