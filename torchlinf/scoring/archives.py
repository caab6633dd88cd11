"""Masks in tar archives: the byte range of each, read from the headers alone."""

import tarfile
from collections import Counter
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from torchlinf.scoring.byte_ranges import ByteRange
from torchlinf.scoring.readers import SUFFIXES


class Member(NamedTuple):
    """A mask in an archive: its name, and its byte range or why it is not read."""

    name: str
    byte_range: ByteRange | None
    error: str | None


def tar_masks(path: Path, members: str | None = None) -> Iterator[Member]:
    """List the masks in an uncompressed tar archive, in its order; nothing is unpacked.

    Args:
        path: the archive.
        members: which ones, as a pattern such as `*.mask.png` that the whole name must match; None takes every member
            with a suffix of a mask, as in the layout of WebDataset.

    Yields:
        One entry a member. A member that is not a plain file, or whose name leads out of the archive, comes with an
        error. So does the second member of one name, which is called by the name and "#2".

    Raises:
        OSError: the archive cannot be opened.
        tarfile.TarError: it is damaged; the members before the damage have been yielded.
    """
    seen: Counter[str] = Counter()
    with path.open("rb") as file:
        end = file.seek(0, 2)
        file.seek(0)
        with tarfile.open(fileobj=file, mode="r:") as archive:
            while (info := archive.next()) is not None:
                wanted = fnmatchcase(info.name, members) if members else info.name.lower().endswith(SUFFIXES)
                if not wanted or info.isdir():
                    continue
                seen[info.name] += 1
                if seen[info.name] > 1:
                    name = f"{info.name}#{seen[info.name]}"
                    yield Member(name, None, "the archive holds another member of this name before")
                    continue
                error = _problem(info, end)
                yield Member(info.name, None if error else ByteRange(info.offset_data, info.size), error)
            # tarfile takes a damaged header for the end of the archive, which is a block of zeros.
            file.seek(archive.offset)
            if file.read(tarfile.BLOCKSIZE) != bytes(tarfile.BLOCKSIZE):
                raise tarfile.ReadError(f"neither a member nor the end mark at byte {archive.offset}")


def _problem(info: tarfile.TarInfo, end: int) -> str | None:
    parts = PurePosixPath(info.name.replace("\\", "/"))
    if parts.is_absolute() or ".." in parts.parts:
        return "the member's name leads out of the archive; it is not read"
    if not info.isreg() or info.issparse():
        return "the member is not a plain file (a link, a device, or sparse)"
    if info.size == 0:
        return "the member is empty (0 bytes)"
    if info.offset_data + info.size > end:
        return "truncated: the archive ends before the member does"
    return None
