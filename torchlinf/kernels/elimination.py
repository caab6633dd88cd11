"""Sparse elimination of the linearised equation, in the order of the field's values, lowest first.

Row i reads a_i x_i - sum of weights times x of the neighbours that hold the maximum and the minimum. When a pixel's
turn comes, what lies below it is gone, and little but its upper neighbours remains: the factors hold 2 to 4 times as
many entries as the matrix, where the reverse order holds 20 times as many. A is an M-matrix, so no pivoting is needed.
Entries below `drop` are left out, which is what keeps volumes within memory; `krylov` makes up for it.
"""

import numpy as np

from torchlinf.kernels._compile import kernel


@kernel
def factorise(begin, column, weight, a, drop):  # type: ignore[no-untyped-def]
    """A = L U from the rows of A, a_i on the diagonal and -`weight` at the neighbours; numbers below 0 are outside.

    Returns the rows of L (without its unit diagonal) and of U (without its diagonal) in one list with L's first,
    where U's part of each row and where the row itself begins, and the inverse diagonal of U.
    """
    size = a.size
    row = np.zeros(size)
    mark = np.full(size, -1, np.int32)
    lower, upper = np.empty(size, np.int32), np.empty(size, np.int32)
    start, middle = np.zeros(size + 1, np.int64), np.empty(size, np.int64)
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
    larger[: array.size] = array
    return larger


@kernel
def substitute(x, transposed, factors):  # type: ignore[no-untyped-def]
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
