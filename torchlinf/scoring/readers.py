"""Image and array files in, numbers out; what is refused, and why, in words.

Everything is judged by its header before memory is taken for it: a few hundred bytes can claim to be a terabyte.
"""

import os
import stat
import zipfile
import zlib
from importlib.metadata import version
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchlinf._helpers.extras import require
from torchlinf.scoring.byte_ranges import ByteRange, PackedRange, open_part
from torchlinf.scoring.names import ARRAY_SUFFIXES, NIFTI_SUFFIXES, SUFFIXES, suffix_of
from torchlinf.scoring.netpbm import BEGINNINGS as NETPBM_BEGINNINGS
from torchlinf.scoring.netpbm import read_netpbm
from torchlinf.scoring.nifti import is_nifti, read_nifti
from torchlinf.scoring.open_image import PILLOW_FORMATS, open_image
from torchlinf.scoring.tiff import read_tiff
from torchlinf.scoring.values import (
    UnreadableMaskError,
    Values,
    require_size,
    values_of_array,
    values_of_colours,
    values_of_palette,
)

if TYPE_CHECKING:
    from PIL.Image import Image

TIFF_BEGINNINGS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")  # the last two are BigTIFF


def read_values(
    path: Path,
    member: str | None,
    max_pixels: int,
    byte_range: ByteRange | PackedRange | None = None,
    volume: bool = False,
) -> Values:
    """Read an image, a NIfTI volume, an .npy array or a member of an .npz archive.

    Args:
        path: the file.
        member: which array of an .npz archive, by name; None if it holds one only. With `byte_range`, the name of what
            it holds.
        max_pixels: what holds more numbers than this is refused.
        byte_range: where in the file the image or array is; None if it is the whole file.
        volume: the last axis of an array is never one of channels.

    Returns:
        The numbers, 2-D or 3-D; leading axes of length 1 are dropped.

    Raises:
        UnreadableMaskError: the file is missing, empty, damaged, too large, or neither image nor array.
    """
    try:
        _require_regular(path)
        if byte_range is None:
            with path.open("rb") as file:
                return parse_values(file, suffix_of(path), max_pixels, member, volume)
        with open_part(path, byte_range, max_pixels) as part:
            return parse_values(part, suffix_of(member or ""), max_pixels, volume=volume)
    except UnreadableMaskError:
        raise
    except (OSError, EOFError, zlib.error) as error:
        raise UnreadableMaskError(_in_words(error)) from error


def parse_values(
    file: IO[bytes], suffix: str, max_pixels: int, member: str | None = None, volume: bool = False
) -> Values:
    """Read an open file, which `suffix` says to be an image, an .npy array or an .npz archive; as `read_values`."""
    try:
        if suffix in ARRAY_SUFFIXES:
            return values_of_array(_read_array(file, suffix, member, max_pixels), volume)
        beginning = file.read(4)
        file.seek(0)
        if suffix in NIFTI_SUFFIXES or is_nifti(file):
            return read_nifti(file, max_pixels)
        if beginning in TIFF_BEGINNINGS:
            return read_tiff(file, max_pixels)
        if beginning[:2] in NETPBM_BEGINNINGS:
            return read_netpbm(file, max_pixels)
        return _read_image(file, suffix, max_pixels)
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


def _read_array(file: IO[bytes], suffix: str, member: str | None, max_pixels: int) -> NDArray[Any]:
    if suffix == ".npy":
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
    require_size(shape, max_pixels)
    file.seek(0)
    array: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
    return array


def _read_image(file: IO[bytes], suffix: str, max_pixels: int) -> Values:
    from PIL import UnidentifiedImageError

    bits, is_coloured = _png_depth(file)
    try:
        with open_image(file, PILLOW_FORMATS) as image:
            require_size((image.height, image.width), max_pixels)
            if bits == 16 and is_coloured:
                return values_of_colours(_deep_png(file))
            lossy = image.format in ("JPEG", "MPO", "AVIF") or (image.format == "WEBP" and _is_lossy_webp(file))
            return _values_of_image(image, lossy, bits if image.mode == "L" and bits in (2, 4) else None)
    except UnidentifiedImageError as error:
        if suffix in (".tif", ".tiff"):
            raise UnreadableMaskError("not a TIFF image, or a damaged one") from error
        if (kind := _missing_decoder(file)) is not None:
            raise UnreadableMaskError(
                f"Pillow {version('pillow')} is installed without {kind}. Run: pip install --upgrade pillow"
            ) from error
        known = ", ".join(suffix[1:] for suffix in SUFFIXES)
        raise UnreadableMaskError(f"not an image in a known format ({known})") from error


