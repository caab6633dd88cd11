"""A sparse linear system x = P x + c solved exactly in torch operations, by eliminating many unknowns at a time.

In each round a set of unknowns is taken out of which no two are in one another's equation, and which are in few
equations themselves; so the rest stays sparse. The constant is the weight of one more unknown, which is 1.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

TERMS = 6  # in the equation of an unknown that is eliminated; this and FILL grow from round to round, so that all end
FILL = 16  # terms that eliminating it may add
GROWTH = 1.15
ROUNDS = 400
FEW = 160  # unknowns of a shape from which on they are solved for as a dense system
FORGET = 1e-17  # weight below which a term is dropped: rounding


@dataclass
class Terms:
    """The terms of all equations, those of one side by side: x[row] is the sum of weight * x[of]."""

    row: Tensor
    of: Tensor
    weight: Tensor

    def where(self, chosen: Tensor) -> "Terms":
        """Some of the terms, by a mask."""
        index = chosen.nonzero()[:, 0]
        return Terms(*(part.index_select(0, index) for part in (self.row, self.of, self.weight)))

    def numbered(self, number: Tensor) -> "Terms":
        """The same with other numbers for the unknowns."""
        return Terms(number.index_select(0, self.row), number.index_select(0, self.of), self.weight)

    def joined(self, other: "Terms") -> "Terms":
        """These terms and then those."""
        pairs = ((self.row, other.row), (self.of, other.of), (self.weight, other.weight))
        return Terms(*(torch.cat(pair) for pair in pairs))


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
    levels = []
    shuffled = (rank * 2654435761).bitwise_and(0xFFFFFFFF)  # another number for each
    terms = _gather(terms, len(rank))
    for number in range(ROUNDS):
        for dense in (True, False):
            out = _of_small_shapes(shape) if dense else _independent(terms, shuffled, GROWTH**number)
            if not out.any():
                continue
            level = _Level.of(out, terms, shape if dense else None)
            levels.append(level)
            terms = _substitute(terms, out, level)
            shuffled, shape = (x.index_select(0, level.kept) for x in (shuffled, shape))
        if not len(shape):
            break
    x = torch.full_like(shape, torch.nan, dtype=terms.weight.dtype)  # of those that are left, if any
    x = torch.cat([x, x.new_ones(1)])
    for level in reversed(levels):
        x = level.extend(x)
    return x[: len(rank)]


@dataclass
class _Level:
    """What is taken out in a round: `out` of all unknowns, with their equations; `kept` are the others.

    `shape` is that of all unknowns if those of `out` are in one another's equations.
    """

    out: Tensor
    kept: Tensor
    equations: Terms
    shape: Tensor | None

    @classmethod
    def of(cls, out: Tensor, terms: Terms, shape: Tensor | None) -> "_Level":
        """The level of the unknowns marked in `out`, (M + 1,) bool."""
        equations = terms.where(out.index_select(0, terms.row))
        return cls(out.nonzero()[:, 0], (~out[:-1]).nonzero()[:, 0], equations, shape)

    def extend(self, x: Tensor) -> Tensor:
        """The values of all unknowns and of the constant from those of `kept` and of the constant."""
        count = len(self.out) + len(self.kept)
        full = x.new_zeros(count + 1).scatter_(0, self.kept, x[:-1])
        full[count] = 1
        if self.shape is not None:
            return full.scatter_(0, self.out, _solve_dense(self.equations, self.out, self.shape))
        fresh = _fresh(self.equations.row)
        sums = _run_sums(self.equations.weight * full.index_select(0, self.equations.of), fresh)
        return full.scatter_(0, self.equations.row.masked_select(fresh), sums)


def _of_small_shapes(shape: Tensor) -> Tensor:
    """The unknowns, (M + 1,) bool, of shapes that have few left."""
    left = torch.zeros(int(shape[-1]) + 1 if len(shape) else 0, dtype=torch.int64, device=shape.device)
    left.index_add_(0, shape, torch.ones_like(shape))
    return torch.cat([left.index_select(0, shape) <= FEW, shape.new_zeros(1, dtype=torch.bool)])


def _independent(terms: Terms, shuffled: Tensor, growth: float) -> Tensor:
    """Unknowns, (M + 1,) bool, no two in one another's equation: those that fill in less than all their neighbours."""
    count = len(shuffled)
    ones = torch.ones_like(terms.row)
    length = torch.zeros(count + 1, dtype=torch.int64, device=shuffled.device).index_add_(0, terms.row, ones)
    uses = torch.zeros_like(length).index_add_(0, terms.of, ones)
    more = uses.mul_(length - 2).clamp_(-1, 1 << 20)  # without itself, and the constant is everywhere
    fits = (length <= TERMS * growth + 1) & (more <= FILL * growth)
    fits[count] = False
    priority = ((1 << 20) - more).mul_(1 << 32)
    priority[:count] += shuffled
    priority = torch.where(fits, priority, -1)
    rival = torch.full_like(priority, -1)
    rival.scatter_reduce_(0, terms.row, priority.index_select(0, terms.of), "amax")
    rival.scatter_reduce_(0, terms.of, priority.index_select(0, terms.row), "amax")
    return priority > rival


