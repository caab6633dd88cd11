"""A sparse linear system x = P x + c solved exactly in torch operations, by eliminating many unknowns at a time.

In each round a set of unknowns is taken out of which no two are in one another's equation, and which are in few
equations themselves; so the rest stays sparse. The constant is the weight of one more unknown, which is 1.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

TERMS = 4  # in the equation of an unknown that is eliminated; this and FILL grow from round to round, so that all end
FILL = 12  # terms that eliminating it may add
GROWTH = 1.15
ROUNDS = 400
FEW = 160  # unknowns of a shape from which on they are solved for as a dense system
FORGET = 1e-17  # weight below which a term is dropped: rounding


@dataclass
class Terms:
    """The terms of all equations, sorted by equation and then by unknown: x[row] is the sum of weight * x[of]."""

    row: Tensor
    of: Tensor
    weight: Tensor

    def where(self, chosen: Tensor) -> "Terms":
        """Some of the terms, by a mask."""
        index = chosen.nonzero()[:, 0]
        return Terms(*(part.index_select(0, index) for part in (self.row, self.of, self.weight)))


def solve_by_elimination(terms: Terms, rank: Tensor, shape: Tensor) -> Tensor:
    """The solution x, (M,), of M equations; unknown M is the constant 1. A shape without one has numbers, inf or NaN.

    Args:
        terms: of all equations, in any order; an unknown may occur twice in an equation.
        rank: (M,) int64, the place of each unknown in its own shape: what is eliminated first depends on it, and not on
            what else is solved in the same call.
        shape: (M,) int64, the shape of each unknown, ascending; no equation holds unknowns of two shapes.

    >>> terms = Terms(torch.tensor([0, 0, 1]), torch.tensor([1, 2, 2]), torch.tensor([0.5, 1.0, 4.0]))  # x = y / 2 + 1
    >>> solve_by_elimination(terms, torch.arange(2), torch.zeros(2, dtype=torch.int64)).tolist()
    [3.0, 4.0]
    """
    count = len(rank)
    shuffled = (rank * 2654435761).bitwise_and(0xFFFFFFFF)  # another number for each
    terms = _gather(terms, count)
    live = torch.arange(count, device=rank.device)
    eliminated: list[tuple[Tensor, Terms]] = []
    shapes = int(shape[-1]) + 1 if count else 0
    left: list[tuple[Tensor, Terms]] = []
    for number in range(ROUNDS):
        left_in = torch.zeros(shapes, dtype=torch.int64, device=rank.device)
        left_in.index_add_(0, shape[live], torch.ones_like(live))
        few = left_in <= FEW
        dense = few[shape[live]]
        if dense.any():
            done = torch.zeros(count, dtype=torch.bool, device=rank.device)
            done[live[dense]] = True
            left.append((live[dense], terms.where(done[terms.row])))
            live, terms = live[~dense], terms.where(~done[terms.row])
        if not len(live):
            break
        growth = GROWTH**number
        chosen = _independent(terms, live, shuffled, min(TERMS * growth, count), min(FILL * growth, 1e6))
        eliminated.append((live[chosen[live]], terms.where(chosen[terms.row])))
        live = live[~chosen[live]]
        terms = _substitute(terms, chosen, count)
    x = rank.new_zeros(count + 1, dtype=terms.weight.dtype)
    x[count] = 1
    for unknowns, equations in left:
        x[unknowns] = _solve_dense(equations, unknowns, shape)
    for unknowns, equations in reversed(eliminated):
        x[unknowns] = _evaluate(equations, unknowns, x)
    return x[:count]


def _independent(terms: Terms, live: Tensor, shuffled: Tensor, most: float, fill: float) -> Tensor:
    """Which unknowns are eliminated now, (M + 1,) bool: those that fill in less than all they share a term with."""
    count = len(shuffled)
    true = terms.where(terms.of < count)
    ones = torch.ones_like(true.row)
    length = torch.zeros(count, dtype=torch.int64, device=live.device).index_add_(0, true.row, ones)
    uses = torch.zeros_like(length).index_add_(0, true.of, ones)
    more = (uses * (length - 1)).clamp(min=-1)
    fits = (length <= most) & (more <= fill)
    priority = torch.where(fits, ((1 << 20) - more.clamp(max=1 << 20)) * (1 << 32) + shuffled, -1)
    rival = torch.full_like(priority, -1)
    rival.scatter_reduce_(0, true.row, priority[true.of], "amax")
    rival.scatter_reduce_(0, true.of, priority[true.row], "amax")
    chosen = torch.zeros(count + 1, dtype=torch.bool, device=live.device)
    chosen[live] = (priority > rival)[live] & fits[live]
    return chosen


def _substitute(terms: Terms, chosen: Tensor, count: int) -> Terms:
    """The equations of the others, with the chosen unknowns replaced by their equations."""
    from_chosen, of_chosen = chosen[terms.row], chosen[terms.of]
    length = torch.zeros(count + 1, dtype=torch.int64, device=chosen.device)
    length.index_add_(0, terms.row, torch.ones_like(terms.row))
    first = length.cumsum(0) - length
    used = terms.where(of_chosen & ~from_chosen)
    times = length[used.of]
    source = torch.repeat_interleave(torch.arange(len(times), device=chosen.device), times)
    begin = times.cumsum(0) - times
    place = first[used.of[source]] + torch.arange(len(source), device=chosen.device) - begin[source]
    kept = terms.where(~of_chosen & ~from_chosen)
    return _gather(
        Terms(
            torch.cat([kept.row, used.row[source]]),
            torch.cat([kept.of, terms.of[place]]),
            torch.cat([kept.weight, used.weight[source] * terms.weight[place]]),
        ),
        count,
    )


def _gather(terms: Terms, count: int) -> Terms:
    """Sort terms, add up those of one unknown in one equation, and solve each equation for its own unknown."""
    key, order = torch.sort(terms.row * (count + 1) + terms.of, stable=True)
    weight = terms.weight[order]
    total = weight
    shift = 1
    while shift < len(key):  # sums of equals, in their order: the same in every batch
        equal = key[shift:] == key[:-shift]
        if not equal.any():
            break
        total = total.clone() if shift == 1 else total
        total[:-shift] += torch.where(equal, weight[shift:], 0)
        shift += 1
    fresh = torch.ones_like(key, dtype=torch.bool)
    fresh[1:] = key[1:] != key[:-1]
    row, of = key // (count + 1), key % (count + 1)
    own = row == of
    scale = torch.ones(count, dtype=weight.dtype, device=weight.device)
    at = (own & fresh).nonzero()[:, 0]
    scale[row[at]] = 1 / (1 - total[at])
    keep = fresh & ~own & (total.abs() > FORGET)
    gathered = Terms(row, of, total).where(keep)
    gathered.weight.mul_(scale[gathered.row])
    return gathered


def _evaluate(equations: Terms, unknowns: Tensor, x: Tensor) -> Tensor:
    """The values of unknowns whose equations hold known ones only; `unknowns` ascend, as the equations do."""
    length = torch.zeros_like(x, dtype=torch.int64)
    length.index_add_(0, equations.row, torch.ones_like(equations.row))
    count = length[unknowns]
    begin = count.cumsum(0) - count
    value = x.new_zeros(len(unknowns))
    products = equations.weight * x[equations.of]
    for j in range(int(count.max()) if len(count) else 0):
        has = count > j
        value += torch.where(has, products[(begin + j).clamp(max=len(products) - 1)], 0)
    return value


def _solve_dense(equations: Terms, unknowns: Tensor, shape: Tensor) -> Tensor:
    """The values of at most FEW unknowns of each shape, ascending, from equations that hold no others."""
    count = len(shape)
    _, system, size = shape[unknowns].unique_consecutive(return_inverse=True, return_counts=True)
    place = torch.zeros_like(shape)
    place[unknowns] = torch.arange(len(unknowns), device=shape.device) - (size.cumsum(0) - size)[system]
    of_system = torch.zeros_like(shape)
    of_system[unknowns] = system
    matrix = torch.eye(FEW, dtype=equations.weight.dtype, device=shape.device).repeat(len(size), 1, 1)
    right = matrix.new_zeros(len(size), FEW)
    constant = equations.where(equations.of == count)
    right[of_system[constant.row], place[constant.row]] = constant.weight
    others = equations.where(equations.of < count)
    matrix[of_system[others.row], place[others.row], place[others.of]] = -others.weight
    return _solve_each(matrix, right)[system, place[unknowns]]


def _solve_each(matrix: Tensor, right: Tensor) -> Tensor:
    """Solve (B, N, N) x = (B, N); NaN for a system that has no single solution, where torch's result is undefined.

    On the CPU one system at a time: torch 2.13 with MKL gives wrong solutions for a batch of 160 unknowns after
    torch.set_num_threads, which a user may have called.
    """
    if matrix.device.type == "cpu":
        each = [torch.linalg.solve_ex(one, of) for one, of in zip(matrix, right, strict=True)]
        result, info = torch.stack([one.result for one in each]), torch.stack([one.info for one in each])
    else:
        result, info = torch.linalg.solve_ex(matrix, right)
    return torch.where(info[:, None] > 0, torch.nan, result)
