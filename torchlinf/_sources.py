"""Which masks there are to score: files, folders, and archives that hold several."""

import os
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from torchlinf._readers import SUFFIXES, arrays_in


@dataclass(frozen=True)
class Source:
    """Where a mask is.

    Attributes:
        path: the file.
        member: which array of an .npz archive that holds several.
        error: why there is nothing to read, if that is known already.
    """

    path: Path
    member: str | None = None
    error: str | None = None

    @property
    def name(self) -> str:
        """The path, with the member after a colon; bytes that are no UTF-8 as escapes."""
        text = os.fsencode(self.path).decode("utf-8", "backslashreplace")
        return text if self.member is None else f"{text}:{self.member}"


def find_masks(paths: Iterable[str | os.PathLike[str]]) -> list[Source]:
    """Find the masks that paths stand for.

    Args:
        paths: files, taken whatever their name, and folders, searched through for files of a known suffix. Hidden
            files and folders are left out, links are followed, and a folder that is reached twice is read once.

    Returns:
        One source a mask: the files of a folder sorted by path, an .npz archive as its arrays, and what cannot be
        read as a source with an error.
    """
    found: list[Source] = []
    for path in map(Path, paths):
        for file in _walk(path) if os.path.isdir(path) else [Source(path)]:
            members = _members(file.path)
            found += [Source(file.path, member) for member in members] if len(members) > 1 else [file]
    return found


def _walk(folder: Path) -> list[Source]:
    found: list[Source] = []
    seen: set[tuple[int, int]] = set()

    def refused(error: OSError) -> None:
        found.append(Source(Path(error.filename), error=f"cannot be searched ({error.strerror})"))

    for root, folders, files in os.walk(folder, onerror=refused, followlinks=True):
        status = os.stat(root)
        # Links make a loop out of a tree: what was seen is not entered again.
        is_new = (status.st_dev, status.st_ino) not in seen
        seen.add((status.st_dev, status.st_ino))
        folders[:] = sorted(name for name in folders if not name.startswith(".")) if is_new else []
        masks = [name for name in files if name.lower().endswith(SUFFIXES) and not name.startswith(".")]
        found += [Source(Path(root, name)) for name in masks if is_new]
    return sorted(found, key=lambda source: source.path.parts)


def _members(path: Path) -> list[str]:
    """Names of the arrays in an .npz archive, from its directory; empty if the file is none or a damaged one."""
    if path.suffix.lower() != ".npz" or not os.path.isfile(path):  # opening a named pipe would wait for ever
        return []
    try:
        with zipfile.ZipFile(path) as archive:
            return arrays_in(archive)
    except (OSError, zipfile.BadZipFile):
        return []
