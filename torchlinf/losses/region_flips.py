"""Region flips: the regions of a shape that are flipped, one at a time, and how each flip changes the complexity.

To flip a region is to remove it from the shape, or to fill it. No pixel alone matters much to the complexity: a bump
has to go as a whole. So the regions are what squares (n-cubes) and bars of a few pixels cannot reach, the pixels about
which a grey prediction is in doubt, and rows of pixels along straight pieces of the boundary.
"""

import itertools
from collections.abc import Iterator

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.morphology import closed, opened
from torchlinf.measure import Measure, complexity

# Sides in pixels of the squares and bars that open and close the shape: every small one, then in steps of sqrt 2. The
# large ones are what leads a disc out of its local minimum, where no small region helps.
SIDES = (2, 3, 4, 5, 6, 7, 8, 11, 16, 23, 32, 45, 64)
DOUBT = (0.3, 0.7)  # levels of the prediction that are compared with the shape, for a threshold of 1/2
SOLVE_PIXELS = 1 << 22  # of the masks that are solved in one call, which bounds the memory

Region = NDArray[np.int64]  # flat indices of the pixels of a region, all inside or all outside the shape
Steps = list[tuple[int, ...]]  # from a pixel to those that belong to the same region


def candidates(probability: Tensor, threshold: float) -> list[list[Region]]:
    """Regions of each shape {probability > threshold} that may be flipped.

    Args:
        probability: (N, *spatial) in [0, 1], contiguous, on the CPU.
        threshold: the shape is where the probability is greater; in (0, 1).

    Returns:
        N lists of regions. A region may come several times, and its pixels in any order.

    Example:
        >>> regions = candidates(torch.tensor([[0.9, 0.9, 0.9, 0.1, 0.9]]), 0.5)
        >>> [region.tolist() for region in regions[0]][:3]
        [[4], [4], [3]]
    """
    inside = probability > threshold
    regions: list[list[Region]] = [[] for _ in inside]
    block = [step for step in itertools.product((-1, 0, 1), repeat=inside.ndim - 1) if any(step)]
    for marked, steps in _maps(probability, inside, threshold, block):
        for n, region in _connected_regions(marked, steps, whole=steps is block):
            regions[n].append(region)
    return regions


def select(inside: Tensor, regions: list[list[Region]], max_flips: int) -> list[list[Region]]:
    """At most `max_flips` regions of each shape, each once, of all sizes, none of more than half the shape's area.

    Sizes are classed by octaves, and the largest regions left of each octave are taken in turn: large ones lead out of
    local minima, small ones say where the outline is rough. Of regions of equal size all are taken or none, so that the
    choice commutes with mirror images of the shape. A shape that all but vanishes is not a simple shape: no region of
    more than half of it is flipped.

    Example:
        >>> regions = [np.arange(n) for n in (1, 2, 3, 4)]
        >>> chosen = select(torch.ones(1, 6, dtype=torch.bool), [regions], 2)
        >>> [region.tolist() for region in chosen[0]]  # 4 of 6 pixels is too many; 3 and 2 are of one octave
        [[0, 1, 2], [0]]
    """
    chosen: list[list[Region]] = []
    for shape, proposed in zip(inside, regions, strict=True):
        limit = int(shape.sum()) // 2
        ranked = sorted((region for region in proposed if len(region) <= limit), key=len, reverse=True)
        octaves: dict[int, list[list[Region]]] = {}
        for size, same_size in itertools.groupby(ranked, key=len):
            octaves.setdefault(size.bit_length(), []).append(list(same_size))
        taken: list[Region] = []
        for together in itertools.chain.from_iterable(itertools.zip_longest(*octaves.values(), fillvalue=[])):
            if len(taken) == max_flips:
                break
            different = {region.tobytes(): region for region in map(np.sort, together)}
            if len(taken) + len(different) <= max_flips:
                taken.extend(different.values())
        chosen.append(taken)
    return chosen


def differences(
    inside: Tensor, regions: list[list[Region]], measure: Measure
) -> tuple[Tensor, list[NDArray[np.float64]]]:
    """The complexity of each shape, and by how much each flip of a region changes it. All of them are solved.

    Args:
        inside: (N, *spatial) bool, the shapes, on the CPU.
        regions: N lists of regions.
        measure: how complexity is measured.

    Returns:
        (N,) float64, NaN for an empty shape; and N arrays with, for each region, the complexity after its flip minus
        the complexity before.

    Example:
        >>> value, [difference] = differences(torch.ones(1, 2, 2, dtype=torch.bool), [[np.array([3])]], Measure())
        >>> value, difference
        (tensor([0.], dtype=torch.float64), array([0.]))
    """
    counts = [1 + len(tried) for tried in regions]
    parts = complexities(_flipped(inside, regions), inside, measure).split(counts)
    value = torch.cat([part[:1] for part in parts])
    return value, [(part[1:] - part[0]).numpy() for part in parts]


