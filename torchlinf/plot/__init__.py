"""Figures of masks, their level lines, and their complexity against scale. Needs the extra `plot` (matplotlib)."""

from torchlinf.plot._one import complexity_map, decision_regions, levels, profile
from torchlinf.plot._panels import COLOURS
from torchlinf.plot._several import hasse, overview, shapes

__all__ = ["COLOURS", "complexity_map", "decision_regions", "hasse", "levels", "overview", "profile", "shapes"]
