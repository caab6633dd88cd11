"""Figures of one thing: a shape with its lines, shares or profile, or the decision regions of a classifier."""

from typing import TYPE_CHECKING

from torch import Tensor

from torchlinf.plot.panels import (
    COLOURS,
    TITLES,
    Look,
    axes_or_new,
    draw_levels,
    draw_map,
    draw_profile,
    draw_regions,
    shares,
    slices,
    solve,
)  # fmt: skip

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from torchlinf.regions import DecisionRegions


def profile(
    mask: Tensor,
    *,
    label: str | None = None,
    color: str | None = None,
    style: str = "-",
    estimator: str = "entropy",
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw the complexity of one shape against scale, level by level.

    Args:
        mask: one shape, (H, W) or (D, H, W) or any other number of spatial dimensions, values 0 or 1, not empty.
        label: name of the line in a legend.
        color: colour of the line; None takes the next of `COLOURS`.
        style: line style, as matplotlib writes it.
        estimator: "entropy", or "std" for the standard deviation of f / max f on each level.
        ax: where to draw; None makes a new figure. Call again with the axes returned to compare shapes, all by the same
            estimator.

    Returns:
        The axes: scale in (0, 1] without unit, complexity in bits, or a standard deviation without unit.

    Raises:
        ImportError: matplotlib is not installed.
        TypeError: `mask` is no tensor.
        ValueError: `mask` is empty or not binary, or `estimator` is neither of the two.

    Example:
        >>> from torchlinf import plot, shapes
        >>> ax = plot.profile(shapes.disc(16), label="disc")
        >>> ax = plot.profile(shapes.square(32), label="square", ax=ax)
        >>> ax.get_ylabel()
        'complexity (bits)'
    """
    solved, ax = solve(mask, estimator), axes_or_new(ax)
    look = Look(color or COLOURS[len(ax.patches) % len(COLOURS)], style)
    return draw_profile(ax, solved, label, look, estimator)


def levels(mask: Tensor, *, of: str | Tensor = "field", color: str | None = None, ax: "Axes | None" = None) -> "Axes":
    """Draw a shape with level lines.

    On a square both kinds of lines are nested squares. How the lines of the field leave those of the distance is what
    the complexity measures.

    Args:
        mask: one shape, (H, W) or (D, H, W), values 0 or 1, not empty. Of a volume the slice through its deepest voxel
            is drawn.
        of: "field" for f / max f, "distance" for the scale t = d / D; or another field to compare them with, (H, W),
            0 outside the shape and positive inside, which is divided by its maximum.
        color: the shape is filled with a pale tint of it; None takes the first of `COLOURS`.
        ax: where to draw; None makes a new figure.

    Returns:
        The axes, in pixels, of equal aspect, rows downwards. The nine lines are at 0.1, 0.2 ... 0.9.

    Raises:
        ImportError: matplotlib is not installed.
        TypeError: `mask` is no tensor.
        ValueError: `mask` is empty, not binary, or neither 2-D nor 3-D; `of` is another word than these two, or a field
            of another shape than an image's `mask`.

    Example:
        >>> from torchlinf import plot, shapes
        >>> ax = plot.levels(shapes.disc(16), of="distance")
        >>> ax.get_xlabel(), ax.get_ylabel()
        ('column (pixels)', 'row (pixels)')
    """
    if isinstance(of, str) and of not in TITLES:
        raise ValueError(f"of must be 'field' or 'distance'; got {of!r}. Pass of='field' for f / max f.")
    field, scale = slices(mask)
    if isinstance(of, Tensor):
        if of.shape != mask.shape or mask.ndim != 2:
            raise ValueError(
                f"of must be a field on an image, of the shape of mask; got {tuple(of.shape)} for {tuple(mask.shape)}. "
                "Pass one value for each pixel."
            )
        values, title = (of / of.max()).numpy(force=True), "field / its maximum"
    else:
        values, title = field if of == "field" else scale, TITLES[of]
    ax = axes_or_new(ax)
    draw_levels(ax, values, color or COLOURS[0])
    ax.set(xlabel="column (pixels)", ylabel="row (pixels)", title=title)
    return ax


def complexity_map(
    mask: Tensor, *, low: float = 0.0, high: float = 1.0, top: float | None = None, ax: "Axes | None" = None
) -> "Axes":
    """Draw where the complexity of a shape sits: each pixel in the colour of its share, with a colour bar.

    Args:
        mask: one shape, (H, W) or (D, H, W), values 0 or 1, not empty. Of a volume the slice through its deepest voxel
            is drawn.
        low: lower end of the window of scales, excluded.
        high: upper end of the window, included; 0 <= low < high <= 1.
        top: the share in bits per pixel from which on all have the darkest colour; None means that 98 % of the pixels
            with a share have less.
        ax: where to draw; None makes a new figure.

    Returns:
        The axes, in pixels, of equal aspect, rows downwards; the title has the sum over the whole shape, in bits.

    Raises:
        ImportError: matplotlib is not installed.
        TypeError: `mask` is no tensor.
        ValueError: `mask` is empty, not binary, or neither 2-D nor 3-D; or low and high are no window.

    Example:
        >>> from torchlinf import plot, shapes
        >>> plot.complexity_map(shapes.disc(16), high=0.25).get_title()
        '... bits'
    """
    whole, drawn = shares(mask, low, high)
    return draw_map(axes_or_new(ax), drawn, whole, top)


def decision_regions(regions: "DecisionRegions", *, ax: "Axes | None" = None) -> "Axes":
    """Draw the decision regions of two features, or of a plane with its three points, and their complexity.

    Args:
        regions: what `torchlinf.regions.decision_region_complexity` or `decision_plane` gives, on a grid of two axes.
        ax: where to draw; None makes a new figure. The colour of the i-th class is the i-th of `COLOURS`, paler, so
            that the data can be drawn on top: `ax.scatter(*X[y == i].T, color=plot.COLOURS[i])`.

    Returns:
        The axes, in the coordinates of the grid, the overall complexity as title; the legend has that of each class
        that is on the grid. Where classes overlap the last is seen; where there is none it is white.

    Raises:
        ImportError: matplotlib is not installed.
        ValueError: the grid has not two axes.

    Example:
        >>> from torchlinf import plot
        >>> from torchlinf.regions import decision_region_complexity
        >>> regions = decision_region_complexity(lambda points: points[:, 0] > 0, [(-1, 1), (-1, 1)], 16)
        >>> plot.decision_regions(regions).get_title()
        '0.00 bits'
    """
    if len(regions.axes) != 2:
        raise ValueError(
            f"regions must be on a grid of two axes; got {len(regions.axes)}. Pass bounds of two features, or use "
            "decision_plane."
        )
    return draw_regions(axes_or_new(ax), regions)
