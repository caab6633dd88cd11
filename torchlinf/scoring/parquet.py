"""Tables as Parquet files. Needs the extra `parquet` (pyarrow)."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchlinf._helpers.extras import require
from torchlinf.scoring.rows import KINDS, NoTableError, Score

if TYPE_CHECKING:
    import pyarrow

ROWS = 10_000  # in memory at a time


def require_pyarrow() -> None:
    """Raise an ImportError that says what to install, if pyarrow is missing."""
    require("pyarrow.parquet", "a table in Parquet", "parquet")


def schema(columns: Sequence[str]) -> "pyarrow.Schema":
    """The columns with their types, all of which but the path may be empty."""
    import pyarrow

    types = {int: pyarrow.int64(), float: pyarrow.float64(), str: pyarrow.string()}
    return pyarrow.schema(
        [pyarrow.field(name, types[KINDS.get(name, float)], nullable=name != "path") for name in columns]
    )


def table(rows: Iterable[Score], columns: Sequence[str]) -> "pyarrow.Table":
    """Rows as an Arrow table."""
    import pyarrow

    return pyarrow.Table.from_pylist([row.cells() for row in rows], schema=schema(columns))


def write(path: Path, rows: Iterable[Score], columns: Sequence[str]) -> None:
    """Write rows as they come, a part of them in memory at a time."""
    import pyarrow.parquet

    remaining = iter(rows)
    with pyarrow.parquet.ParquetWriter(path, schema(columns)) as writer:
        while part := list(islice(remaining, ROWS)):
            writer.write_table(table(part, columns))


def read_cells(path: Path, check: Callable[[tuple[str, ...]], None]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """The cells of each row of a Parquet file by the names of the columns, with where they are.

    Args:
        path: the file.
        check: called with the names of the columns; may raise a NoTableError.

    Raises:
        OSError: it cannot be read.
        NoTableError: it is not a Parquet file.
    """
    require_pyarrow()
    import pyarrow.parquet

    number = 0
    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            check(tuple(file.schema_arrow.names))
            # pyarrow 18 and 19 fail on a file without row groups.
            for batch in file.iter_batches(ROWS) if file.num_row_groups else ():
                for cells in batch.to_pylist():
                    yield f"row {(number := number + 1)}", cells
    except pyarrow.ArrowException as error:
        raise NoTableError(f"it is not a Parquet file, or a damaged one ({error})") from error
