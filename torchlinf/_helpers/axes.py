"""Which axes of an array are those of an image: one rule for label maps, transforms, metrics and masks in memory.

Axes of length 1 before and behind an image are nothing but a batch or channels of one. Three long axes can be read in
two ways, as a volume or as a stack of images, and so can a last axis of 3 or 4, as colours: then the caller is asked.
"""

from torchlinf._helpers.checks import MAX_SPATIAL_NDIM

COLOURS = (3, 4)  # lengths of a last axis that holds red, green, blue, and opacity


def image_shape(shape: tuple[int, ...], spatial_ndim: int | None, name: str, batch: int = 0) -> tuple[int, ...]:
    """The shape of images without the axes of length 1 before and behind them.

    Args:
        shape: of the array.
        spatial_ndim: dimensions that an image has; None means 2, and raises where more are left.
        name: what the messages call the argument.
        batch: how many leading axes are kept as they are, those of a batch.

    Raises:
        ValueError: another number of axes is left, or it is not clear what they are.

    >>> image_shape((1, 20, 30), None, "mask"), image_shape((5, 1, 20, 30), 3, "preds", batch=1)
    ((20, 30), (5, 1, 20, 30))
    """
    lead, spatial = shape[:batch], shape[batch:]
    while len(spatial) > (spatial_ndim or 2) and 1 in (spatial[0], spatial[-1]):
        spatial = spatial[1:] if spatial[0] == 1 else spatial[:-1]
    ndim = len(spatial)
    if spatial_ndim is None and ndim > 2:
        refuse_colours(shape, name)
    if ndim != spatial_ndim and (spatial_ndim is not None or ndim not in (1, 2)):
        volume = f"spatial_ndim={ndim} if these are the axes of a volume, or " if 2 < ndim <= MAX_SPATIAL_NDIM else ""
        raise ValueError(
            f"{name} must be {_form(spatial_ndim or 2, batch)} for spatial_ndim={spatial_ndim}; got {shape}. "
            f"Pass {volume}one image at a time."
        )
    return lead + spatial


def refuse_colours(shape: tuple[int, ...], name: str) -> None:
    """Raise for an array of three axes or more whose last one may hold colours."""
    if len(shape) > 2 and shape[-1] in COLOURS:
        raise ValueError(
            f"{name} must have one number a pixel; got {shape}, whose last axis may be one of colours. "
            f"Pass {name}[..., 0] or a number for each colour, or spatial_ndim if the last axis is one of space."
        )


def _form(ndim: int, batch: int) -> str:
    axes = ("*spatial",) if ndim > 3 else ("D", "H", "W")[3 - ndim :]
    return f"({', '.join(('B',) * batch + axes)}{',' if batch + len(axes) == 1 else ''})"
