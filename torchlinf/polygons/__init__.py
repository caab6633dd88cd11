"""Outlines to tables, and to simpler outlines: each is drawn in its own frame and at the detail that is asked for.

Needs the extra `geo` (shapely; GeoPandas and pyogrio for files).
"""

from torchlinf.polygons.simplify import simplify
from torchlinf.polygons.table import MAX_PIXELS, complexity_table

__all__ = ["MAX_PIXELS", "complexity_table", "simplify"]
