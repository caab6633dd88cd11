"""Compiled CPU kernels: the only files that know numba.

Every kernel is single-threaded, releases the GIL and works on the flat view of one shape's cropped box, padded by
one ring of outside pixels, so that a neighbour is always `x + offset` and never needs a bounds check.

Numba compiles a kernel when it is first called, and keeps it on disk for later processes. `torchlinf.warm_up`
compiles them all.
"""

import importlib.util
from functools import cache

from torch import Tensor


def usable(x: Tensor) -> bool:
    """Whether the kernels can take this tensor: it is on the CPU, and numba is installed."""
    return x.device.type == "cpu" and has_compiler()


@cache
def has_compiler() -> bool:
    """Whether numba is installed. It is not imported: that takes longer than all the rest of the library."""
    return importlib.util.find_spec("numba") is not None
