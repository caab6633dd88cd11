"""Moves: regions of a shape that might be removed or filled as a whole, and what each does to the complexity, exactly.

No pixel alone matters much to the complexity of a shape: a bump has to go as
a whole. So the regions are what squares (n-cubes) and bars of a few pixels cannot reach, what a grey prediction is in
doubt about, and rows of pixels along straight pieces of the boundary.
"""

import itertools
from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from torchlinf._morphology import closed, opened
from torchlinf.measure import complexity

# Sides in pixels of the squares and bars that open and close the shape: every small one, then in steps of sqrt 2. The
# large ones are what leads a disc out of its local minimum, where no small move helps.
SIDES = (2, 3, 4, 5, 6, 7, 8, 11, 16, 23, 32, 45, 64)
DOUBT = (0.3, 0.7)  # levels of the prediction that are compared with the shape, for a threshold of 1/2
SOLVE_PIXELS = 1 << 22  # of the masks that are solved in one call, which bounds the memory

Move = np.ndarray  # flat indices of the pixels of a region, all inside or all outside the shape


def move_gradient(
    probability: Tensor, *, threshold: float, low: float, high: float, max_moves: int, deformations: bool = False
) -> tuple[Tensor, Tensor]:
    """Hard complexity of each thresholded shape, and the density of its exact differences under moves.

    Args:
        probability: (N, *spatial) in [0, 1], on the CPU.
        threshold: the shape is where the probability is larger.
        low: lower end of the window of scales.
        high: its upper end.
        max_moves: moves tried per shape.
        deformations: whether the density is corrected by `torchlinf.losses.deformations`.

    Returns:
        The complexity, (N,) float64, NaN for an empty shape, and the density G like `probability`, float64: the sum
        over the moves R of +-dC(R) / |R| on the pixels of R, + where R is outside and - where it is inside. Its sum
        over a change of the shape says how much that change is worth.

    Example:
        >>> from torchlinf import shapes
        >>> shape = shapes.with_appendages((9, 9), [shapes.Appendage("right", 3, 2)], margin=2)
        >>> value, density = move_gradient(shape[None].float(), threshold=0.5, low=0.0, high=1.0, max_moves=16)
        >>> value, density[0, 6, 11:13] > 0  # descent removes the appendage
        (tensor([0.2369], dtype=torch.float64), tensor([True, True]))
    """
    probability = probability.contiguous()
    inside = probability > threshold
    moves = select(inside, candidates(probability, threshold), max_moves)
    value, difference = differences(inside, moves, low, high)
    density = np.zeros((len(inside), inside[0].numel()))
    for n, (shape, tried) in enumerate(zip(inside.flatten(1).numpy(), moves, strict=True)):
        for move, gain in zip(tried, difference[n], strict=True):
            density[n, move] += (-gain if shape[move[0]] else gain) / len(move)
    if deformations:
        _correct(density, value, inside, low, high)
    return value, torch.from_numpy(density).reshape(inside.shape)


def _correct(density: np.ndarray, value: Tensor, inside: Tensor, low: float, high: float) -> None:
    """Correct the density (N, P) of each shape in place by its deformations."""
    from torchlinf.losses.deformations import correct, deformed

    lines = [deformed(shape) for shape in inside.numpy()]
    masks = (torch.from_numpy(mask) for line in lines for mask in line.reshape(-1, *inside.shape[1:]))
    found = _complexities(masks, inside, low, high).split([line.shape[0] * line.shape[1] for line in lines])
    for n, (line, values) in enumerate(zip(lines, found, strict=True)):
        density[n] = correct(density[n], value[n].item(), line, values.numpy().reshape(line.shape[:2]))


def candidates(probability: Tensor, threshold: float) -> list[list[Move]]:
    """Regions of each shape {probability > threshold}; (N, *spatial), contiguous, gives N lists.

    A region may come several times, and its pixels in any order.

    Example:
        >>> moves = candidates(torch.tensor([[0.9, 0.9, 0.9, 0.1, 0.9]]), 0.5)
        >>> [move.tolist() for move in moves[0]][:3]
        [[4], [4], [3]]
    """
    inside = probability > threshold
    found: list[list[Move]] = [[] for _ in inside]
    ndim = inside.ndim - 1
    block = [step for step in itertools.product((-1, 0, 1), repeat=ndim) if any(step)]
    for region, steps in _maps(probability, inside, threshold, block):
        for n, move in _regions(region, steps, whole=steps is block):
            found[n].append(move)
    return found


