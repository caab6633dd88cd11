"""Tables of outlines: kept in a journal while they are measured, and written with the attributes at the end.

The journal has one line for every part of a file, so a run that is stopped goes on at the part where it was.
"""

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

from torchlinf.scoring.atomic_write import replace_file
from torchlinf.scoring.geodata import GeoOptions, GeoPart, joined
from torchlinf.scoring.journal import JOURNAL
from torchlinf.scoring.rows import NoTableError, csv_line

GEO_TABLES = (".csv", ".jsonl", ".parquet", ".gpkg")
WITH_GEOMETRY = (".parquet", ".gpkg")


class GeoJournal:
    """The parts of a table that are measured already, in a file beside it."""

    def __init__(self, out: Path, options: GeoOptions) -> None:
        """Open the journal of a table, or begin one.

        Raises:
            OSError: it cannot be opened.
            NoTableError: it is of a run with other options, or no such journal.
        """
        self._path = out.with_name(out.name + JOURNAL)
        settings = {"measure": options.measure.settings(), "drawing": options.drawing()}
        self.done: dict[str, dict[int, GeoPart]] = {}
        self._size = 0
        if self._path.exists():
            self._read(settings)
        self._file = self._path.open("r+b" if self._path.exists() else "wb", buffering=0)
        self._file.truncate(self._size)  # a line that a kill has cut off
        self._file.seek(self._size)
        if not self._size:
            self._file.write((json.dumps(settings) + "\n").encode())

    def append(self, part: GeoPart) -> None:
        """Keep a part, if it is not kept already."""
        if part.total and part.begin not in self.done.get(part.file, {}):
            self._file.write((json.dumps(asdict(part)) + "\n").encode())

    def close(self, remove: bool) -> None:
        """Close the journal; it is removed when the table is written."""
        self._file.close()
        if remove:
            self._path.unlink()

    def _read(self, settings: dict[str, str]) -> None:
        with self._path.open("rb") as lines:
            for number, line in enumerate(lines):
                if not line.endswith(b"\n"):
                    break
                try:
                    content = json.loads(line)
                    if number:
                        part = GeoPart(**content)
                        self.done.setdefault(part.file, {})[part.begin] = part
                except (ValueError, TypeError) as error:
                    raise NoTableError(f"its journal {self._path} holds a line that is no part ({error})") from error
                if not number and content != settings:
                    raise NoTableError(f"its rows were measured with other options, {content}; got {settings}")
                self._size += len(line)


@contextmanager
def open_journal(out: Path | None, options: GeoOptions, overwrite: bool) -> Iterator[GeoJournal | None]:
    """The journal of a table, or None for standard output. It stays if the context ends by an exception.

    Raises:
        OSError: it cannot be opened.
        NoTableError: it is of a run with other options.
    """
    if out is None:
        yield None
        return
    if overwrite:
        out.with_name(out.name + JOURNAL).unlink(missing_ok=True)
    journal = GeoJournal(out, options)
    whole = False
    try:
        yield journal
        whole = True
    finally:
        journal.close(remove=whole)


def rows_in(out: Path, files: Sequence[Path], options: GeoOptions) -> tuple[int, int] | None:
    """How many rows with an error a finished table has, and how many in all; or None if there is no table.

    Raises:
        NoTableError: the table is not one of these files and options.
    """
    if not out.exists():
        return None
    import pandas as pd

    try:
        table = _read(out)
        names = {str(path).rpartition(":")[0] or str(path) for path in table["path"]} | set(table["path"])
        same = {*table["measure"]} == {options.measure.settings()} and {*table["drawing"]} == {options.drawing()}
    except Exception as error:  # whatever another program has written there
        raise NoTableError(f"it is not a table of outlines ({type(error).__name__}: {error})") from error
    suffix = "" if options.layer is None else f":{options.layer}"
    if not same:
        raise NoTableError("its rows were measured with other options")
    if not all(f"{file}{suffix}" in names or str(file) in names for file in files):
        raise NoTableError("it is of other files; a table of outlines is written in one run")
    return int(pd.notna(table["error"]).sum()), len(table)


def write_geo_table(out: Path | None, parts: Sequence[GeoPart], options: GeoOptions, *, as_json: bool = False) -> None:
    """Write a whole table in one piece, or print it.

    Args:
        out: the file: GeoPackage (.gpkg) and GeoParquet (.parquet) keep the geometry, CSV and JSON lines (.jsonl) do
            not; None for standard output.
        parts: of all files.
        options: how they were read and measured.
        as_json: print JSON lines instead of CSV.

    Raises:
        OSError: the file cannot be written.
    """
    import sys

    suffix = "" if out is None else out.suffix.lower()
    table = joined(parts, options, suffix in WITH_GEOMETRY)
    if out is None:
        _write_text(sys.stdout, table, as_json)
        return

    def write(temporary: Path) -> None:
        if suffix == ".gpkg":
            # GDAL goes by the name of the file, and makes it and a journal of its own.
            named = temporary.with_name(temporary.name + ".gpkg")
            try:
                table.to_file(named, layer=out.stem, driver="GPKG", engine="pyogrio")
                os.replace(named, temporary)
            finally:
                named.unlink(missing_ok=True)
        elif suffix == ".parquet":
            table.to_parquet(temporary, index=False)
        else:
            with temporary.open("w", encoding="utf-8", newline="") as file:
                _write_text(file, table, suffix == ".jsonl")

    replace_file(out, write)


def _write_text(file: TextIO, table: Any, as_json: bool) -> None:
    """CSV, or JSON lines; None where there is nothing, and every digit of a number."""
    names = list(table.columns)
    plain = table.astype(object).where(table.notna(), None)
    if not as_json:
        file.write(csv_line(names))
    for cells in plain.itertuples(index=False, name=None):
        file.write(json.dumps(dict(zip(names, cells, strict=True)), default=str) + "\n" if as_json else csv_line(cells))


def _read(out: Path) -> Any:
    import geopandas
    import pandas as pd

    suffix = out.suffix.lower()
    if suffix == ".gpkg":
        return geopandas.read_file(out, engine="pyogrio", ignore_geometry=True)
    if suffix == ".parquet":
        return pd.read_parquet(out)
    return pd.read_json(out, lines=True) if suffix == ".jsonl" else pd.read_csv(out)
