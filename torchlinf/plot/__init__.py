"""Figures of shapes, their level lines, their complexity against scale, their orders, and decision regions.

Each function draws what is computed already, where it is given, and solves nothing twice. They need the extra `plot`
(matplotlib).
"""

from torchlinf.plot.comparison_figures import overview, shapes
from torchlinf.plot.drawing import COLOURS
from torchlinf.plot.hasse_figure import hasse
from torchlinf.plot.region_figure import decision_regions
from torchlinf.plot.shape_figures import complexity_map, levels, profile

__all__ = ["COLOURS", "complexity_map", "decision_regions", "hasse", "levels", "overview", "profile", "shapes"]
