"""The decorators that all kernels share, and what the user is told about compiling."""

import logging
import sys
import warnings
from collections.abc import Callable
from typing import Any

import numba
from numba.core import event
from numba.extending import register_jitable

# Certificates rest on the order of operations, so sums may be neither fused nor reordered. NaN and infinities cannot
# occur (inputs are checked), and saying so lets the compiler turn max and min into single vector instructions.
_OPTIONS = {"nogil": True, "no_cfunc_wrapper": True, "fastmath": {"nnan", "ninf", "nsz"}, "error_model": "numpy"}
_KERNELS = __name__.rpartition(".")[0] + "."
_said: set[str] = set()


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile `function` at its first call, without the GIL, and cache it on disk where a folder can be written."""
    try:
        return numba.njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # numba found no folder for its cache
        _warn_of_no_cache()
        return numba.njit(**_OPTIONS)(function)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make `function` a part of each kernel that calls it; called from Python, it stays what it is.

    LLVM inlines it, not numba: numba would copy and look through its statements at every call, which takes longer than
    to compile it once a process.
    """
    return register_jitable(forceinline=True, **_OPTIONS)(function)


def _warn_of_no_cache() -> None:
    """Warn once a process that every process will compile anew."""
    if "no cache" in _said:
        return
    _said.add("no cache")
    warnings.warn(
        "the cache of compiled kernels must be a folder that can be written; got none, neither beside the package nor "
        "in the home folder, so every process compiles for some seconds. Set NUMBA_CACHE_DIR to a folder that can be "
        "written.",
        RuntimeWarning,
        stacklevel=2,
    )


class _Announcement(event.Listener):  # type: ignore[misc]
    """Says once a process that a kernel of this library is being compiled, which the cache did not hold."""

    def on_start(self, event: Any) -> None:
        module = event.data["dispatcher"].py_func.__module__
        if "compiling" in _said or not module.startswith(_KERNELS):
            return
        _said.add("compiling")
        text = "torchlinf: compiling its kernels, which takes some seconds; they are kept for the next time"
        if sys.stderr is not None and sys.stderr.isatty():
            print(text, file=sys.stderr, flush=True)
        else:
            logging.getLogger("torchlinf").info(text)

    def on_end(self, event: Any) -> None:
        pass


event.register("numba:compile", _Announcement())
