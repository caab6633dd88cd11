"""Region flips: the regions of a shape that are flipped, one at a time, and how each flip changes the complexity.

To flip a region is to remove it from the shape, or to fill it. No pixel alone matters much to the complexity: a bump
has to go as a whole. So the regions are what squares (n-cubes) and bars of a few pixels cannot reach, the pixels about
which a grey prediction is in doubt, and rows of pixels along straight pieces of the boundary.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.morphology import closed, opened
from torchlinf._helpers.parallel import for_each
from torchlinf.kernels import has_compiler
from torchlinf.kernels.regions import FAR, Maps, RegionList
from torchlinf.measure import Measure, complexities_after_flips, complexity

# Sides in pixels of the squares and bars that open and close the shape: every small one, then in steps of sqrt 2. The
# large ones are what leads a disc out of its local minimum, where no small region helps.
SIDES = (2, 3, 4, 5, 6, 7, 8, 11, 16, 23, 32, 45, 64)
DOUBT = (0.3, 0.7)  # levels of the prediction that are compared with the shape, for a threshold of 1/2
SOLVE_PIXELS = 1 << 22  # of the masks that are solved in one call, which bounds the memory

# Pixels that are looked at for a shape, in units of the pixels of its array. Silhouettes take 2, windows of facades up
# to 5. Noise would take 37, for regions of which there are too many of each size to be chosen anyway.
BUDGET = 8
CHUNK = 1 << 19  # pixels whose maps are made at a time, which bounds the memory

Region = NDArray[np.int64]  # flat indices of the pixels of a region, all inside or all outside the shape
Steps = list[tuple[int, ...]]  # from a pixel to those that belong to the same region


@dataclass(frozen=True, eq=False)
class Candidates:
    """Regions of N shapes that may be flipped.

    Attributes:
        pixels: (total,) int32, flat indices, region by region; within a region in any order.
        begin: (R + 1,) int64, where each region begins, and the last one ends.
        owner: (R,) int32, the shape that each region belongs to.
        code: (R,) uint64, the same for the same pixels, and for different ones as good as never.
    """

    pixels: NDArray[np.int32]
    begin: NDArray[np.int64]
    owner: NDArray[np.int32]
    code: NDArray[np.uint64]

    def of(self, shape: int) -> list[Region]:
        """The regions of one shape."""
        return [self.region(i) for i in np.flatnonzero(self.owner == shape).tolist()]

    def region(self, number: int) -> Region:
        """The pixels of a region, ascending."""
        return np.sort(self.pixels_of(number)).astype(np.int64)

    def pixels_of(self, number: int) -> NDArray[np.int32]:
        """The pixels of a region as they come; a view."""
        return self.pixels[self.begin[number] : self.begin[number + 1]]

    def chosen(self, keep: NDArray[np.bool_]) -> "Candidates":
        """Some of the regions."""
        size = np.diff(self.begin)
        begin = np.concatenate([[0], np.cumsum(size[keep])])
        return Candidates(self.pixels[np.repeat(keep, size)], begin, self.owner[keep], self.code[keep])


def candidates(probability: Tensor, threshold: float, max_flips: int, inside: Tensor | None = None) -> Candidates:
    """Regions of each shape {probability > threshold} that `select` may choose from.

    What can never be chosen is left out before it is made: regions of more than half of the shape, and those of a size
    of which there are too many at once. Maps of what openings and closings change are looked at from small sides to
    large ones, as far as `BUDGET` reaches. So the cost is that of some passes over the array, whatever it holds. Mirror
    images have the mirrored candidates.

    Args:
        probability: (N, *spatial) in [0, 1], on the CPU.
        threshold: the shape is where the probability is greater; in (0, 1).
        max_flips: how many regions of a shape will be chosen.
        inside: like `probability`, bool, other shapes whose regions are looked for, of which the probability tells
            where they are in doubt.

    Returns:
        The regions. One may come several times.

    Example:
        >>> found = candidates(torch.tensor([[0.9, 0.9, 0.9, 0.1, 0.9]]), 0.5, 16)
        >>> sorted({tuple(region.tolist()) for region in found.of(0)})
        [(0,), (2,), (3,), (4,)]
    """
    # In NumPy: the torch operations of a thread would start threads of their own.
    grey = probability.numpy()
    mask = grey > threshold if inside is None else inside.numpy()
    count, size = len(probability), probability[0].numel()
    step = max(1, min(ceil(count / torch.get_num_threads()), CHUNK // size))
    parts: list[tuple[NDArray[Any], ...]] = [()] * ceil(count / step)

    def gather(i: int, check: Callable[[], None]) -> None:
        some = slice(i * step, (i + 1) * step)
        parts[i] = _regions_of(grey[some], mask[some], threshold, max_flips, check)

    for_each(gather, len(parts))
    pixels, begins, owners, codes = zip(*parts, strict=True)
    ends = np.cumsum([0, *map(len, pixels)]).tolist()
    begin = [np.zeros(1, np.int64), *(begin[1:] + end for begin, end in zip(begins, ends, strict=False))]
    owner = [owner + np.int32(i * step) for i, owner in enumerate(owners)]
    return Candidates(*(np.concatenate(arrays) for arrays in (pixels, begin, owner, codes)))


def select(inside: Tensor, proposed: Candidates, max_flips: int) -> list[list[Region]]:
    """At most `max_flips` regions of each shape, each once, of all sizes, none of more than half the shape's area.

    Sizes are classed by octaves, and the largest regions left of each octave are taken in turn: large ones lead out of
    local minima, small ones say where the outline is rough. Of regions of equal size all are taken or none, so that the
    choice commutes with mirror images of the shape. A shape that all but vanishes is not a simple shape: no region of
    more than half of it is flipped.

    Example:
        >>> pixels, begin = np.array([0, 0, 1, 0, 1, 2, 0, 1, 2, 3], np.int32), np.array([0, 1, 3, 6, 10])
        >>> proposed = Candidates(pixels, begin, np.zeros(4, np.int32), np.arange(4, dtype=np.uint64))
        >>> chosen = select(torch.ones(1, 6, dtype=torch.bool), proposed, 2)
        >>> [region.tolist() for region in chosen[0]]  # 4 of 6 pixels is too many; 3 and 2 are of one octave
        [[0, 1, 2], [0]]
    """
    size = np.diff(proposed.begin)
    limit = inside.flatten(1).count_nonzero(dim=1).numpy() // 2
    order = np.flatnonzero(size <= limit[proposed.owner])
    order = order[np.lexsort((proposed.code[order], -size[order], proposed.owner[order]))]
    new = np.zeros(len(order), np.bool_)
    new[:1] = True
    for fact in (proposed.owner, size, proposed.code):
        new[1:] |= fact[order[1:]] != fact[order[:-1]]
    order = order[new]
    ends = np.searchsorted(proposed.owner[order], np.arange(len(inside) + 1)).tolist()
    sizes, numbers = size[order].tolist(), order.tolist()
    return [
        [proposed.region(numbers[i]) for i in _in_turn(sizes, range(begin, end), max_flips)]
        for begin, end in itertools.pairwise(ends)
    ]


def _in_turn(sizes: list[int], ranked: range, max_flips: int) -> list[int]:
    """The choice for one shape, from its different regions, the largest first."""
    octaves: dict[int, list[list[int]]] = {}
    for size, same_size in itertools.groupby(ranked, key=sizes.__getitem__):
        octaves.setdefault(size.bit_length(), []).append(list(same_size))
    taken: list[int] = []
    for together in itertools.chain.from_iterable(itertools.zip_longest(*octaves.values(), fillvalue=[])):
        if len(taken) == max_flips:
            break
        if len(taken) + len(together) <= max_flips:
            taken.extend(together)
    return taken


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
    found = complexities_after_flips(list(inside.numpy()), regions, measure)
    value = torch.tensor([before for before, _ in found], dtype=torch.float64, device="cpu")
    return value, [after - before for before, after in found]


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


def _regions_of(
    grey: NDArray[np.floating], mask: NDArray[np.bool_], threshold: float, max_flips: int, check: Callable[[], None]
) -> tuple[NDArray[Any], ...]:
    """Pixels, begin, owner and code of the candidates of some shapes."""
    ndim = mask.ndim - 1
    limit = np.count_nonzero(mask.reshape(len(mask), -1), axis=1) // 2
    regions = RegionList(mask.shape[1:], limit, BUDGET * mask[0].size, max_flips)
    block = [step for step in itertools.product((-1, 0, 1), repeat=ndim) if any(step)]
    around = np.array(block).reshape(-1, ndim) @ regions.strides

    def gather(maps: Maps, kind: int = 0, offsets: NDArray[np.int64] | None = None) -> None:
        """Maps that an axis swap turns into each other come together, so that the budget treats them alike."""
        check()
        steps = np.tile(around, (len(maps.order), 1)) if offsets is None else offsets
        regions.gather(maps, kind, steps, offsets is None)

    low, high = (grey > level_at_odds(threshold, level) for level in DOUBT)
    gather(_marked([low & ~mask, mask & ~high]))
    rows, along = [], []
    for axis in range(ndim):
        for direction in (1, -1):
            beside = _neighbour(mask, axis + 1, direction)
            rows += [mask & ~beside, beside & ~mask]
        faces = np.delete(regions.strides, axis)
        along += [np.concatenate([[0], faces, -faces])] * 4
    gather(_marked(rows), offsets=np.array(along))
    check()
    cubes = Maps(np.stack([_cube_sizes(mask, False), _cube_sizes(~mask, True)]), SIDES) if ndim > 1 else None
    lengths_of = _run_lengths
    if has_compiler():
        from torchlinf.kernels.openings import run_lengths as lengths_of
    lengths = [
        lengths_of(x, axis, endless) for axis in range(1, ndim + 1) for x, endless in ((mask, False), (~mask, True))
    ]
    bars = Maps(np.stack(lengths), SIDES)
    for kind in range(len(SIDES)):
        if cubes is not None:
            gather(cubes, kind)
        gather(bars, kind)
    return regions.found()


def _marked(marks: list[NDArray[np.bool_]]) -> Maps:
    """Maps of what is marked."""
    return Maps(1 - np.stack(marks).view(np.int8).astype(np.int16), (1,))


def _cube_sizes(marked: NDArray[np.bool_], endless: bool) -> NDArray[np.integer]:
    """For each marked pixel one less than the least of `SIDES` of which no cube in what is marked holds it; else 9999.

    Beyond the array all is marked if it is `endless`, else nothing. Boxes that are longer than the array are cut to its
    length and one more.
    """
    if marked.ndim == 3 and has_compiler():
        from torchlinf.kernels.openings import square_sizes

        longest = max(marked.shape[1:]) + 1
        sides = tuple(side for side in SIDES if side < longest) + (longest,) * (longest <= SIDES[-1])
        return np.stack([square_sizes(one, sides[-1] if endless else 0, sides) for one in marked])
    inside, found = torch.from_numpy(marked), np.full(marked.shape, FAR, np.int16)
    for side in reversed(SIDES):
        sides = tuple(min(side, size + 1) for size in marked.shape[1:])
        opening = ~closed(~inside, sides) if endless else opened(inside, sides)
        found[(inside & ~opening).numpy()] = side - 1
    return found


def _run_lengths(marked: NDArray[np.bool_], axis: int, endless: bool) -> NDArray[np.integer]:
    """The length of the run of marked pixels along an axis that each is in; very long elsewhere.

    So is, if the array is `endless`, a run that reaches its end.

    Example:
        >>> _run_lengths(np.array([[True, True, False, True]]), 1, False)
        array([[   2,    2, 9999,    1]], dtype=int16)
    """
    size = marked.shape[axis]
    dtype = np.int16 if size < FAR else np.int32
    place = np.arange(1, size + 1, dtype=dtype).reshape(-1, *[1] * (marked.ndim - axis - 1))
    ends = np.array([-FAR, size + FAR] if endless else [0, size + 1], dtype)
    before = np.maximum.accumulate(np.where(marked, ends[0], place), axis=axis)
    after = np.minimum.accumulate(np.flip(np.where(marked, ends[1], place), axis), axis=axis)
    lengths = np.minimum(np.flip(after, axis) - before - dtype(1), dtype(FAR))
    return np.where(marked, lengths, dtype(FAR))


def level_at_odds(threshold: float, level: float) -> float:
    """The level whose odds against the threshold are those of `level` against 1/2.

    Example:
        >>> level_at_odds(0.5, 0.3), level_at_odds(0.8, 0.5)
        (0.3, 0.8)
    """
    odds = level / (1 - level) * threshold / (1 - threshold)
    return odds / (1 + odds)


def _neighbour(mask: NDArray[np.bool_], axis: int, direction: int) -> NDArray[np.bool_]:
    """Whether the next pixel in a direction is inside; beyond the array is outside."""
    shifted = np.zeros_like(mask)
    first = (slice(None),) * axis
    near, far = (*first, slice(None, -1)), (*first, slice(1, None))
    if direction > 0:
        shifted[near] = mask[far]
    else:
        shifted[far] = mask[near]
    return shifted
