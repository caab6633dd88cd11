"""Figure of the decision regions of a classifier."""

from typing import TYPE_CHECKING, cast

import numpy as np

from torchlinf._helpers.checks import window
from torchlinf.plot.drawing import COLOURS, axes_or_new, in_unit

# Of the first ten classes, the next ten, and the third; then they come again.
STRENGTHS = (0.4, 0.8, 0.2)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

    from torchlinf.regions import DecisionRegions


def decision_regions(
    regions: "DecisionRegions", *, low: float = 0.0, high: float = 1.0, ax: "Axes | None" = None
) -> "Axes":
    """Draw the decision regions of two features, or of a plane with its three points, and their complexity.

    Args:
        regions: what `torchlinf.regions.decision_region_complexity` or `decision_plane` returns, on a grid of two axes.
        low: lower end of the window of scales of the numbers, excluded.
        high: upper end of the window, included; 0 <= low < high <= 1.
        ax: where to draw; None makes a new figure.

    Returns:
        The axes, in the coordinates of the grid. A grid that is turned is drawn where it lies: the picture is turned
        back, and the axes are the features. The title is the overall complexity; the legend has the complexity of
        each class that is on the grid. The colour of the i-th class is the i-th of `COLOURS`, paler, so that the data
        can be drawn on top: `ax.scatter(*X[y == i].T, color=plot.COLOURS[i])`. The eleventh to the twentieth class have
        a stronger tint, the next ten a fainter one. Where classes overlap, the last of them is seen; where there is no
        class, the figure is white.

    Raises:
        ImportError: matplotlib is not installed.
        TypeError: `regions` is no `DecisionRegions`, or `low`, `high` or `ax` is of the wrong type.
        ValueError: the grid does not have two axes, or `low` and `high` are no window.

    Example:
        >>> from torchlinf import plot
        >>> from torchlinf.regions import decision_region_complexity
        >>> regions = decision_region_complexity(lambda points: points[:, 0] > 0, [(-1, 1), (-1, 1)], resolution=16)
        >>> plot.decision_regions(regions).get_title()
        '0.00 bits'
    """
    from torchlinf.regions import DecisionRegions

    if not isinstance(regions, DecisionRegions):
        got = type(regions).__name__
        raise TypeError(f"regions must be DecisionRegions; got {got}. Pass what decision_region_complexity returns.")
    if len(regions.axes) != 2:
        raise ValueError(
            f"regions must be on a grid of two axes; got {len(regions.axes)}. Pass bounds of two features, or use "
            "decision_plane."
        )
    low, high = window(low, high)
    return _draw_regions(axes_or_new(ax), regions, low, high)


def _draw_regions(ax: "Axes", regions: "DecisionRegions", low: float, high: float) -> "Axes":
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    horizontal, vertical = ((float(axis[0]), float(axis[-1]), float(axis[1] - axis[0]) / 2) for axis in regions.axes)
    # Points are the centres of their pixels.
    extent = tuple(edge for first, last, half in (horizontal, vertical) for edge in (first - half, last + half))
    image = np.ones((*regions.masks.shape[1:], 3))
    named, measure = [], regions.profile.measure
    for i, (name, mask, value) in enumerate(zip(regions.classes, regions.masks, regions.mean(low, high), strict=True)):
        strength = STRENGTHS[i // len(COLOURS) % len(STRENGTHS)]
        red, green, blue = (1 - strength * (1 - part) for part in to_rgb(COLOURS[i % len(COLOURS)]))
        image[mask.numpy()] = red, green, blue
        if mask.any():
            named.append(Patch(color=(red, green, blue), label=f"{name}: {in_unit(value, measure)}"))
    drawn = ax.imshow(image.swapaxes(0, 1), extent=cast("tuple[float, float, float, float]", extent), origin="lower")
    if isinstance(regions.orientation, float):
        _turn_back(ax, drawn, regions, regions.orientation)
    words = ["feature 0", "feature 1"]
    if regions.plane is not None:
        words = ["along the longest side", "towards the third point"]
        ax.plot(*regions.plane.corners.numpy().T, "o", color="#222222", markersize=4)
    ax.set(xlabel=words[0], ylabel=words[1], title=in_unit(regions.overall(low, high), measure))
    ax.legend(handles=named, fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1), frameon=False)
    return ax


def _turn_back(ax: "Axes", drawn: "AxesImage", regions: "DecisionRegions", degrees: float) -> None:
    """Show a turned grid where it lies. The turn acts on steps of the grid, which may differ between the axes."""
    from matplotlib.transforms import Affine2D

    steps = [float(axis[1] - axis[0]) for axis in regions.axes]
    centre = [float(axis[0] + axis[-1]) / 2 for axis in regions.axes]
    back = Affine2D().translate(-centre[0], -centre[1]).scale(1 / steps[0], 1 / steps[1]).rotate_deg(-degrees)
    back = back.scale(*steps).translate(*centre)
    left, right, bottom, top = drawn.get_extent()
    corners = back.transform([(left, bottom), (left, top), (right, bottom), (right, top)])
    drawn.set_transform(back + ax.transData)
    ax.set(xlim=(corners[:, 0].min(), corners[:, 0].max()), ylim=(corners[:, 1].min(), corners[:, 1].max()))
