"""The file that was read last, kept: of a panoptic picture, a label map or a stack many masks are asked for in turn."""

import threading
from pathlib import Path
from typing import Any

from torchlinf.scoring.byte_ranges import ByteRange, PackedRange
from torchlinf.scoring.readers import read_values
from torchlinf.scoring.values import Values

_lock = threading.Lock()  # several threads ask for the same picture at once; one of them reads it
_last: dict[Any, Values] = {}


def read_once(
    path: Path,
    member: str | None,
    max_pixels: int,
    byte_range: ByteRange | PackedRange | None = None,
    volume: bool = False,
) -> Values:
    """The numbers of a file, as `read_values` reads them; not read again while no other file is asked for.

    Raises:
        UnreadableMaskError: as `read_values`.
    """
    arguments = (path, member, max_pixels, byte_range, volume)
    with _lock:
        try:
            status = path.stat()
        except OSError:
            return read_values(*arguments)  # which says what is wrong
        key = (*arguments, status.st_mtime_ns, status.st_size)
        if key not in _last:
            _last.clear()
            _last[key] = read_values(*arguments)
        return _last[key]
