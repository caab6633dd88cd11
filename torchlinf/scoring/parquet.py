"""Tables as Parquet files. Needs the extra `parquet` (pyarrow)."""

from collections.abc import Container, Iterable, Iterator
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from torchlinf.scoring.atomic_write import replace_file
from torchlinf.scoring.rows import COLUMNS, KINDS, NoTableError, Score

if TYPE_CHECKING:
    import pyarrow

ROWS = 10_000  # in memory at a time


def require_pyarrow() -> None:
    """Raise an ImportError that says what to install, if it must be."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "Tables in Parquet need pyarrow, which is not installed. Run: pip install 'torchlinf[parquet]'"
        ) from error


def schema() -> "pyarrow.Schema":
    """The columns of `Score` with their types, all of which but the path may be empty."""
    import pyarrow

    types = {int: pyarrow.int64(), float: pyarrow.float64(), str: pyarrow.string()}
    return pyarrow.schema([pyarrow.field(name, types[KINDS[name]], nullable=name != "path") for name in COLUMNS])


def table(rows: Iterable[Score]) -> "pyarrow.Table":
    """Rows as an Arrow table."""
    import pyarrow

    return pyarrow.Table.from_pylist([asdict(row) for row in rows], schema=schema())


def rows(path: Path) -> Iterator[Score]:
    """The rows of a Parquet file.

    Raises:
        OSError: it cannot be read.
        NoTableError: it is no table of `torchlinf score`.
    """
    for batch in _batches(path, list(COLUMNS)):
        yield from (Score(**row) for row in batch.to_pylist())


def done(path: Path) -> dict[str, str | None]:
    """Of every row of a Parquet file, the path and the error.

    Raises:
        OSError: it cannot be read.
        NoTableError: it is no table of `torchlinf score`.
    """
    batches = _batches(path, ["path", "error"])
    return {row["path"]: row["error"] for batch in batches for row in batch.to_pylist()}


def extend(path: Path, new: Iterable[Score], *, without: Container[str] = frozenset()) -> None:
    """Put rows behind those that a Parquet file holds, if there is one: the file is replaced in one piece.

    Args:
        path: the file.
        new: the rows.
        without: paths of rows that are dropped from the file.
    """
    import pyarrow
    import pyarrow.parquet

    def write(temporary: Path) -> None:
        with pyarrow.parquet.ParquetWriter(temporary, schema()) as writer:
            for batch in _batches(path, list(COLUMNS)) if path.exists() else ():
                kept = batch.filter(pyarrow.array([name not in without for name in batch["path"].to_pylist()]))
                writer.write_table(pyarrow.Table.from_batches([kept]).cast(schema()))
            remaining = iter(new)
            while part := list(islice(remaining, ROWS)):
                writer.write_table(table(part))

    replace_file(path, write)


def _batches(path: Path, columns: list[str]) -> Iterator["pyarrow.RecordBatch"]:
    require_pyarrow()
    import pyarrow
    import pyarrow.parquet

    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            if tuple(file.schema_arrow.names) != COLUMNS:
                raise NoTableError("its columns are not those of this version")
            yield from file.iter_batches(ROWS, columns=columns)
    except pyarrow.ArrowInvalid as error:
        raise NoTableError(f"it is no Parquet file, or a damaged one ({error})") from error
