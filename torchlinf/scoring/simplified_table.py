"""The table of simplified masks: rows go into a journal at once, and the table is made of it at the end."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from torchlinf.scoring.journal import JOURNAL, Journal
from torchlinf.scoring.rows import NoTableError
from torchlinf.scoring.simplify import SIMPLIFIED, Simplified, Simplifying
from torchlinf.scoring.table_files import read_cells, write_lines


@contextmanager
def open_simplified(
    path: Path, options: Simplifying, *, overwrite: bool = False
) -> Iterator[tuple[Mapping[str, Simplified], Callable[..., None]]]:
    """Open the table of a run of `torchlinf simplify`.

    Args:
        path: .csv or .tsv, each also with .gz behind.
        options: those of the run; the rows of the table must have the same.
        overwrite: begin anew.

    Yields:
        The rows that the table has, by path, and what takes the rows of a source, all or none.

    Raises:
        OSError: it cannot be opened or written, or another run writes it.
        NoTableError: the file is not such a table, or was made with other options. It is left as it was.
    """
    with Journal(path.with_name(path.name + JOURNAL), Simplified.of) as journal:
        if overwrite:
            path.unlink(missing_ok=True)
            journal.clear()
        rows = {row.path: row for row in _rows(path)} if path.exists() else {}
        _take(rows, journal)
        if other := next((row for row in rows.values() if row.options != options.settings()), None):
            raise NoTableError(f"its masks were simplified with other options: {_difference(other.options, options)}")
        if not path.exists():
            write_lines(path, [SIMPLIFIED])  # so that what is in the folder is known to be of this run, however it ends
        yield dict(rows), journal.append
        _take(rows, journal)
        write_lines(path, [SIMPLIFIED, *(tuple(row.cells().values()) for row in rows.values())])
        journal.clear()


def _difference(held: str | None, options: Simplifying) -> str:
    """Which options of a table are others, with both values."""
    try:
        old, new = (_flat(json.loads(text or "")) for text in (held, options.settings()))
    except (ValueError, AttributeError):
        return str(held)
    names = [name for name in {**old, **new} if old.get(name) != new.get(name)]
    return ", ".join(f"{name} {json.dumps(old.get(name))}, not {json.dumps(new.get(name))}" for name in names)


def _flat(settings: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        flat |= value if isinstance(value, dict) else {name: value}
    return flat


def _take(rows: dict[str, Simplified], journal: Journal) -> None:
    """Put the rows of a journal in place of earlier ones."""
    for group in journal.groups():
        for name in group.instead_of:
            rows.pop(name, None)
        rows |= {row.path: cast(Simplified, row) for row in group.rows}


def _rows(path: Path) -> Iterator[Simplified]:
    for where, cells in read_cells(path, _require):
        try:
            yield Simplified.of(cells)
        except ValueError as error:
            raise NoTableError(f"it holds a line that is not a row ({where}: {error})") from error


def _require(names: tuple[str, ...]) -> None:
    if names != SIMPLIFIED:
        raise NoTableError("its columns are not those of a table of simplified masks")
