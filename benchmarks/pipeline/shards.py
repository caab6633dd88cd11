"""What does a silhouette in a tar shard cost, where does the time go, and what does Ray add?"""

import io
import os
import tarfile
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks import shapes
from torchlinf.scoring import (
    COLUMNS,
    ScoreOptions,
    Source,
    find_masks,
    read_source,
    score_mask,
    score_masks,
    write_table,
)
from torchlinf.scoring.ray import connected, score_shards
from torchlinf.scoring.readers import read_values
from torchlinf.scoring.shards import Part, find_shards, score_shard


@dataclass(frozen=True)
class Stage:
    """Milliseconds of processor time for a mask, median and least over the rounds."""

    name: str
    median: float
    least: float


@dataclass(frozen=True)
class Answer:
    """Of a set of shards: sizes a mask, the stages, and processor time a mask, ms, in one process and on Ray."""

    masks: int
    shards: int
    pixels: float
    bytes_in: float
    bytes_out: float
    stages: list[Stage]
    local: float
    workers: float
    around: float  # what Ray's other processes and this one take
    start: float  # processor time, s, until Ray is up and each worker has done a first shard of four masks


def run(count: int = 4000, side: int = 128, shards: int = 8, rounds: int = 3, workers: int = 2) -> Answer:
    """Write silhouettes into shards, and score them stage by stage, as a whole, and on Ray."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        pixels = write(root / "shards", count, side, shards)
        write(root / "few", 4 * workers, side, workers)
        paths = sorted((root / "shards").iterdir())
        list(score_masks(find_masks([root / "few"])))  # compiles, or loads what is compiled
        stages = _stages(paths, root, rounds)
        local = _local(paths, root / "local")
        start, own, around = _on_ray(root, workers)
        bytes_in, bytes_out = (
            sum(path.stat().st_size for path in files) / count for files in (paths, (root / "local").glob("*.parquet"))
        )
        return Answer(
            count, shards, pixels, bytes_in, bytes_out, stages, local, 1e3 * own / count, 1e3 * around / count, start
        )


def write(folder: Path, count: int, side: int, shards: int) -> float:
    """Silhouettes, turned and cut off at random so that no two are the same; mean pixels inside."""
    folder.mkdir()
    generator = np.random.default_rng(0)
    masks = [shape.mask.numpy() for shape in shapes.silhouettes(40)]
    inside = 0
    for number, part in enumerate(np.array_split(np.arange(count), shards)):
        with tarfile.open(folder / f"{number:05}.tar", "w") as archive:
            for index in part:
                mask = _centred(masks[index % len(masks)], side, generator.uniform(0, 360))
                inside += int(mask.sum())
                content = io.BytesIO()
                Image.fromarray(mask).save(content, "PNG")
                member = tarfile.TarInfo(f"{index:07}.png")
                member.size = content.tell()
                content.seek(0)
                archive.addfile(member, content)
    return inside / count


def _centred(mask: np.ndarray, side: int, angle: float) -> np.ndarray:
    """A silhouette that fills an image of this side, turned."""
    image = Image.fromarray(np.where(mask, 255, 0).astype(np.uint8)).rotate(angle, expand=True)
    image = image.crop(image.getbbox())
    image.thumbnail((side, side))
    canvas = Image.new("L", (side, side))
    canvas.paste(image, ((side - image.width) // 2, (side - image.height) // 2))
    return np.asarray(canvas) > 127


def _stages(paths: list[Path], root: Path, rounds: int) -> list[Stage]:
    """Each stage alone, over all masks, in turn; what a stage needs of those before it is prepared."""
    sources = find_masks(paths)
    sample = sources[:: max(1, len(sources) // 1000)]
    masks = [read_source(source) for source in sample]
    rows = list(score_masks(sample))
    runs: dict[str, tuple[int, Callable[[], object]]] = {
        "list": (len(sources), lambda: find_masks(paths)),
        "read": (len(sources), lambda: [_bytes(source) for source in sources]),
        "read and decode": (len(sample), lambda: [read_values(s.path, s.member, 2**26, s.data) for s in sample]),
        "score": (len(masks), lambda: [score_mask(mask) for mask in masks]),
        "write": (len(rows), lambda: write_table(root / "stage.parquet", rows, columns=COLUMNS)),
    }
    times = {name: [_cpu(of) / count for _ in range(rounds)] for name, (count, of) in runs.items()}
    return [Stage(name, 1e3 * float(np.median(each)), 1e3 * min(each)) for name, each in times.items()]


def _bytes(source: Source) -> bytes:
    with source.path.open("rb") as file:
        file.seek(source.data.offset)
        return file.read(source.data.size)


def _local(paths: list[Path], out: Path) -> float:
    """All shards, one after the other, in this process."""
    pieces = find_shards(paths)
    out.mkdir()
    parts: list[Part] = []
    seconds = _cpu(lambda: parts.extend(score_shard(shard, out, ScoreOptions()) for shard in pieces))
    return 1e3 * seconds / sum(part.masks for part in parts)


def _on_ray(root: Path, workers: int) -> tuple[float, float, float]:
    """Processor time of all processes until all is warm; then of the workers, and of all others, for the shards."""
    before = sum(_cpu_of_all())
    with connected("local", workers=workers):
        list(score_shards(find_shards([root / "few"]), root / "first"))
        warm = _cpu_of_all()
        parts = list(score_shards(find_shards([root / "shards"]), root / "second"))
        after = _cpu_of_all()
    if any(part.failed for part in parts):
        raise AssertionError("all silhouettes must be scored")
    return sum(warm) - before, after[0] - warm[0], after[1] - warm[1]


def _cpu(run: Callable[[], object]) -> float:
    began = time.process_time()
    run()
    return time.process_time() - began


def _cpu_of_all() -> tuple[float, float]:
    """Seconds of Ray's workers, and of this process and all others below it, by the counters of Linux."""
    ticks, parents, titles = {}, {}, {}
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it may have ended meanwhile
            values = (entry / "stat").read_text().rpartition(")")[2].split()
            pid, ticks[int(entry.name)] = int(entry.name), int(values[11]) + int(values[12])
            parents[pid], titles[pid] = int(values[1]), (entry / "cmdline").read_bytes()
    tree = {os.getpid()}
    while new := {child for child, parent in parents.items() if parent in tree} - tree:
        tree |= new
    workers = {pid for pid in tree if titles.get(pid, b"").startswith(b"ray::") and b"Agent" not in titles[pid]}
    second = os.sysconf("SC_CLK_TCK")
    return sum(ticks[pid] for pid in workers) / second, sum(ticks.get(pid, 0) for pid in tree - workers) / second
