"""Images opened by Pillow without its own limit of size, which is a global of the process."""

import struct
from collections.abc import Mapping
from contextlib import suppress
from importlib import import_module
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

# Files from strangers should meet few decoders.
PILLOW_FORMATS = {"PNG": "Png", "GIF": "Gif", "BMP": "Bmp", "JPEG": "Jpeg", "WEBP": "WebP", "AVIF": "Avif"}


def open_image(file: IO[bytes], formats: Mapping[str, str]) -> "ImageFile":
    """Open an image by its header; no pixel is read yet, so that the caller can judge its size.

    `Image.open` warns or fails above `Image.MAX_IMAGE_PIXELS`. To set that would change the user's process, and other
    threads in it. The decoders of the formats, which it calls, know no such limit.

    Args:
        file: at its beginning.
        formats: as Pillow names them, with the beginning of the name of the module; the first that fits is taken.

    Raises:
        UnidentifiedImageError: the file is in none of the formats.
    """
    from PIL import Image, UnidentifiedImageError

    for plugin in formats.values():
        with suppress(ImportError):  # an older Pillow has no AVIF
            import_module(f"PIL.{plugin}ImagePlugin")
    start = file.read(16)
    for name in [name for name in formats if name in Image.OPEN]:
        factory, accepts = Image.OPEN[name]
        file.seek(0)
        accepted = accepts is None or accepts(start)
        if not accepted or isinstance(accepted, str):  # a text says what this build of Pillow lacks
            continue
        try:
            return factory(file, "")
        except (SyntaxError, IndexError, TypeError, struct.error):  # a header that is not of this format
            continue
    raise UnidentifiedImageError("in none of the formats")