def _substitute(terms: Terms, out: Tensor, level: _Level) -> Terms:
    """The equations of the others, with the chosen unknowns replaced by their equations, all numbered anew."""
    count = len(level.kept)
    number = (~out).cumsum(0).sub_(1)
    of_out = out.index_select(0, terms.of)
    rest = ~out.index_select(0, terms.row)
    used = terms.where(of_out & rest)
    touched = torch.zeros_like(out).index_fill_(0, used.row, True).index_select(0, terms.row)
    same, kept = (
        chosen.numbered(number) for chosen in (terms.where(rest & ~touched), terms.where(rest & touched & ~of_out))
    )
    if not len(used.row):
        return same
    equations = level.equations
    fresh = _fresh(equations.row)
    begin = fresh.nonzero()[:, 0]
    first, length = torch.zeros_like(number), torch.zeros_like(number)
    owner = equations.row.index_select(0, begin)
    first.scatter_(0, owner, begin)
    length.scatter_(0, owner, torch.diff(begin, append=begin.new_full((1,), len(fresh))))
    times = length.index_select(0, used.of)
    shift = first.index_select(0, used.of) - (times.cumsum(0) - times)
    source = torch.repeat_interleave(times)
    place = shift.index_select(0, source).add_(torch.arange(len(source), device=out.device))
    row, of = (number.index_select(0, x) for x in (used.row, equations.of.index_select(0, place)))
    weight = used.weight.index_select(0, source) * equations.weight.index_select(0, place)
    merged = _gather(kept.joined(Terms(row.index_select(0, source), of, weight)), count)
    return same.joined(merged)


def _gather(terms: Terms, count: int) -> Terms:
    """Sort terms, add up those of one unknown in one equation, and solve each equation for its own unknown."""
    key, order = torch.sort(terms.row * (count + 1) + terms.of, stable=True)
    fresh = _fresh(key)
    total = _run_sums(terms.weight.index_select(0, order), fresh)
    key = key.masked_select(fresh)
    row = torch.div(key, count + 1, rounding_mode="floor")
    of = key - row * (count + 1)
    own = row == of
    at = own.nonzero()[:, 0]
    scale = torch.ones(count, dtype=total.dtype, device=total.device)
    scale.scatter_(0, row.index_select(0, at), 1 / (1 - total.index_select(0, at)))
    gathered = Terms(row, of, total).where(~own & (total.abs() > FORGET))
    gathered.weight.mul_(scale.index_select(0, gathered.row))
    return gathered


def _fresh(key: Tensor) -> Tensor:
    """Where a run of equals begins."""
    fresh = torch.ones_like(key, dtype=torch.bool)
    torch.ne(key[1:], key[:-1], out=fresh[1:])
    return fresh


def _run_sums(x: Tensor, fresh: Tensor) -> Tensor:
    """The sum of each run, that begins where `fresh`, in its order: the same in every batch."""
    if x.device.type == "cpu":  # here index_add_ adds one by one
        run = fresh.cumsum(0).sub_(1)
        return x.new_zeros(int(run[-1]) + 1 if len(run) else 0).index_add_(0, run, x)
    begin = fresh.nonzero()[:, 0]
    length = torch.diff(begin, append=begin.new_full((1,), len(x)))
    total = x.index_select(0, begin)
    for j in range(1, int(length.max()) if len(length) else 0):
        total += torch.where(length > j, x.index_select(0, (begin + j).clamp_(max=len(x) - 1)), 0)
    return total


def _solve_dense(equations: Terms, unknowns: Tensor, shape: Tensor) -> Tensor:
    """The values of at most FEW unknowns of each shape, ascending, from equations that hold no others."""
    count = len(shape)
    _, system, size = shape.index_select(0, unknowns).unique_consecutive(return_inverse=True, return_counts=True)
    most = int(size.max())
    place, of_system = torch.zeros_like(shape), torch.zeros_like(shape)
    place.scatter_(0, unknowns, torch.arange(len(unknowns), device=shape.device) - (size.cumsum(0) - size)[system])
    of_system.scatter_(0, unknowns, system)
    matrix = torch.eye(most, dtype=equations.weight.dtype, device=shape.device).repeat(len(size), 1, 1)
    right = matrix.new_zeros(len(size), most)
    constant, others = equations.where(equations.of == count), equations.where(equations.of < count)
    right[of_system[constant.row], place[constant.row]] = constant.weight
    matrix[of_system[others.row], place[others.row], place[others.of]] = -others.weight
    return _solve_each(matrix, right, size.tolist())[system, place[unknowns]]


def _solve_each(matrix: Tensor, right: Tensor, size: list[int]) -> Tensor:
    """Solve (B, N, N) x = (B, N), of which the first `size` count, the same in every batch.

    NaN for a system that has no single solution, where torch's result is undefined. On the CPU one system at a time:
    torch 2.13 with MKL gives wrong solutions for a batch of 160 unknowns after torch.set_num_threads, which a user may
    have called.
    """
    if matrix.device.type != "cpu":
        result, info = torch.linalg.solve_ex(matrix, right)
        return torch.where(info[:, None] > 0, torch.nan, result)
    result = torch.full_like(right, torch.nan)
    for found, a, b, n in zip(result, matrix, right, size, strict=True):
        x, info = torch.linalg.solve_ex(a[:n, :n], b[:n])
        found[:n] = torch.where(info > 0, torch.nan, x)
    return result
