"""What only a fresh process can tell. Run as `python -m benchmarks.probes QUESTION ARGUMENT...`, prints JSON."""

import gc
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


def probe(*arguments: str, **environment: str) -> dict[str, Any]:
    """Run this file in a fresh process, with more environment variables, and read what it prints."""
    command = [sys.executable, "-m", "benchmarks.probes", *arguments]
    variables = {**os.environ, **environment}
    done = subprocess.run(command, cwd=ROOT, env=variables, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(arguments)}: the probe failed\n{done.stderr}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def startup(call: str) -> dict[str, Any]:
    """Seconds of the import beyond torch, of the first call and of the same once more."""
    import torch

    began = time.perf_counter()
    import torchlinf

    imported = time.perf_counter() - began
    mask = torch.zeros(96, 128, dtype=torch.bool)
    mask[8:80, 8:60] = mask[20:50, 40:120] = mask[70:90, 15:25] = True  # a shape that needs more than its start
    run = getattr(torchlinf, call)
    seconds, processor = [], []
    for _ in range(2):
        began, busy = time.perf_counter(), time.process_time()
        run(mask, spatial_ndim=2)
        seconds.append(time.perf_counter() - began)
        processor.append(time.process_time() - busy)
    return {"import": imported, "first": seconds[0], "again": seconds[1], "processor": processor[0]}


def compiler() -> dict[str, Any]:
    """Seconds that numba alone takes for its import and for one trivial kernel out of its cache."""
    import numpy as np

    began = time.perf_counter()
    import numba

    numba.njit(cache=True)(_double)(np.ones(3))
    return {"first": time.perf_counter() - began}


def _double(x):  # type: ignore[no-untyped-def]
    return x + x


def memory(call: str, kind: str, side: str) -> dict[str, Any]:
    """Bytes of peak memory above the input, and of the output."""
    import torch

    import torchlinf

    torch.set_num_threads(1)
    if call == "batched":
        run: Callable[..., Any] = partial(torchlinf.solve_field, method=call)
    elif call == "accelerated":  # all its memory is in use from the first sweeps on, of which it takes thousands
        run = partial(torchlinf.solve_field, method=call, max_sweeps=200, throw=False)
    else:
        run = getattr(torchlinf, call)
    small, mask = _mask(kind, 24), _mask(kind, int(side))
    run(small, spatial_ndim=small.ndim)
    peak, result = peak_of(lambda: run(mask, spatial_ndim=mask.ndim))
    output = getattr(result, "value", result if isinstance(result, torch.Tensor) else None)
    return {
        "peak": peak,
        "output": 0 if output is None else output.numel() * output.element_size(),
        "pixels": mask.numel(),
        "inside": int(mask.sum()),
        "shape": f"{kind}, {' x '.join(map(str, mask.shape))}",
    }


def peak_of(run: Callable[[], object]) -> tuple[int, object]:
    """Bytes by which resident memory grew at most during a call, and what it returned.

    Every allocator is seen this way: torch, numpy and what numba's kernels take for themselves. On Linux the mark of
    the highest memory is reset first. Elsewhere it is that of the whole process so far, and what was used and freed
    before the call hides an equal amount of the call's own.
    """
    gc.collect()
    before = _reset()
    result = run()
    return _highest() - before, result


def _reset() -> int:
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        return _status("VmRSS:")
    except OSError:
        return _highest()


def _highest() -> int:
    if Path("/proc/self/status").exists():
        return _status("VmHWM:")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # bytes on macOS


def _status(key: str) -> int:
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(key):
            return 1024 * int(line.split()[1])
    raise OSError(f"no {key} in /proc/self/status")


def _mask(kind: str, side: int) -> Any:
    """A mask of about that side, whose making leaves no large memory behind."""
    from benchmarks import shapes

    if kind == "square":
        return shapes.noisy_square(side * 4 // 5)
    if kind == "silhouette":
        shape = shapes.silhouettes(1)[0].mask
        return shapes.smooth(shape, max(1, round(side / max(shape.shape))))
    return shapes.volumes(side)[2].mask


QUESTIONS: dict[str, Callable[..., dict[str, Any]]] = {
    "startup": startup,
    "compiler": compiler,
    "memory": memory,
}

if __name__ == "__main__":
    question, *rest = sys.argv[1:]
    print(json.dumps(QUESTIONS[question](*rest)))
