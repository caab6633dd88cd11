"""How many silhouettes of 128 x 128 pixels does a core score a second, and what do two workers gain?"""

import os
import statistics
import tempfile
import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks import shapes
from benchmarks.timing import alternate
from torchlinf.scoring import Source, find_masks, read_source, score_source
from torchlinf.scoring.workers import in_order


@dataclass(frozen=True)
class Worker:
    """A turn: masks a second on the clock, and processor milliseconds a mask, of the workers and of their parent."""

    rate: float
    each: float
    parent: float


@dataclass(frozen=True)
class Answer:
    """Processor milliseconds a mask in one process, all and for reading, and turns with one and with two workers."""

    each: float
    reading: float
    one: list[Worker]
    two: list[Worker]

    @property
    def gains(self) -> list[float]:
        """How many times as many masks a second two workers score, turn by turn."""
        return [two.rate / one.rate for one, two in zip(self.one, self.two, strict=True)]

    @property
    def gain_of_two_cores(self) -> float:
        """The same by processor time, the median of the turns: what it is where nothing else runs on two cores.

        One worker and its parent have a core each, of which the worker fills its own. Two share both with the parent.
        """
        return statistics.median(
            2 * one.each / (two.each + two.parent) for one, two in zip(self.one, self.two, strict=True)
        )


def run(side: int = 128, count: int = 40, masks: int = 300, rounds: int = 5) -> Answer:
    """Read and score in one process, then in turns with one and with two workers that score the same masks."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), side, count)
        sources = find_masks([folder])
        times = alternate(
            {
                "score": lambda: [score_source(source) for source in sources],
                "read": lambda: [read_source(source) for source in sources],
            },
            rounds=rounds,
        )
        score, read = (1e3 * statistics.median(times[name].cpu) / len(sources) for name in ("score", "read"))
        one, two = start(sources, 1), start(sources, 2)
        turns = [(turn(one, masks), turn(two, masks)) for _ in range(2 * rounds)]
        one.close()
        two.close()
        return Answer(score, read, *map(list, zip(*turns, strict=True)))


@dataclass(frozen=True)
class Clock:
    """Which process scored a mask, in how many seconds, and the processor seconds it has used since it started."""

    process: int
    seconds: float
    used: float


def clocked(source: Source) -> Clock:
    """Score a mask in a worker."""
    row = score_source(source)
    if row.error:
        raise AssertionError(f"all masks must be scored; {row.path}: {row.error}")
    return Clock(os.getpid(), row.seconds or 0.0, time.process_time())


def start(sources: list[Source], workers: int) -> Generator[Clock]:
    """Workers that score the masks again and again, all of which have begun."""
    done = in_order(clocked, cycle(sources), workers=workers, seconds=_seconds, died=_died, isolated=True)
    seen: set[int] = set()
    while len(seen) < workers:
        seen.add(next(done).process)
    yield from done


def turn(done: Iterator[Clock], masks: int) -> Worker:
    """Score masks, after as many that do not count: some of those were scored before the turn."""
    for _ in islice(done, masks):
        pass
    began, parent = time.perf_counter(), time.process_time()
    clocks = list(islice(done, masks))
    seconds, parent = time.perf_counter() - began, time.process_time() - parent
    used, processes = 0.0, {clock.process for clock in clocks}
    for process in processes:
        readings = [clock.used for clock in clocks if clock.process == process]
        used += readings[-1] - readings[0]
    return Worker(masks / seconds, 1e3 * used / max(1, masks - len(processes)), 1e3 * parent / masks)


def _seconds(clock: Clock) -> float:
    return clock.seconds


def _died(source: Source) -> Clock:
    raise AssertionError(f"no worker may end; one did with {source.name}")


def write(folder: Path, side: int, count: int) -> None:
    """Silhouettes of `side` pixels along the longer side, in the middle of a square."""
    for number, shape in enumerate(shapes.silhouettes(count, side)):
        square = np.zeros((side, side), dtype=np.uint8)
        height, width = shape.mask.shape
        top, left = (side - height) // 2, (side - width) // 2
        square[top : top + height, left : left + width] = 255 * shape.mask.numpy()
        Image.fromarray(square).save(folder / f"{number:03}.png")
