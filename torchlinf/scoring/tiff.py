"""TIFF images: every byte order, depth, sign and layout, by tifffile.

What tifffile cannot decompress without imagecodecs, such as LZW and JPEG, Pillow does; the type of
the numbers comes from the file's tags all the same.
"""

import re
from dataclasses import replace
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from torchlinf.scoring.values import (
    UnreadableMaskError,
    Values,
    require_size,
    values_of_array,
    values_of_colours,
    values_of_palette,
)

GDAL_NODATA, GEO_PIXEL_SCALE = 42113, 33550
MIN_IS_WHITE, RGB, PALETTE, YCBCR = 0, 2, 3, 6
LOSSY = (6, 7)  # JPEG, old and new


def read_tiff(file: IO[bytes], max_pixels: int) -> Values:
    """Read a TIFF: one page, or several as a stack. Overviews, and masks inside of the file, are passed over.

    Raises:
        UnreadableMaskError: it is too large, its pages differ, or it has bands that are no colours.
    """
    import tifffile

    try:
        with tifffile.TiffFile(file) as tiff:
            pages = [page for page in tiff.pages if not (page.is_reduced or page.is_mask)]  # type: ignore[union-attr]
            if not pages:
                raise UnreadableMaskError("the TIFF holds no page but overviews and masks")
            first: Any = pages[0]
            series = tiff.series[0]
            in_one = len(pages) == 1 and series.axes.strip("S") not in ("YX", "") and series.ndim > 2
            if in_one and series.shape != first.shape:  # a stack that has one directory for all of its images
                require_size(series.shape, max_pixels)
                array = series.asarray()
            else:
                if any(page.shape[:2] != first.shape[:2] or page.shape != first.shape for page in pages):
                    sizes = " and ".join(str(page.shape) for page in (first, pages[1]))
                    raise UnreadableMaskError(f"the pages of a TIFF must be of one size; got {sizes}")
                require_size((len(pages), *first.shape)[len(pages) == 1 :], max_pixels)
                index = [page.index for page in pages]
                arrays = [_decode(file, page, number) for page, number in zip(pages, index, strict=True)]
                array = np.stack(arrays) if len(arrays) > 1 else arrays[0]
            values = _values(array, first)
            return replace(values, spacing=_spacing(tiff, first, values.array.ndim))
    except tifffile.TiffFileError as error:
        raise UnreadableMaskError(f"not a TIFF image, or a damaged one ({error})") from error


def _decode(file: IO[bytes], page: Any, index: int) -> NDArray[Any]:
    try:
        return page.asarray()
    except (ValueError, ImportError, NotImplementedError) as error:
        if "imagecodecs" not in str(error) and not isinstance(error, ImportError):
            raise
        return _decode_by_pillow(file, page, index, error)


def _decode_by_pillow(file: IO[bytes], page: Any, index: int, cause: Exception) -> NDArray[Any]:
    from PIL import Image, TiffImagePlugin, UnidentifiedImageError

    file.seek(0)
    refusal = UnreadableMaskError(
        f"its compression needs imagecodecs, which is not installed or cannot do it ({cause}). Run: pip install "
        "'torchlinf[codecs]'"
    )
    try:
        image = TiffImagePlugin.TiffImageFile(file)
    except (UnidentifiedImageError, SyntaxError):
        raise refusal from cause
    # The file stays open: it belongs to the caller.
    image.seek(index)
    array = np.asarray(image.convert("RGB") if image.mode in ("YCbCr", "CMYK") else image)
    if page.photometric == MIN_IS_WHITE and image.mode in ("1", "L"):
        array = ~array  # Pillow has inverted it already, and `_values` inverts it again
    if Image.getmodebands(image.mode) != page.samplesperpixel or array.shape[:2] != (page.imagelength, page.imagewidth):
        raise refusal from cause
    bits = page.bitspersample
    if bits < 8 and image.mode == "L":
        array = array // (255 // (2**bits - 1))
    if page.dtype is None or array.dtype == np.bool_ or array.dtype == page.dtype:
        return array
    if array.dtype.itemsize == page.dtype.itemsize:
        return array.view(page.dtype)
    return array.astype(page.dtype)


def _values(array: NDArray[Any], page: Any) -> Values:
    if array.dtype.byteorder not in "=|":
        array = array.astype(array.dtype.newbyteorder("="))
    samples = page.samplesperpixel
    if samples > 1 and page.planarconfig == 2:
        array = np.moveaxis(array, -3, -1)
    lossy = page.compression in LOSSY
    if page.photometric in (RGB, YCBCR) and samples >= 3:
        return values_of_colours(array[..., : 4 if samples > 3 and page.extrasamples[:1] in ((1,), (2,)) else 3], lossy)
    if samples == 2 and page.extrasamples[:1] in ((1,), (2,)):
        return values_of_colours(array)
    if samples > 1:
        raise UnreadableMaskError(f"a mask has one band; got {samples} bands that are no colours. Save one of them")
    if page.photometric == PALETTE and page.colormap is not None:
        values = values_of_palette(array, (page.colormap.T >> 8).astype(np.uint8))
        return replace(values, valid=_valid(array, page))
    bits = page.bitspersample
    if page.photometric == MIN_IS_WHITE and array.dtype.kind in "bu":
        array = ~array if array.dtype == np.bool_ else array.dtype.type(2**bits - 1) - array
    top = 2**bits - 1 if bits in (2, 4, 6, 10, 12, 14) else None
    values = values_of_array(array, volume=True)
    return Values(values.array, lossy, valid=_valid(values.array, page), top=top)


def _valid(array: NDArray[Any], page: Any) -> NDArray[np.bool_] | None:
    """What is not the nodata value of a GeoTIFF; None if the file names none."""
    tag = page.tags.get(GDAL_NODATA)
    try:
        nodata = float(str(tag.value).strip(" \0")) if tag is not None else None
    except ValueError:
        return None
    if nodata is None or (nodata != nodata and array.dtype.kind != "f"):
        return None
    return ~np.isnan(array) if nodata != nodata else array != nodata


def _spacing(tiff: Any, page: Any, ndim: int) -> tuple[float, ...] | None:
    """The size of a pixel along the last axes, depth first, by the tags of OME, ImageJ, GeoTIFF or TIFF."""
    tags = page.tags
    sizes: list[Any] = [None, *(_per_unit(tags.get(name)) for name in ("YResolution", "XResolution"))]
    if tiff.is_ome:
        found = dict(re.findall(r'PhysicalSize([XYZ](?:Unit)?)="([^"]*)"', tiff.ome_metadata))
        units = {found.get(f"{axis}Unit", "\N{MICRO SIGN}m") for axis in "XYZ" if axis in found}
        sizes = [found.get(axis) if len(units) == 1 else None for axis in "ZYX"]
    elif tiff.is_imagej:
        sizes[0] = (tiff.imagej_metadata or {}).get("spacing")
    elif (scale := tags.get(GEO_PIXEL_SCALE)) is not None:
        sizes = [None, *reversed(scale.value[:2])]
    try:
        known = tuple(float(size) for size in sizes[-min(ndim, 3) :])
    except (TypeError, ValueError):
        return None
    return known if all(0 < size < np.inf for size in known) else None


def _per_unit(tag: Any) -> float | None:
    """The size of a pixel by a tag of pixels to a unit."""
    pixels, units = (0, 1) if tag is None else tag.value
    return units / pixels if pixels else None
