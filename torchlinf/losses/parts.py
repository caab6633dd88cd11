"""The parts of predicted shapes for the loss: objects, and shapes in their own frames, cut out of the probabilities.

A part is a small image of probabilities of which one object alone is above the threshold, turned into its frame. It
is made of the prediction by indexing and weighted sums, through which the gradient comes back.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box
from torchlinf.measure import Measure, components, in_frame, ragged_profile, require_frame, rotations_of

MARGIN = 8  # pixels around an object that may be filled; none of the small regions reaches further
STEP = 16  # sizes of parts are rounded up to multiples of it, so that many are of one size

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Part:
    """One shape in one frame.

    Attributes:
        owner: the number of the prediction that it is of.
        weight: how much it counts in the mean over the parts of that prediction.
        inside: bool, the shape in its frame, with `MARGIN` pixels around it.
        origin: where the box of the object begins in the prediction, one number an axis.
        alone: bool, of the size of the object's box, the object in it.
        back: (n, n), from a step in the frame to a step in the prediction; None if nothing is turned.
        offset: (n,), where pixel 0 of the frame lies, relative to `origin`.
    """

    owner: int
    weight: float
    inside: Mask
    origin: tuple[int, ...]
    alone: Mask
    back: NDArray[np.float64] | None
    offset: NDArray[np.float64]


def parts_of(inside: Mask, measure: Measure) -> list[Part]:
    """The parts of thresholded predictions.

    Args:
        inside: bool (N, *spatial).
        measure: how complexity is measured.

    Returns:
        Those of the first prediction first; none of an empty one. The weights of those of one prediction add up to 1.

    Raises:
        ValueError: shapes of so many dimensions cannot be turned as the measure says.

    Example:
        >>> inside = np.array([[[True, True, False, True]]])
        >>> [(part.origin, part.weight) for part in parts_of(inside, Measure(per="object"))]
        [((0, 0), 0.5), ((0, 3), 0.5)]
    """
    require_frame(measure, inside.ndim - 1)
    found = [list(_of_one(i, mask, measure)) for i, mask in enumerate(inside)]
    if measure.orientation == "least":
        found = [_least(parts, measure) for parts in found]
    totals = [sum(part.weight for part in parts) for parts in found]
    return [
        replace(part, weight=part.weight / total) for parts, total in zip(found, totals, strict=True) for part in parts
    ]


def _of_one(owner: int, mask: Mask, measure: Measure) -> Iterator[Part]:
    if measure.per == "object":
        objects = components(mask, connectivity=measure.connectivity, min_pixels=measure.min_pixels)
        shapes = [(one.box, one.mask(), one.pixels if measure.pool == "area" else 1) for one in objects]
    else:
        box = bounding_box(mask)
        shapes = [(box, mask[box], 1)] if mask[box].size else []
    for box, alone, weight in shapes:
        for number in range(rotations_of(measure)):
            turned, angle = in_frame(alone, measure, number)
            back = _rotation(measure, angle)
            offset = np.full(mask.ndim, float(-MARGIN))
            if back is not None:
                # The centre of mass stays where it is.
                offset = _centre(alone) - back @ (_centre(turned) + MARGIN)
            origin = tuple(side.start for side in box)
            yield Part(owner, weight, np.pad(turned, MARGIN), origin, alone, back, offset)


def _least(parts: list[Part], measure: Measure) -> list[Part]:
    """Of the frames of each object the one with the least complexity."""
    rotations = rotations_of(measure)
    means = ragged_profile(lambda i: parts[i].inside, len(parts), measure.plain()).mean(measure.low, measure.high)
    best = means.reshape(-1, rotations).argmin(dim=1).tolist() if parts else []
    return [parts[i * rotations + number] for i, number in enumerate(best)]


def _rotation(measure: Measure, angle: float) -> NDArray[np.float64] | None:
    """From a step in the turned frame to a step in the prediction; None if there is no turn."""
    if isinstance(measure.orientation, tuple):
        return None if angle == 0 else np.array(measure.orientation).T
    if angle == 0:
        return None
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.array([[cos, sin], [-sin, cos]])


def _centre(mask: Mask) -> NDArray[np.float64]:
    mean: NDArray[np.float64] = np.argwhere(mask).mean(axis=0)
    return mean


def others_of(part: Part, inside: Mask) -> Mask:
    """What else is inside in the prediction that a part is of.

    >>> inside = np.array([[True, True, False, True]])
    >>> others_of(parts_of(inside[None], Measure(per="object"))[0], inside)
    array([[False, False, False,  True]])
    """
    others = inside.copy()
    others[tuple(slice(o, o + size) for o, size in zip(part.origin, part.alone.shape, strict=True))] &= ~part.alone
    return others


def cut_out(image: Tensor, part: Part, others: Mask | None = None) -> Tensor:
    """The values of an image in the frame of a part; differentiable in the image.

    Args:
        image: (*spatial), floating point.
        part: the part; beyond the image is 0.
        others: bool (*spatial), pixels of other shapes, which are taken as 0; None if there are none.

    Returns:
        Tensor of the size of `part.inside`, the linear interpolation of the values of the pixels.

    Example:
        >>> inside = np.array([[True, True, False, True]])
        >>> first, _ = parts_of(inside[None], Measure(per="object"))
        >>> cut_out(torch.tensor([[0.9, 0.8, 0.3, 0.7]]), first, np.array([[False, False, False, True]]))[8, 7:13]
        tensor([0.0000, 0.9000, 0.8000, 0.3000, 0.0000, 0.0000])
    """
    size = np.array(image.shape)
    steps = np.indices(part.inside.shape).reshape(image.ndim, -1).astype(np.float64)
    turned = steps if part.back is None else part.back @ steps
    place = turned + (part.offset + part.origin)[:, None]  # (n, pixels) in the image
    first = np.floor(place).astype(np.int64)
    rest = place - first
    flat, result = image.reshape(-1), image.new_zeros(steps.shape[1])
    kept = np.ones(flat.numel(), dtype=np.bool_) if others is None else ~others.reshape(-1)
    for corner in product((0, 1), repeat=image.ndim):
        share = np.prod([part_of if up else 1 - part_of for up, part_of in zip(corner, rest, strict=True)], axis=0)
        at = first + np.array(corner)[:, None]
        within = ((at >= 0) & (at < size[:, None])).all(axis=0) & (share > 0)
        index = np.ravel_multi_index(tuple(np.where(within, at, 0)), tuple(size))
        share = share * (within & kept[index])
        if share.any():
            result = result + flat[torch.from_numpy(index).to(image.device)] * torch.from_numpy(share).to(result)
    return result.reshape(part.inside.shape)


def consistent(values: Tensor, part: Part, threshold: float) -> Tensor:
    """Probabilities, without a gradient, moved to that side of the threshold on which the shape in its frame has them.

    Example:
        >>> (part,) = parts_of(np.ones((1, 1, 1), dtype=bool), Measure(per="object"))
        >>> consistent(torch.full((17, 17), 0.75), part, 0.5)[8, 7:9]
        tensor([0.5000, 0.7500])
    """
    inside = torch.from_numpy(part.inside).to(values.device)
    above = threshold + (1 - threshold) * 1e-3
    values = values.detach().clamp(0, 1)
    return torch.where(inside, values.clamp(min=above), values.clamp(max=threshold))


def like_sizes(parts: list[Part]) -> Iterator[list[int]]:
    """The numbers of the parts, in groups of like size."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for i, part in enumerate(parts):
        groups.setdefault(tuple(-(-side // STEP) for side in part.inside.shape), []).append(i)
    yield from groups.values()


def padded_to(image: Tensor, group: Sequence[Tensor]) -> Tensor:
    """An image with zeros behind it, of the size of the largest sides in its group.

    >>> padded_to(torch.ones(1, 2), [torch.ones(1, 2), torch.ones(2, 1)])
    tensor([[1., 1.],
            [0., 0.]])
    """
    most = [max(sides) for sides in zip(*(one.shape for one in group), strict=True)]
    behind = [(0, side - size) for side, size in zip(most, image.shape, strict=True)]
    return torch.nn.functional.pad(image, [end for pair in reversed(behind) for end in pair])
