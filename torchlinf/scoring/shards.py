"""Shards in, parts out: an archive, or a run of files, becomes one Parquet file, which is there whole or not at all.

Whoever works on a shard leaves a marker beside its part, and takes it away at the end. A marker that is found says that
an earlier worker was lost, perhaps by one of the masks: from then on they are scored in a process of their own.
"""

import os
import platform
import re
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b
from itertools import tee
from pathlib import Path

from torchlinf.scoring.atomic_write import replace_file
from torchlinf.scoring.options import ScoreOptions
from torchlinf.scoring.rows import Score
from torchlinf.scoring.score import blank_row, score_groups
from torchlinf.scoring.sources import AnyPath, Source, find_files, is_archive, open_file
from torchlinf.scoring.tables import write_table

FILES = 1000  # single files in a shard
LOST = 5  # workers that a shard may cost in one run: Ray Data would go on for ever
RUN = re.compile(r"files-[0-9a-f]+\.parquet$")  # parts of single files
SETTINGS = "_settings.json"  # readers of Parquet folders pass over names that begin with _ or .


@dataclass(frozen=True)
class Shard:
    """What one worker does at a time.

    Attributes:
        files: an archive alone, or single files.
        folder: where relative paths start.
    """

    files: tuple[Source, ...]
    folder: str

    @property
    def part(self) -> str:
        """Name of the file that its rows are in. It follows from the paths alone, not from what is in the files."""
        paths = b"\0".join(os.fsencode(os.path.join(self.folder, file.path)) for file in self.files)
        first = self.files[0].path
        # A run of files is called by no file's name: the hash says which they are.
        title = re.sub(r"[^\w.-]", "_", first.name, flags=re.ASCII).lstrip("._")[:80] if self.is_archive else "files"
        return f"{title}-{blake2b(paths, digest_size=8).hexdigest()}.parquet"

    @property
    def is_archive(self) -> bool:
        """Whether it is an archive, not files."""
        return is_archive(self.files[0].path)


@dataclass(frozen=True)
class Part:
    """What is known of a part.

    Attributes:
        name: of the Parquet file.
        masks: rows in it.
        failed: rows with an error.
        seconds: time that the worker took; 0.0 if the part was there before.
    """

    name: str
    masks: int
    failed: int
    seconds: float = 0.0


def find_shards(
    paths: AnyPath | Iterable[AnyPath], *, files: int = FILES, passed_over: Counter[str] | None = None
) -> list[Shard]:
    """Find what there is to score, in pieces for workers. No file is opened.

    Args:
        paths: one path, or several: files, folders and patterns, as in `find_masks`.
        files: how many single files make a shard. A tar archive or a .json file is one shard, whatever it holds.
        passed_over: takes the count of what folders hold beside masks, as in `find_masks`.

    Returns:
        Shards, each once.

    Raises:
        TypeError: a path is neither text nor a path.
        ValueError: `files` is less than 1, or a path is empty text.
    """
    if files < 1:
        raise ValueError(f"files must be 1 or more; got {files}. Pass for example {FILES}.")
    folder = os.getcwd()
    archives: list[Source] = []
    single: list[Source] = []
    for file in {file.name: file for file in find_files(paths, passed_over=passed_over)}.values():
        (archives if is_archive(file.path) else single).append(file)
    runs = [(file,) for file in archives] + [tuple(single[i : i + files]) for i in range(0, len(single), files)]
    return list({shard.part: shard for shard in (Shard(run, folder) for run in runs)}.values())