def _missing_decoder(file: IO[bytes]) -> str | None:
    """The format of an image that this Pillow was built without; None if that is not what is wrong."""
    from PIL import Image, features

    file.seek(0)
    beginning = file.read(12)
    found = {"WEBP": beginning[:4] + beginning[8:] == b"RIFFWEBP", "AVIF": beginning[4:11] == b"ftypavi"}
    kind = next((kind for kind in found if found[kind]), None)
    # Pillow before 11.3 has no AVIF.
    return kind if kind is not None and not (kind in Image.OPEN and features.check(kind.lower())) else None


def _is_lossy_webp(file: IO[bytes]) -> bool:
    """Whether the first frame of a WebP is compressed by VP8, not VP8L; the file is where it was afterwards."""
    place = file.tell()
    file.seek(12)
    lossy = True
    while len(head := file.read(8)) == 8:
        if head[:4] in (b"VP8 ", b"VP8L"):
            lossy = head[:4] == b"VP8 "
            break
        size = int.from_bytes(head[4:], "little")
        # A frame of an animation has a header of 16 bytes, then chunks of its own.
        file.seek(16 if head[:4] == b"ANMF" else size + size % 2, os.SEEK_CUR)
    file.seek(place)
    return lossy


def _deep_png(file: IO[bytes]) -> NDArray[Any]:
    """The colours of a PNG with 16 bits a channel: Pillow drops the lower eight."""
    try:
        imagecodecs = require("imagecodecs", "reading a PNG with 16-bit colours", "codecs")
    except ImportError as error:
        raise UnreadableMaskError(f"{error}. Or save it as TIFF, or as 16-bit grey") from error
    file.seek(0)
    colours: NDArray[Any] = imagecodecs.png_decode(file.read())
    return colours


def _png_depth(file: IO[bytes]) -> tuple[int | None, bool]:
    """Bits of a channel in a PNG, and whether there are several channels; (None, False) for other files."""
    header = file.read(26)
    file.seek(0)
    if len(header) < 26 or not header.startswith(b"\x89PNG\r\n\x1a\n"):
        return None, False
    return header[24], header[25] in (2, 4, 6)


def _values_of_image(image: "Image", lossy: bool, bits: int | None) -> Values:
    """The numbers of an image that Pillow has opened.

    Args:
        image: its first frame is read.
        lossy: whether its compression changes values.
        bits: of a pixel, where Pillow has scaled fewer than eight bits to eight.
    """
    if image.mode == "P":
        indices = np.asarray(image)
        palette = np.array(image.getpalette("RGB"), dtype=np.uint8).reshape(-1, 3)
        palette = np.vstack([palette, np.zeros((256 - len(palette), 3), np.uint8)])
        opacity = np.asarray(image.convert("RGBA"))[..., 3] if image.has_transparency_data else None
        return values_of_palette(indices, palette, opacity)
    if image.mode in ("1", "L", "F") or image.mode.startswith("I"):
        return _values_of_grey(image, lossy, bits)
    channels = np.asarray(
        image.convert("RGBA" if image.has_transparency_data else "RGB") if image.mode != "LA" else image
    )
    return values_of_colours(channels, lossy)


def _values_of_grey(image: "Image", lossy: bool, bits: int | None) -> Values:
    array = np.asarray(image)
    if image.mode.startswith("I") and image.format == "PNG":
        array = array.astype(np.uint16)  # older versions of Pillow widen 16 bits to 32
    top = None
    if bits is not None:
        top = 2**bits - 1
        array = array // (255 // top)
    clear = image.info.get("transparency")
    if not isinstance(clear, int):
        return Values(array, lossy, top=top)
    if image.mode == "1":
        clear = bool(clear)
    transparent = array == clear
    shown = np.where(transparent, np.zeros((), array.dtype), array)
    # Where one colour is left, the opacity is the mask.
    return Values(~transparent if shown.min() == shown.max() else shown, lossy, top=top)


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
