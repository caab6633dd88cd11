"""Complexity of the decision regions of a classifier, on grids and on planes through data points."""

from torchlinf.regions.decision_planes import PlaneComplexity, decision_plane, decision_plane_complexity
from torchlinf.regions.decision_regions import DecisionRegions, decision_region_complexity
from torchlinf.regions.grids import Plane, bounds_around
from torchlinf.regions.region_loss import DecisionRegionLoss
from torchlinf.regions.summary import RegionSummary, decision_region_summary

__all__ = [
    "DecisionRegionLoss",
    "DecisionRegions",
    "Plane",
    "PlaneComplexity",
    "RegionSummary",
    "bounds_around",
    "decision_plane",
    "decision_plane_complexity",
    "decision_region_complexity",
    "decision_region_summary",
]
