"""Text files of whole lines, which one run at a time writes."""

import io
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Self

from torchlinf.scoring.atomic_write import replace_file


class LineFile:
    """A text file of whole lines, which one run at a time writes.

    Each line goes to the system in one unbuffered write: a program that is interrupted or killed leaves no more than
    one half line, at the end, and what was written can be read while the program still runs.
    """

    def __init__(self, path: Path) -> None:
        """Open a file, or make it; nothing of it is changed yet.

        Raises:
            OSError: it cannot be opened, or another run is writing it.
        """
        self._path = path
        self._file = _open(path)

    def cut(self, size: int) -> None:
        """Drop what stands behind the first `size` bytes."""
        with suppress(io.UnsupportedOperation):
            if self._file.seekable() and os.fstat(self._file.fileno()).st_size > size:
                self._file.truncate(size)

    def write(self, line: str) -> None:
        """Append a line, which ends with a line break; if it cannot be written in full, not at all.

        Raises:
            OSError: it cannot be written, for example because the disk is full.
        """
        data, written = line.encode(), 0
        try:
            while written < len(data):
                written += self._file.write(data[written:])
        except OSError:
            if written:
                with suppress(OSError):  # a pipe cannot be cut back
                    self._file.truncate(self._file.seek(-written, io.SEEK_CUR))
            raise

    def replace(self, lines: Iterable[str]) -> None:
        """Put other lines in the place of all that are there, in one piece.

        Raises:
            OSError: they cannot be written, and the file is as before; or another run was faster.
        """

        def write(temporary: Path) -> None:
            with temporary.open("wb") as file:
                file.writelines(line.encode() for line in lines)

        replace_file(self._path, write)
        self._file.close()
        self._file = _open(self._path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


def _open(path: Path) -> io.FileIO:
    file = path.open("ab", buffering=0)
    try:
        _lock(file, path)
    except OSError:
        file.close()
        raise
    return file


def _lock(file: io.FileIO, path: Path) -> None:
    try:
        import fcntl
    except ImportError:
        return
    taken = "another run is writing it"
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise OSError(error.errno, taken) from error
    except OSError:
        return  # file systems without locks
    # That run may have replaced or removed the file since it was opened, and let go of it.
    if not (path.exists() and os.path.samestat(path.stat(), os.fstat(file.fileno()))):
        raise OSError(0, taken)
