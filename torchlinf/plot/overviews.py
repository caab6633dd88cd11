"""Figures of several shapes: ranked, in pairs of pictures, or as a partial order."""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import TYPE_CHECKING, Unpack

from torch import Tensor

from torchlinf.measure import Measure, MeasureOptions, takes
from torchlinf.order import WINDOWS, Node, dominance
from torchlinf.plot import hasse_layout
from torchlinf.plot.panels import (
    TITLES,
    draw_legend,
    draw_levels,
    draw_profile,
    looks,
    page,
    shorten,
    slices,
    solve_all,
)  # fmt: skip

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from networkx import DiGraph


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


@takes(MeasureOptions)
def overview(masks: Mapping[str, Tensor], **options: Unpack[MeasureOptions]) -> "Figure":
    """Draw each mask twice, with level lines of f and of t, and all profiles in one plot below.

    Args:
        masks: the shapes by name, each as for `levels`. Up to a dozen stay readable.
        {measure options}

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
    measure = Measure.of(options, MeasureOptions)
    solved = solve_all(masks, bins=measure.bins, estimator=measure.estimator, rho=measure.rho, tol=measure.tol)
    rows = ceil(len(masks) / 3)
    columns = ceil(len(masks) / rows)
    figure, top, ax_profiles = page(max(4.4 * columns, 6.4), 2.9 * rows, 3.4)
    pairs = top.subfigures(rows, columns, squeeze=False).flat
    for pair, name, look in zip(pairs, masks, looks(len(masks)), strict=False):
        cut = ", deepest slice" if masks[name].ndim == 3 else ""
        means = (f"{float(solved[name].mean(*ends)):.3f}" for ends in measure.named_windows().values())
        pair.suptitle(f"{shorten(name)}{cut}: {', '.join(means)} {measure.unit}", fontsize=11)
        left, right = pair.subplots(1, 2, sharey=True)
        for panel, values, title in zip((left, right), slices(masks[name]), TITLES.values(), strict=True):
            draw_levels(panel, values, look.color)
            panel.set_title(title, fontsize=9)
            panel.set_xlabel("column (pixels)", fontsize=8)
            panel.set_anchor("N")
            panel.tick_params(labelsize=8)
        left.set_ylabel("row (pixels)", fontsize=8)
        draw_profile(ax_profiles, solved[name], shorten(name), look, measure.estimator)
    draw_legend(ax_profiles)
    return figure


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
    return hasse_layout.draw_order(ax, order, masks, highlight)
