"""Many small tasks on several cores, answers in order: threads for a few, processes for many.

When worker processes start: `in_order` starts them if there are several workers and more than `FEW` tasks, or if tasks
are to be isolated. Half of the work on a small mask holds Python's lock, so that threads gain little there; but a
process takes seconds to start. A task that kills its process costs its own answer only.
"""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import chain, islice
from multiprocessing import connection
from typing import TypeVar

from torchlinf._helpers.parallel import cancelled_by

Task = TypeVar("Task")
Answer = TypeVar("Answer")

FEW = 100  # tasks that are done before processes have started
PART = 0.1  # seconds of work that a worker should be handed at a time: handing over costs its parent 0.2 ms and more
LONGEST = 64  # tasks in a part at most


class NoWorkersError(RuntimeError):
    """Worker processes do not start; the message says why, and what to do."""


def in_order(
    work: Callable[[Task], Answer],
    tasks: Iterable[Task],
    *,
    workers: int,
    seconds: Callable[[Answer], float],
    died: Callable[[Task], Answer],
    isolated: bool = False,
) -> Generator[Answer]:
    """Answer tasks, in their order, each as soon as it and those before it are done.

    Args:
        work: gives the answer, and raises nothing but what should end all. It is sent to processes, so it must pickle.
        tasks: any number; they are taken when there is room for them.
        workers: how many tasks are worked on at a time.
        seconds: how long an answer took.
        died: the answer where a task ended the process that worked on it.
        isolated: use processes however few the tasks and the workers are.

    Returns:
        An iterator. When it is closed, or ended by an exception such as that of Ctrl-C, its workers end soon: processes
        at once, threads at the next check of the solve that they are in.

    Raises:
        NoWorkersError: a RuntimeError: processes do not start.
    """
    tasks = iter(tasks)
    head = list(islice(tasks, FEW + 1))
    tasks = chain(head, tasks)
    if isolated or (workers > 1 and len(head) > FEW):
        return _by_processes(work, tasks, workers, seconds, died)
    return _by_threads(work, tasks, workers)


def _by_threads(work: Callable[[Task], Answer], tasks: Iterable[Task], workers: int) -> Generator[Answer]:
    stop = threading.Event()
    waiting: deque[Future[Answer]] = deque()

    def answer(task: Task) -> Answer:
        with cancelled_by(stop):
            return work(task)

    with ThreadPoolExecutor(max_workers=workers) as pool:
        try:
            for task in tasks:
                waiting.append(pool.submit(answer, task))
                # Enough in flight to keep the workers busy past one slow task, few enough for any number of them.
                if len(waiting) > 8 * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)


def _by_processes(
    work: Callable[[Task], Answer],
    tasks: Iterator[Task],
    workers: int,
    seconds: Callable[[Answer], float],
    died: Callable[[Task], Answer],
) -> Generator[Answer]:
    waiting: deque[tuple[list[Task], Future[list[Answer]]]] = deque()
    size = 1
    while True:
        with _processes(workers) as pool:
            while True:
                while len(waiting) < 4 * workers and (part := list(islice(tasks, size))):
                    waiting.append((part, _submit(pool, work, part)))
                if not waiting:
                    return
                part, future = waiting.popleft()
                try:
                    answers = future.result()
                except BrokenProcessPool:
                    break
                mean = sum(map(seconds, answers)) / len(answers)
                size = max(1, min(LONGEST, 2 * size, round(PART / max(mean, 1e-9))))
                yield from answers
        # One of the tasks in flight ended its process, and with it the pool.
        lost = [*part, *chain.from_iterable(part for part, _ in waiting)]
        waiting.clear()
        yield from _one_by_one(work, lost, died)
        if not (head := list(islice(tasks, 1))):
            return
        tasks = chain(head, tasks)


def _one_by_one(
    work: Callable[[Task], Answer], tasks: Iterable[Task], died: Callable[[Task], Answer]
) -> Generator[Answer]:
    """Answer tasks in a process of their own, alone, so that the one that ends it is known."""
    remaining = deque(tasks)
    while remaining:
        with _processes(1) as pool:
            while remaining:
                task = remaining.popleft()
                try:
                    (answer,) = _submit(pool, work, [task]).result()
                except BrokenProcessPool:
                    yield died(task)
                    break
                yield answer


@contextmanager
def _processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Worker processes that have started; at the end of the context they are ended, whatever they work on."""
    # Not forked: threads of this process, such as torch's, would leave locks behind that nobody releases.
    context = multiprocessing.get_context("spawn")
    listener, stopper = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin, initargs=(listener,))
    try:
        try:
            _submit(pool, len, []).result()
        except BrokenProcessPool as error:
            raise NoWorkersError(
                "worker processes must be able to import the main script; they end at once. Call this under "
                'if __name__ == "__main__":, or pass workers=1.'
            ) from error
        yield pool
    finally:
        stopper.send(None)
        pool.shutdown(cancel_futures=True)
        stopper.close()
        listener.close()


def _submit(pool: Executor, work: Callable[[Task], Answer], part: list[Task]) -> Future[list[Answer]]:
    try:
        with _deaf_to_interrupts():  # the pool starts a worker when there is work for it
            return pool.submit(_answer, work, part)
    except OSError as error:
        raise NoWorkersError(
            f"no further worker process can be started ({error.strerror}). Pass fewer workers"
        ) from error
    except BrokenProcessPool as error:
        future: Future[list[Answer]] = Future()
        future.set_exception(error)
        return future


def _answer(work: Callable[[Task], Answer], part: list[Task]) -> list[Answer]:
    return [work(task) for task in part]


def _begin(listener: "connection.Connection[None, None]") -> None:
    """What a worker process does first."""
    import torch

    torch.set_num_threads(1)
    threading.Thread(target=_end_with_parent, args=[listener], daemon=True).start()


def _end_with_parent(listener: "connection.Connection[None, None]") -> None:
    """End this worker process when its parent says so, or is no more: it would wait for tasks for ever.

    The message stays in the pipe, so that every worker sees it.
    """
    connection.wait([listener])
    os._exit(1)


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Processes started within ignore Ctrl-C, which goes to all of them: the parent ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
