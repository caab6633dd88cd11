"""Compiled CPU kernels: the only files that know numba.

Every kernel is single-threaded, releases the GIL and works on the flat view of one shape's cropped box, padded by
one ring of outside pixels, so that a neighbour is always `x + offset` and never needs a bounds check.

Numba compiles a kernel when it is first called, and keeps it on disk for later processes. `warm_up` compiles them all.
"""

import importlib.util
import time
from functools import cache

from torch import Tensor


def usable(x: Tensor) -> bool:
    """Whether the kernels can take this tensor: it is on the CPU, and numba is installed."""
    return x.device.type == "cpu" and has_compiler()


@cache
def has_compiler() -> bool:
    """Whether numba is installed. It is not imported: that takes longer than all the rest of the library."""
    return importlib.util.find_spec("numba") is not None


def warm_up() -> float:
    """Compile all kernels, so that no later call of this library on this machine has to.

    Meant for images of containers, whose processes would otherwise each compile anew: run it once when the image is
    built, as the user and with the NUMBA_CACHE_DIR that the processes will have.

    Returns:
        The seconds that it took: some 20 if nothing was compiled before, else about 1.

    Raises:
        ImportError: numba is not installed.

    Example:
        >>> from torchlinf.kernels import warm_up
        >>> seconds = warm_up()
    """
    if not has_compiler():
        raise ImportError("warm_up compiles kernels with numba, which is not installed. Run: pip install numba")
    from torchlinf.kernels.every_kernel import call_everything

    start = time.perf_counter()
    call_everything()
    return time.perf_counter() - start
