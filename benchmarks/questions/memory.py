"""How much memory does a call need above its input and output?"""

from benchmarks.probes import probe
from benchmarks.results import Cell, Result, Table, Target
from benchmarks.sizes import Size

CALLS = ["solve_field", "complexity_profile", "chessboard_distance", "accelerated", "batched"]
JUDGED = CALLS[:2]


def run(size: Size) -> Result:
    """Every call on every kind of mask, each in a fresh process."""
    rows: list[list[Cell]] = []
    worst = 0.0
    for kind in size.memory_kinds:
        side = size.volume_side if kind == "volume" else size.memory_side
        for call in CALLS:
            if call == "accelerated" and kind != "square":
                continue
            found = probe("memory", call, kind, str(side))
            above = found["peak"] - found["output"]
            a_pixel = above / found["pixels"]
            rows.append([call, found["shape"], found["pixels"], above / 2**20, a_pixel, above / found["inside"]])
            if call in JUDGED:
                worst = max(worst, a_pixel)
    columns = ["call", "mask", "pixels", "MiB above input and output", "bytes a pixel", "bytes an inside pixel"]
    note = (
        "Largest resident memory during the call, above that just before it, less the output. Each line is a fresh "
        "process that made a small call of the same kind first."
    )
    return Result(
        name="memory",
        title="Memory",
        targets=[
            Target("memory above input and output", "<=", 100, 40, worst, " bytes a pixel", "most, field and profile")
        ],
        tables=[Table("Peak memory of one call, one thread", columns, rows, note)],
    )
