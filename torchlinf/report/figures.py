"""The parts of a report that bokeh draws: the table, the histogram, the scatter plot and the profiles."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchlinf._helpers.extras import require
from torchlinf.report.masks import COLOUR

BLUE, GREY, ORANGE = "#{:02x}{:02x}{:02x}".format(*COLOUR), "#c9d1da", "#d95f02"
# Colours that can be told apart by people who do not see all colours (Okabe and Ito), for profiles side by side.
LINES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#000000")
ROW, HEIGHT, CHART, PROFILE = 46, 560, 300, 270  # pixels: a row of the table, the table, a chart, the chart of profiles

# Text of files stands in a page only through templates that escape it: "<%-" does, "<%=" would not.
PICTURE = '<% if (value) { %><img src="<%- value %>" width="40" height="40" alt=""><% } %>'
TEXT = '<span title="<%- value %>"><%- value %></span>'
HOVER = """
<div style="max-width: 320px; font: 13px system-ui, sans-serif">
  <img src="@thumb" alt="" style="display: block; width: 96px; height: 96px; image-rendering: pixelated">
  <div style="overflow-wrap: anywhere"><b>@c0</b></div>
  <div>{values}</div>
</div>
"""

TABLE_STYLE = """
.slick-header-column { font: 600 12.5px system-ui, sans-serif; color: #1c2733; background: #eef2f6; }
.slick-cell { font: 13px system-ui, sans-serif; line-height: 44px; padding: 0 8px; border-color: transparent #eef2f6; }
.slick-cell img { vertical-align: middle; }
.slick-cell.selected { background: #d7e6f7; }
"""


@dataclass(frozen=True)
class Column:
    """A column of the table of a report.

    Attributes:
        name: as in the table of scores.
        title: with its unit.
        values: float64 numbers, NaN for none; or text.
        width: pixels.
    """

    name: str
    title: str
    values: NDArray[Any]
    width: int

    @property
    def is_number(self) -> bool:
        """Whether it holds numbers."""
        return self.values.dtype.kind == "f"


def models(
    columns: Mapping[str, Column],
    windows: int,
    borders: Sequence[float],
    thumbs: Sequence[str],
    profiles: Sequence[NDArray[np.uint16]],
    code: str,
) -> dict[str, Any]:
    """The bokeh models of a page: its parts by the id of the element that holds each.

    Args:
        columns: the columns by the name of their field in the page; the path is first.
        windows: how many columns behind it are means over windows of scales.
        borders: scales at which a window ends, for lines in the chart of the profiles.
        thumbs: a picture a row, as a data URI; "" for none.
        profiles: values of the profile of each row; empty for none.
        code: JavaScript that is run with all models when the page is ready.
    """
    require("bokeh", "a report", "report")
    from bokeh.document import Document
    from bokeh.models import BooleanFilter, CDSView, ColumnDataSource, CustomJS

    fields = {field: column.values if column.is_number else list(column.values) for field, column in columns.items()}
    source = ColumnDataSource({"thumb": list(thumbs), **fields}, name="rows")
    shown = BooleanFilter(booleans=[True] * len(thumbs))
    view = CDSView(filter=shown)
    lengths = np.array([len(profile) for profile in profiles], dtype=np.uint32)
    levels = np.concatenate([*profiles, np.empty(0, np.uint16)])
    stored = ColumnDataSource({"levels": levels}, name="profiles")
    bins = ColumnDataSource({"left": [], "right": [], "all": [], "shown": []})
    lines = ColumnDataSource({"x": [], "y": [], "colour": [], "path": []}, name="lines")
    histogram, scatter, profile = _histogram(bins), _scatter(source, view, columns, windows), _profile(lines, borders)
    table = _table(source, view, columns)
    parts = {"table": table, "histogram": histogram, "scatter": scatter, "profile": profile}
    document = Document()
    for part in parts.values():
        document.add_root(part)
    names = {
        "source": source,
        "shown": shown,
        "stored": stored,
        "starts": (np.cumsum(lengths) - lengths).tolist(),
        "lengths": lengths.tolist(),
        "bins": bins,
        "lines": lines,
        "dots": [
            scatter.renderers[0].glyph,
            scatter.renderers[0].selection_glyph,
            scatter.renderers[0].nonselection_glyph,
        ],
        "axes": {
            "x": scatter.xaxis[0],
            "y": scatter.yaxis[0],
            "histogram": histogram.xaxis[0],
            "profile": profile.yaxis[0],
        },
        **parts,
    }
    start = CustomJS(args={"models": names}, code=code)
    document.js_on_event("document_ready", start)
    return parts


def _table(source: Any, view: Any, columns: Mapping[str, Column]) -> Any:
    from bokeh.models import DataTable, HTMLTemplateFormatter, InlineStyleSheet, NanCompare, TableColumn

    picture = TableColumn(
        field="thumb", title="mask", width=64, sortable=False, formatter=HTMLTemplateFormatter(template=PICTURE)
    )
    shown = [
        TableColumn(
            field=field,
            title=html.escape(column.title),  # bokeh takes a title for HTML
            width=column.width,
            formatter=_number_format(column.values) if column.is_number else HTMLTemplateFormatter(template=TEXT),
            sorter=NanCompare() if column.is_number else None,
        )
        for field, column in columns.items()
    ]
    return DataTable(
        source=source,
        view=view,
        columns=[picture, *shown],
        row_height=ROW,
        height=HEIGHT,
        sizing_mode="stretch_width",
        autosize_mode="none",
        index_position=None,
        reorderable=False,
        stylesheets=[InlineStyleSheet(css=TABLE_STYLE)],
    )


def _number_format(values: NDArray[np.float64]) -> Any:
    from bokeh.models import NumberFormatter, ScientificFormatter

    known = values[np.isfinite(values)]
    if known.size and (known == np.round(known)).all() and np.abs(known).max() >= 1:
        return NumberFormatter(format="0,0", nan_format="", text_align="right")
    if known.size and 0 < np.abs(known).max() < 1e-3:
        return ScientificFormatter(precision=1, nan_format="", text_align="right")
    return NumberFormatter(format="0.0000", nan_format="", text_align="right")


def _histogram(bins: Any) -> Any:
    from bokeh.models import BoxSelectTool
    from bokeh.plotting import figure

    plot = figure(height=CHART, sizing_mode="stretch_width", tools="", y_axis_label="masks")
    plot.add_tools(box := BoxSelectTool(dimensions="width"))
    plot.toolbar.active_drag = box
    for heights, colour, label in (("all", GREY, "all masks"), ("shown", BLUE, "those that pass the filters")):
        bars = plot.quad("left", "right", heights, 0, source=bins, color=colour, line_color="white", legend_label=label)
        bars.nonselection_glyph = bars.selection_glyph = None
    plot.y_range.start = 0
    return _plain(plot)


def _scatter(source: Any, view: Any, columns: Mapping[str, Column], windows: int) -> Any:
    from bokeh.models import HoverTool, TapTool
    from bokeh.plotting import figure

    plot = figure(height=CHART, sizing_mode="stretch_width", tools="pan,wheel_zoom,box_select,lasso_select,reset")
    # The page sets the fields of both axes.
    field = next(field for field, column in columns.items() if column.is_number)
    dots = plot.scatter(
        field, field, source=source, view=view, size=7, color=BLUE, alpha=0.45, line_color=None, hit_dilation=1.5
    )
    dots.nonselection_glyph.fill_alpha = 0.25
    dots.selection_glyph = dots.glyph.clone(fill_color=ORANGE, fill_alpha=1.0, size=11, line_color="white")
    values = "<br>".join(
        f"{html.escape(column.title)} @{field}{{0.000}}" for field, column in list(columns.items())[1 : windows + 1]
    )
    plot.add_tools(
        TapTool(renderers=[dots]), HoverTool(renderers=[dots], tooltips=HOVER.replace("{values}", values), limit=3)
    )
    return _plain(plot)


def _profile(lines: Any, borders: Sequence[float]) -> Any:
    from bokeh.models import HoverTool, Range1d, Span
    from bokeh.plotting import figure

    plot = figure(
        height=PROFILE,
        sizing_mode="stretch_width",
        tools="",
        x_range=Range1d(0, 1),
        x_axis_label="scale t (share of the radius; small is near the boundary)",
    )
    curves = plot.multi_line("x", "y", source=lines, color="colour", line_width=2)
    plot.add_tools(
        HoverTool(renderers=[curves], tooltips=[("", "@path"), ("scale", "$x{0.00}"), ("value", "$y{0.00}")])
    )
    for scale in borders:
        plot.add_layout(Span(location=scale, dimension="height", line_color="#8896a5", line_dash="dashed"))
    plot.y_range.start = 0
    return _plain(plot)


def _plain(plot: Any) -> Any:
    """The look that all charts share."""
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    plot.background_fill_color = plot.border_fill_color = "white"
    plot.outline_line_color = None
    plot.grid.grid_line_color = "#e8edf2"
    plot.axis.axis_line_color = plot.axis.major_tick_line_color = "#8896a5"
    plot.axis.minor_tick_line_color = None
    plot.axis.axis_label_text_font_style = "normal"
    plot.axis.axis_label_text_font = plot.axis.major_label_text_font = "system-ui, sans-serif"
    plot.axis.major_label_text_font_size = plot.axis.axis_label_text_font_size = "12px"
    if plot.legend:
        legend = plot.legend[0]
        plot.add_layout(legend, "above")  # it would hide bars
        legend.orientation, legend.border_line_color, legend.padding = "horizontal", None, 2
        legend.label_text_font, legend.label_text_font_size = "system-ui, sans-serif", "12px"
    return plot
