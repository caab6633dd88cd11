"""Alternating runs in one process: every contender in turn, so that a busy moment of the machine hits all of them."""

import gc
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

Run = Callable[[], object]

TURN = 0.05  # seconds that a turn should last: shorter runs are repeated, and their mean counts
MOST = 50  # repetitions in a turn at most


@dataclass(frozen=True)
class Times:
    """Seconds a run, one entry a round: on the clock, and of processor time over all threads."""

    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)

    @property
    def median(self) -> float:
        """Seconds on the clock."""
        return statistics.median(self.wall)


@dataclass(frozen=True)
class Ratio:
    """How many times as long one contender took as another: the quotients of the rounds."""

    median: float
    low: float
    high: float
    cpu: float  # median of the quotients of processor time


def alternate(contenders: Mapping[str, Run], *, rounds: int, budget: float = np.inf) -> dict[str, Times]:
    """Time the contenders in turn, round after round.

    Args:
        contenders: what to run, by name.
        rounds: at least 1. Who begins changes from round to round.
        budget: seconds after which no further round is begun; the first is always finished.

    Returns:
        `Times` by name, as many entries each as rounds were run. The first run of all decides how often a contender
        is repeated within a turn. It is thrown away as a warm-up, unless it took over a second: such a run is the first
        round's turn.
    """
    began = time.perf_counter()
    gc.collect()
    gc.freeze()  # what is alive now stays so: looking at it again before each turn would take longer than many turns
    try:
        return _rounds(contenders, rounds, began + budget)
    finally:
        gc.unfreeze()


def ratio(slower: Times, faster: Times) -> Ratio:
    """The quotients, round by round."""
    wall = [a / b for a, b in zip(slower.wall, faster.wall, strict=True)]
    cpu = [a / max(b, 1e-9) for a, b in zip(slower.cpu, faster.cpu, strict=True)]
    return Ratio(statistics.median(wall), min(wall), max(wall), statistics.median(cpu))


def _rounds(contenders: Mapping[str, Run], rounds: int, deadline: float) -> dict[str, Times]:
    first = {name: _first(run) for name, run in contenders.items()}
    repeats = {name: int(np.clip(np.ceil(TURN / max(wall, 1e-9)), 1, MOST)) for name, (wall, _) in first.items()}
    times = {name: Times() for name in contenders}
    names = list(contenders)
    for number in range(rounds):
        if number > 0 and time.perf_counter() > deadline:
            break
        for name in names[number % len(names) :] + names[: number % len(names)]:
            slow = number == 0 and first[name][0] > 1
            wall, cpu = first[name] if slow else _turn(contenders[name], repeats[name])
            times[name].wall.append(wall)
            times[name].cpu.append(cpu)
    return times


def _first(run: Run) -> tuple[float, float]:
    """One run, of those that are short the second: their first may have loaded or cached something."""
    found = _turn(run, 1)
    return found if found[0] > TURN else _turn(run, 1)


def _turn(run: Run, repeats: int) -> tuple[float, float]:
    gc.collect()
    cpu, wall = time.process_time(), time.perf_counter()
    for _ in range(repeats):
        run()
    return (time.perf_counter() - wall) / repeats, (time.process_time() - cpu) / repeats
