"""The field's equation linearised at a field, on one shape: solved forwards, or transposed for a gradient.

a(x) y(x) - mean of y over up(x) - mean of y over down(x) = b(x), where up(x) and down(x) are the neighbours that hold
the block's maximum and minimum. Of several neighbours that are equal the nearest count, in equal parts: the pixel
itself, else those across a face, else across an edge, and so on. That commutes with flips and axis swaps, as a
derivative should. Taking all of them would too, but where the field runs straight into a shape the influence of a pixel
would then spread sideways like heat, and the linear system would be as hard as a heat equation.

Pixels are eliminated in the order of the field's values, lowest first. When a pixel's turn comes, what lies below it is
gone, and little but its upper neighbours remains: the factors hold 2 to 4 times as many entries as the matrix, where
the reverse order holds 20 times as many. The matrix is an M-matrix, so no pivoting is needed. SciPy's SuperLU in the
same order takes 4 to 11 times as long.
"""

import math

import numpy as np

from torchlinf.kernels.bicgstab import bicgstab
from torchlinf.kernels.compiler import kernel
from torchlinf.kernels.grid import Grid

# Entries of the factors below this, beside a diagonal of 2, are left out, which keeps volumes within memory; BiCGStab
# makes up for them.
DROP = 1e-5
_ITERATIONS = 200
_STARTS = 5  # of BiCGStab, each from the true residual: it may break down, or drift from it


class LinearisedOperator:
    """The linearised operator of one shape with ties split, and its factors: some 200 bytes a pixel."""

    def __init__(self, grid: Grid, v: np.ndarray, a: np.ndarray, tie: float, drop: float = DROP) -> None:
        """Linearise at v, flat on the padded grid; `a` = 2 + s(x), flat; `tie` is absolute."""
        number = np.full(math.prod(grid.shape), -1, np.int32)
        inside = np.flatnonzero(v > 0)
        self.order = inside[np.argsort(v[inside], kind="stable")].astype(np.int32)
        number[self.order] = np.arange(grid.pixels, dtype=np.int32)
        self._begin, self._target, self._weight = _find_ties(v, self.order, *nearest_first(grid), tie)
        self._matrix = (self._begin, number[self._target], self._weight, a[self.order])
        self._factors = _factorise(*self._matrix, drop)

    def solve(self, b: np.ndarray, tol: float, transposed: bool = False) -> tuple[np.ndarray, float]:
        """The solution for a flat right-hand side, by unknown (pixel `order[i]`), and its relative residual.

        With exact factors the first substitution is the solution, and only its residual is taken.
        """
        rhs = b[self.order]
        y = self._precondition(rhs, transposed)
        size = float(np.sqrt((rhs * rhs).sum()))
        for start in range(_STARTS):
            r = rhs - self._product(y, transposed)
            reached = float(np.sqrt((r * r).sum())) / size if size > 0.0 else 0.0
            if not reached > tol or start == _STARTS - 1:
                break
            y += bicgstab(
                lambda x: self._product(x, transposed), r, 0.1 * tol * size, _ITERATIONS,
                lambda x: self._precondition(x, transposed),
            )  # fmt: skip
        return y, reached

    def spread(self, y: np.ndarray, out: np.ndarray) -> None:
        """Add to `out`, flat, at every pixel its shares of the y of those that have it as a neighbour.

        That is a y - A^T y, but outside the shape as well, on pixels that hold the minimum of a boundary pixel.
        """
        _spread(y, out, self.order, self._begin, self._target, self._weight)

    def _product(self, x: np.ndarray, transposed: bool) -> np.ndarray:
        out = np.empty_like(x)
        _multiply(x, out, transposed, *self._matrix)
        return out

    def _precondition(self, x: np.ndarray, transposed: bool) -> np.ndarray:
        y = x.copy()
        _substitute(y, transposed, self._factors)
        return y


