"""Block max and min along runs: sweeps of T, the residual, and the policies.

A run is a row segment of the shape. Its block max is taken in two steps that both vectorise: the max over the
neighbouring rows, column by column, then over three adjacent columns.

Screening s and weight w = 1 / (2 + s) are one number for the whole shape, or arrays with one number a pixel. The
kernels take both forms: `screening` and `screenings`, of which the array is None where the number holds.
"""

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel


@inlined
def _row_extrema(v, rows, first, count, high, low):  # type: ignore[no-untyped-def]
    """Max and min over the neighbouring rows, for columns first .. first + count."""
    for group in range(0, rows.size, 3):
        a = v[first + rows[group] : first + rows[group] + count]
        b = v[first + rows[group + 1] : first + rows[group + 1] + count]
        c = v[first + rows[group + 2] : first + rows[group + 2] + count]
        if group == 0:
            for j in range(count):
                high[j] = max(max(a[j], b[j]), c[j])
                low[j] = min(min(a[j], b[j]), c[j])
        else:
            for j in range(count):
                high[j] = max(max(max(a[j], b[j]), c[j]), high[j])
                low[j] = min(min(min(a[j], b[j]), c[j]), low[j])


@kernel
def sweep(v, starts, ends, rows, weight, weights, num_sweeps, buffer):  # type: ignore[no-untyped-def]
    """v <- w (M v + N v + 1) in place, `num_sweeps` times, row by row, down and up in turn.

    A row sees the new values of the rows before it, which is still monotone and a contraction, needs no second
    array, and carries news across the whole shape in the direction of travel.
    """
    high, low = buffer[0], buffer[1]
    for number in range(num_sweeps):
        for k in range(starts.size):
            run = k if number % 2 == 0 else starts.size - 1 - k
            start = starts[run]
            length = ends[run] - start
            _row_extrema(v, rows, start - 1, length + 2, high, low)
            values = v[start : start + length]
            if weights is None:
                for j in range(length):
                    most = max(max(high[j], high[j + 1]), high[j + 2])
                    least = min(min(low[j], low[j + 1]), low[j + 2])
                    values[j] = (most + least + 1.0) * weight
            else:
                factors = weights[start : start + length]
                for j in range(length):
                    most = max(max(high[j], high[j + 1]), high[j + 2])
                    least = min(min(low[j], low[j + 1]), low[j + 2])
                    values[j] = (most + least + 1.0) * factors[j]


@inlined
def row_update(v, start, length, rows, weight, buffer):  # type: ignore[no-untyped-def]
    """What a sweep makes of one run, w (M v + N v + 1), into buffer[2]."""
    high, low, values = buffer[0], buffer[1], buffer[2]
    _row_extrema(v, rows, start - 1, length + 2, high, low)
    for j in range(length):
        most = max(max(high[j], high[j + 1]), high[j + 2])
        least = min(min(low[j], low[j + 1]), low[j + 2])
        values[j] = (most + least + 1.0) * weight


@inlined
def row_residuals(v, start, length, rows, screening, screenings, buffer):  # type: ignore[no-untyped-def]
    """R(v) = (M v - v) - (v - N v) + (1 - s v) on one run, into buffer[2].

    In this order the two differences are exact in floating point, so R is known to a few ulps of 1, not of v.
    """
    high, low, residual = buffer[0], buffer[1], buffer[2]
    _row_extrema(v, rows, start - 1, length + 2, high, low)
    values = v[start : start + length]
    if screenings is None:
        for j in range(length):
            most = max(max(high[j], high[j + 1]), high[j + 2])
            least = min(min(low[j], low[j + 1]), low[j + 2])
            residual[j] = ((most - values[j]) - (values[j] - least)) + (1.0 - screening * values[j])
    else:
        s = screenings[start : start + length]
        for j in range(length):
            most = max(max(high[j], high[j + 1]), high[j + 2])
            least = min(min(low[j], low[j + 1]), low[j + 2])
            residual[j] = ((most - values[j]) - (values[j] - least)) + (1.0 - s[j] * values[j])


@kernel
def residual_bounds(v, starts, ends, rows, screening, screenings, buffer):  # type: ignore[no-untyped-def]
    """Largest positive and negative part of R(v) on the shape."""
    above = 0.0
    below = 0.0
    residual = buffer[2]
    for run in range(starts.size):
        length = ends[run] - starts[run]
        row_residuals(v, starts[run], length, rows, screening, screenings, buffer)
        for j in range(length):
            above = max(above, residual[j])
            below = max(below, -residual[j])
    return above, below


@kernel
def choose_policies(v, starts, ends, rows, tie, up, down, buffer):  # type: ignore[no-untyped-def]
    """The neighbours that hold the block max (up) and min (down) of every pixel.

    The canonical tie rule: among the neighbours within `tie` of the extremum the pixel itself if it is one, else the
    one of smallest index. Without it, values that are equal in exact arithmetic would make chains zigzag.
    """
    high, low = buffer[0], buffer[1]
    for run in range(starts.size):
        start = starts[run]
        length = ends[run] - start
        _row_extrema(v, rows, start - 1, length + 2, high, low)
        values, above, below = v[start : start + length], up[start : start + length], down[start : start + length]
        here = np.int32(start)
        for group in range(rows.size - 3, -1, -3):  # descending, so that the smallest index is written last
            a = v[start + rows[group] - 1 : start + rows[group] + length + 1]
            b = v[start + rows[group + 1] - 1 : start + rows[group + 1] + length + 1]
            c = v[start + rows[group + 2] - 1 : start + rows[group + 2] + length + 1]
            step_a, step_b, step_c = np.int32(rows[group]), np.int32(rows[group + 1]), np.int32(rows[group + 2])
            for j in range(length):
                most = max(max(high[j], high[j + 1]), high[j + 2]) - tie
                x = here + np.int32(j)
                y = _first_above(c[j], c[j + 1], c[j + 2], most, x + step_c, above[j])
                y = _first_above(b[j], b[j + 1], b[j + 2], most, x + step_b, y)
                y = _first_above(a[j], a[j + 1], a[j + 2], most, x + step_a, y)
                above[j] = x if values[j] >= most else y
            for j in range(length):
                least = min(min(low[j], low[j + 1]), low[j + 2]) + tie
                x = here + np.int32(j)
                y = _first_below(c[j], c[j + 1], c[j + 2], least, x + step_c, below[j])
                y = _first_below(b[j], b[j + 1], b[j + 2], least, x + step_b, y)
                y = _first_below(a[j], a[j + 1], a[j + 2], least, x + step_a, y)
                below[j] = x if values[j] <= least else y


@inlined
def _first_above(left, middle, right, most, x, other):  # type: ignore[no-untyped-def]
    """The first of the pixels x - 1, x, x + 1 whose value is not below `most`, or else the other pixel."""
    y = x + np.int32(1) if right >= most else other
    y = x if middle >= most else y
    return x - np.int32(1) if left >= most else y


@inlined
def _first_below(left, middle, right, least, x, other):  # type: ignore[no-untyped-def]
    """The first of the pixels x - 1, x, x + 1 whose value is not above `least`, or else the other pixel."""
    y = x + np.int32(1) if right <= least else other
    y = x if middle <= least else y
    return x - np.int32(1) if left <= least else y
