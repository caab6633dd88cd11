"""One file a question. Each has a `run(size)` that hands back a `Result`."""

from collections.abc import Callable

from benchmarks.questions import batch, distance, field, growth, memory, profile, startup, torch_path, volume, work
from benchmarks.results import Result
from benchmarks.sizes import Size

QUESTIONS: dict[str, Callable[[Size], Result]] = {
    "field": field.run,
    "work": work.run,
    "growth": growth.run,
    "distance": distance.run,
    "profile": profile.run,
    "batch": batch.run,
    "torch_path": torch_path.run,
    "volume": volume.run,
    "memory": memory.run,
    "startup": startup.run,
}