def nearest_first(grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Flat offsets of the block, nearest first, and along how many axes each of them steps."""
    steps = [(0, 0)]
    for stride in grid.strides.tolist():
        steps = [(axes + abs(step), offset + step * stride) for axes, offset in steps for step in (-1, 0, 1)]
    axes, offsets = zip(*sorted(steps), strict=True)
    return np.array(offsets), np.array(axes)


@kernel
def _find_ties(v, order, offsets, axes, tie):  # type: ignore[no-untyped-def]
    """Rows of neighbours: `target[begin[i] : begin[i + 1]]` are flat pixels, and `weight` their shares, at order[i].

    A row holds first the neighbours within `tie` of the maximum, then those within `tie` of the minimum.
    """
    begin = np.empty(order.size + 1, np.int64)
    begin[0] = 0
    target = np.empty(3 * order.size + 2 * offsets.size, np.int32)
    weight = np.empty(target.size)
    count = 0
    for i in range(order.size):
        x = order[i]
        if count + 2 * offsets.size > target.size:
            target, weight = _grown(target), _grown(weight)
        high = low = v[x]
        for offset in offsets:
            high = max(high, v[x + offset])
            low = min(low, v[x + offset])
        count = _add_nearest(v, x, offsets, axes, high - tie, 1.0, target, weight, count)
        count = _add_nearest(v, x, offsets, axes, -low - tie, -1.0, target, weight, count)
        begin[i + 1] = count
    return begin, target[:count], weight[:count]


@kernel
def _add_nearest(v, x, offsets, axes, bound, sign, target, weight, count):  # type: ignore[no-untyped-def]
    """Append the nearest neighbours with sign v >= bound; returns the new count."""
    stop = count
    for k in range(offsets.size):
        if stop > count and axes[k] > axes[k - 1]:
            break
        if sign * v[x + offsets[k]] >= bound:
            target[stop] = x + offsets[k]
            stop += 1
    for k in range(count, stop):
        weight[k] = 1.0 / (stop - count)
    return stop


@kernel
def _factorise(begin, column, weight, a, drop):  # type: ignore[no-untyped-def]
    """A = L U from the rows of A, a_i on the diagonal and -`weight` at the neighbours; numbers below 0 are outside.

    Returns the rows of L (without its unit diagonal) and of U (without its diagonal) in one list with L's first,
    where U's part of each row and where the row itself begins, and the inverse diagonal of U.
    """
    size = a.size
    row, mark = np.empty(size), np.empty(size, np.int32)
    for i in range(size):
        mark[i] = -1
    lower, upper = np.empty(size, np.int32), np.empty(size, np.int32)
    start, middle = np.empty(size + 1, np.int64), np.empty(size, np.int64)
    start[0] = 0
    index, entry = np.empty(8 * size, np.int32), np.empty(8 * size)
    inverse = np.empty(size)
    for i in range(size):
        row[i] = a[i]
        mark[i] = i
        below, above = 0, 0
        for k in range(begin[i], begin[i + 1]):
            j = column[k]
            if j >= 0:
                if mark[j] != i:
                    mark[j] = i
                    row[j] = 0.0
                    if j < i:
                        below = _insert(lower, below, j)
                    else:
                        upper[above] = j
                        above += 1
                row[j] -= weight[k]
        count = start[i]
        done = 0
        while done < below:
            k = lower[done]
            done += 1
            factor = row[k] * inverse[k]
            if abs(factor) <= drop:
                continue
            if count == index.size:
                index, entry = _grown(index), _grown(entry)
            index[count], entry[count] = k, factor
            count += 1
            for e in range(middle[k], start[k + 1]):
                j = index[e]
                if mark[j] != i:
                    mark[j] = i
                    row[j] = 0.0
                    if j < i:
                        below = _insert(lower, below, j)
                    else:
                        upper[above] = j
                        above += 1
                row[j] -= factor * entry[e]
        middle[i] = count
        while count + above > index.size:
            index, entry = _grown(index), _grown(entry)
        inverse[i] = 1.0 / row[i]
        for k in range(above):
            j = upper[k]
            if abs(row[j]) > drop:
                index[count], entry[count] = j, row[j]
                count += 1
        start[i + 1] = count
    return start, middle, index, entry, inverse


@kernel
def _insert(sorted_list, count, j):  # type: ignore[no-untyped-def]
    """Insert j into the first `count` entries, ascending; returns the new count."""
    k = count
    while k > 0 and sorted_list[k - 1] > j:
        sorted_list[k] = sorted_list[k - 1]
        k -= 1
    sorted_list[k] = j
    return count + 1


@kernel
def _grown(array):  # type: ignore[no-untyped-def]
    larger = np.empty(2 * array.size, array.dtype)
    for i in range(array.size):
        larger[i] = array[i]
    return larger


@kernel
def _substitute(x, transposed, factors):  # type: ignore[no-untyped-def]
    """x <- (L U)^-1 x, or (L U)^-T x."""
    start, middle, index, entry, inverse = factors
    if transposed:
        for i in range(x.size):
            x[i] *= inverse[i]
            for e in range(middle[i], start[i + 1]):
                x[index[e]] -= entry[e] * x[i]
        for i in range(x.size - 1, -1, -1):
            for e in range(start[i], middle[i]):
                x[index[e]] -= entry[e] * x[i]
    else:
        for i in range(x.size):
            for e in range(start[i], middle[i]):
                x[i] -= entry[e] * x[index[e]]
        for i in range(x.size - 1, -1, -1):
            for e in range(middle[i], start[i + 1]):
                x[i] -= entry[e] * x[index[e]]
            x[i] *= inverse[i]


@kernel
def _multiply(x, out, transposed, begin, column, weight, a):  # type: ignore[no-untyped-def]
    """out = A x, or A^T x. Neighbours with a negative number are outside the shape, where x is 0."""
    for i in range(x.size):
        out[i] = a[i] * x[i]
    for i in range(x.size):
        for k in range(begin[i], begin[i + 1]):
            j = column[k]
            if j >= 0:
                if transposed:
                    out[j] -= weight[k] * x[i]
                else:
                    out[i] -= weight[k] * x[j]


@kernel
def _spread(x, out, order, begin, target, weight):  # type: ignore[no-untyped-def]
    """Add x, share by share, to the flat pixels that each row points to, outside the shape as well."""
    for i in range(order.size):
        for k in range(begin[i], begin[i + 1]):
            out[target[k]] += weight[k] * x[i]
