"""From stored results to what the documentation includes: tables and plots."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.results import Result, load, markdown, target_table

TABLES = "performance_tables.inc"
IMAGES = "images"


def stored(folder: Path, order: Sequence[str]) -> list[Result]:
    """The results in a folder, in the order of the questions."""
    return [load(folder / f"{name}.json") for name in order if (folder / f"{name}.json").exists()]


def write(results: list[Result], folder: Path) -> list[Path]:
    """Write the tables and plots into a folder; the paths written."""
    from benchmarks import plots

    folder.mkdir(parents=True, exist_ok=True)
    tables = folder / TABLES
    tables.write_text(text(results), encoding="utf-8")
    return [tables, *plots.draw(results, folder / IMAGES)]


def text(results: list[Result]) -> str:
    """Where it was measured, the table of targets, and every other table, as Markdown from level 2 on."""
    parts = ["## Targets", target_table(results), _setting(results)]
    for result in results:
        parts += [f"## {result.title}", *(markdown(table) for table in result.tables)]
    return "\n".join(parts)


def _setting(results: list[Result]) -> str:
    """One sentence if all results were measured alike, else one for each kind."""
    sentences = dict.fromkeys(_sentence(result.environment) for result in results)
    loads = [result.environment.get("load") for result in results]
    known = [load for load in loads if load is not None]
    busy = f" Load average while measuring: {min(known)} to {max(known)}." if known else ""
    return "\n".join([*sentences, busy.strip(), ""])


def _sentence(environment: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in environment["versions"].items() if version)
    return (
        f"Measured ({environment['size']} run) on {environment['cores']} cores of {environment['processor']}, "
        f"Python {environment['python']}, {versions}."
    )
