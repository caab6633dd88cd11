"""The estimators, in torch operations: how much the values of a level vary. The bins and their edges are here.

The values of all levels of all shapes stand in one flat list, beside the number of the level that each belongs to. So
shapes of different radius need no padding, and one call treats all of them.
"""

import math
from collections.abc import Callable

import torch
from torch import Tensor

# The lower edge of every bin lies this share of a bin below its nominal place; see level_entropy.
EDGE_SLACK = 1e-6
# Entries of the table of bins that bounds are found with.
TABLE = 1 << 22


def level_entropy(values: Tensor, level: Tensor, num_levels: int, bins: int = 1024) -> Tensor:
    """Entropy in bits of the histogram of the values on each level.

    The bins are equal and fixed on [0, 1], the last one closed. Each edge is lowered by 1e-6 of a bin, which at 1024
    bins is 1e-9 of the range, the solver's default tolerance: values that are equal in exact arithmetic and lie ON an
    edge, as on symmetric shapes, are then not split over two bins by rounding.

    Args:
        values: (P,) floating point, in [0, 1].
        level: (P,) int64, in [0, num_levels): the level each value belongs to.
        num_levels: number of levels.
        bins: number of bins.

    Returns:
        (num_levels,) tensor of the dtype of `values`, in [0, log2(bins)]; exactly 0.0 where all values share a bin, NaN
        for a level without a value. It depends neither on the order of the values nor on what else is in the batch, and
        is the same in every run on CPU and CUDA. Memory is O(P + num_levels), whatever the number of bins. Not
        differentiable.

    Example:
        >>> values = torch.tensor([0.1, 0.2, 0.3, 0.4, 0.5, 0.5], dtype=torch.float64)
        >>> level_entropy(values, torch.tensor([0, 0, 0, 0, 1, 1]), 2)
        tensor([2., 0.], dtype=torch.float64)
    """
    # Only the cells that occur are kept: a dense table would have num_levels * bins of them.
    cell, cell_count = torch.unique(level * bins + bin_of(values, bins), return_counts=True)
    level_of_cell = cell.div(bins, rounding_mode="floor")
    size = torch.bincount(level, minlength=num_levels)  # (num_levels,)
    share = cell_count.to(values.dtype) / size[level_of_cell]
    # An entropy is at most log2(bins) <= 20.
    entropy = segment_sum(-share * share.log2(), level_of_cell, torch.full_like(size, 32))
    return entropy.masked_fill(size == 0, torch.nan)


def bin_of(values: Tensor, bins: int) -> Tensor:
    """Number of the bin that each value in [0, 1] falls into.

    Args:
        values: any shape, floating point, in [0, 1].
        bins: number of bins.

    Returns:
        int64 tensor like `values`, in [0, bins); the edges are those of `level_entropy`.

    Example:
        >>> bin_of(torch.tensor([0.0, 0.25, 0.4, 1.0]), 4)
        tensor([0, 1, 1, 3])
    """
    return (values * bins + EDGE_SLACK).floor().clamp(0, bins - 1).long()


