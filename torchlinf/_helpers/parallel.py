"""Threads over shapes: kernels release the GIL, and a pool lives only as long as one call, so forks are safe.

Torch's own threads, those of OpenMP, are not: a child that is forked after they have started waits for them without end
at the first operation on more than some 30,000 numbers. So on the CPU what leads from a mask to its complexity is done
by the kernels and by NumPy.
"""

import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import contextmanager

import torch


class Cancelled(Exception):
    """Raised inside a worker that should stop, since another one failed or the user interrupted."""


_scope = threading.local()
_listener: Callable[[str], None] | None = None


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Torch, and with it the library, on that many threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def told_to(listener: Callable[[str], None]) -> Iterator[None]:
    """Within this context, what a long solve says about how far it is, on any thread, is told to `listener`."""
    global _listener
    before, _listener = _listener, listener
    try:
        yield
    finally:
        _listener = before


def tell(text: str) -> None:
    """Say how far a long solve is, to whoever listens."""
    if _listener is not None:
        _listener(text)


@contextmanager
def cancelled_by(stop: threading.Event) -> Iterator[None]:
    """Within this context, `for_each` on this thread raises `Cancelled` soon after `stop` is set.

    A thread cannot be interrupted from outside. With this, a program that is stopped need not wait for its threads.
    """
    before = getattr(_scope, "stop", None)
    _scope.stop = stop
    try:
        yield
    finally:
        _scope.stop = before


def for_each(task: Callable[[int, Callable[[], None]], None], count: int) -> None:
    """Call `task(i, check)` for i in range(count), on at most `torch.get_num_threads()` threads.

    `check()` raises `Cancelled` once the call is to end early, so that Ctrl-C does not wait for long tasks. The first
    exception of a task is raised here.
    """
    threads = min(torch.get_num_threads(), count)
    outer: threading.Event | None = getattr(_scope, "stop", None)
    stop = threading.Event()

    def check() -> None:
        if stop.is_set() or (outer is not None and outer.is_set()):
            raise Cancelled

    # torch.compile would trace the tasks and cannot see through NumPy. It follows no other thread.
    if threads <= 1 and "torch._dynamo" not in sys.modules:
        for i in range(count):
            task(i, check)
        return

    with ThreadPoolExecutor(max(1, threads)) as pool:
        futures = [pool.submit(task, i, check) for i in range(count)]
        try:
            wait(futures, return_when=FIRST_EXCEPTION)
            failed = any(future.done() and future.exception() is not None for future in futures)
        except BaseException:
            failed = True
            raise
        finally:
            if failed:
                stop.set()
                pool.shutdown(cancel_futures=True)
    for future in futures:
        if not future.cancelled() and not isinstance(future.exception(), Cancelled):
            future.result()
    check()
