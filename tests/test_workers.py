"""Workers: order, killed workers, and that none outlives a killed run."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial

import pytest

from torchlinf._helpers.parallel import Cancelled, for_each
from torchlinf.scoring import workers
from torchlinf.scoring.workers import FEW, NoWorkersError, in_order


def double(task: int) -> float:
    return 2.0 * task


def kill_on_13(task: int) -> float:
    if task == 13:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2.0 * task


def where(task: int) -> float:
    return float(os.getpid())


def answers(work: Callable[[int], float], count: int, **options: object) -> list[float]:
    options = {"workers": 2, "seconds": lambda answer: 1e-4, "died": lambda task: -1.0 - task, **options}
    return list(in_order(work, iter(range(count)), **options))


@pytest.mark.parametrize("count", [0, 1, FEW, 3 * FEW])
@pytest.mark.parametrize("workers", [1, 2])
def test_answers_come_in_order(count: int, workers: int) -> None:
    assert answers(double, count, workers=workers) == [2.0 * i for i in range(count)]


def test_processes_are_for_many_tasks_or_for_isolation() -> None:
    here = float(os.getpid())
    assert set(answers(where, FEW)) == {here}
    assert set(answers(where, 3 * FEW, workers=1)) == {here}
    assert here not in answers(where, 3 * FEW)
    assert here not in answers(where, 3, workers=1, isolated=True)


@pytest.mark.skipif(os.name != "posix", reason="kills as POSIX does")
@pytest.mark.slow
def test_a_task_that_ends_its_process_costs_its_own_answer_only() -> None:
    expected = [2.0 * i for i in range(3 * FEW)]
    expected[13] = -14.0
    assert answers(kill_on_13, 3 * FEW) == expected
    assert answers(kill_on_13, 15, workers=1, isolated=True) == expected[:15]


def slow(seconds: float, task: int) -> float:
    time.sleep(seconds)
    return float(os.getpid())


@pytest.mark.skipif(os.name != "posix", reason="kills as POSIX does")
def test_a_worker_that_is_killed_by_chance_costs_nothing() -> None:
    found = in_order(
        partial(slow, 0.01), iter(range(3 * FEW)), workers=2, seconds=lambda answer: 0.01, died=lambda task: -1.0
    )
    first = next(found)
    os.kill(int(first), signal.SIGKILL)
    rest = list(found)
    assert len(rest) == 3 * FEW - 1
    # The task that it worked on at that moment is tried again.
    assert -1.0 not in rest


def test_threads_end_with_the_iterator() -> None:
    """What they solve is given up at its next check: a thread cannot be interrupted from outside."""
    begun = threading.Event()
    given_up = []

    def endless(task: int) -> int:
        def turn(_: int, check: Callable[[], None]) -> None:
            try:
                while task > 1:
                    begun.set()
                    check()
                    time.sleep(0.001)
            except Cancelled:
                given_up.append(task)
                raise

        for_each(turn, 1)
        return task

    with closing(in_order(endless, iter(range(20)), workers=2, seconds=float, died=abs)) as found:
        assert [next(found), next(found)] == [0, 1]
        assert begun.wait(60)
    assert given_up  # the other of the two may not have begun
    assert set(given_up) <= {2, 3}


@pytest.mark.skipif(os.name != "posix", reason="sends a signal as POSIX does")
def test_processes_end_with_the_iterator() -> None:
    found = in_order(partial(slow, 100), iter(range(5)), workers=2, seconds=float, died=abs, isolated=True)
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt), interrupted_after(3):
        next(found)
    assert time.monotonic() - start < 60
    assert not multiprocessing.active_children()


@contextmanager
def interrupted_after(seconds: float) -> Iterator[None]:
    """Ctrl-C after a while."""
    timer = threading.Timer(seconds, os.kill, [os.getpid(), signal.SIGINT])
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)


def test_a_main_script_without_a_guard_is_told_so(tmp_path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "from torchlinf.scoring.workers import in_order\n"
        "list(in_order(abs, range(300), workers=2, seconds=float, died=abs))\n"
    )
    result = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=100, check=False)
    assert result.returncode == 1
    assert "NoWorkersError: worker processes must be able to import the main script" in result.stderr


def test_a_system_without_room_for_processes_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: object) -> None:
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.context.SpawnProcess.start", refuse)
    with pytest.raises(NoWorkersError, match=r"can be started \(Resource temporarily unavailable\). Pass fewer"):
        answers(double, 3 * FEW)


def test_parts_grow_to_the_time_that_handing_over_is_worth(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = []
    submit = workers._submit
    monkeypatch.setattr(
        workers, "_submit", lambda pool, work, part: sizes.append(len(part)) or submit(pool, work, part)
    )
    answers(double, 5 * FEW)
    assert sizes[:2] == [0, 1]  # the first starts the pool
    assert max(sizes) == workers.LONGEST
    sizes.clear()
    answers(double, 3 * FEW, seconds=lambda answer: 1.0)
    assert max(sizes) == 1
