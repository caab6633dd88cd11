"""Planes through random triples of data points, and what is found on them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from numpy.typing import ArrayLike
from torch import Tensor

from torchlinf._checks import count
from torchlinf.regions.grids import Plane, as_points, spans_plane

TRIES = 10  # triples drawn for each plane at most


@dataclass(frozen=True, eq=False)
class PlaneComplexity:
    """Complexity of decision regions on planes through random triples; made by `decision_plane_complexity`.

    Attributes:
        values: (T,) float64, the overall complexity on each plane. NaN where no class has any point of it, which only
            happens with a threshold.
        triples: (T, 3) int64, the points that each plane goes through, as indices of the data.
    """

    values: Tensor
    triples: Tensor

    @property
    def num_empty(self) -> int:
        """Planes without any region; they are left out of the mean and its error."""
        return int(self.values.isnan().sum())

    @property
    def mean(self) -> float:
        """Mean over the planes."""
        return float(self.values.nanmean())

    @property
    def standard_error(self) -> float:
        """Of that mean: the sample standard deviation over the square root of the number of planes."""
        found = self.values[~self.values.isnan()]
        return float(found.std() / math.sqrt(len(found))) if len(found) > 1 else math.nan


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
    generator = torch.Generator().manual_seed(seed)
    found = 0
    for _ in range(TRIES * num_planes):
        triple = torch.randperm(len(data), generator=generator)[:3]
        if spans_plane(data[triple]):
            yield triple, Plane.through(data[triple])
            found += 1
            if found == num_planes:
                return
    raise ValueError(
        f"X must hold triples that span planes; got {found} in {TRIES * num_planes} tries. Pass data of two dimensions "
        "or more, without copies, such as numpy.unique(X, axis=0)."
    )