def complexities(masks: Iterator[Tensor], like: Tensor, measure: Measure) -> Tensor:
    """Complexity of any number of masks of the size of the shapes in `like`, in calls of bounded memory.

    Example:
        >>> squares = torch.ones(2, 4, 4, dtype=torch.bool)
        >>> complexities(iter(squares), squares, Measure())
        tensor([0., 0.], dtype=torch.float64)
    """
    values = [torch.empty(0, dtype=torch.float64, device="cpu")]
    step = max(1, SOLVE_PIXELS // like[0].numel())
    while chunk := list(itertools.islice(masks, step)):
        values.append(complexity(torch.stack(chunk), spatial_ndim=like.ndim - 1, **measure.options()))
    return torch.cat(values)


def _flipped(inside: Tensor, regions: list[list[Region]]) -> Iterator[Tensor]:
    """Each shape, followed by the shape after the flip of each of its regions."""
    for shape, tried in zip(inside, regions, strict=True):
        yield shape
        for region in tried:
            after = shape.clone()
            after.view(-1)[torch.from_numpy(region)] ^= True
            yield after


def _maps(probability: Tensor, inside: Tensor, threshold: float, block: Steps) -> Iterator[tuple[Tensor, Steps]]:
    """Maps of what might be flipped, (N, *spatial) bool, and the steps between pixels that are flipped together."""
    ndim = inside.ndim - 1
    # Boxes that are longer than the array all act like one of its own length (closing) or leave nothing (opening).
    longest = [size + 1 for size in inside.shape[1:]]
    boxes: dict[tuple[int, ...], None] = {}
    for side in SIDES:
        for axes in [range(ndim), *([axis] for axis in range(ndim))]:
            boxes[tuple(min(side, longest[i]) if i in axes else 1 for i in range(ndim))] = None
    for sides in boxes:
        yield inside & ~opened(inside, sides), block
        yield closed(inside, sides) & ~inside, block
    for level in DOUBT:
        yield (probability > level_at_odds(threshold, level)) ^ inside, block
    for axis in range(ndim):
        along = [step for step in block if step[axis] == 0 and sum(map(abs, step)) == 1]
        for direction in (1, -1):
            beside = _neighbour(inside, axis + 1, direction)
            yield inside & ~beside, along
            yield beside & ~inside, along


def level_at_odds(threshold: float, level: float) -> float:
    """The level whose odds against the threshold are those of `level` against 1/2.

    Example:
        >>> level_at_odds(0.5, 0.3), level_at_odds(0.8, 0.5)
        (0.3, 0.8)
    """
    odds = level / (1 - level) * threshold / (1 - threshold)
    return odds / (1 + odds)


def _connected_regions(marked: Tensor, steps: Steps, whole: bool) -> Iterator[tuple[int, Region]]:
    """Each map as a whole, if asked for, and each of its connected regions; with the number of its shape."""
    from torchlinf.kernels.regions import flood

    padded = torch.nn.functional.pad(marked.view(torch.uint8), [1, 1] * (marked.ndim - 1))
    strides = np.array(padded.stride()[1:])
    index = np.full(padded.shape[1:], -1)
    index[(slice(1, -1),) * (marked.ndim - 1)] = np.arange(marked[0].numel()).reshape(marked.shape[1:])
    offsets = np.array(steps, dtype=np.int64).reshape(-1, marked.ndim - 1) @ strides
    pixels, begin, owner = flood(padded.flatten(1).numpy(), offsets)
    pixels = index.ravel()[pixels]
    if whole:
        first = begin[np.searchsorted(owner, np.arange(len(marked) + 1))].tolist()
        yield from ((n, pixels[first[n] : first[n + 1]]) for n in range(len(marked)) if first[n + 1] > first[n])
    begin = begin.tolist()
    yield from ((n, pixels[begin[i] : begin[i + 1]]) for i, n in enumerate(owner.tolist()))


def _neighbour(inside: Tensor, dim: int, direction: int) -> Tensor:
    """Whether the next pixel in a direction is inside; beyond the array is outside."""
    shifted = torch.zeros_like(inside)
    size = inside.shape[dim] - 1
    near, far = (0, 1) if direction > 0 else (1, 0)
    shifted.narrow(dim, near, size).copy_(inside.narrow(dim, far, size))
    return shifted
