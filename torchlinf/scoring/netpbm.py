"""PBM, PGM and PPM images, plain and binary, by their definition.

Not by Pillow: it scales the numbers of a file whose largest one is not 255 or 65535, and so changes labels.
"""

import re
from dataclasses import replace
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from torchlinf.scoring.values import UnreadableMaskError, Values, require_size, values_of_colours

BEGINNINGS = (b"P1", b"P2", b"P3", b"P4", b"P5", b"P6")
LONGEST_HEADER = 2**16  # bytes: comments take room
# After the magic number two or three numbers, each behind blanks and comments; one blank before the pixels.
NUMBER = rb"(?:\s|#[^\n]*\n)+(\d{1,9})"


def read_netpbm(file: IO[bytes], max_pixels: int) -> Values:
    """Read a PBM, PGM or PPM image, the first one in the file. Of a PBM white is 1, as in other images.

    Raises:
        UnreadableMaskError: it is damaged, or too large.

    Example:
        >>> from io import BytesIO
        >>> read_netpbm(BytesIO(b"P2 3 2 9  0 1 2  7 8 9"), max_pixels=6).array
        array([[0, 1, 2],
               [7, 8, 9]], dtype=uint8)
    """
    beginning = file.read(LONGEST_HEADER)
    kind = beginning[:2]
    header = re.match(rb"P\d" + NUMBER * (2 if kind in (b"P1", b"P4") else 3) + rb"(?:#[^\n]*\n|\s)", beginning)
    if header is None:
        raise UnreadableMaskError("a PBM, PGM or PPM image without width, height and largest number")
    width, height, top = (*map(int, header.groups()), 1)[:3]
    if not (width and height and 0 < top < 65536):
        raise UnreadableMaskError(f"an image of {width} x {height} pixels with numbers up to {top}")
    require_size((height, width), max_pixels)
    file.seek(header.end())
    channels = 3 if kind in (b"P3", b"P6") else 1
    if kind in (b"P1", b"P4"):
        return Values(_bits(file, kind, height, width) == 0)
    numbers = _numbers(file, kind, height * width * channels, top)
    if int(numbers.max()) > top:
        raise UnreadableMaskError(f"damaged: it holds the number {numbers.max()}, and says that the largest is {top}")
    pixels = numbers.reshape(height, width, channels)
    values = Values(pixels[..., 0]) if channels == 1 else values_of_colours(pixels)
    return values if top in (255, 65535) else replace(values, top=top)


def _bits(file: IO[bytes], kind: bytes, height: int, width: int) -> NDArray[np.uint8]:
    if kind == b"P1":  # digits, with blanks between them or not
        digits = np.frombuffer(_without_comments(file), np.uint8)
        digits = digits[(digits == ord("0")) | (digits == ord("1"))]
        return _whole(digits, height * width).reshape(height, width) - ord("0")
    row = (width + 7) // 8
    packed = _whole(np.frombuffer(file.read(height * row), np.uint8), height * row)
    return np.unpackbits(packed.reshape(height, row), axis=1)[:, :width]


def _numbers(file: IO[bytes], kind: bytes, count: int, top: int) -> NDArray[Any]:
    dtype = np.dtype(np.uint8 if top < 256 else np.uint16)
    if kind in (b"P2", b"P3"):
        words = _without_comments(file).split(maxsplit=count)[:count]
        return _whole(np.array(words, dtype=np.bytes_).astype(np.int64), count).astype(dtype, casting="unsafe")
    stored = np.frombuffer(file.read(count * dtype.itemsize), dtype.newbyteorder(">"))
    return _whole(stored, count).astype(dtype)


def _without_comments(file: IO[bytes]) -> bytes:
    return re.sub(rb"#[^\n]*", b"", file.read())


def _whole(numbers: NDArray[Any], count: int) -> NDArray[Any]:
    if len(numbers) < count:
        raise UnreadableMaskError(f"truncated: {len(numbers)} of {count} numbers are there")
    return numbers[:count]
