"""The paper's explicit scheme, v <- T v = mask (M v + N v + 1) / (2 + s), written three times.

The iterates are the same to the last bits, so the number of sweeps is counted once, with the fastest of the three.
"""

import time
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor

from benchmarks.baselines.domain import Array, Domain, bound


class Compiled:
    """T in compiled loops over the row segments that hold the shape; the inner loops vectorise."""

    def __init__(self, domain: Domain) -> None:
        """Find the rows that meet the shape, and from where to where."""
        sizes = domain.inside.shape
        strides = [int(np.prod(sizes[axis + 1 :])) for axis in range(len(sizes) - 1)]
        offsets = [0]
        for stride in strides:
            offsets = [offset + sign * stride for offset in offsets for sign in (-1, 0, 1)]
        rows = domain.inside.reshape(-1, sizes[-1])
        hit = np.flatnonzero(rows.any(axis=1))
        starts = hit * sizes[-1] + rows[hit].argmax(axis=1)
        stops = (hit + 1) * sizes[-1] - rows[hit][:, ::-1].argmax(axis=1)
        inside = domain.inside.astype(np.float64).reshape(-1)
        self.geometry = (inside, starts, stops, np.array(offsets), domain.screening)
        self.other = np.zeros(inside.size)

    def sweep(self, v: Array, count: int) -> Array:
        """T applied `count` times to v, which is overwritten."""
        flat, other = v.reshape(-1), self.other
        for _ in range(count):
            _jacobi(flat, other, *self.geometry)
            flat, other = other, flat
        self.other = other
        return flat.reshape(v.shape)

    def bound(self, v: Array) -> float:
        """Certified relative error of v."""
        return bound(*_residuals(v.reshape(-1), *self.geometry))


class Vectorised:
    """T in whole-array operations: separable maxima and minima of shifted slices, without new memory."""

    def __init__(self, domain: Domain) -> None:
        """Allocate the arrays between the steps."""
        self.inside = torch.from_numpy(domain.inside).double()
        self.screening = domain.screening
        self.block = [torch.zeros_like(self.inside) for _ in range(4)]

    def sweep(self, v: Tensor, count: int) -> Tensor:
        """T applied `count` times to v, which is overwritten; float64 with a ring of outside pixels."""
        high, low, *scratch = self.block
        for _ in range(count):
            _separable(torch.maximum, v, high, scratch)
            _separable(torch.minimum, v, low, scratch)
            torch.add(high, low, out=v)
            v.add_(1).mul_(self.inside).mul_(1 / (2 + self.screening))
        return v


class Pooling:
    """T as a torch user writes it for 2-D images: max pooling, and max pooling of the negative."""

    def __init__(self, domain: Domain) -> None:
        """Keep the mask as `(1, 1, H, W)`."""
        self.inside = torch.from_numpy(domain.inside).double()[None, None]
        self.screening = domain.screening

    def sweep(self, v: Tensor, count: int) -> Tensor:
        """T applied `count` times to v `(1, 1, H, W)`."""
        for _ in range(count):
            high = torch.nn.functional.max_pool2d(v, 3, stride=1, padding=1)
            low = -torch.nn.functional.max_pool2d(-v, 3, stride=1, padding=1)
            v = self.inside * (high + low + 1) / (2 + self.screening)
        return v


@dataclass(frozen=True)
class Count:
    """Sweeps from zero to a certified tolerance; where patience ran out, by the decay rate seen last."""

    sweeps: int
    extrapolated: bool
    value: Array


