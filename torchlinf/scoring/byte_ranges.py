"""Parts of files, read in place: what is in an archive is never unpacked, and never read further than its own end."""

import gzip
import io
import os
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

from torchlinf.scoring.values import UnreadableMaskError


@dataclass(frozen=True)
class ByteRange:
    """Where a part of a file is.

    Attributes:
        offset: of its first byte.
        size: in bytes.
    """

    offset: int
    size: int


def open_range(path: Path, span: ByteRange) -> IO[bytes]:
    """Open a part of a file as if it were a file of its own.

    Raises:
        OSError: the file cannot be opened.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     whole = Path(folder) / "whole"
        ...     _ = whole.write_bytes(b"0123456789")
        ...     with open_range(whole, ByteRange(3, 4)) as part:
        ...         part.read()
        b'3456'
    """
    return cast("IO[bytes]", io.BufferedReader(_Window(path, span)))


@dataclass(frozen=True)
class PackedRange:
    """Where a part of a file is that gzip has compressed.

    Attributes:
        offset: of its first byte, in what is unpacked.
        size: in bytes.
    """

    offset: int
    size: int


def open_part(path: Path, span: ByteRange | PackedRange, max_pixels: int) -> IO[bytes]:
    """Open a part of a file, as `open_range` or `open_packed`."""
    return open_range(path, span) if isinstance(span, ByteRange) else open_packed(path, span, max_pixels)


_open = threading.local()  # of each thread the stream that it reads: another one would move it


def open_packed(path: Path, span: PackedRange, max_pixels: int) -> IO[bytes]:
    """Read a part of a file that gzip has compressed. Parts that are asked for in their order are read in one pass.

    Raises:
        OSError: the file cannot be read.
        EOFError: it ends before the part does.
        UnreadableMaskError: the part is larger than any image of `max_pixels`.
    """
    if span.size > 32 * max_pixels + 2**20:
        raise UnreadableMaskError(f"{span.size} bytes are more than a mask of {max_pixels} pixels takes")
    status = path.stat()
    key = (path, status.st_ino, status.st_mtime_ns)
    if getattr(_open, "key", None) != key:
        if hasattr(_open, "stream"):
            _open.stream.close()
        _open.key, _open.stream = key, gzip.GzipFile(path)
    try:
        _open.stream.seek(span.offset)
        part = _open.stream.read(span.size)
    except BaseException:
        _open.key = None  # what it has read is in no known state
        raise
    if len(part) < span.size:
        raise EOFError("the archive ends before the member does")
    return io.BytesIO(part)


class _Window(io.RawIOBase):
    def __init__(self, path: Path, span: ByteRange) -> None:
        self._file = path.open("rb", buffering=0)
        self._span = span
        self._position = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._position

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._span.size}[whence]
        if start + offset < 0:
            raise ValueError(f"a position must be at least 0; got {start + offset}")
        self._position = start + offset
        return self._position

    def readinto(self, buffer: "memoryview") -> int:  # type: ignore[override]
        room = memoryview(buffer)[: max(self._span.size - self._position, 0)]
        self._file.seek(self._span.offset + self._position)
        count = self._file.readinto(room) or 0
        self._position += count
        return count

    def close(self) -> None:
        self._file.close()
        super().close()
