"""What a classifier's regions are: their masks, areas and profiles, and one number of all of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypedDict

from torch import Tensor

from torchlinf._checks import choice
from torchlinf.measure import ComplexityProfile, complexity_profile
from torchlinf.regions.grids import Grid, Plane
from torchlinf.regions.open_boundary import open_profile
from torchlinf.regions.responses import class_masks

FRAMES = ("background", "open")


@dataclass(frozen=True, eq=False)
class DecisionRegions:
    """The regions that a classifier gives its classes on a grid, and their complexity.

    C is the number of classes; what a class has on the grid is one shape, in one piece or several.

    Attributes:
        classes: names of the C classes, those of the classifier or 0, 1, ...
        masks: (C, *resolution) bool, where each class is; the i-th dimension is the i-th feature.
        axes: coordinates of the points along each dimension, 1-D float64.
        profile: the complexity against scale, leading shape (C,); NaN for a class that is nowhere on the grid.
        area: (C,) float64, share of the grid's points in each region.
        plane: for `decision_plane`, where the grid lies in the input space; else None.
    """

    classes: tuple[Any, ...]
    masks: Tensor
    axes: tuple[Tensor, ...]
    profile: ComplexityProfile
    area: Tensor
    plane: Plane | None = None

    @property
    def num_empty(self) -> int:
        """Number of classes that are nowhere on the grid."""
        return int((self.profile.radius == 0).sum())

    def mean(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """Complexity of each class: (C,) exact means over the scales in (low, high]; see `ComplexityProfile.mean`."""
        return self.profile.mean(low, high)

    def overall(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """One number: the mean over the classes, each weighted by its area.

        That is the expected complexity of the region that a random point of the grid falls into. So neither splitting
        off a class of a few points nor losing one changes it by much, as an unweighted mean would.

        Args:
            low: lower end of the window of scales, excluded.
            high: upper end, included; 0 <= low < high <= 1.

        Returns:
            Tensor without dimensions, float64, in the unit of the profile. Classes that are nowhere have no weight;
            NaN if all are.
        """
        return self._weighted(self.mean(low, high)[:, None])[0]

    def overall_values(self) -> Tensor:
        """The same mean at each of `profile.scales`, (L,): the overall profile."""
        return self._weighted(self.profile.values)

    def _weighted(self, values: Tensor) -> Tensor:
        return (values.nan_to_num() * self.area[:, None]).sum(dim=0) / self.area.sum()


class Asked(TypedDict):
    """How a classifier is asked; the arguments of `decision_region_complexity` of these names."""

    response_method: str
    threshold: float | None
    classes: Sequence[Any] | None
    chunk_size: int | None


class Measured(TypedDict):
    """How regions are measured; the arguments of these names."""

    bins: int
    estimator: str
    tol: float


def regions_on(classifier: Any, grid: Grid, frame: str, asked: Asked, measured: Measured) -> DecisionRegions:
    """The regions of a classifier on a grid.

    Example:
        >>> asked = Asked(response_method="auto", threshold=0.0, classes=None, chunk_size=None)
        >>> grid = Grid.within([(-1, 1)], 5)
        >>> regions_on(lambda points: points, grid, "open", asked, Measured(bins=1024, estimator="std", tol=1e-9)).area
        tensor([0.6000, 0.4000], dtype=torch.float64)
    """
    choice(frame, FRAMES, "frame")
    masks, names = class_masks(classifier, grid, **asked)
    if frame == "open":
        profile = open_profile(masks, **measured)
    else:
        profile = complexity_profile(masks, spatial_ndim=masks.ndim - 1, **measured)
    area = masks.flatten(1).double().mean(dim=1)
    return DecisionRegions(names, masks, grid.axes, profile, area, grid.plane)