def open_folder(out: Path, shards: Iterable[Shard], options: ScoreOptions) -> None:
    """Make the folder of the parts, or see that the parts in it are of these masks and settings.

    Raises:
        ValueError: they are not.
        OSError: it cannot be made or written.
    """
    out.mkdir(parents=True, exist_ok=True)
    settings, text = out / SETTINGS, options.settings()
    before = settings.read_text() if settings.exists() else None
    if before not in (None, text):
        raise ValueError(
            f"{out} holds parts scored with other settings, {before}; got {text}. Pass the same settings, or another "
            "folder."
        )
    expected = {shard.part for shard in shards}
    others = [name for name in sorted(os.listdir(out)) if RUN.match(name) and name not in expected]
    if others:
        raise ValueError(
            f"{out} holds {len(others)} part(s) of another list of files, such as {others[0]}, so that masks could be "
            "there twice. Pass another folder, or the paths of the run before, if no file came or went since."
        )
    if before is None:

        def write(temporary: Path) -> None:
            temporary.write_text(text)

        replace_file(settings, write)


def tidy(out: Path, shards: Iterable[Shard]) -> None:
    """Remove what killed workers left of shards that are done."""
    hidden = tuple(f".{shard.part}." for shard in shards)
    for name in os.listdir(out) if hidden else ():
        if name.startswith(".") and name.startswith(hidden):
            (out / name).unlink(missing_ok=True)


def read_part(path: Path, columns: Sequence[str]) -> Part | None:
    """What is known of a part by its footer; None if it is missing, damaged, or has other columns."""
    import pyarrow
    import pyarrow.parquet

    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            if tuple(file.schema_arrow.names) != tuple(columns):
                return None
            groups = [file.metadata.row_group(i) for i in range(file.num_row_groups)]
            sound = sum(group.column(columns.index("error")).statistics.null_count for group in groups)
            return Part(path.name, file.metadata.num_rows, file.metadata.num_rows - sound)
    except (pyarrow.ArrowInvalid, OSError):
        return None


def score_shard(shard: Shard, out: Path, options: ScoreOptions, run: str = "") -> Part:
    """Score the masks of a shard into its part, unless that is there.

    Args:
        shard: what to score.
        out: the folder of the parts.
        options: how its masks are read and measured.
        run: a word for the run that this belongs to. Workers that other runs lost do not count against the shard:
            they may have been ended with their run.

    Returns:
        What is known of the part.

    Raises:
        OSError: the part cannot be written.
        ImportError: there are COCO files, and pycocotools is not installed.
    """
    start, path = time.perf_counter(), out / shard.part
    if (part := read_part(path, options.columns)) is not None:
        return part
    marker = out / f".{shard.part}.begun"
    before = _begin(marker, run)
    lost = before.count(run)
    try:
        rows = _rows(shard, options, isolated=bool(before)) if lost < LOST else _given_up(shard, options, lost)
        write_table(path, rows, columns=options.columns)
    finally:
        marker.unlink(missing_ok=True)
    part = read_part(path, options.columns)
    assert part is not None
    return replace(part, seconds=time.perf_counter() - start)


def _begin(marker: Path, run: str) -> list[str]:
    """Add a line to the marker; the runs of the workers that began before and did not end."""
    with marker.open("a+") as file:
        file.seek(0)
        before = [line.partition(" ")[0] for line in file]
        file.write(f"{run} {platform.node()} {os.getpid()}\n")
    return before


def _rows(shard: Shard, options: ScoreOptions, isolated: bool) -> Iterator[Score]:
    def named() -> Iterator[tuple[Source, str]]:
        for file in shard.files:
            # Workers may run in other folders; the row names the file as it was given.
            for source in open_file(replace(file, path=Path(shard.folder, file.path)), options.members):
                yield source, replace(source, path=file.path).name

    sources, names = tee(named())
    groups = score_groups((source for source, _ in sources), options, isolated=isolated)
    for rows, (source, name) in zip(groups, names, strict=True):
        yield from (replace(row, path=name + row.path.removeprefix(source.name)) for row in rows)


def _given_up(shard: Shard, options: ScoreOptions, lost: int) -> list[Score]:
    error = f"not scored: {lost} workers were killed or crashed in its shard; delete {shard.part} to try again"
    return [blank_row(file.name, options.measure, error) for file in shard.files]
