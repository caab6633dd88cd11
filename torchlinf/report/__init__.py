"""A table of scores as one page to look at. Needs the extra `report` (bokeh)."""

from torchlinf.report.masks import MaskReader
from torchlinf.report.write import Report, write_report

__all__ = ["MaskReader", "Report", "write_report"]
