"""Image and array files in, numbers out; what is refused, and why, in words.

Everything is judged by its header before memory is taken for it: a few hundred bytes can claim to be a terabyte.
"""

import stat
import zipfile
from dataclasses import dataclass
from importlib import import_module
from math import prod
from pathlib import Path, PurePosixPath
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchlinf.scoring.byte_ranges import ByteRange, open_range

if TYPE_CHECKING:
    from PIL.Image import Image

IMAGE_SUFFIXES = (".png", ".gif", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg")
ARRAY_SUFFIXES = (".npy", ".npz")
SUFFIXES = IMAGE_SUFFIXES + ARRAY_SUFFIXES

# Pillow tries every format it knows unless told otherwise; files from strangers should meet few decoders.
PILLOW_FORMATS = ("PNG", "GIF", "TIFF", "BMP", "JPEG")


class UnreadableMaskError(ValueError):
    """No mask can be had from a file; the message says why, in words."""


@dataclass(frozen=True)
class Values:
    """The numbers in a file, before anything is inside or outside.

    Attributes:
        array: (H, W) or (D, H, W), bool, integer or floating point.
        lossy: whether the file's compression changes values, so that 0 may have become 3.
        labels: whether the values are colours that stand for labels.
    """

    array: NDArray[Any]
    lossy: bool = False
    labels: bool = False


def read_values(path: Path, member: str | None, max_pixels: int, byte_range: ByteRange | None = None) -> Values:
    """Read an image, an .npy array or a member of an .npz archive.

    Args:
        path: the file.
        member: which array of an .npz archive, by name; None if it holds one only. With `byte_range`, the name of what
            it holds.
        max_pixels: what holds more numbers than this is refused.
        byte_range: where in the file the image or array is; None if it is the whole file.

    Returns:
        The numbers, 2-D or 3-D; leading axes of length 1 are dropped.

    Raises:
        UnreadableMaskError: the file is missing, empty, damaged, too large, or neither image nor array.
    """
    try:
        _require_regular(path)
        if byte_range is None:
            with path.open("rb") as file:
                return parse_values(file, path.suffix, max_pixels, member)
        with open_range(path, byte_range) as part:
            return parse_values(part, PurePosixPath(member or "").suffix, max_pixels)
    except UnreadableMaskError:
        raise
    except OSError as error:
        raise UnreadableMaskError(_in_words(error)) from error


def parse_values(file: IO[bytes], suffix: str, max_pixels: int, member: str | None = None) -> Values:
    """Read an open file, which `suffix` says to be an image, an .npy array or an .npz archive; as `read_values`."""
    try:
        is_array = suffix.lower() in ARRAY_SUFFIXES
        values = (
            Values(_read_array(file, suffix, member, max_pixels)) if is_array else _read_image(file, suffix, max_pixels)
        )
        array = values.array
        while array.ndim > 2 and array.shape[0] == 1:
            array = array[0]
        if array.ndim not in (2, 3) or array.size == 0:
            raise UnreadableMaskError(f"a mask must be 2-D or 3-D and hold pixels; got shape {values.array.shape}")
        return Values(array, values.lossy, values.labels)
    except UnreadableMaskError:
        raise
    except Exception as error:
        # On damaged files the decoders raise whatever they stumble over: struct.error, SyntaxError, IndexError ...
        raise UnreadableMaskError(_in_words(error)) from error


def arrays_in(archive: zipfile.ZipFile) -> list[str]:
    """Names of the arrays in an .npz archive, in its order."""
    return [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]


def _require_regular(path: Path) -> None:
    # Opening a named pipe would wait for ever, and /dev/zero has no end.
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise UnreadableMaskError("not a regular file")
    if status.st_size == 0:
        raise UnreadableMaskError("the file is empty (0 bytes)")


def _require_size(shape: tuple[int, ...], max_pixels: int) -> None:
    if prod(shape) > max_pixels:
        sizes = " x ".join(str(size) for size in shape)
        raise UnreadableMaskError(f"{sizes} pixels are more than the limit of {max_pixels}; raise it to read the file")


def _read_array(file: IO[bytes], suffix: str, member: str | None, max_pixels: int) -> NDArray[Any]:
    if suffix.lower() == ".npy":
        return _parse_npy(file, max_pixels)
    try:
        with zipfile.ZipFile(file) as archive:
            names = arrays_in(archive)
            if member is None and len(names) != 1:
                raise UnreadableMaskError(
                    f"the archive must hold one array, or one must be named; it holds {len(names)}"
                )
            with archive.open(f"{member or names[0]}.npy") as array:
                return _parse_npy(array, max_pixels)
    except zipfile.BadZipFile as error:
        raise UnreadableMaskError(f"not an .npz archive, or a damaged one ({error})") from error


def _parse_npy(file: IO[bytes], max_pixels: int) -> NDArray[Any]:
    if file.read(6) != np.lib.format.MAGIC_PREFIX:
        raise UnreadableMaskError("not a .npy array")
    file.seek(0)
    major, _ = np.lib.format.read_magic(file)
    read_header = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
    shape, _, dtype = read_header(file)
    if dtype.kind not in "buif":
        raise UnreadableMaskError(f"an array must be bool, integer or floating point; got {dtype}")
    _require_size(shape, max_pixels)
    file.seek(0)
    array: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
    return array


def _read_image(file: IO[bytes], suffix: str, max_pixels: int) -> Values:
    from PIL import Image, UnidentifiedImageError

    for name in PILLOW_FORMATS:  # if one is missing, Pillow loads all of the forty others as well
        import_module(f"PIL.{name.title()}ImagePlugin")
    try:
        with Image.open(file, formats=PILLOW_FORMATS) as image:
            return _read_frames(image, max_pixels)
    except UnidentifiedImageError as error:
        if suffix.lower() in (".tif", ".tiff"):
            return _read_odd_tiff(file, max_pixels)
        known = ", ".join(suffix[1:] for suffix in SUFFIXES)
        raise UnreadableMaskError(f"not an image in a known format ({known})") from error


def _read_frames(image: "Image", max_pixels: int) -> Values:
    pages = getattr(image, "n_frames", 1) if image.format == "TIFF" else 1
    _require_size((pages, image.height, image.width)[pages == 1 :], max_pixels)
    size, frames = image.size, []
    for page in range(pages):
        image.seek(page)
        if image.size != size:
            raise UnreadableMaskError(f"the pages of a TIFF must be of one size; got {size} and {image.size}")
        frames.append(_brightness(image))
    lossy = image.format in ("JPEG", "MPO") or "jpeg" in str(image.info.get("compression"))
    colours = image.getpalette() if image.mode == "P" else None
    labels = colours is not None and not colours[0::3] == colours[1::3] == colours[2::3]
    return Values(np.stack(frames) if pages > 1 else frames[0], lossy, labels)


def _brightness(image: "Image") -> NDArray[Any]:
    """One number a pixel: grey as it is, of colours the brightest channel, on black where transparent."""
    if image.mode in ("1", "F") or image.mode.startswith("I"):
        return np.asarray(image)
    transparent = image.has_transparency_data
    if image.mode == "L" and not transparent:
        return np.asarray(image)
    channels = np.asarray(image.convert("RGBA" if transparent else "RGB"))
    bright: NDArray[Any] = np.maximum(np.maximum(channels[..., 0], channels[..., 1]), channels[..., 2])
    if transparent:
        opacity: NDArray[Any] = channels[..., 3]
        bright = ((bright.astype(np.uint16) * opacity + 127) // 255).astype(np.uint8)
        if bright.min() == bright.max():
            return opacity
    return bright


def _read_odd_tiff(file: IO[bytes], max_pixels: int) -> Values:
    """TIFF with samples that Pillow does not know, such as float64 or 16-bit colours."""
    import tifffile

    try:
        file.seek(0)
        with tifffile.TiffFile(file) as tiff:
            series = tiff.series[0]
            _require_size(series.shape, max_pixels)
            array = series.asarray()
            return Values(array[..., :3].max(axis=-1) if series.axes.endswith("S") else array)
    except tifffile.TiffFileError as error:
        raise UnreadableMaskError(f"not a TIFF image, or a damaged one ({error})") from error


def _in_words(error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return "no such file"
    if isinstance(error, PermissionError):
        return "no permission to read it"
    if isinstance(error, MemoryError):
        return "not enough memory to read it"
    if type(error).__name__.startswith("DecompressionBomb"):
        return f"larger than any image that is read ({error})"
    return f"truncated or damaged ({type(error).__name__}: {error})"
