"""The policies of a field in torch operations, and the values that they lead to: (2+s) v(x) - v(up) - v(down) = 1.

Pixels that are equal in value, block maximum and block minimum have the same equation, and are one unknown, a class.
On real shapes this leaves a few thousand classes of tens of thousands of pixels. Where up(x) = y and down(y) = x the
two are linked. A maximal chain of links is a tridiagonal system with constant coefficients, so each of its values is
v = a v(A) + b v(B) + c in closed form, with A below its lowest and B above its highest class. Left are the classes that
are an A or a B: some hundreds, which `solve_by_elimination` solves.
"""

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
    place, shape = pixels.place[first], pixels.shape[first]
    up = label[pixels.index[_neighbour(highs, strides, place, tie[shape])]]
    down = label[pixels.index[_neighbour([-low for low in lows], [-stride for stride in strides], place, tie[shape])]]
    return _values(up, down, highs[0][place], pixels.screening[shape], pixels.rank[first], shape)[label[:-1]]


def _classes(pixels: Pixels, tie: Tensor, highs: list[Tensor], lows: list[Tensor]) -> tuple[Tensor, Tensor]:
    """The class of each pixel, and of the outside as the last; and the first pixel of each class, ascending."""
    unit, key = tie[pixels.shape], pixels.shape * MIX[2]
    for line, odd in zip((highs[0], highs[-1], lows[-1]), MIX, strict=True):
        key = (key + (line[pixels.place] / unit).round().long()) * odd
    key, order = torch.sort(key, stable=True)
    fresh = torch.ones_like(key, dtype=torch.bool)
    fresh[1:] = key[1:] != key[:-1]
    first = order[fresh]
    is_first = torch.zeros_like(fresh)
    is_first[first] = True
    number = is_first.cumsum(0) - 1
    label = torch.empty(len(key) + 1, dtype=torch.int64, device=key.device)
    label[order] = number[first][fresh.cumsum(0) - 1]
    label[-1] = len(first)
    return label, is_first.nonzero()[:, 0]


def _neighbour(extrema: list[Tensor], strides: list[int], place: Tensor, tie: Tensor) -> Tensor:
    """Where the maximum of the block of each place is: at the place itself if it can be, else along many axes."""
    least = extrema[-1][place] - tie
    found = place
    for partial, stride in zip(reversed(extrema[:-1]), strides, strict=True):
        before, after = partial[found - stride] >= least, partial[found + stride] >= least
        found = found + torch.where(before, -stride, torch.where(after, stride, 0))
    return torch.where(extrema[0][place] >= least, place, found)


def _values(up: Tensor, down: Tensor, now: Tensor, screening: Tensor, rank: Tensor, shape: Tensor) -> Tensor:
    """The values of C classes from their neighbours, where C is the outside; `now` are the present values."""
    count = len(up)
    own = torch.arange(count, device=up.device)
    head, place, length, last = _chains(up, down, own)
    below, above = down[head], up[last]
    peak, plateau = above == last, below == head
    a, b, c = _chain_weights(place, length, peak, screening)
    # a plateau is a peak as well, where v = 1/s; elsewhere the policy is wrong, and the present value serves
    c = torch.where(plateau, torch.where(peak, 1 / screening, c + a * now[head]), c)
    below = torch.where(plateau, count, below)
    above = torch.where(peak, count, above)
    needed = torch.zeros(count + 1, dtype=torch.bool, device=up.device)
    heads = own[head == own]
    needed[below[heads]] = needed[above[heads]] = True
    needed[count] = False
    unknown = needed.nonzero()[:, 0]
    number = torch.full_like(needed, len(unknown), dtype=torch.int64)
    row = torch.arange(len(unknown), device=up.device)
    number[unknown] = row
    of = torch.cat([number[below[unknown]], number[above[unknown]], torch.full_like(row, len(unknown) + 1)])
    terms = Terms(row.repeat(3), of, torch.cat([a[unknown], b[unknown], c[unknown]]))
    terms = terms.where(of != len(unknown))  # outside, where the value is 0
    terms.of.clamp_(max=len(unknown))
    value = now.new_zeros(count + 1)
    value[unknown] = solve_by_elimination(terms, rank[unknown], shape[unknown])
    return a * value[below] + b * value[above] + c


def _chains(up: Tensor, down: Tensor, own: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Of each class: the lowest of its chain, its place above that (from 1), the chain's length and its highest."""
    count = len(own)
    outside = own.new_full((1,), count)
    linked = (torch.cat([up, outside])[down] == own) & (down != own)
    top = (torch.cat([down, outside])[up] != own) | (up == own)
    head, steps = torch.where(linked, down, own), linked.long()
    for _ in range(count.bit_length()):  # twice as far each time
        more = steps[head]
        if not more.any():
            break
        head, steps = head[head], steps + more
    last = top.nonzero()[:, 0]
    highest, length = torch.zeros_like(own), torch.zeros_like(own)
    highest[head[last]] = last
    length[head[last]] = steps[last] + 1
    return head, steps + 1, length[head], highest[head]


def _chain_weights(place: Tensor, length: Tensor, peak: Tensor, screening: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """a, b, c of v = a v(A) + b v(B) + c at a place of a chain, with 2 sinh(theta / 2) = sqrt(s).

    a = sinh(theta (L+1-i)) / sinh(theta (L+1)), b = sinh(theta i) / sinh(theta (L+1)), c = (1 - a - b) / s, and without
    cancellation. A chain that ends in a peak is half of one that is 2 L long and the same from both ends.
    """
    theta = 2 * torch.asinh(screening.sqrt() / 2)
    i = place.to(theta)
    whole = torch.where(peak, 2 * length + 1, length + 1).to(theta)
    j = whole - i
    rise, rest, decay = torch.expm1(-theta * i), torch.expm1(-theta * j), torch.exp(-theta * whole)
    c = rise * rest / (screening * (1 + decay))
    both = torch.expm1(-2 * theta * whole)
    a = torch.exp(-theta * i) * torch.expm1(-2 * theta * j) / both
    b = torch.exp(-theta * j) * torch.expm1(-2 * theta * i) / both
    return torch.where(peak, a + b, a), torch.where(peak, 0, b), c
