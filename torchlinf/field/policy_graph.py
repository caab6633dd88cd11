"""The policies of a field in torch operations, and the values that they lead to: (2+s) v(x) - v(up) - v(down) = 1.

Pixels that are equal in value, block maximum and block minimum have the same equation, and are one unknown, a class.
On real shapes this leaves a few thousand classes of tens of thousands of pixels. Where up(x) = y and down(y) = x the
two are linked. A maximal chain of links is a tridiagonal system with constant coefficients, so each of its values is
v = a v(A) + b v(B) + c in closed form, with A below its lowest and B above its highest class. Left are the classes that
are an A or a B: some hundreds, which `solve_by_elimination` solves.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchlinf.field.elimination import Terms, solve_by_elimination

MIX = (-7046029254386353131, -4417276706812531889, -8796714831421723037)  # odd numbers that mix the bits of a key


@dataclass(frozen=True)
class Pixels:
    """The pixels of the shapes on the line of a layout, in its order.

    Attributes:
        place: where on the line, (P,).
        shape: of which shape, (P,).
        rank: the how manieth of its shape, (P,).
        index: for each place of the line the number of its pixel, P where none is.
        screening: s of each shape.
    """

    place: Tensor
    shape: Tensor
    rank: Tensor
    index: Tensor
    screening: Tensor


def solve_policies(pixels: Pixels, tie: Tensor, highs: list[Tensor], lows: list[Tensor], strides: list[int]) -> Tensor:
    """The values, (P,), that the policies of a field lead to.

    Args:
        pixels: of all shapes.
        tie: of each shape, how much equal values may differ.
        highs: the field, and its maxima over the last axis, the last two ..., all; lines of one layout.
        lows: the same with minima.
        strides: of the line, one an axis.
    """
    label, first = _classes(pixels, tie, highs, lows)
    place, shape, rank = (x.index_select(0, first) for x in (pixels.place, pixels.shape, pixels.rank))
    near = tie.index_select(0, shape)
    up = _neighbour(highs, strides, place, highs[-1].index_select(0, place) - near, torch.ge)
    down = _neighbour(lows, [-stride for stride in strides], place, lows[-1].index_select(0, place) + near, torch.le)
    up, down = (label.index_select(0, pixels.index.index_select(0, x)) for x in (up, down))
    screening = pixels.screening.index_select(0, shape)
    value = _values(up, down, highs[0].index_select(0, place), screening, rank, shape)
    return value.index_select(0, label[:-1])


def _classes(pixels: Pixels, tie: Tensor, highs: list[Tensor], lows: list[Tensor]) -> tuple[Tensor, Tensor]:
    """The class of each pixel, and of the outside as the last; and the first pixel of each class, ascending."""
    key, scale = pixels.shape * MIX[2], tie.reciprocal().index_select(0, pixels.shape)
    for line, odd in zip((highs[0], highs[-1], lows[-1]), MIX, strict=True):
        key = line.index_select(0, pixels.place).mul_(scale).round_().long().add_(key).mul_(odd)
    count = len(key)
    first = _first_equal(key)
    is_first = first == torch.arange(count, device=key.device)
    number = is_first.cumsum(0).sub_(1)
    label = torch.cat([number.index_select(0, first), is_first.sum(0, keepdim=True)])
    return label, is_first.nonzero()[:, 0]


def _first_equal(key: Tensor) -> Tensor:
    """For each key the place of the first that equals it: equal keys meet in a slot of a table, of several the first.

    Whoever finds another key there tries another slot. Sorting takes several times as long.
    """
    first = torch.empty_like(key)
    left, place, mixed = key, torch.arange(len(key), device=key.device), key
    while len(left):
        bits = (2 * len(left)).bit_length()
        mixed = mixed * MIX[0]
        slot = (mixed >> (64 - bits)).bitwise_and_((1 << bits) - 1)
        table = torch.full((1 << bits,), len(key), dtype=torch.int64, device=key.device)
        found = table.scatter_reduce_(0, slot, place, "amin").index_select(0, slot)
        first.scatter_(0, place, found)
        other = (key.index_select(0, found) != left).nonzero()[:, 0]
        left, place, mixed = (x.index_select(0, other) for x in (left, place, mixed))
    return first


def _neighbour(
    extrema: list[Tensor], strides: list[int], place: Tensor, limit: Tensor, reaches: Callable[..., Tensor]
) -> Tensor:
    """Where the extremum of the block of each place is: at the place itself if it can be, else along many axes."""
    found = place
    for partial, stride in zip(reversed(extrema[:-1]), strides, strict=True):
        before = reaches(partial.index_select(0, found - stride), limit)
        after = reaches(partial.index_select(0, found + stride), limit) & ~before
        found = found + (after.long() - before.long()) * stride
    return torch.where(reaches(extrema[0].index_select(0, place), limit), place, found)


def _values(up: Tensor, down: Tensor, now: Tensor, screening: Tensor, rank: Tensor, shape: Tensor) -> Tensor:
    """The values of C classes from their neighbours, where C is the outside; `now` are the present values."""
    count = len(up)
    own = torch.arange(count, device=up.device)
    head, place, length, last = _chains(up, down, own)
    below, above = down.index_select(0, head), up.index_select(0, last)
    peak, plateau = above == last, below == head
    a, b, c = _chain_weights(place, length, peak, screening)
    # a plateau is a peak as well, where v = 1/s; elsewhere the policy is wrong, and the present value serves
    c = torch.where(plateau, torch.where(peak, 1 / screening, c + a * now.index_select(0, head)), c)
    below = below.masked_fill_(plateau, count)
    above = above.masked_fill_(peak, count)
    heads = (head == own).nonzero()[:, 0]
    needed = torch.zeros(count + 1, dtype=torch.bool, device=up.device)
    needed.index_fill_(0, below.index_select(0, heads), True).index_fill_(0, above.index_select(0, heads), True)
    needed[count] = False
    unknown = needed.nonzero()[:, 0]
    row = torch.arange(len(unknown), device=up.device)
    number = torch.full_like(needed, len(unknown), dtype=torch.int64).scatter_(0, unknown, row)
    before, after = (number.index_select(0, x.index_select(0, unknown)) for x in (below, above))
    of = torch.cat([before, after, torch.full_like(row, len(unknown) + 1)])
    terms = Terms(row.repeat(3), of, torch.cat([x.index_select(0, unknown) for x in (a, b, c)]))
    terms = terms.where(of != len(unknown))  # outside, where the value is 0
    terms.of.clamp_(max=len(unknown))
    solved = solve_by_elimination(terms, rank.index_select(0, unknown), shape.index_select(0, unknown))
    value = now.new_zeros(count + 1).scatter_(0, unknown, solved)
    return a.mul_(value.index_select(0, below)).add_(b.mul_(value.index_select(0, above))).add_(c)


def _chains(up: Tensor, down: Tensor, own: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Of each class: the lowest of its chain, its place above that (from 1), the chain's length and its highest."""
    count = len(own)
    outside = own.new_full((1,), count)
    linked = (torch.cat([up, outside]).index_select(0, down) == own) & (down != own)
    top = (torch.cat([down, outside]).index_select(0, up) != own) | (up == own)
    head, steps = torch.where(linked, down, own), linked.long()
    for _ in range(count.bit_length()):  # twice as far each time
        more = steps.index_select(0, head)
        if not more.any():
            break
        head, steps = head.index_select(0, head), steps + more
    last = top.nonzero()[:, 0]
    lowest = head.index_select(0, last)
    highest = torch.zeros_like(own).scatter_(0, lowest, last)
    length = torch.zeros_like(own).scatter_(0, lowest, steps.index_select(0, last) + 1)
    return head, steps + 1, length.index_select(0, head), highest.index_select(0, head)


def _chain_weights(place: Tensor, length: Tensor, peak: Tensor, screening: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """a, b, c of v = a v(A) + b v(B) + c at a place of a chain, with 2 sinh(theta / 2) = sqrt(s).

    a = sinh(theta (L+1-i)) / sinh(theta (L+1)), b = sinh(theta i) / sinh(theta (L+1)), c = (1 - a - b) / s, and without
    cancellation. A chain that ends in a peak is half of one that is 2 L long and the same from both ends.
    """
    theta = 2 * torch.asinh(screening.sqrt() / 2)
    whole = torch.where(peak, 2 * length + 1, length + 1)
    near, far, all_ = (torch.expm1(-theta * steps) for steps in (place, whole - place, whole))
    c = near * far / (screening * (2 + all_))
    both = (all_ * (all_ + 2)).reciprocal_()
    a = torch.exp(-theta * place) * far * (far + 2) * both
    b = torch.exp(-theta * (whole - place)) * near * (near + 2) * both
    return torch.where(peak, a + b, a), torch.where(peak, 0, b), c
