"""What the figures of `torchlinf.plot` are made of: colours, pages, and the drawing of each thing on its axes."""

from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.extras import require
from torchlinf._helpers.terminal import printable
from torchlinf.measure import ComplexityProfile, Measure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

# Paul Tol's "muted" colours, which people of any colour vision tell apart, in an order that puts unlike ones side by
# side, and a grey. From the eleventh shape on they come again, with another line style.
COLOURS = (
    "#332288", "#CC6677", "#117733", "#88CCEE", "#882255", "#999933", "#AA4499", "#44AA99", "#DDCC77", "#555555",
)  # fmt: skip
STYLES = ("-", "--", ":")

# Level lines at a tenth, two tenths ... of the maximum.
LINES = np.arange(1, 10) / 10

DARKEST = 98  # percentile of the shares of pixels from which on they are drawn alike

TITLES = {"field": "field f / max f", "distance": "scale t = d / D"}

# Of each estimator: the label of the axis of a profile, and how high that axis is at least.
PROFILE_AXES = {"entropy": ("complexity (bits)", 1.0), "std": ("standard deviation of f / max f", 0.01)}


class Look(NamedTuple):
    """Colour and style of a line."""

    color: str
    style: str


def looks(count: int) -> list[Look]:
    """Looks for shapes side by side, all different up to thirty."""
    return [Look(COLOURS[i % len(COLOURS)], STYLES[i // len(COLOURS) % len(STYLES)]) for i in range(count)]


def pyplot() -> ModuleType:
    """Import matplotlib.pyplot, or say which extra to install."""
    return require("matplotlib.pyplot", "torchlinf.plot", "plot")


def page(width: float, height: float, height_profiles: float) -> tuple["Figure", "SubFigure", "Axes"]:
    """A figure (sizes in inches) with room for shapes above, and axes for the profiles below."""
    figure = pyplot().figure(figsize=(width, height + height_profiles), layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=[height, height_profiles])
    return figure, top, bottom.subplots()


def axes_or_new(ax: "Axes | None") -> "Axes":
    """The axes, or those of a new figure."""
    if ax is None:
        return cast("Axes", pyplot().subplots(layout="constrained")[1])
    require_axes(ax)
    return ax


def require_axes(ax: object) -> None:
    """Raise unless it is matplotlib's axes."""
    pyplot()
    from matplotlib.axes import Axes

    if not isinstance(ax, Axes):
        raise TypeError(f"ax must be matplotlib axes; got {type(ax).__name__}. Pass plt.subplots()[1], or None.")


def in_unit(value: Tensor | float, measure: Measure) -> str:
    """A number with its unit.

    >>> in_unit(1.234, Measure())
    '1.23 bits'
    """
    return f"{float(value):.2f} bits" if measure.unit == "bits" else f"{float(value):.3f} of max f"


def draw_profile(ax: "Axes", solved: ComplexityProfile, label: str | None, look: Look) -> "Axes":
    """Level k holds for the scales from (k-1)/D to k/D: a staircase, not a line through points."""
    ends, values, _ = (one.numpy(force=True) for one in solved.steps())
    edges = np.concatenate([[0.0], ends])
    ax.stairs(values, edges, baseline=None, label=label, color=look.color, linestyle=look.style, linewidth=1.6)
    # The same ground for all, at least one bit high, and low enough to show the line of a profile that is zero.
    words, least = PROFILE_AXES[solved.measure.estimator]
    top = max(least, ax.dataLim.y1)
    ax.set(xlim=(0, 1), ylim=(-0.02 * top, 1.05 * top))
    ax.set(xlabel="scale t = d / D (share of the radius)", ylabel=words)
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def draw_levels(ax: "Axes", values: NDArray[np.float64], color: str) -> None:
    """Fill what is above 0 with a pale tint of the colour, and draw level lines on it."""
    from matplotlib.colors import ListedColormap, to_rgb

    # A frame of zeros closes the lines of shapes that touch the border.
    framed = np.pad(values, 1)
    rows, columns = (np.arange(-1, size + 1) for size in values.shape)
    pale = (1 + np.array(to_rgb(color))) / 2
    extent = (-1.5, columns[-1] + 0.5, rows[-1] + 0.5, -1.5)
    ax.imshow(framed > 0, cmap=ListedColormap(np.array([np.ones(3), pale])), extent=extent, interpolation="nearest")
    ax.contour(columns, rows, framed, levels=LINES, colors="#222222", linewidths=0.6)


def draw_map(ax: "Axes", share: NDArray[np.float64], whole: float, top: float | None) -> "Axes":
    """Image of the shares, from pale to dark, white outside; with the outline of the shape and a colour bar."""
    if top is None:
        # Levels near the middle have few pixels, each with so large a share that all others would look alike.
        top = float(np.percentile(share[share > 0], DARKEST)) if (share > 0).any() else 1.0
    drawn = ax.imshow(share, cmap="YlOrBr", vmin=0.0, vmax=top, interpolation="nearest")
    draw_outline(ax, ~np.isnan(share))
    bar = ax.figure.colorbar(drawn, ax=ax, shrink=0.85, extend="max" if np.nanmax(share) > top else "neither")
    bar.set_label("share (bits per pixel)")
    ax.set(xlabel="column (pixels)", ylabel="row (pixels)", title=f"{whole:.2f} bits")
    return ax


def draw_outline(ax: "Axes", inside: NDArray[np.bool_]) -> None:
    """Line along the edges of the pixels that bound a shape."""
    # Contours run between the centres of pixels; with four to a pixel the outline all but keeps its corners.
    fine = np.pad(inside, 1).repeat(2, 0).repeat(2, 1)
    rows, columns = (np.arange(size) / 2 - 1.25 for size in fine.shape)
    ax.contour(columns, rows, fine, levels=[0.5], colors="#222222", linewidths=0.6)


def draw_legend(ax: "Axes", reverse: bool = False) -> None:
    """Name the lines beside the axes, where there are several."""
    if len(ax.patches) > 1:
        ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, reverse=reverse)


def shorten(name: str, longest: int = 24) -> str:
    r"""A name as text in a figure, where no character of it has a meaning, cut at the front if it is long.

    The end of a path tells more than its beginning.

    >>> shorten("silhouettes/animals/horse-17.png", longest=14), shorten("$a$")
    ('…/horse-17.png', '\\$a\\$')
    """
    name = printable(name)
    name = name if len(name) <= longest else "…" + name[1 - longest :]
    # Between two dollar signs matplotlib reads formulas; a legend leaves out names that begin with an underscore.
    shown = name.replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown
