"""Files that are there whole or not at all."""

import os
from collections.abc import Callable
from pathlib import Path
from uuid import uuid4


def replace_file(path: Path, write: Callable[[Path], None]) -> None:
    """Have `write(temporary)` write a file, and give it its name when it is whole and on the disk."""
    path = path.resolve()  # a link stays one
    # Not the number of the process: on two machines that share the folder it may be the same.
    temporary = path.with_name(f".{path.name}.{uuid4().hex}.tmp")
    try:
        write(temporary)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
