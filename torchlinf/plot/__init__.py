"""Figures of masks, their level lines, and their complexity against scale. Needs the extra `plot` (matplotlib)."""

from torchlinf.plot.overviews import hasse, overview, shapes
from torchlinf.plot.panels import COLOURS
from torchlinf.plot.single import complexity_map, decision_regions, levels, profile

__all__ = ["COLOURS", "complexity_map", "decision_regions", "hasse", "levels", "overview", "profile", "shapes"]
