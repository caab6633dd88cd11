"""Parts of files, read in place: what is in an archive is never unpacked, and never read further than its own end."""

import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast


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
