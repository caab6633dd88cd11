"""Differentiable complexity of a probability."""

import math
from typing import Unpack

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from torchlinf._helpers.checks import count, positive, positive_tensor
from torchlinf.field import (
    FieldSolution,
    as_probability,
    largest,
    length_of,
    normalised,
    number_of_slices,
    occupancy_of,
    occupied_field,
    soft_distance_of,
)
from torchlinf.measure.options import Measure, SoftOptions, takes

FLOOR = 1e-4  # of the standard deviation, where its square root would have no derivative
LIGHT = 1e-9  # share of a level below which a pixel does not count
GROUP_PIXELS = 1 << 16  # of the shapes that are looked at together
APART = 64.0  # bandwidths between the values of two levels: exp(-64) is nothing

Soft = tuple[tuple[float, float], str, float]  # window of scales, estimator, bandwidth


@takes(SoftOptions)
def soft_complexity(
    probability: Tensor,
    *,
    bandwidth: float = 1 / 1024,
    slices: int = 1,
    spatial_ndim: int | None = None,
    **options: Unpack[SoftOptions],
) -> Tensor:
    """A differentiable stand-in for `complexity`, of a probability.

    The probability is cut into slices, see `soft_linf_field`. Each is divided by the occupancy it reaches; the result
    is the mean of their complexities, weighted by that occupancy. In each a pixel of occupancy o and soft distance d
    belongs to level k with weight o max(0, 1 - |d - k|). A level's value is

        E_k = - sum_i w_i log2 sum_j w_j K(|f_i - f_j| / bandwidth),    K(r) = (1 + r) exp(-r),

    with weights that sum to 1: the entropy in bits of a histogram whose bins are the values themselves, where values
    count as one as far as they are similar. It is 0 on a level of equal values, and no bin edge makes it jump.

    Args:
        probability: (B, C, *spatial) with 1 to 4 spatial dimensions, floating point in [0, 1].
        bandwidth: distance within which values of the normalised field are similar. On binary masks the result grows as
            it shrinks; around the width of a bin of the hard histogram, 1/1024, it follows `complexity` most closely.
        slices: number of equal intervals the probability is cut into, 1 or more. More follow grey
            masks better, at as many times the work; on a binary mask all are the same and one is taken.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.
        {measure options}
            Here rho None means each slice's own radius, and "std" is the weighted standard deviation less what rounds
            its foot, sqrt(variance + 1e-8) - 1e-4.

    Returns:
        Tensor of the leading shape and the dtype of `probability`, in bits or shares of the field's maximum. 0 for an
        empty mask, which is not a simple shape: count such masks apart. At most 1e-3 on shapes of complexity 0.
        Differentiable once with respect to `probability` and `rho`, in memory of the order of the pixels, whatever the
        radius and the bandwidth. `torch.compile` breaks its graph here, so that `fullgraph=True` raises.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong rank or value.
        RuntimeError: a field, or in the backward pass its gradient, could not be solved.

    Source: the levels and scales are those of `complexity`; docs/notes/regulariser compares it with the loss.

    Example:
        >>> from torchlinf import shapes
        >>> masks = torch.stack([shapes.box(17, 17), shapes.disc(8)]).double()
        >>> simple, disc = soft_complexity(masks, spatial_ndim=2)
        >>> simple < 1e-9, disc
        (tensor(True), tensor(0.6233, dtype=torch.float64))
    """
    measure, rho = Measure.of(options, SoftOptions), options.get("rho")
    shapes, lead = as_probability(probability, spatial_ndim)
    number, bandwidth = count(slices, "slices"), positive(bandwidth, "bandwidth")
    number = number_of_slices(shapes, number)
    size = max(1, GROUP_PIXELS // max(1, shapes[0].numel() if len(shapes) else 1))
    groups = list(shapes.split(size)) if len(shapes) else []
    rhos: list[float | Tensor | None] = [rho] * len(groups)
    if isinstance(rho, Tensor):
        positive_tensor(rho, lead, "rho")
        rhos = list(rho.broadcast_to(lead).reshape(-1).split(size))
    soft = ((measure.low, measure.high), measure.estimator, bandwidth)
    found = [_of_group(*group, number, measure.tol, soft) for group in zip(groups, rhos, strict=True)]
    result = torch.cat(found) if found else shapes.sum(dim=tuple(range(1, shapes.ndim)))
    return result.reshape(lead).to(probability.dtype)


def _of_group(shapes: Tensor, rho: float | Tensor | None, number: int, tol: float, options: Soft) -> Tensor:
    """The result for a group of shapes, `(N,)`.

    For the backward pass only its fields are kept. All else is made again, so that of one group alone it is in memory.
    """
    known: list[list[FieldSolution]] = [[] for _ in range(number)]

    def mean(shapes: Tensor, rho: float | Tensor | None) -> Tensor:
        values, weights = [], []
        for low in range(number):
            occupancy, reached = occupancy_of(shapes, number, low)
            distance = soft_distance_of(occupancy)
            length = length_of(rho, (len(shapes),), distance)
            field = normalised(occupied_field(occupancy, length, tol, known[low]))
            values.append(reached * _mean_over_scales(field, distance, occupancy, *options))
            weights.append(reached)
        weight = torch.stack(weights).sum(dim=0)
        return torch.stack(values).sum(dim=0) / torch.where(weight > 0, weight, 1)

    result: Tensor = checkpoint(mean, shapes, rho, use_reentrant=False, preserve_rng_state=False)
    return result


def _mean_over_scales(
    field: Tensor, distance: Tensor, occupancy: Tensor, scales: tuple[float, float], estimator: str, bandwidth: float
) -> Tensor:
    """Mean over scales of the level values of every shape, `(N,)`."""
    radius = largest(distance)
    levels = int(radius.detach().max().ceil()) if len(radius) else 0
    if levels == 0:
        return 0 * radius
    cell, weight, value = _members(field.flatten(1), distance.flatten(1), occupancy.flatten(1), levels)
    found = ESTIMATORS[estimator](cell, weight, value, len(radius) * levels, bandwidth).view(-1, levels)
    level = torch.arange(1, levels + 1, device=radius.device).to(radius)
    D = torch.where(radius > 0, radius, 1)[:, None]
    low, high = scales
    overlap = ((level / D).clamp(max=high) - ((level - 1) / D).clamp(min=low)).clamp(min=0)
    return (found * overlap).sum(dim=1) / (high - low)


def _members(field: Tensor, distance: Tensor, occupancy: Tensor, levels: int) -> tuple[Tensor, Tensor, Tensor]:
    """Which (shape, level) cell pixels belong to, with what weight, and their field: one or two entries a pixel."""
    floor = distance.detach().floor().clamp(max=levels - 1)
    share = distance - floor  # of level floor + 1; the rest is level floor's
    first = torch.arange(len(field), device=field.device)[:, None] * levels
    entries = []
    for level, part in ((floor, 1 - share), (floor + 1, share)):
        weight = part * occupancy
        keep = (level >= 1) & (weight.detach() > LIGHT)
        entries.append(((first + level.long() - 1)[keep], weight[keep], field[keep]))
    cell, weight, value = (torch.cat(parts) for parts in zip(*entries, strict=True))
    size = weight.new_zeros(len(field) * levels).index_add(0, cell, weight)
    return cell, weight / size[cell], value


def similarity_entropy(cell: Tensor, weight: Tensor, value: Tensor, cells: int, bandwidth: float) -> Tensor:
    """-sum_i w_i log2 sum_j w_j K(|f_i - f_j| / h) in every cell, `(cells,)`; 0 in an empty one.

    On sorted values a sum over exp(-r) is a running sum to either side, taken as running log-sum-exps over all cells
    at once, which lie too far apart to feel each other.
    """
    order = (cell + value.detach() / 2).argsort(stable=True)
    cell, weight, value = cell[order], weight[order], value[order]
    x = value / bandwidth
    place = x + cell * (1 / bandwidth + APART)
    near = _running(place, weight, x) + _running(-place.flip(0), weight.flip(0), -x.flip(0)).flip(0) - weight
    terms = -weight * near.clamp(max=1).log2()
    return terms.new_zeros(cells).index_add(0, cell, terms)


def _running(place: Tensor, weight: Tensor, x: Tensor) -> Tensor:
    """sum over j <= i of w_j (1 + r) exp(-r), r = place_i - place_j, for ascending places."""
    sums = (torch.logcumsumexp(place + weight.log(), 0) - place).exp()
    # moments about the lowest x of all, so that their terms are positive and have logarithms
    height = x - x.detach().amin() + 1
    moments = (torch.logcumsumexp(place + (weight * height).log(), 0) - place).exp()
    return (1 + height) * sums - moments


def soft_deviation(cell: Tensor, weight: Tensor, value: Tensor, cells: int, bandwidth: float) -> Tensor:
    """Weighted standard deviation in every cell, rounded at its foot; `bandwidth` is not used."""
    mean = weight.new_zeros(cells).index_add(0, cell, weight * value)
    variance = weight.new_zeros(cells).index_add(0, cell, weight * (value - mean[cell]).square())
    return (variance + FLOOR**2).sqrt() - math.sqrt(FLOOR**2)


ESTIMATORS = {"entropy": similarity_entropy, "std": soft_deviation}