def entropy_bounds(values: Tensor, level: Tensor, entropies: Tensor, error: Tensor, bins: int = 1024) -> Tensor:
    """How far the entropy of each level can be from that of the exact field, in bits.

    A value is known to a factor of (1 + e) / (1 - e). It is in doubt if that interval meets several bins. Of every bin
    it is known how many values it holds at least and at most, so its term -x log2 x lies in an interval, and the sum of
    these intervals holds the entropy. No bound is larger than Audenaert's, m/n log2(bins - 1) + h2(m/n) with m of n
    values in doubt.

    Args:
        values: (P,) floating point, in [0, 1].
        level: (P,) int64, in [0, num_levels): the level each value belongs to.
        entropies: (num_levels,) what `level_entropy` found.
        error: (num_levels,) e, the relative error of the field that the level belongs to; inf where nothing is known.
        bins: number of bins.

    Returns:
        (num_levels,) tensor of the dtype of `values`, 0 or more; 0.0 where no value is in doubt.

    Example:
        >>> values = torch.tensor([0.3, 0.3, 0.3, 0.5], dtype=torch.float64)  # one lies at the edge of two bins
        >>> level = torch.zeros(4, dtype=torch.int64)
        >>> found = level_entropy(values, level, 1, bins=2)
        >>> found, entropy_bounds(values, level, found, torch.tensor([1e-4]), bins=2)
        (tensor([0.8113], dtype=torch.float64), tensor([0.8113], dtype=torch.float64))
    """
    known = error < 1
    e = torch.where(known, error, 0).to(values.dtype)
    factor = ((1 + e) / (1 - e) * (1 + 4 * torch.finfo(values.dtype).eps))[level]
    low = torch.where(known[level], bin_of(values / factor, bins), 0)
    high = torch.where(known[level], bin_of((values * factor).clamp(max=1), bins), bins - 1)
    size = torch.bincount(level, minlength=len(entropies))
    doubtful = torch.bincount(level[low != high], minlength=len(entropies))
    bounds = torch.zeros_like(entropies)
    # Levels in doubt only, and so many at a time that the table of their bins stays small.
    for some in doubtful.nonzero()[:, 0].split(max(1, TABLE // (bins + 1))):
        row = torch.full_like(size, -1)
        row[some] = torch.arange(len(some), device=some.device)
        of = row[level]
        mine = of >= 0
        args = (of[mine], low[mine], high[mine], bin_of(values[mine], bins), bins)
        bounds[some] = _deviation(*args, size[some], doubtful[some], entropies[some])
    return bounds


def _deviation(
    row: Tensor, low: Tensor, high: Tensor, now: Tensor, bins: int, size: Tensor, doubtful: Tensor, entropy: Tensor
) -> Tensor:
    """The largest difference in entropy of each level (row), from how many values each bin holds at least and most."""
    table = entropy.new_zeros(len(size), bins + 1)
    first = row * (bins + 1)
    one = torch.ones_like(row, dtype=entropy.dtype)
    certain = table.clone().view(-1).index_add(0, (first + low)[low == high], one[low == high]).view_as(table)
    count = table.clone().view(-1).index_add(0, first + now, one).view_as(table)
    change = table.view(-1).index_add(0, first + low, one).index_add(0, first + high + 1, -one).view_as(table)
    share = [x[:, :bins] / size[:, None] for x in (certain, change.cumsum(dim=1), count)]
    terms = [-torch.special.xlogy(x, x) / math.log(2) for x in share]
    most = torch.maximum(terms[0], terms[1])
    most = torch.where((share[0] * math.e < 1) & (share[1] * math.e > 1), math.log2(math.e) / math.e, most)
    moved = share[1] > share[0]
    rise = torch.where(moved, most - terms[2], 0).sum(dim=1)
    fall = torch.where(moved, terms[2] - torch.minimum(terms[0], terms[1]), 0).sum(dim=1)
    # An entropy lies between 0 and the logarithm of the number of values or bins.
    bound = torch.maximum(torch.minimum(rise, size.clamp(max=bins).to(entropy).log2() - entropy), fall.minimum(entropy))
    if bins > 1:
        part = (doubtful / size).to(entropy)
        binary = -(torch.special.xlogy(part, part) + torch.special.xlogy(1 - part, 1 - part)) / math.log(2)
        formula = part * math.log2(bins - 1) + binary
        bound = torch.where(part <= 1 - 1 / bins, torch.minimum(bound, formula), bound)
    return bound.clamp(min=0)


def std_bounds(values: Tensor, level: Tensor, num_levels: int, error: Tensor) -> Tensor:
    """How far the standard deviation of each level can be from that of the exact field.

    Values move by at most ((1 + e) / (1 - e) - 1) times themselves. A standard deviation changes by no more than the
    root mean square of what its values change by.

    Args:
        values: (P,) floating point, in [0, 1].
        level: (P,) int64, the level each value belongs to.
        num_levels: number of levels.
        error: (num_levels,) the relative error of the field that the level belongs to.

    Returns:
        (num_levels,) tensor of the dtype of `values`, in [0, 0.5].

    Example:
        >>> std_bounds(torch.ones(2), torch.tensor([0, 0]), 1, torch.tensor([0.01])).round(decimals=4)
        tensor([0.0202])
    """
    e = torch.where(error < 1, error, torch.nan).to(values.dtype)
    square = torch.zeros(num_levels, dtype=values.dtype, device=values.device).index_add(0, level, values.square())
    size = torch.bincount(level, minlength=num_levels)
    return (2 * e / (1 - e) * (square / size).sqrt()).nan_to_num(nan=0.5).clamp(max=0.5)


def level_std(values: Tensor, level: Tensor, num_levels: int, bins: int = 1024) -> Tensor:
    """Population standard deviation (divided by n, not n - 1) of the values on each level.

    Args:
        values: (P,) floating point.
        level: (P,) int64, in [0, num_levels): the level each value belongs to.
        num_levels: number of levels.
        bins: not used; here so that all estimators are called alike.

    Returns:
        (num_levels,) tensor of the dtype of `values`, in their unit; exactly 0.0 where all values are equal, NaN for
        a level without a value. It depends neither on the order of the values nor on what else is in the batch, and is
        the same in every run on CPU and CUDA. Not differentiable.

    Example:
        >>> values = torch.tensor([0.1, 0.1, 0.2, 0.4], dtype=torch.float64)
        >>> level_std(values, torch.tensor([0, 0, 1, 1]), 2)
        tensor([0.0000, 0.1000], dtype=torch.float64)
    """
    size = torch.bincount(level, minlength=num_levels)
    lowest = values.new_full((num_levels,), torch.inf).scatter_reduce(0, level, values, "amin")
    highest = values.new_full((num_levels,), -torch.inf).scatter_reduce(0, level, values, "amax")
    spread = highest - lowest
    # Counted from the level's lowest value a uniform level is exactly 0; in units of the level's own spread the squares
    # of tiny deviations are not lost.
    unit = torch.where(spread > 0, spread, 1.0)
    height = (values - lowest[level]) / unit[level]  # in [0, 1]
    mean = segment_sum(height, level, size) / size
    variance = segment_sum((height - mean[level]).square(), level, size) / size
    return (spread * variance.sqrt()).masked_fill(size == 0, torch.nan)


def segment_sum(terms: Tensor, segment: Tensor, bound: Tensor) -> Tensor:
    """Sum the terms of each segment, the same to the last bit in whatever order they come.

    Floating-point addition depends on the order of the terms: on CUDA on the scheduling, everywhere on flips of the
    shape. So the terms are rounded once to integers, in steps below bound / 2^60, and those are added exactly.

    Args:
        terms: (P,) floating point, each in [0, bound of its segment].
        segment: (P,) int64, the segment each term belongs to.
        bound: (S,) what the sum of each segment cannot exceed, non-negative.

    Returns:
        (S,) tensor of the dtype of the terms; an empty segment gives 0.0, and no sum is -0.0.

    Example:
        >>> segment_sum(torch.tensor([0.5, 0.25, 1.0]), torch.tensor([0, 0, 2]), torch.tensor([1, 1, 1]))
        tensor([0.7500, 0.0000, 1.0000])
    """
    exponent = torch.frexp(bound.to(terms.dtype)).exponent  # bound <= 2^exponent
    # 2^61, not 2^63: room for the sign and for the rounding of every term.
    scale = torch.ldexp(torch.ones_like(bound, dtype=terms.dtype), 61 - exponent)
    total = torch.zeros_like(bound, dtype=torch.int64)
    total.index_add_(0, segment, (terms * scale[segment]).round().long())
    return total.to(terms.dtype) / scale


ESTIMATORS: dict[str, Callable[[Tensor, Tensor, int, int], Tensor]] = {"entropy": level_entropy, "std": level_std}
