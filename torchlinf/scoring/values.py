"""The numbers in a file, before anything is inside or outside: of arrays, colours and palettes."""

from dataclasses import dataclass, replace
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

ALMOST_GREY = 16  # channels of a grey JPEG differ by no more


class UnreadableMaskError(ValueError):
    """No mask can be had from a file; the message says why, in words."""


@dataclass(frozen=True)
class Values:
    """The numbers in a file, before anything is inside or outside.

    Attributes:
        array: (H, W), or (D, H, W) of a volume or a stack; bool, integer or floating point, in the machine's byte
            order. Of colours the brightest channel.
        lossy: whether the file's compression changes values, so that 0 may have become 3.
        ids: the labels, where they are other numbers: the indices of a palette, colours as R + 256 G + 65536 B.
        coloured: whether `array` is the brightness of colours that are not all grey.
        is_rgb: whether `ids` are colours, not the indices of a palette.
        valid: which pixels hold data; None if all do.
        top: the number that is white, if it is not the largest one of the type.
        spatial_ndim: axes of one mask, where the format says it; None if three axes may be a volume or a stack.
        spacing: size of a pixel along the last axes, in the file's unit; None if the file does not say it.
        is_to_scale: whether `spacing` is meant to be used, as it is in medical images; resolutions of pictures are not.
    """

    array: NDArray[Any]
    lossy: bool = False
    ids: NDArray[Any] | None = None
    coloured: bool = False
    is_rgb: bool = False
    valid: NDArray[np.bool_] | None = None
    top: int | None = None
    spatial_ndim: int | None = None
    spacing: tuple[float, ...] | None = None
    is_to_scale: bool = False

    @property
    def labels(self) -> NDArray[Any]:
        """The numbers that options of labels name: `ids` where there are some, else `array`."""
        return self.array if self.ids is None else self.ids

    def page(self, index: int) -> "Values":
        """One page of a stack."""
        ids, valid = (None if one is None else one[index] for one in (self.ids, self.valid))
        spacing = None if self.spacing is None else self.spacing[-(self.array.ndim - 1) :]
        return replace(self, array=self.array[index], ids=ids, valid=valid, spacing=spacing)


def require_size(shape: tuple[int, ...], max_pixels: int, purpose: str = "read the file") -> None:
    """Raise if there are more pixels than the limit."""
    if prod(shape) > max_pixels:
        sizes = " x ".join(str(size) for size in shape)
        raise UnreadableMaskError(f"{sizes} pixels are more than the limit of {max_pixels}; raise it to {purpose}")


def values_of_array(array: NDArray[Any], volume: bool = False) -> Values:
    """The numbers of an array: a last axis of 1, 3 or 4 is one of channels, unless it is a volume.

    Raises:
        UnreadableMaskError: it has another number of axes, or no pixels.

    Example:
        >>> values_of_array(np.array([[[0, 0, 9]], [[255, 0, 0]]], dtype=np.uint8)).ids
        array([[589824],
               [   255]])
    """
    whole = array.shape
    if array.dtype.byteorder not in "=|":
        array = array.astype(array.dtype.newbyteorder("="))
    while array.ndim > 2 and array.shape[0] == 1:
        array = array[0]
    while array.ndim > 3 - (not volume) and array.shape[-1] == 1:
        array = array[..., 0]
    channels = array.shape[-1] if array.ndim in (3, 4) and array.shape[-1] in (3, 4) and not volume else 0
    if array.ndim - bool(channels) not in (2, 3) or array.size == 0:
        raise UnreadableMaskError(f"a mask must be 2-D or 3-D and hold pixels; got shape {whole}")
    return values_of_colours(array) if channels else Values(array)


def values_of_colours(channels: NDArray[Any], lossy: bool = False) -> Values:
    """The numbers of colours, (..., 2) to (..., 4): grey and opacity, or red, green, blue, and opacity.

    Transparent pixels are black; where that leaves one colour, the opacity is the mask.
    """
    if channels.dtype.kind != "u" and channels.dtype != np.bool_:
        if channels.dtype.kind == "f" or channels.min() < 0 or channels.max() > 65535:
            raise UnreadableMaskError(
                f"colours must be unsigned integers; got channels of {channels.dtype}. Save one number a pixel"
            )
        channels = channels.astype(np.uint8 if channels.max() < 256 else np.uint16)
    if channels.dtype == np.bool_:
        channels = channels.astype(np.uint8) * 255
    colours, opacity = channels, None
    if channels.shape[-1] in (2, 4):
        colours, opacity = channels[..., :-1], channels[..., -1]
        top = np.iinfo(channels.dtype).max
        if bool((opacity == top).all()):
            opacity = None
        else:
            blended = (colours.astype(np.uint64) * opacity[..., None] + top // 2) // top
            colours = blended.astype(channels.dtype)
            if bool((colours == colours.reshape(-1, colours.shape[-1])[0]).all()):
                return Values(opacity)
    if colours.shape[-1] == 1:
        return Values(colours[..., 0], lossy)
    bright, dark = colours.max(axis=-1), colours.min(axis=-1)
    # Compression moves the channels of a grey image a little apart.
    if int((bright - dark).max()) <= (ALMOST_GREY if lossy else 0):
        return Values(bright, lossy)
    red, green, blue = (colours[..., i].astype(np.int64) for i in range(3))
    depth = 8 * colours.dtype.itemsize
    return Values(bright, lossy, (red + (green << depth)) + (blue << 2 * depth), coloured=True, is_rgb=True)


def values_of_palette(indices: NDArray[Any], palette: NDArray[Any], opacity: NDArray[Any] | None = None) -> Values:
    """The numbers of an image with a palette, (N, 3): its greys, or the indices if colours are in use."""
    used = palette[np.unique(indices)]
    greys = used[:, 0]
    if bool((used == greys[:, None]).all()):
        array = palette[:, 0][indices]
        values = Values(array) if opacity is None else values_of_colours(np.stack([array, opacity], axis=-1))
        return replace(values, ids=indices) if len(greys) > 2 else values
    if opacity is not None:
        values = values_of_colours(np.concatenate([palette[indices], opacity[..., None]], axis=-1))
        if not values.coloured:
            return values
        indices = np.where(opacity > 0, indices, 0)  # what is transparent is background
    return Values(palette.max(axis=1)[indices], ids=indices, coloured=True)
