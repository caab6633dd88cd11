"""How long do the import and the first call in a fresh process take, and the first call on a fresh machine?"""

import tempfile

from benchmarks.probes import probe
from benchmarks.questions.common import median
from benchmarks.results import Cell, Result, Table, Target
from benchmarks.sizes import Size

WHAT = {
    "import": "`import torchlinf` after `import torch`",
    "solve_field": "first `solve_field`",
    "complexity_profile": "first `complexity_profile`",
    "compiler": "numba alone: its import and one trivial kernel",
    "again": "second `solve_field`",
}


def run(size: Size) -> Result:
    """Fresh processes, one after the other; the first, which may have to compile, is not counted."""
    probe("startup", "solve_field")
    probe("startup", "complexity_profile")
    probe("compiler")
    seconds: dict[str, list[float]] = {name: [] for name in WHAT}
    for _ in range(size.processes):
        for call in ("solve_field", "complexity_profile"):
            found = probe("startup", call)
            seconds["import"].append(found["import"])
            seconds[call].append(found["first"])
            if call == "solve_field":
                seconds["again"].append(found["again"])
        seconds["compiler"].append(probe("compiler")["first"])
    compiling = []
    for _ in range(size.processes):
        with tempfile.TemporaryDirectory() as folder:
            first, second = (probe("startup", "complexity", NUMBA_CACHE_DIR=folder) for _ in range(2))
        compiling.append(first["processor"] - second["processor"])
    rows: list[list[Cell]] = [
        [WHAT[name], 1e3 * median(values), 1e3 * min(values), 1e3 * max(values)] for name, values in seconds.items()
    ]
    return Result(
        name="startup",
        title="Start-up",
        targets=[
            Target("`import torchlinf` beyond `import torch`", "<=", 0.2, None, median(seconds["import"]), " s"),
            Target(
                "first call in a fresh process, kernels cached", "<=", 0.5, None, median(seconds["solve_field"]), " s"
            ),
            Target("compiling for the first 2-D `complexity`, processor time", "<=", 8, None, median(compiling), " s"),
        ],
        tables=[
            Table("Fresh processes, kernels cached by an earlier one", ["what", "ms, median", "least", "most"], rows)
        ],
        raw={**{name: {"wall": values} for name, values in seconds.items()}, "compiling": {"processor": compiling}},
    )
