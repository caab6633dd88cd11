"""Figures of one shape: its level lines, its profile, or where its complexity sits."""

from typing import TYPE_CHECKING, TypedDict, Unpack

import torch
from torch import Tensor

from torchlinf._helpers.checks import positive
from torchlinf.field import FieldSolution
from torchlinf.measure import ComplexityProfile, Measure, ProfileOptions, WindowOptions, takes
from torchlinf.measure import complexity_map as measured_map
from torchlinf.plot.drawing import COLOURS, TITLES, Look, axes_or_new, draw_levels, draw_map, draw_profile
from torchlinf.plot.solved_shape import deepest, distance_of, profile_of, refuse_beside, scale_slice, solved_shape

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class FieldOptions(TypedDict, total=False):
    """Options of the field alone."""

    rho: float | Tensor | None
    tol: float


@takes(ProfileOptions)
def profile(
    mask: Tensor | ComplexityProfile,
    *,
    label: str | None = None,
    color: str | None = None,
    style: str = "-",
    ax: "Axes | None" = None,
    **options: Unpack[ProfileOptions],
) -> "Axes":
    """Draw the complexity of one shape against scale, level by level.

    Args:
        mask: one shape, (H, W) or (D, H, W) or any other number of spatial dimensions up to 4, values 0 or 1, not
            empty. Or its `ComplexityProfile`, if that is computed already; then nothing is solved, and the options of
            the measure are left out.
        label: name of the line in a legend.
        color: colour of the line; None takes the next of `COLOURS`.
        style: line style, as matplotlib writes it.
        ax: where to draw; None makes a new figure. Call again with the axes returned to compare shapes, all by the same
            estimator.
        {measure options}

    Returns:
        The axes: scale in (0, 1] without unit, complexity in bits, or for "std" a standard deviation without unit.

    Raises:
        ImportError: matplotlib is not installed.
        TypeError: `mask` is neither a tensor nor a profile, or another argument is of the wrong type.
        ValueError: the mask is empty or not binary, the profile is of several shapes or of an empty one, an option has
            a wrong value, or an option is given beside a profile.
        RuntimeError: the field could not be solved to `tol`.

    Example:
        >>> from torchlinf import complexity_profile, plot, shapes
        >>> ax = plot.profile(shapes.disc(16), label="disc")
        >>> ax = plot.profile(complexity_profile(shapes.square(32), spatial_ndim=2), label="square", ax=ax)
        >>> ax.get_ylabel()
        'complexity (bits)'
    """
    solved = profile_of(mask, options)
    ax = axes_or_new(ax)
    look = Look(color or COLOURS[len(ax.patches) % len(COLOURS)], style)
    return draw_profile(ax, solved, label, look)


