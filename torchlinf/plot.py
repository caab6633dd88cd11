"""Figures of masks, their level lines, and their complexity against scale. Needs the extra `plot` (matplotlib)."""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import TYPE_CHECKING

from torch import Tensor

from torchlinf import _hasse
from torchlinf._panels import (
    COLOURS,
    TITLES,
    Look,
    axes_or_new,
    draw_legend,
    draw_levels,
    draw_map,
    draw_profile,
    draw_regions,
    looks,
    page,
    shares,
    shorten,
    slices,
    solve,
    solve_all,
)  # fmt: skip
from torchlinf.order import WINDOWS, Node, dominance

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from networkx import DiGraph

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


def shapes(masks: Mapping[str, Tensor]) -> "Figure":
    """Draw shapes in the order of their complexity, each with its number and level lines of f, and their profiles.

    Args:
        masks: the shapes by name, each as for `levels`. Up to a dozen stay readable.

    Returns:
        The figure; its first axes hold the profiles, the others the shapes.

    Raises:
        ImportError: matplotlib is not installed.
        ValueError: there is no mask, or one is empty, not binary, or neither 2-D nor 3-D.

    Example:
        >>> from torchlinf import plot, shapes
        >>> figure = plot.shapes({"disc": shapes.disc(16), "square": shapes.square(32)})
        >>> [ax.get_xlabel().split()[0] for ax in figure.axes[1:]]
        ['square', 'disc']
    """
    solved = solve_all(masks)
    names = sorted(masks, key=lambda name: float(solved[name].mean()))
    rows = ceil(len(names) / 5)
    columns = ceil(len(names) / rows)
    figure, top, ax_profiles = page(max(1.9 * columns, 6.0), 2.3 * rows, 3.2)
    panels = list(top.subplots(rows, columns, squeeze=False).flat)
    for panel in panels[len(names) :]:
        panel.remove()
    for panel, name, look in zip(panels, names, looks(len(names)), strict=False):
        draw_levels(panel, slices(masks[name])[0], look.color)
        panel.set(xticks=[], yticks=[], anchor="S")
        panel.spines[:].set_visible(False)
        panel.set_xlabel(f"{shorten(name)}\n{float(solved[name].mean()):.2f} bits")
        draw_profile(ax_profiles, solved[name], shorten(name), look)
    draw_legend(ax_profiles, reverse=True)  # the order of the lines, from the top
    return figure


def overview(masks: Mapping[str, Tensor]) -> "Figure":
    """Draw each mask twice, with level lines of f and of t, and all profiles in one plot below.

    Args:
        masks: the shapes by name, each as for `levels`. Up to a dozen stay readable.

    Returns:
        The figure; its first axes hold the profiles, the others the shapes.

    Raises:
        ImportError: matplotlib is not installed.
        ValueError: there is no mask, or one is empty, not binary, or neither 2-D nor 3-D.

    Example:
        >>> from torchlinf import plot, shapes
        >>> figure = plot.overview({"disc": shapes.disc(16)})
        >>> [ax.get_title() for ax in figure.axes[1:]]
        ['field f / max f', 'scale t = d / D']
    """
    solved = solve_all(masks)
    rows = ceil(len(masks) / 3)
    columns = ceil(len(masks) / rows)
    figure, top, ax_profiles = page(max(4.4 * columns, 6.4), 2.9 * rows, 3.4)
    pairs = top.subfigures(rows, columns, squeeze=False).flat
    for pair, name, look in zip(pairs, masks, looks(len(masks)), strict=False):
        cut = ", deepest slice" if masks[name].ndim == 3 else ""
        pair.suptitle(f"{shorten(name)}{cut}: {float(solved[name].mean()):.3f} bits", fontsize=11)
        left, right = pair.subplots(1, 2, sharey=True)
        for panel, values, title in zip((left, right), slices(masks[name]), TITLES.values(), strict=True):
            draw_levels(panel, values, look.color)
            panel.set_title(title, fontsize=9)
            panel.set_xlabel("column (pixels)", fontsize=8)
            panel.set_anchor("N")
            panel.tick_params(labelsize=8)
        left.set_ylabel("row (pixels)", fontsize=8)
        draw_profile(ax_profiles, solved[name], shorten(name), look)
    draw_legend(ax_profiles)
    return figure


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


def hasse(
    masks: Mapping[str, Tensor],
    *,
    order: "DiGraph | None" = None,
    windows: Sequence[tuple[float, float]] | None = WINDOWS,
    highlight: Sequence[Node] = (),
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw the Hasse diagram of a partial order of shapes: each line leads up to a shape that is more complex.

    A shape is higher than another if a path of lines leads up to it; the others cannot be compared. Steps that follow
    from others are left out. Shapes that are equal, within the certified error, stand together in a frame.

    Args:
        masks: the shapes by name, each as for `levels`. Up to about twenty stay readable.
        order: the order, as `torchlinf.order.dominance` returns it; None makes it of the masks.
        windows: the windows of scales by which it is made, or None for all scales; unused where `order` is given.
        highlight: nodes to be drawn in another colour, with the lines from each to the next; a chain, for example.
        ax: where to draw; None makes a new figure of a size that suits.

    Returns:
        The axes. Shapes are drawn with the longer side at 1, whatever their size in pixels; below are their names
        and the means over the windows in bits.

    Raises:
        ImportError: matplotlib is not installed.
        TypeError, ValueError: a mask or the windows cannot be used, or `order` has names that `masks` has not.

    Example:
        >>> from torchlinf import plot, shapes
        >>> ax = plot.hasse({"disc": shapes.disc(16), "square": shapes.square(32), "box": shapes.box(9, 20)})
        >>> len(ax.images), len(ax.lines)
        (3, 1)
    """
    if order is None:
        order = dominance(solve_all(masks), windows=windows)
    return _hasse.draw_order(ax, order, masks, highlight)