def select(inside: Tensor, moves: list[list[Move]], max_moves: int) -> list[list[Move]]:
    """At most `max_moves` moves of each shape, each once, of all sizes, none of more than half the shape's area.

    Sizes are classed by octaves, and the largest moves left of each octave are taken in turn: large moves lead out of
    local minima, small ones say where the outline is rough. Of moves of equal size all are taken or none, so that the
    choice commutes with flips of the shape. A shape that all but vanishes is not a simple shape: moves towards that
    must never be proposed.
    """
    chosen: list[list[Move]] = []
    for shape, found in zip(inside, moves, strict=True):
        limit = int(shape.sum()) // 2
        ranked = sorted((move for move in found if len(move) <= limit), key=len, reverse=True)
        octaves: dict[int, list[list[Move]]] = {}
        for size, tied in itertools.groupby(ranked, key=len):
            octaves.setdefault(size.bit_length(), []).append(list(tied))
        taken: list[Move] = []
        for together in itertools.chain.from_iterable(itertools.zip_longest(*octaves.values(), fillvalue=[])):
            if len(taken) == max_moves:
                break
            different = {move.tobytes(): move for move in map(np.sort, together)}
            if len(taken) + len(different) <= max_moves:
                taken.extend(different.values())
        chosen.append(taken)
    return chosen


def differences(inside: Tensor, moves: list[list[Move]], low: float, high: float) -> tuple[Tensor, list[np.ndarray]]:
    """Complexity of each shape (N,), and for each of its moves the complexity after the move minus before."""
    counts = [1 + len(tried) for tried in moves]
    parts = _complexities(_moved(inside, moves), inside, low, high).split(counts)
    value = torch.stack([part[0] for part in parts])
    return value, [(part[1:] - part[0]).numpy() for part in parts]


def _complexities(masks: Iterator[Tensor], like: Tensor, low: float, high: float) -> Tensor:
    """Complexity of any number of masks of the size of the shapes in `like`, in calls of bounded memory."""
    scores = [torch.empty(0, dtype=torch.float64)]
    step = max(1, SOLVE_PIXELS // like[0].numel())
    while chunk := list(itertools.islice(masks, step)):
        scores.append(complexity(torch.stack(chunk), low=low, high=high, spatial_ndim=like.ndim - 1))
    return torch.cat(scores)


def _moved(inside: Tensor, moves: list[list[Move]]) -> Iterator[Tensor]:
    """Each shape, followed by the shape after each of its moves."""
    for shape, tried in zip(inside, moves, strict=True):
        yield shape
        for move in tried:
            after = shape.clone()
            after.view(-1)[torch.from_numpy(move)] ^= True
            yield after


Steps = list[tuple[int, ...]]


def _maps(probability: Tensor, inside: Tensor, threshold: float, block: Steps) -> Iterator[tuple[Tensor, Steps]]:
    """Maps of what might be flipped, (N, *spatial) bool, and the steps between pixels that are flipped together."""
    ndim = inside.ndim - 1
    for side in SIDES:
        bars = [tuple(side if i == axis else 1 for i in range(ndim)) for axis in range(ndim)]
        for sides in dict.fromkeys([(side,) * ndim, *bars]):
            yield inside & ~opened(inside, sides), block
            yield closed(inside, sides) & ~inside, block
    for level in DOUBT:
        # The levels keep their odds against the threshold.
        yield (probability > _shifted(threshold, level)) ^ inside, block
    for axis in range(ndim):
        along = [step for step in block if step[axis] == 0 and sum(map(abs, step)) == 1]
        for direction in (1, -1):
            beside = _neighbour(inside, axis + 1, direction)
            yield inside & ~beside, along
            yield beside & ~inside, along


def _shifted(threshold: float, level: float) -> float:
    """The level whose odds are those of `level`, times those of the threshold."""
    odds = level / (1 - level) * threshold / (1 - threshold)
    return odds / (1 + odds)


def _regions(region: Tensor, steps: Steps, whole: bool) -> Iterator[tuple[int, Move]]:
    """Each map as a whole, if asked for, and each of its connected regions; with the number of its shape."""
    from torchlinf.kernels.regions import flood

    padded = torch.nn.functional.pad(region.view(torch.uint8), [1, 1] * (region.ndim - 1))
    strides = np.array(padded.stride()[1:])
    index = torch.full(padded.shape[1:], -1)
    index[(slice(1, -1),) * (region.ndim - 1)] = torch.arange(region[0].numel()).reshape(region.shape[1:])
    offsets = np.array(steps, dtype=np.int64).reshape(-1, region.ndim - 1) @ strides
    pixels, begin, owner = flood(padded.flatten(1).numpy(), offsets)
    pixels = index.flatten().numpy()[pixels]
    if whole:
        first = begin[np.searchsorted(owner, np.arange(len(region) + 1))].tolist()
        yield from ((n, pixels[first[n] : first[n + 1]]) for n in range(len(region)) if first[n + 1] > first[n])
    begin = begin.tolist()
    yield from ((n, pixels[begin[i] : begin[i + 1]]) for i, n in enumerate(owner.tolist()))


def _neighbour(inside: Tensor, dim: int, direction: int) -> Tensor:
    """Whether the next pixel in a direction is inside; beyond the array is outside."""
    shifted = torch.zeros_like(inside)
    size = inside.shape[dim] - 1
    near, far = (0, 1) if direction > 0 else (1, 0)
    shifted.narrow(dim, near, size).copy_(inside.narrow(dim, far, size))
    return shifted