@takes(FieldOptions)
def levels(
    mask: Tensor,
    *,
    of: str | Tensor = "field",
    solution: FieldSolution | None = None,
    color: str | None = None,
    ax: "Axes | None" = None,
    **options: Unpack[FieldOptions],
) -> "Axes":
    """Draw a shape with level lines.

    On a square both kinds of lines are nested squares. How the lines of the field leave those of the distance is what
    the complexity measures.

    Args:
        mask: one shape, (H, W) or (D, H, W), values 0 or 1, not empty. Of a volume the slice through its deepest voxel
            is drawn.
        of: "field" for f / max f, "distance" for the scale t = d / D, for which nothing is solved; or another field to
            compare them with, (H, W), 0 outside the shape and positive inside, which is divided by its maximum.
        solution: what `torchlinf.solve_field(mask, spatial_ndim=mask.ndim)` returned, if that is computed already;
            then nothing is solved, and `rho` and `tol` are left out. Only "field" uses it.
        color: the shape is filled with a pale tint of it; None takes the first of `COLOURS`.
        ax: where to draw; None makes a new figure.
        {measure options}

    Returns:
        The axes, in pixels, of equal aspect, rows downwards. The nine lines are at 0.1, 0.2 ... 0.9.

    Raises:
        ImportError: matplotlib is not installed.
        TypeError: an argument is of the wrong type.
        ValueError: `mask` is empty, not binary, or neither 2-D nor 3-D; `of` is another word than these two, or a field
            of another shape than an image's `mask`; `solution` is of another mask; or an option has a wrong value.
        RuntimeError: the field could not be solved to `tol`.

    Example:
        >>> from torchlinf import plot, shapes
        >>> ax = plot.levels(shapes.disc(16), of="distance")
        >>> ax.get_xlabel(), ax.get_ylabel()
        ('column (pixels)', 'row (pixels)')
    """
    measure = Measure.of(options, FieldOptions)
    if solution is not None:
        refuse_beside(options, "solution")
    if isinstance(of, Tensor):
        distance_of(mask)  # checks the mask
        if of.shape != mask.shape or mask.ndim != 2:
            raise ValueError(
                f"of must be a field on an image, of the shape of mask; got {tuple(of.shape)} for {tuple(mask.shape)}. "
                "Pass one value for each pixel."
            )
        values, title = (of / of.max()).numpy(force=True), "field / its maximum"
    elif of not in TITLES:
        raise ValueError(f"of must be 'field' or 'distance'; got {of!r}. Pass of='field' for f / max f.")
    elif of == "field":
        values, title = solved_shape(mask, measure, solution).field_slice(), TITLES[of]
    else:
        values, title = scale_slice(distance_of(mask)), TITLES[of]
    ax = axes_or_new(ax)
    draw_levels(ax, values, color or COLOURS[0])
    ax.set(xlabel="column (pixels)", ylabel="row (pixels)", title=title)
    return ax


@takes(WindowOptions)
def complexity_map(
    mask: Tensor,
    *,
    shares: Tensor | None = None,
    top: float | None = None,
    ax: "Axes | None" = None,
    **options: Unpack[WindowOptions],
) -> "Axes":
    """Draw where the complexity of a shape sits: each pixel in the colour of its share, with a colour bar.

    Args:
        mask: one shape, (H, W) or (D, H, W), values 0 or 1, not empty. Of a volume the slice through its deepest voxel
            is drawn.
        shares: what `torchlinf.complexity_map(mask, spatial_ndim=mask.ndim)` returned, if that is computed already;
            then nothing is solved, and the options of the measure are left out.
        top: the share in bits per pixel from which on all have the darkest colour; None means that 98 % of the pixels
            with a share have less.
        ax: where to draw; None makes a new figure.
        {measure options}

    Returns:
        The axes, in pixels, of equal aspect, rows downwards; the title has the sum over the whole shape, in bits.

    Raises:
        ImportError: matplotlib is not installed.
        TypeError: an argument is of the wrong type.
        ValueError: `mask` is empty, not binary, or neither 2-D nor 3-D; `shares` is of another shape; an option has a
            wrong value, `estimator` is not "entropy", or an option is given beside `shares`.
        RuntimeError: the field could not be solved to `tol`.

    Example:
        >>> from torchlinf import plot, shapes
        >>> plot.complexity_map(shapes.disc(16), high=0.25).get_title()
        '... bits'
    """
    place = deepest(distance_of(mask))
    if top is not None:
        top = positive(top, "top")
    if shares is None:
        shares = measured_map(mask, spatial_ndim=mask.ndim, **options)
    else:
        refuse_beside(options, "map")
        if not isinstance(shares, Tensor):
            raise TypeError(
                f"shares must be a tensor; got {type(shares).__name__}. Pass torchlinf.complexity_map(...)."
            )
        if shares.shape != mask.shape:
            raise ValueError(
                f"shares must be those of mask; got {tuple(shares.shape)} for {tuple(mask.shape)}. "
                f"Pass torchlinf.complexity_map(mask, spatial_ndim={mask.ndim})."
            )
    shares = shares.double()
    drawn = torch.where(mask.to(shares.device) != 0, shares, torch.nan)[place].numpy(force=True)
    return draw_map(axes_or_new(ax), drawn, float(shares.sum()), top)
