"""Which masks there are to score: files, folders, patterns, and archives that hold several."""

import os
import tarfile
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from glob import has_magic, iglob
from pathlib import Path
from typing import TypeAlias

from torchlinf.scoring.archives import tar_masks
from torchlinf.scoring.byte_ranges import ByteRange
from torchlinf.scoring.coco import Outline, Segment, coco_masks
from torchlinf.scoring.in_memory import InMemory
from torchlinf.scoring.readers import SUFFIXES, arrays_in
from torchlinf.scoring.values import UnreadableMaskError

AnyPath: TypeAlias = str | os.PathLike[str]


@dataclass(frozen=True)
class Source:
    """Where a mask is.

    Attributes:
        path: the file.
        member: which of the masks in it: the array of an .npz archive that holds several, the member of a tar archive,
            the id of an annotation.
        error: why there is nothing to read, if that is known already.
        data: where the mask's data is, if it is not the whole file: a byte range of a tar archive, an outline or a
            segment of a COCO file, or a mask in memory.
        category: of an annotation, its category: the name, or the id if the file has none.
        image: of an annotation, its image: the file name, or the id if the file has none.
    """

    path: Path
    member: str | None = None
    error: str | None = None
    data: ByteRange | Outline | Segment | InMemory | None = None
    category: str | None = None
    image: str | None = None

    @property
    def name(self) -> str:
        """The path, with the member after a colon; bytes that are no UTF-8 as escapes. No two masks share one."""
        return _text(self.path) if self.member is None else f"{_text(self.path)}:{_text(self.member)}"


def find_masks(paths: AnyPath | Iterable[AnyPath], *, members: str | None = None) -> list[Source]:
    """Find the masks that paths stand for.

    Args:
        paths: one path, or several: files, taken whatever their name; folders, searched through for files of a known
            suffix; and patterns such as `masks/**/*.png`, where no file has that very name. Hidden files and folders
            are left out, links are followed, and a folder that is reached twice is read once.
        members: which members of tar archives are masks, as a pattern such as `*.mask.png`; None takes all with a
            suffix of a mask.

    Returns:
        One source a mask, however often it is reached: the files of a folder sorted by path, an .npz archive as its
        arrays, a tar archive as its members, a COCO file as its annotations, and what cannot be read as a source with
        an error.

    Raises:
        TypeError: a path is neither text nor a path.
        ValueError: a path is empty text.
        ImportError: there are COCO files, and pycocotools is not installed.
    """
    sources = (source for path in _as_paths(paths) for file in _files(path) for source in open_file(file, members))
    return list({source.name: source for source in sources}.values())


def find_files(paths: AnyPath | Iterable[AnyPath]) -> Iterator[Source]:
    """Find the files that paths stand for, without looking into them: archives stay whole."""
    for path in _as_paths(paths):
        yield from _files(path)


def open_file(file: Source, members: str | None = None) -> Iterator[Source]:
    """Find the masks in a file: itself, or those it holds."""
    suffix, is_file = file.path.suffix.lower(), os.path.isfile(file.path)  # opening a named pipe would wait for ever
    if file.error is None and is_file and suffix in (".tar", ".json"):
        try:
            if suffix == ".json":
                for one in coco_masks(file.path):
                    yield Source(file.path, one.name, one.error, one.outline, one.category, one.image)
                return
            for name, data, error in tar_masks(file.path, members):
                yield Source(file.path, name, error, data)
        except tarfile.TarError as damage:
            yield Source(file.path, error=f"not an uncompressed tar archive, or a damaged one ({damage})")
        except UnreadableMaskError as refusal:
            yield Source(file.path, error=str(refusal))
        except OSError as failure:
            yield Source(file.path, error=f"cannot be read ({failure.strerror})")
        return
    arrays = _arrays(file.path) if suffix == ".npz" and is_file else []
    yield from (Source(file.path, name) for name in arrays) if len(arrays) > 1 else [file]


def _as_paths(paths: AnyPath | Iterable[AnyPath]) -> Iterator[Path]:
    """One path or several; a text is one path, not a list of letters."""
    for path in [paths] if isinstance(paths, str | os.PathLike) else paths:
        if not isinstance(path, str | os.PathLike):
            raise TypeError(f"paths must be a path or several; got {path!r}. Pass for example 'masks/'.")
        if path == "":  # Path would make the current folder of it
            raise ValueError("paths must not be empty; got ''. Pass '.' for the current folder.")
        yield Path(path)


def _files(path: Path) -> Iterable[Source]:
    if os.path.isdir(path):
        return _walk(path)
    if os.path.lexists(path) or not has_magic(str(path)):
        return [Source(path)]
    return [Source(Path(name)) for name in sorted(iglob(str(path), recursive=True)) if not os.path.isdir(name)]


def _walk(folder: Path) -> list[Source]:
    sources: list[Source] = []
    seen: set[tuple[int, int]] = set()

    def refused(error: OSError) -> None:
        sources.append(Source(Path(error.filename), error=f"cannot be searched ({error.strerror})"))

    for root, folders, files in os.walk(folder, onerror=refused, followlinks=True):
        status = os.stat(root)
        # Links make a loop out of a tree: what was seen is not entered again.
        is_new = (status.st_dev, status.st_ino) not in seen
        seen.add((status.st_dev, status.st_ino))
        folders[:] = sorted(name for name in folders if not name.startswith(".")) if is_new else []
        masks = [name for name in files if name.lower().endswith((*SUFFIXES, ".tar")) and not name.startswith(".")]
        sources += [Source(Path(root, name)) for name in masks if is_new]
    return sorted(sources, key=lambda source: source.path.parts)


def _arrays(path: Path) -> list[str]:
    """Names of the arrays in an .npz archive, from its directory; empty if the file is none or a damaged one."""
    try:
        with zipfile.ZipFile(path) as archive:
            return arrays_in(archive)
    except (OSError, zipfile.BadZipFile):
        return []


def _text(path: str | Path) -> str:
    try:
        return os.fsencode(path).decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:  # the id of an annotation may hold half of a pair of surrogates
        return str(path).encode("utf-8", "backslashreplace").decode()
