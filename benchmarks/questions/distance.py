"""How long does the chessboard distance take, against other libraries?"""

from collections.abc import Mapping
from functools import partial

import numpy as np
import torch
from scipy import ndimage
from torch import Tensor

from benchmarks import shapes
from benchmarks.baselines.distances import transforms
from benchmarks.questions.common import median, spread, times_as_long
from benchmarks.results import Cell, Result, Table, Target
from benchmarks.shapes import Named
from benchmarks.sizes import Size
from benchmarks.timing import Ratio, Run, Times, alternate, ratio
from torchlinf import chessboard_distance
from torchlinf._helpers.parallel import threads

Pairs = dict[str, dict[str, Times]]  # times of the library and of one other, by the other's name

ORDER = ["scipy", "opencv", "kornia"]
EXACT = {"scipy", "opencv"}


def run(size: Size) -> Result:
    """2-D masks, a volume and a batch; one core for each contender."""
    side = size.distance_side
    with threads(1):
        flat = {shape.name: _measure(shape, size) for shape in _masks(side)}
        solid = _with_ring(shapes.volumes(size.volume_side)[1])
        stack = torch.nn.functional.pad(shapes.batch(size.batches[1], side - 2), (1, 1, 1, 1))
        found = {**flat, solid.name: _measure(solid, size), _title(stack): _measure_batch(stack, size)}
    reached = median([_against(pairs, "scipy").median for pairs in flat.values()])
    what = f"chessboard distance of one {side} x {side} mask, time over scipy's"
    return Result(
        name="distance",
        title="Chessboard distance against other libraries",
        targets=[Target(what, "<=", 1.0, 0.3, reached, "x", "median of three masks")],
        tables=[_table(found)],
        raw={
            mask: {name: {key: vars(entry) for key, entry in times.items()} for name, times in pairs.items()}
            for mask, pairs in found.items()
        },
    )


def _title(stack: Tensor) -> str:
    return f"{stack.shape[0]} silhouettes, {stack.shape[1]} x {stack.shape[2]}"


def _masks(side: int) -> list[Named]:
    random = np.random.default_rng(3)
    blobs = ndimage.gaussian_filter(random.standard_normal((side, side)), side / 40) > 0
    silhouette = shapes.batch(1, side - 2)[0]
    return [
        _with_ring(Named("silhouette", silhouette)),
        _with_ring(Named("blobs", torch.from_numpy(blobs[1:-1, 1:-1]))),
        _with_ring(Named("full square", torch.ones(side - 2, side - 2, dtype=torch.bool))),
    ]


def _with_ring(shape: Named) -> Named:
    """The outside must be in the array for other libraries; some answer -1 on a mask without any."""
    padded = torch.nn.functional.pad(shape.mask, [1, 1] * shape.mask.ndim)
    return Named(f"{shape.name}, {' x '.join(map(str, padded.shape))}", padded)


def _measure(shape: Named, size: Size) -> Pairs:
    mask = shape.mask
    theirs = transforms(mask)
    for name in EXACT & theirs.keys():
        if not np.array_equal(chessboard_distance(mask, spatial_ndim=mask.ndim).numpy(), np.asarray(theirs[name]())):
            raise AssertionError(f"exact distances must be equal; {name}'s differ on {shape.name}")
    return _pairs(lambda: chessboard_distance(mask, spatial_ndim=mask.ndim), theirs, size)


def _measure_batch(masks: Tensor, size: Size) -> Pairs:
    """A batch in one call, against the others in a loop."""
    calls = [transforms(mask) for mask in masks]

    def loop(name: str) -> None:
        for each in calls:
            each[name]()

    loops = {name: partial(loop, name) for name in EXACT & calls[0].keys()}
    return _pairs(lambda: chessboard_distance(masks, spatial_ndim=2), loops, size)


def _pairs(ours: Run, theirs: Mapping[str, Run], size: Size) -> Pairs:
    """Each of the others in turn with the library, so that a slow one does not use up the time of a fast one."""
    return {
        name: alternate({"torchlinf": ours, name: call}, rounds=size.rounds, budget=size.patience / 4)
        for name, call in sorted(theirs.items(), key=lambda item: ORDER.index(item[0]))
    }


def _against(pairs: Pairs, name: str) -> Ratio:
    return ratio(pairs[name]["torchlinf"], pairs[name][name])


def _table(found: dict[str, Pairs]) -> Table:
    others = [name for name in ORDER if any(name in pairs for pairs in found.values())]
    columns = ["mask", "torchlinf, ms (least to most)"]
    for other in others:
        columns += [f"{other}, ms", f"torchlinf / {other}"]
    rows: list[list[Cell]] = []
    for mask, pairs in found.items():
        row: list[Cell] = [mask, spread(pairs["scipy"]["torchlinf"])]
        for other in others:
            known = other in pairs
            row += [1e3 * pairs[other][other].median, times_as_long(_against(pairs, other))] if known else [None, None]
        rows.append(row)
    note = "scipy's and OpenCV's results are checked to be equal. Kornia's is a Euclidean distance, and approximate."
    return Table("One core; a ratio below 1 says that torchlinf is faster", columns, rows, note)
