"""The masks that a command is given."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer

from torchlinf.scoring import SUFFIXES, Source, find_masks


@contextmanager
def reading_options() -> Iterator[None]:
    """Options that contradict each other, as wrong usage."""
    try:
        yield
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


def find_sources(paths: list[Path], members: str | None = None) -> list[Source]:
    """Find the masks that paths stand for.

    Raises:
        typer.BadParameter: there are none.
        ImportError: an extra that they need is missing.
    """
    from rich.console import Console

    with Console(stderr=True).status("looking for masks"):
        sources = find_masks(paths, members=members)
    if not sources:
        known = f"looked for {' '.join((*SUFFIXES, '.tar'))}"
        if members is not None:
            known += f", in archives for members that match {members} as a whole"
        raise typer.BadParameter(f"no masks found in {', '.join(map(str, paths))}; {known}")
    return sources
