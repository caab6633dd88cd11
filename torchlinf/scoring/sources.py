"""Which masks there are to score: files, folders, patterns, and archives that hold several."""

import json
import os
import tarfile
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from glob import has_magic, iglob
from pathlib import Path
from typing import TypeAlias

from torchlinf.scoring.archives import tar_masks
from torchlinf.scoring.byte_ranges import ByteRange, PackedRange
from torchlinf.scoring.coco import Outline, Segment, coco_masks
from torchlinf.scoring.in_memory import InMemory
from torchlinf.scoring.labelme import Drawing, is_labelme, labelme_masks
from torchlinf.scoring.names import SUFFIXES, TAR_SUFFIXES, suffix_of
from torchlinf.scoring.readers import arrays_in
from torchlinf.scoring.values import UnreadableMaskError

AnyPath: TypeAlias = str | os.PathLike[str]


@dataclass(frozen=True)
class Source:
    """Where a mask is.

    Attributes:
        path: the file.
        member: which of the masks in it: the array of an .npz archive that holds several, the member of a tar archive,
            the id of an annotation, the position of a shape.
        error: why there is nothing to read, if that is known already.
        data: where the mask's data is, if it is not the whole file: a byte range of a tar archive, an outline or a
            segment of a COCO file, the shapes of an object in a labelme file, or a mask in memory.
        category: of an annotation, its category: the name, or the id if the file has none; labelme's label.
        image: of an annotation, its image: the file name, or the id if the file has none.
    """

    path: Path
    member: str | None = None
    error: str | None = None
    data: ByteRange | PackedRange | Outline | Segment | Drawing | InMemory | None = None
    category: str | None = None
    image: str | None = None

    @property
    def name(self) -> str:
        """The path, with the member after a colon; bytes that are no UTF-8 as escapes. No two masks share one."""
        return _text(self.path) if self.member is None else f"{_text(self.path)}:{_text(self.member)}"


def find_masks(
    paths: AnyPath | Iterable[AnyPath], *, members: str | None = None, passed_over: Counter[str] | None = None
) -> list[Source]:
    """Find the masks that paths stand for.

    Args:
        paths: one path, or several: files, taken whatever their name; folders, searched through for files of a known
            suffix; and patterns such as `masks/**/*.png`, where no file has that very name. Hidden files and folders
            are left out, links are followed, and a folder that is reached twice is read once.
        members: which members of tar archives are masks, as a pattern such as `*.mask.png`; None takes all with a
            suffix of a mask.
        passed_over: takes the count of what folders hold beside masks, by suffix: ".txt", "hidden", "without a suffix".

    Returns:
        One source a mask, however often it is reached: the files of a folder sorted by path, an .npz archive as its
        arrays, a tar archive as its members, a COCO file as its annotations, a labelme file as its objects, and what
        cannot be read as a source with an error.

    Raises:
        TypeError: a path is neither text nor a path.
        ValueError: a path is empty text.
        ImportError: there are COCO files, and pycocotools is not installed.
    """
    files = find_files(paths, passed_over=passed_over)
    sources = (source for file in files for source in open_file(file, members))
    return list({source.name: source for source in sources}.values())


def find_files(paths: AnyPath | Iterable[AnyPath], *, passed_over: Counter[str] | None = None) -> Iterator[Source]:
    """Find the files that paths stand for, without looking into them: archives stay whole."""
    for path in _as_paths(paths):
        yield from _files(path, Counter() if passed_over is None else passed_over)


def open_file(file: Source, members: str | None = None) -> Iterator[Source]:
    """Find the masks in a file: itself, or those it holds."""
    suffix, is_file = suffix_of(file.path), os.path.isfile(file.path)  # opening a named pipe would wait for ever
    if file.error is None and is_file and suffix in (*TAR_SUFFIXES, ".json"):
        try:
            if suffix == ".json":
                yield from _described(file.path)
                return
            for one in tar_masks(file.path, members):
                yield Source(file.path, one.name, one.error, one.byte_range)
        except tarfile.TarError as damage:
            kind = "an uncompressed tar archive" if suffix == ".tar" else "a tar archive compressed by gzip"
            yield Source(file.path, error=f"not {kind}, or a damaged one ({damage})")
        except UnreadableMaskError as refusal:
            yield Source(file.path, error=str(refusal))
        except OSError as failure:
            yield Source(file.path, error=f"cannot be read ({failure.strerror})")
        return
    arrays = _arrays(file.path) if suffix == ".npz" and is_file else []
    yield from (Source(file.path, name) for name in arrays) if len(arrays) > 1 else [file]


def is_archive(path: Path) -> bool:
    """Whether a file holds any number of masks, by its name.

    >>> is_archive(Path("a.tar.gz")), is_archive(Path("a.nii.gz"))
    (True, False)
    """
    return suffix_of(path) in (*TAR_SUFFIXES, ".json")


def _described(path: Path) -> Iterator[Source]:
    """The masks that a JSON file describes, of COCO or of labelme."""
    try:
        content = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise UnreadableMaskError(f"not a COCO file, nor one of labelme ({type(error).__name__}: {error})") from error
    if is_labelme(content):
        for mark in labelme_masks(path, content):
            yield Source(path, mark.name, mark.error, mark.drawing, mark.category, mark.image)
    else:
        for one in coco_masks(path, content):
            yield Source(path, one.name, one.error, one.outline, one.category, one.image)


def _as_paths(paths: AnyPath | Iterable[AnyPath]) -> Iterator[Path]:
    """One path or several; a text is one path, not a list of letters."""
    for path in [paths] if isinstance(paths, str | os.PathLike) else paths:
        if not isinstance(path, str | os.PathLike):
            raise TypeError(f"paths must be a path or several; got {path!r}. Pass for example 'masks/'.")
        if path == "":  # Path would make the current folder of it
            raise ValueError("paths must not be empty; got ''. Pass '.' for the current folder.")
        yield Path(path)


def _files(path: Path, passed_over: Counter[str]) -> Iterable[Source]:
    if os.path.isdir(path):
        return _walk(path, passed_over)
    if os.path.lexists(path) or not has_magic(str(path)):
        return [Source(path)]
    return [Source(Path(name)) for name in sorted(iglob(str(path), recursive=True)) if not os.path.isdir(name)]


def _walk(folder: Path, passed_over: Counter[str]) -> list[Source]:
    sources: list[Source] = []
    seen: set[tuple[int, int]] = set()

    def refused(error: OSError) -> None:
        sources.append(Source(Path(error.filename), error=f"cannot be searched ({error.strerror})"))

    for root, folders, files in os.walk(folder, onerror=refused, followlinks=True):
        status = os.stat(root)
        # Links make a loop out of a tree: what was seen is not entered again.
        is_new = (status.st_dev, status.st_ino) not in seen
        seen.add((status.st_dev, status.st_ino))
        if not is_new:
            folders.clear()
            continue
        shown = sorted(name for name in folders if not name.startswith("."))
        passed_over["hidden"] += len(folders) - len(shown)
        folders[:] = shown
        for name in files:
            if name.startswith("."):
                passed_over["hidden"] += 1
            elif name.lower().endswith((*SUFFIXES, *TAR_SUFFIXES)):
                sources.append(Source(Path(root, name)))
            else:
                passed_over[suffix_of(name) or "without a suffix"] += 1
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
