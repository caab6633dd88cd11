"""Sweeps and residual where every pixel has its own weight w = 1 / (2 + s(x)); `sweeps` is the case of one s."""

from torchlinf.kernels._compile import kernel
from torchlinf.kernels.sweeps import _row_extrema


@kernel
def sweep(v, starts, ends, rows, weight, num_sweeps, buffer):  # type: ignore[no-untyped-def]
    """v <- w (M v + N v + 1) in place, `num_sweeps` times, row by row, down and up in turn."""
    high, low = buffer[0], buffer[1]
    for number in range(num_sweeps):
        for k in range(starts.size):
            run = k if number % 2 == 0 else starts.size - 1 - k
            start = starts[run]
            length = ends[run] - start
            _row_extrema(v, rows, start - 1, length + 2, high, low)
            values = v[start : start + length]
            factors = weight[start : start + length]
            for j in range(length):
                most = max(max(high[j], high[j + 1]), high[j + 2])
                least = min(min(low[j], low[j + 1]), low[j + 2])
                values[j] = (most + least + 1.0) * factors[j]


@kernel
def residual_bounds(v, starts, ends, rows, screening, buffer):  # type: ignore[no-untyped-def]
    """Largest positive and negative part of R(v) = (M v - v) - (v - N v) + (1 - s v) on the shape."""
    above = 0.0
    below = 0.0
    high, low = buffer[0], buffer[1]
    for run in range(starts.size):
        start = starts[run]
        length = ends[run] - start
        _row_extrema(v, rows, start - 1, length + 2, high, low)
        values = v[start : start + length]
        s = screening[start : start + length]
        for j in range(length):
            most = max(max(high[j], high[j + 1]), high[j + 2])
            least = min(min(low[j], low[j + 1]), low[j + 2])
            r = ((most - values[j]) - (values[j] - least)) + (1.0 - s[j] * values[j])
            above = max(above, r)
            below = max(below, -r)
    return above, below
