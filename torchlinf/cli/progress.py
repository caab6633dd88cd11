"""The bar that shows how far a command is, and how many cores it works with."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager


def cores() -> int:
    """How many cores this process may use."""
    # In a container or a batch job the machine may have more cores than this process may use.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def progress(done: int, total: int, shown: bool, doing: str = "scoring") -> Iterator[Callable[[], None]]:
    """A bar on the terminal, with the time so far and what a long solve says; yields what advances it by a step.

    Masks that worker processes score say nothing: there are many of them, and the bar moves.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    from torchlinf._helpers.parallel import told_to  # which imports torch

    columns = (
        TextColumn(doing),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[solve]}"),
    )
    console = Console(stderr=True)
    if not (shown and console.is_terminal):  # a disabled Progress of rich before 14.3 prints an empty line
        yield lambda: None
        return
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(doing, total=total, completed=done, solve="")
        with told_to(lambda text: progress.update(task, solve=text)):
            yield lambda: progress.update(task, advance=1, solve="")
