"""The one decorator that all kernels share."""

from collections.abc import Callable
from typing import Any

from torchlinf.kernels._collector import collector_at_rest

with collector_at_rest():
    import numba

# Sums may be fused and reordered by no one: certificates rest on the order of operations. NaN and infinities cannot
# occur (inputs are checked), and saying so lets the compiler turn max/min into single vector instructions.
_FLAGS = {"nnan", "ninf", "nsz"}


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile `function` without the GIL, cached on disk where any folder can be written."""
    options = {"nogil": True, "fastmath": _FLAGS, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no writable place for its cache: compile anew in each process
        return numba.njit(**options)(function)


@kernel
def _nothing() -> None:
    pass


with collector_at_rest():
    _nothing()  # with its first kernel, whichever that is, numba loads as much again as with its import
