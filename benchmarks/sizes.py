"""How much to measure: the full run, a quick one, and toy sizes that only show that everything runs."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Size:
    """Settings of a run.

    Attributes:
        name: "full", "quick" or "toy".
        silhouettes: how many of them.
        silhouette_side: their longest side in pixels at most; None leaves them as they are.
        documented: scale of the shapes of the method page.
        rounds: rounds of alternating runs.
        patience: seconds after which a baseline of the field is given up, for one shape.
        factors: enlargements for the growth of time.
        distance_side: side of the masks whose distance is measured.
        batches: batch sizes; the last is the one compared with one by one.
        batch_side: side of the shapes in a batch.
        memory_kinds: masks whose memory is measured.
        memory_side: their side, if they are no volumes.
        volume_side: side of the volumes.
        processes: how often a fresh process is measured.
    """

    name: str
    silhouettes: int
    silhouette_side: int | None
    documented: float
    rounds: int
    patience: float
    factors: tuple[int, ...]
    distance_side: int
    batches: tuple[int, ...]
    batch_side: int
    memory_kinds: tuple[str, ...]
    memory_side: int
    volume_side: int
    processes: int


FULL = Size(
    name="full",
    silhouettes=12,
    silhouette_side=None,
    documented=1.0,
    rounds=5,
    patience=20.0,
    factors=(1, 2, 4, 8),
    distance_side=512,
    batches=(1, 16, 64),
    batch_side=192,
    memory_kinds=("square", "silhouette", "volume"),
    memory_side=1024,
    volume_side=128,
    processes=7,
)
QUICK = Size(
    name="quick",
    silhouettes=3,
    silhouette_side=192,
    documented=0.5,
    rounds=3,
    patience=3.0,
    factors=(1, 2, 4),
    distance_side=512,
    batches=(1, 4, 16),
    batch_side=64,
    memory_kinds=("square",),
    memory_side=512,
    volume_side=40,
    processes=2,
)
TOY = Size(
    name="toy",
    silhouettes=2,
    silhouette_side=24,
    documented=0.125,
    rounds=1,
    patience=1.0,
    factors=(1, 2),
    distance_side=32,
    batches=(1, 3),
    batch_side=16,
    memory_kinds=("square",),
    memory_side=64,
    volume_side=12,
    processes=1,
)
SIZES = {size.name: size for size in (FULL, QUICK, TOY)}
