"""Complexity of the decision regions of a classifier, on grids and on planes through data points."""

from torchlinf.regions.grids import Plane, bounds_around
from torchlinf.regions.loss import DecisionRegionLoss
from torchlinf.regions.measured import decision_plane, decision_plane_complexity, decision_region_complexity
from torchlinf.regions.planes import PlaneComplexity
from torchlinf.regions.result import DecisionRegions

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
