"""What does `labels.complexity_table` gain over a Python loop over the objects, with the same solver?"""

import time
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from skimage.draw import ellipse
from skimage.measure import regionprops

from benchmarks.timing import Ratio, alternate, ratio
from torchlinf import complexity
from torchlinf.labels import complexity_table

Labels = NDArray[np.int32]


@dataclass(frozen=True)
class Answer:
    """Seconds for the whole map, and how many times as long a loop takes for each object."""

    objects: int
    seconds: float
    cropped: Ratio
    full: float


def run(side: int = 4096, objects: int = 5000, rounds: int = 5) -> Answer:
    """Time the whole map, and the loops on a part of it, which a loop over whole masks would not end on."""
    found = nuclei(side, objects)
    part = found[: side // 4, : side // 4]
    complexity_table(part)
    began = time.perf_counter()
    table = complexity_table(found)
    seconds = time.perf_counter() - began
    if len(table["label"]) != objects:
        raise AssertionError(f"the map must hold {objects} objects; got {len(table['label'])}")
    expected = np.array(over_crops(part))
    if not np.allclose(expected, complexity_table(part)["complexity"], rtol=0, atol=1e-9):
        raise AssertionError("the loop must give the numbers of the table")
    times = alternate({"table": lambda: complexity_table(part), "loop": lambda: over_crops(part)}, rounds=rounds)
    began = time.perf_counter()
    over_masks(found, count := min(20, objects))
    full = (time.perf_counter() - began) / count * objects / seconds
    return Answer(objects, seconds, ratio(times["loop"], times["table"]), full)


def nuclei(side: int, objects: int) -> Labels:
    """Ellipses of radii 9 to 26 pixels (if `side` is 4096 for 5,000 of them) with ragged rims, on a grid."""
    generator = np.random.default_rng(0)
    columns = int(np.ceil(np.sqrt(objects)))
    pitch = side / columns
    found: Labels = np.zeros((side, side), dtype=np.int32)
    for i in range(objects):
        row, column = ((i // columns + 0.5) * pitch, (i % columns + 0.5) * pitch)
        radii = generator.uniform(0.16, 0.45, 2) * pitch
        found[ellipse(row, column, *radii, shape=found.shape, rotation=generator.uniform(0, np.pi))] = i + 1
        for angle in generator.uniform(0, 2 * np.pi, 4):  # bites and bumps at the rim
            at = (row + radii[0] * np.sin(angle), column + radii[0] * np.cos(angle))
            inside = ellipse(*at, 0.05 * pitch, 0.05 * pitch, shape=found.shape)
            found[inside] = 0 if generator.random() < 0.5 else i + 1
    return found


def over_crops(found: Labels) -> list[float]:
    """The careful loop: scikit-image cuts the boxes, and every object is one call."""
    return [complexity(torch.from_numpy(region.image), spatial_ndim=2).item() for region in regionprops(found)]


def over_masks(found: Labels, count: int) -> list[float]:
    """The loop that first comes to mind: a mask of the whole map for every label."""
    return [complexity(torch.from_numpy(found == label), spatial_ndim=2).item() for label in range(1, count + 1)]
