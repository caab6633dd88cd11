"""Masks in tar archives: the byte range of each, read from the headers alone."""

import gzip
import tarfile
import zlib
from collections.abc import Iterator
from contextlib import ExitStack
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import IO, NamedTuple, cast

from torchlinf.scoring.byte_ranges import ByteRange, PackedRange
from torchlinf.scoring.names import PACKED_SUFFIXES, SUFFIXES, name_beside, suffix_of


class Member(NamedTuple):
    """A mask in an archive: its name, and its byte range or why it is not read."""

    name: str
    byte_range: ByteRange | PackedRange | None
    error: str | None


def tar_masks(path: Path, members: str | None = None) -> Iterator[Member]:
    """List the masks in a tar archive, in its order; nothing is unpacked.

    Args:
        path: the archive; compressed by gzip if its name ends in .tar.gz or .tgz. Then it is read through once for the
            list.
        members: which ones, as a pattern such as `*.mask.png` that the whole name must match; None takes every member
            with a suffix of a mask, as in the layout of WebDataset.

    Yields:
        One entry a member. A member that is not a plain file, or whose name leads out of the archive, comes with an
        error. So does the second member of one name, which is called by the name and "~2".

    Raises:
        OSError: the archive cannot be opened.
        tarfile.TarError: it is damaged; the members before the damage have been yielded.
    """
    is_packed = suffix_of(path) in PACKED_SUFFIXES
    seen: set[str] = set()  # names in the archive
    taken: set[str] = set()  # names of entries
    with ExitStack() as files:
        file = cast("IO[bytes]", files.enter_context(gzip.GzipFile(path) if is_packed else path.open("rb")))
        end = None if is_packed else file.seek(0, 2)
        file.seek(0)
        try:
            archive = files.enter_context(tarfile.open(fileobj=file, mode="r:"))
            while (info := archive.next()) is not None:
                wanted = fnmatchcase(info.name, members) if members else info.name.lower().endswith(SUFFIXES)
                if not wanted or info.isdir():
                    continue
                name, error = name_beside(info.name, taken), _problem(info, end)
                if info.name in seen:
                    error = "the archive holds another member of this name before"
                seen.add(info.name)
                taken.add(name)
                if error is not None:
                    yield Member(name, None, error)
                    continue
                span = (PackedRange if is_packed else ByteRange)(info.offset_data, info.size)
                yield Member(name, span, None)
            # tarfile takes a damaged header for the end of the archive, which is a block of zeros.
            file.seek(archive.offset)
            if file.read(tarfile.BLOCKSIZE) != bytes(tarfile.BLOCKSIZE):
                raise tarfile.ReadError(f"neither a member nor the end mark at byte {archive.offset}")
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise tarfile.ReadError(f"damaged or truncated within gzip: {error}") from error


def _problem(info: tarfile.TarInfo, end: int | None) -> str | None:
    parts = PurePosixPath(info.name.replace("\\", "/"))
    if parts.is_absolute() or ".." in parts.parts:
        return "the member's name leads out of the archive; it is not read"
    if not info.isreg() or info.issparse():
        return "the member is not a plain file (a link, a device, or sparse)"
    if info.size == 0:
        return "the member is empty (0 bytes)"
    if end is not None and info.offset_data + info.size > end:
        return "truncated: the archive ends before the member does"
    return None