def sweeps_from_zero(domain: Domain, tol: float, patience: float) -> Count:
    """Iterate T from v = 0 until certified to `tol`, for at most `patience` seconds.

    T contracts, so in the end the residual decays by a fixed factor a sweep. If time runs out, the factor of the last
    third of the run gives the sweeps that were still to come; the run is not ended before it has swept D^2 times, where
    the decay is steady.
    """
    scheme = Compiled(domain)
    v = np.zeros(domain.inside.shape)
    began = time.perf_counter()
    chunk = max(16, domain.radius)
    history: list[float] = []
    while not history or history[-1] > tol:
        v = scheme.sweep(v, chunk)
        history.append(scheme.bound(v))
        sweeps = chunk * len(history)
        if time.perf_counter() - began > patience and sweeps > domain.radius**2:
            earlier = len(history) * 2 // 3
            rate = np.log(history[-1] / history[earlier - 1]) / (len(history) - earlier)
            return Count(sweeps + int(chunk * np.ceil(np.log(tol / history[-1]) / rate)), True, v)
    return Count(chunk * len(history), False, v)


def _separable(extremum: Any, v: Tensor, out: Tensor, scratch: list[Tensor]) -> None:
    """Extremum over the block at all pixels but the ring, where `out` means nothing."""
    source = v
    for axis in range(v.ndim):
        target = out if axis == v.ndim - 1 else scratch[axis % 2]
        size = v.shape[axis] - 2
        left, middle, right = (source.narrow(axis, start, size) for start in range(3))
        inner = target.narrow(axis, 1, size)
        extremum(left, right, out=inner)
        extremum(inner, middle, out=inner)
        source = target


@numba.njit(nogil=True, cache=True, fastmath={"nnan", "ninf", "nsz"})
def _extrema(v, offsets, start, count, high, low):  # type: ignore[no-untyped-def]
    """Max and min over the block's rows for `count` columns from `start` on, three rows at a time.

    Slices, and three rows in one expression, since the compiler vectorises the plainer forms of this loop badly.
    """
    for k in range(0, offsets.size, 3):
        first, second, third = start + offsets[k], start + offsets[k + 1], start + offsets[k + 2]
        a, b, c = v[first : first + count], v[second : second + count], v[third : third + count]
        if k == 0:
            for j in range(count):
                high[j] = max(max(a[j], b[j]), c[j])
                low[j] = min(min(a[j], b[j]), c[j])
        else:
            for j in range(count):
                high[j] = max(max(max(a[j], b[j]), c[j]), high[j])
                low[j] = min(min(min(a[j], b[j]), c[j]), low[j])


@numba.njit(nogil=True, cache=True, fastmath={"nnan", "ninf", "nsz"})
def _jacobi(v, out, inside, starts, stops, offsets, screening):  # type: ignore[no-untyped-def]
    longest = (stops - starts).max() + 2
    high, low = np.empty(longest), np.empty(longest)
    inverse = 1.0 / (2.0 + screening)
    for k in range(starts.size):
        start, count = starts[k], stops[k] - starts[k]
        _extrema(v, offsets, start - 1, count + 2, high, low)
        target = out[start : start + count]
        factor = inside[start : start + count]
        for j in range(count):
            most = max(max(high[j], high[j + 1]), high[j + 2])
            least = min(min(low[j], low[j + 1]), low[j + 2])
            target[j] = (most + least + 1.0) * inverse * factor[j]


@numba.njit(nogil=True, cache=True, fastmath={"nnan", "ninf", "nsz"})
def _residuals(v, inside, starts, stops, offsets, screening):  # type: ignore[no-untyped-def]
    longest = (stops - starts).max() + 2
    high, low = np.empty(longest), np.empty(longest)
    above = 0.0
    below = 0.0
    for k in range(starts.size):
        start, count = starts[k], stops[k] - starts[k]
        _extrema(v, offsets, start - 1, count + 2, high, low)
        values = v[start : start + count]
        factor = inside[start : start + count]
        for j in range(count):
            most = max(max(high[j], high[j + 1]), high[j + 2])
            least = min(min(low[j], low[j + 1]), low[j + 2])
            r = (((most - values[j]) - (values[j] - least)) + (1.0 - screening * values[j])) * factor[j]
            above = max(above, r)
            below = max(below, -r)
    return above, below
