"""Files of tables: which format a name asks for, and the cells of what is there, whoever has saved it."""

import csv
import gzip
import io
import json
import os
import re
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO, cast

from torchlinf._helpers.terminal import encodable, printable
from torchlinf.scoring import parquet
from torchlinf.scoring.atomic_write import replace_file
from torchlinf.scoring.cells import unguarded
from torchlinf.scoring.journal import JOURNAL, rows_of_line
from torchlinf.scoring.rows import NoTableError, csv_line

CSV, TSV, JSON_LINES, PARQUET = "csv", "tsv", "jsonl", "parquet"
KIND_OF_SUFFIX = {
    "": CSV, ".csv": CSV, ".txt": CSV, ".tsv": TSV, ".tab": TSV, ".jsonl": JSON_LINES, ".ndjson": JSON_LINES,
    ".parquet": PARQUET,
}  # fmt: skip
IN_FOLDERS = (".csv", ".tsv", ".jsonl", ".ndjson", ".parquet", ".csv.gz", ".tsv.gz", ".jsonl.gz", ".ndjson.gz")
DELIMITERS = ",;\t"
STANDARD_OUTPUT = "-"  # as a name of a file

GZIP = b"\x1f\x8b"
OTHER_PROGRAMS = {  # what files of spreadsheets begin with
    b"PK\x03\x04": "it is a workbook (.xlsx, .ods) or another zip archive; save it as CSV UTF-8 and pass that",
    b"\xd0\xcf\x11\xe0": "it is a workbook of Excel; save it as CSV UTF-8 and pass that",
}
# What pandas calls an index that it has written without a name.
INDEX = re.compile(r"|Unnamed: \d+(\.\d+)?|__index_level_\d+__")

Cells = Mapping[str, Any]
Check = Callable[[tuple[str, ...]], None]


@dataclass(frozen=True)
class TableFormat:
    """What a file of a table holds.

    Attributes:
        kind: "csv", "tsv", "jsonl" or "parquet".
        compressed: whether the text is compressed by gzip.
    """

    kind: str
    compressed: bool = False

    @property
    def delimiter(self) -> str:
        """What stands between two cells."""
        return "\t" if self.kind == TSV else ","


def table_format(path: Path, *, as_json: bool = False) -> TableFormat:
    """The format that the name of a file asks for: CSV if it has no suffix.

    Args:
        path: the file.
        as_json: JSON lines whatever the suffix, but for Parquet.

    Raises:
        ValueError: no table is written in the format of this suffix.

    >>> table_format(Path("scores.tsv.gz")), table_format(Path("scores"))
    (TableFormat(kind='tsv', compressed=True), TableFormat(kind='csv', compressed=False))
    """
    compressed = path.suffix.lower() == ".gz"
    suffix = Path(path.stem).suffix.lower() if compressed else path.suffix.lower()
    kind = KIND_OF_SUFFIX.get(suffix)
    if as_json and kind != PARQUET:
        return TableFormat(JSON_LINES, compressed)
    if kind is None or (compressed and kind == PARQUET):
        raise ValueError(
            f"a table must be .csv, .tsv or .jsonl, which may have .gz behind, or .parquet; got {path.name!r}. "
            "Pass for example scores.csv, which spreadsheets can open."
        )
    return TableFormat(kind, compressed)


@contextmanager
def writing(path: Path, compressed: bool) -> Iterator[TextIO]:
    """A file for lines of text in UTF-8."""
    with path.open("wb") as raw:
        # Without a name and a time inside, equal tables are equal files.
        binary = gzip.GzipFile("", "wb", fileobj=raw, mtime=0) if compressed else raw
        with io.TextIOWrapper(cast(io.BufferedWriter, binary), encoding="utf-8", newline="") as text:
            yield text


def write_lines(path: Path, rows: Iterable[Iterable[Any]]) -> None:
    """Write any cells as CSV, as a table of scores is written; to "-", a pipe or a device as they come.

    Raises:
        OSError: the file cannot be written.
    """
    if os.fspath(path) == STANDARD_OUTPUT:
        _send_lines(sys.stdout, rows)
        return
    if path.exists() and not path.is_file():
        with path.open("w", encoding="utf-8", newline="") as stream:
            _send_lines(stream, rows)
        return
    form = table_format(path)

    def write(temporary: Path) -> None:
        with writing(temporary, form.compressed) as file:
            file.writelines(csv_line(cells, delimiter=form.delimiter) for cells in rows)

    replace_file(path, write)


def _send_lines(file: TextIO, rows: Iterable[Iterable[Any]]) -> None:
    for cells in rows:
        send_text(file, csv_line(shown_cells(cells) if file.isatty() else cells))


def shown_cells(cells: Iterable[Any]) -> list[Any]:
    """Cells for a terminal, which no text steers."""
    return [printable(cell) if isinstance(cell, str) else cell for cell in cells]


def send_text(file: TextIO, text: str) -> None:
    """Send text on at once; what the encoding of the stream does not have goes as an escape."""
    file.write(encodable(text, file.encoding))
    file.flush()  # a reader may wait for it


