"""Outlines to tables: one row per polygon, each drawn in its own frame and at the detail that is asked for.

Needs the extra `geo` (shapely; GeoPandas and pyogrio for files).
"""

from torchlinf.polygons.table import MAX_PIXELS, complexity_table

__all__ = ["MAX_PIXELS", "complexity_table"]
