"""What the figures of `torchlinf.plot` are made of."""

from collections.abc import Mapping
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple, Unpack, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._checks import as_mask
from torchlinf.field import chessboard_distance, linf_field
from torchlinf.measure import ComplexityProfile, LevelOptions, complexity_map, complexity_profile

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from torchlinf.regions import DecisionRegions

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

# What profiles are drawn of: the label of the axis, and how high the axis is at least.
ESTIMATED = {"entropy": ("complexity (bits)", 1.0), "std": ("standard deviation of f / max f", 0.01)}


class Look(NamedTuple):
    """Colour and style of a line."""

    color: str
    style: str


def looks(count: int) -> list[Look]:
    """Looks for shapes side by side, all different up to thirty."""
    return [Look(COLOURS[i % len(COLOURS)], STYLES[i // len(COLOURS) % len(STYLES)]) for i in range(count)]


def pyplot() -> ModuleType:
    """Import matplotlib.pyplot, or say which extra to install."""
    try:
        import matplotlib.pyplot
    except ImportError as error:
        raise ImportError(
            "torchlinf.plot needs matplotlib, which is not installed. Run: pip install 'torchlinf[plot]'"
        ) from error
    return matplotlib.pyplot


def page(width: float, height: float, height_profiles: float) -> tuple["Figure", "SubFigure", "Axes"]:
    """A figure (sizes in inches) with room for shapes above, and axes for the profiles below."""
    figure = pyplot().figure(figsize=(width, height + height_profiles), layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=[height, height_profiles])
    return figure, top, bottom.subplots()


def axes_or_new(ax: "Axes | None") -> "Axes":
    """The axes, or those of a new figure."""
    return cast("Axes", pyplot().subplots(layout="constrained")[1]) if ax is None else ax


def solve(mask: Tensor, estimator: str = "entropy") -> ComplexityProfile:
    """Profile of one shape without leading dimensions."""
    _require_shape(mask)
    return complexity_profile(mask, estimator=estimator, spatial_ndim=mask.ndim)


def solve_all(masks: Mapping[str, Tensor], **options: Unpack[LevelOptions]) -> dict[str, ComplexityProfile]:
    """Profiles of shapes by name, at least one."""
    if not masks:
        raise ValueError("masks must hold at least one mask; got none. Pass for example {'disc': shapes.disc(32)}.")
    for mask in masks.values():
        _require_shape(mask)
    return {name: complexity_profile(mask, spatial_ndim=mask.ndim, **options) for name, mask in masks.items()}


def slices(mask: Tensor) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The field f / max f and the scale t of an image, or of the slice of a volume through its deepest voxel."""
    distance, deepest = _deepest(mask)
    field = linf_field(mask, spatial_ndim=mask.ndim, dtype=torch.float64)
    scale = distance.double() / distance.max()
    return field[deepest].numpy(force=True), scale[deepest].numpy(force=True)


def shares(mask: Tensor, low: float, high: float) -> tuple[float, NDArray[np.float64]]:
    """The complexity, and the share of each pixel of an image or of the deepest slice of a volume; NaN outside."""
    _, deepest = _deepest(mask)
    share = complexity_map(mask, low=low, high=high, spatial_ndim=mask.ndim).double()
    return float(share.sum()), torch.where(mask != 0, share, torch.nan)[deepest].numpy(force=True)


def silhouette(mask: Tensor) -> NDArray[np.bool_]:
    """An image, or the slice of a volume through its deepest voxel, cut to what is inside."""
    distance, deepest = _deepest(mask)
    inside = (distance[deepest] > 0).numpy(force=True)
    rows, columns = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
    return inside[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _deepest(mask: Tensor) -> tuple[Tensor, tuple[int, ...]]:
    """The distance, and the index of the slice to draw: none of an image, of a volume that of its deepest voxel."""
    _require_shape(mask)
    if mask.ndim not in (2, 3):
        raise ValueError(f"mask must be (H, W) or (D, H, W); got {tuple(mask.shape)}. Pass one shape, without a batch.")
    distance = chessboard_distance(mask, spatial_ndim=mask.ndim)
    return distance, (int(distance.flatten(1).amax(dim=1).argmax()),) if mask.ndim == 3 else ()


def _require_shape(mask: Tensor) -> None:
    inside, _ = as_mask(mask, getattr(mask, "ndim", None))
    if not inside.any():
        raise ValueError("mask must have at least one pixel inside; got an empty one. Leave it out.")


def draw_profile(
    ax: "Axes", solved: ComplexityProfile, label: str | None, look: Look, estimator: str = "entropy"
) -> "Axes":
    """Level k holds for the scales from (k-1)/D to k/D: a staircase, not a line through points."""
    values = cast("Tensor", solved.levels()).numpy(force=True)
    edges = np.arange(len(values) + 1) / len(values)
    ax.stairs(values, edges, baseline=None, label=label, color=look.color, linestyle=look.style, linewidth=1.6)
    # The same ground for all, at least one bit high, and low enough to show the line of a profile that is zero.
    words, least = ESTIMATED[estimator]
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


def draw_regions(ax: "Axes", regions: "DecisionRegions") -> "Axes":
    """Fill each region with a pale tint of its class's colour; name the classes with their complexities."""
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    horizontal, vertical = ((float(axis[0]), float(axis[-1]), float(axis[1] - axis[0]) / 2) for axis in regions.axes)
    # Points are the centres of their pixels.
    extent = tuple(edge for low, high, half in (horizontal, vertical) for edge in (low - half, high + half))
    image = np.ones((*regions.masks.shape[1:], 3))
    named = []
    for i, (name, mask, value) in enumerate(zip(regions.classes, regions.masks, regions.mean(), strict=True)):
        red, green, blue = (0.6 + 0.4 * part for part in to_rgb(COLOURS[i % len(COLOURS)]))
        image[mask.numpy()] = red, green, blue
        if mask.any():
            named.append(Patch(color=(red, green, blue), label=f"{name}: {float(value):.2f} bits"))
    ax.imshow(image.swapaxes(0, 1), extent=cast("tuple[float, float, float, float]", extent), origin="lower")
    words = ["feature 0", "feature 1"]
    if regions.plane is not None:
        words = ["along the longest side", "towards the third point"]
        ax.plot(*regions.plane.corners.numpy().T, "o", color="#222222", markersize=4)
    ax.set(xlabel=words[0], ylabel=words[1], title=f"{float(regions.overall()):.2f} bits")
    ax.legend(handles=named, fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1), frameon=False)
    return ax


def draw_legend(ax: "Axes", reverse: bool = False) -> None:
    """Name the lines beside the axes, where there are several."""
    if len(ax.patches) > 1:
        ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, reverse=reverse)


def shorten(name: str, longest: int = 24) -> str:
    """Cut a long name at the front: the end of a path tells more than its beginning.

    >>> shorten("silhouettes/animals/horse-17.png", longest=14)
    '…/horse-17.png'
    """
    return name if len(name) <= longest else "…" + name[1 - longest :]