def is_table(path: Path) -> bool:
    """Whether a file in a folder of tables is one of them, by its name."""
    return path.name.lower().endswith(IN_FOLDERS) and not path.name.startswith(".")


def read_cells(path: Path, check: Check) -> Iterator[tuple[str, Cells]]:
    """The cells of each row of a file, by the names of the columns, with where they are: "line 3".

    The file may have been saved by another program: with a byte order mark, other line ends, semicolons or tabs
    between the cells, an index, JSON objects in one list instead of lines.

    Args:
        path: the file.
        check: called with the names of the columns, of JSON whenever a row has others; may raise a NoTableError.

    Raises:
        OSError: it cannot be read.
        NoTableError: it is not a table.
    """
    if path.suffix.lower() == ".parquet":
        yield from parquet.read_cells(path, lambda names: check(without_index(names)))
        return
    with _reading(path) as file:
        start = next((letter for letter in iter(lambda: file.read(1), "") if not letter.isspace()), "")
        file.seek(0)
        suffix = path.suffix.lower()
        if suffix == JOURNAL:
            rows = _rows_of_journal(file)
        elif start == "[":
            rows = _rows_of_list(file)
        elif start == "{" or suffix in (".jsonl", ".ndjson"):
            rows = _rows_of_lines(file)
        else:
            yield from _rows_of_csv(file, check)
            return
        known: tuple[str, ...] = ()
        for where, cells in rows:
            if not isinstance(cells, dict):
                raise NoTableError(f"it holds a line that is not a row ({where}: not an object)")
            if tuple(cells) != known:
                known = tuple(cells)
                check(without_index(known))
            yield where, cells


def without_index(names: Iterable[str]) -> tuple[str, ...]:
    """The names of the columns without an index."""
    return tuple(name for name in names if not INDEX.fullmatch(name))


@contextmanager
def _reading(path: Path) -> Iterator[TextIO]:
    """A file of text, compressed or not, whose encoding is UTF-8, or what its byte order mark says."""
    with path.open("rb") as raw:
        start = raw.read(4)
        raw.seek(0)
        try:
            binary = cast(io.BufferedReader, gzip.GzipFile(fileobj=raw) if start.startswith(GZIP) else raw)
            if start.startswith(GZIP):
                start = binary.read(4)
                binary.seek(0)
            if start in OTHER_PROGRAMS:
                raise NoTableError(OTHER_PROGRAMS[start])
            is_utf16 = start[:2] in (b"\xff\xfe", b"\xfe\xff")
            with io.TextIOWrapper(binary, encoding="utf-16" if is_utf16 else "utf-8-sig", newline="") as text:
                yield text
        except UnicodeDecodeError as error:
            raise NoTableError(
                f"it is not text in UTF-8 (byte 0x{error.object[error.start]:02x}); save it as CSV UTF-8"
            ) from error
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise NoTableError(f"it is a damaged .gz file ({error})") from error


def _rows_of_csv(file: TextIO, check: Check) -> Iterator[tuple[str, Cells]]:
    header = file.readline()
    file.seek(0)
    # A cell of the header is the path; so what stands between the cells is known.
    heads = {mark: next(csv.reader([header], delimiter=mark), []) for mark in DELIMITERS}
    delimiter = next((mark for mark, cells in heads.items() if "path" in cells), ",")
    lines = csv.reader(file, delimiter=delimiter, strict=True)
    try:
        names = tuple(map(unguarded, next(lines, [])))
        known = without_index(names)
        if twice := [name for name in known if known.count(name) > 1]:
            raise NoTableError(f"its columns must have names of their own; {twice[0]!r} is there twice")
        check(known)
        for cells in lines:
            where = f"line {lines.line_num}"
            if not any(cells):  # an empty line, or one of empty cells as spreadsheets leave behind
                continue
            if len(cells) != len(names):
                raise NoTableError(
                    f"it holds a line that is not a row ({where}: {len(cells)} cells in {len(names)} columns)"
                )
            yield where, {name: unguarded(cell) for name, cell in zip(names, cells, strict=True)}
    except csv.Error as error:
        raise NoTableError(f"it holds a line that is not a row (line {lines.line_num}: {error})") from error


def _rows_of_lines(file: TextIO) -> Iterator[tuple[str, Any]]:
    for number, line in enumerate(file, 1):
        if line.strip():
            yield f"line {number}", _parse(line, f"line {number}")


def _rows_of_list(file: TextIO) -> Iterator[tuple[str, Any]]:
    for number, cells in enumerate(_parse(file.read(), "as a whole"), 1):
        yield f"entry {number}", cells


def _rows_of_journal(file: TextIO) -> Iterator[tuple[str, Any]]:
    """Of a journal, which may be written just now, the complete lines."""
    for number, line in enumerate(file, 1):
        if line.endswith("\n"):
            for cells in rows_of_line(_parse(line, f"line {number}")):
                yield f"line {number}", cells


def _parse(text: str, where: str) -> Any:
    try:
        return json.loads(text)
    except ValueError as error:
        raise NoTableError(f"it holds a line that is not a row ({where}: {error})") from error
