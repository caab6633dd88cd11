"""The masks that a command is given."""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import typer

from torchlinf.cli.outputs import say
from torchlinf.scoring import SUFFIXES, TAR_SUFFIXES, Source, find_masks

KINDS_SHOWN = 8


@contextmanager
def reading_options() -> Iterator[None]:
    """Options that contradict each other, as wrong usage."""
    try:
        yield
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


def spacing_of(text: str | None) -> str | tuple[float, ...] | None:
    """What --spacing says: numbers, or a word.

    >>> spacing_of("3,0.9,0.9"), spacing_of("header")
    ((3.0, 0.9, 0.9), 'header')
    """
    try:
        return None if text is None else tuple(float(size) for size in text.split(","))
    except ValueError:
        return text


def find_sources(paths: list[Path], members: str | None = None) -> list[Source]:
    """Find the masks that paths stand for, and say on standard error what folders hold beside them.

    Raises:
        typer.BadParameter: there are none.
        ImportError: an extra that they need is missing.
    """
    from rich.console import Console

    passed_over: Counter[str] = Counter()
    with Console(stderr=True).status("looking for masks"):
        sources = find_masks(paths, members=members, passed_over=passed_over)
    tell_passed_over(passed_over)
    if not sources:
        known = f"looked for {' '.join((*SUFFIXES, *TAR_SUFFIXES))}"
        if members is not None:
            known += f", in archives for members that match {members} as a whole"
        raise typer.BadParameter(f"no masks found in {', '.join(map(str, paths))}; {known}")
    return sources


def tell_passed_over(passed_over: Counter[str]) -> None:
    """Say in one line what folders hold that is not read: the most frequent suffixes first."""
    if not (total := passed_over.total()):
        return
    counts = sorted(passed_over.items(), key=lambda one: (-one[1], one[0]))
    kinds = [f"{number:,} {kind}" for kind, number in counts if number]
    shown = kinds if len(kinds) <= KINDS_SHOWN else [*kinds[: KINDS_SHOWN - 1], "others"]
    say(f"Passed over in folders: {total:,} ({', '.join(shown)}).")


def by_source(paths: Iterable[str], names: Collection[str]) -> dict[str, list[str]]:
    """Paths of rows by their source; a page, a label and an object may be behind its name, as stack.npy[3]#15@2."""
    sources: dict[str, list[str]] = {}
    for path in paths:
        shorter = [path]
        for behind in (r"@\d+$", r"#\d+$", r"\[\d+\]$"):
            shorter.append(re.sub(behind, "", shorter[-1]))
        name = next((name for name in shorter if name in names), shorter[-1])
        sources.setdefault(name, []).append(path)
    return sources
