"""Figures of several shapes: in the order of their complexity, or each with both kinds of level lines."""

from collections.abc import Mapping
from math import ceil
from typing import TYPE_CHECKING, Unpack

from torch import Tensor

from torchlinf.field import FieldSolution
from torchlinf.measure import GridOptions, LevelOptions, Measure, takes
from torchlinf.plot.drawing import TITLES, draw_legend, draw_levels, draw_profile, in_unit, looks, page, shorten
from torchlinf.plot.solved_shape import refuse_beside, solved_shapes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@takes(LevelOptions)
def shapes(
    masks: Mapping[str, Tensor],
    *,
    solutions: Mapping[str, FieldSolution] | None = None,
    **options: Unpack[LevelOptions],
) -> "Figure":
    """Draw shapes in the order of their complexity, each with its number and level lines of f, and their profiles.

    Args:
        masks: the shapes by name, each (H, W) or (D, H, W), values 0 or 1, not empty. Of a volume the slice through its
            deepest voxel is drawn. Up to a dozen shapes stay readable.
        solutions: what `torchlinf.solve_field(mask, spatial_ndim=mask.ndim)` returned for each name, if that is
            computed already; then nothing is solved, and `rho` and `tol` are left out.
        {measure options}

    Returns:
        The figure; its first axes hold the profiles, the others the shapes.

    Raises:
        ImportError: matplotlib is not installed.
        TypeError: an argument is of the wrong type.
        ValueError: there is no mask, or one is empty, not binary, or neither 2-D nor 3-D; `solutions` have other names
            or are of other masks; or an option has a wrong value.
        RuntimeError: a field could not be solved to `tol`.

    Example:
        >>> from torchlinf import plot, shapes
        >>> figure = plot.shapes({"disc": shapes.disc(16), "square": shapes.square(32)})
        >>> [ax.get_xlabel().split()[0] for ax in figure.axes[1:]]
        ['square', 'disc']
    """
    measure = Measure.of(options, LevelOptions)
    if solutions is not None:
        refuse_beside({name: value for name, value in options.items() if name in ("rho", "tol")}, "solution")
    solved = solved_shapes(masks, measure, solutions)
    profiles = {name: shape.profile(measure) for name, shape in solved.items()}
    names = sorted(masks, key=lambda name: float(profiles[name].mean()))
    rows = ceil(len(names) / 5)
    columns = ceil(len(names) / rows)
    figure, top, ax_profiles = page(max(1.9 * columns, 6.0), 2.3 * rows, 3.2)
    panels = list(top.subplots(rows, columns, squeeze=False).flat)
    for panel in panels[len(names) :]:
        panel.remove()
    for panel, name, look in zip(panels, names, looks(len(names)), strict=False):
        draw_levels(panel, solved[name].field_slice(), look.color)
        panel.set(xticks=[], yticks=[], anchor="S")
        panel.spines[:].set_visible(False)
        panel.set_xlabel(f"{shorten(name)}\n{in_unit(profiles[name].mean(), measure)}")
        draw_profile(ax_profiles, profiles[name], shorten(name), look)
    draw_legend(ax_profiles, reverse=True)  # the order of the lines, from the top
    return figure


@takes(GridOptions)
def overview(
    masks: Mapping[str, Tensor],
    *,
    solutions: Mapping[str, FieldSolution] | None = None,
    **options: Unpack[GridOptions],
) -> "Figure":
    """Draw each mask twice, with level lines of f and of t, and all profiles in one plot below.

    Args:
        masks: the shapes by name, each (H, W) or (D, H, W), values 0 or 1, not empty. Of a volume the slice through its
            deepest voxel is drawn. Up to a dozen shapes stay readable.
        solutions: what `torchlinf.solve_field(mask, spatial_ndim=mask.ndim)` returned for each name, if that is
            computed already; then nothing is solved, and `rho` and `tol` are left out.
        {measure options}

    Returns:
        The figure; its first axes hold the profiles, the others the shapes.

    Raises:
        ImportError: matplotlib is not installed.
        TypeError: an argument is of the wrong type.
        ValueError: there is no mask, or one is empty, not binary, or neither 2-D nor 3-D; `solutions` have other names
            or are of other masks; or an option has a wrong value.
        RuntimeError: a field could not be solved to `tol`.

    Example:
        >>> from torchlinf import plot, shapes
        >>> figure = plot.overview({"disc": shapes.disc(16)})
        >>> [ax.get_title() for ax in figure.axes[1:]]
        ['field f / max f', 'scale t = d / D']
    """
    measure = Measure.of(options, GridOptions)
    if solutions is not None:
        refuse_beside({name: value for name, value in options.items() if name in ("rho", "tol")}, "solution")
    solved = solved_shapes(masks, measure, solutions)
    profiles = {name: shape.profile(measure) for name, shape in solved.items()}
    rows = ceil(len(masks) / 3)
    columns = ceil(len(masks) / rows)
    figure, top, ax_profiles = page(max(4.4 * columns, 6.4), 2.9 * rows, 3.4)
    pairs = top.subfigures(rows, columns, squeeze=False).flat
    for pair, name, look in zip(pairs, masks, looks(len(masks)), strict=False):
        cut = ", deepest slice" if masks[name].ndim == 3 else ""
        means = (in_unit(profiles[name].mean(*ends), measure) for ends in measure.named_windows().values())
        pair.suptitle(f"{shorten(name)}{cut}: {', '.join(means)}", fontsize=11)
        slices = solved[name].field_slice(), solved[name].scale_slice()
        left, right = pair.subplots(1, 2, sharey=True)
        for panel, values, title in zip((left, right), slices, TITLES.values(), strict=True):
            draw_levels(panel, values, look.color)
            panel.set_title(title, fontsize=9)
            panel.set_xlabel("column (pixels)", fontsize=8)
            panel.set_anchor("N")
            panel.tick_params(labelsize=8)
        left.set_ylabel("row (pixels)", fontsize=8)
        draw_profile(ax_profiles, profiles[name], shorten(name), look)
    draw_legend(ax_profiles)
    return figure
