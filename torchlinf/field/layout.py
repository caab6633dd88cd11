"""Storage in which a sweep over many shapes is a few operations on long contiguous runs, and the sweeps on it."""

import math
from collections.abc import Callable
from functools import cache

import torch
from torch import Tensor

from torchlinf._boxes import bounding_box


class Layout:
    """Shapes in one line of memory, each axis closed by one layer of zeros.

    The layer that ends a row is also the layer before the next row, so on the line the two neighbours along an axis
    are the entries at plus and minus its stride: no sweep has to pad. A guard of zeros at both ends keeps the
    neighbours of the first and the last row in range. Only the smallest box that holds every shape is stored.
    """

    def __init__(self, mask: Tensor) -> None:
        self.grid = tuple(mask.shape[1:])
        box = bounding_box(mask.any(dim=0).numpy(force=True))
        self.box = tuple(side if side.stop else slice(0, 1) for side in box)  # one pixel where nothing is inside
        self.sizes = tuple(part.stop - part.start + 1 for part in self.box)
        self.strides = [math.prod(self.sizes[axis + 1 :]) for axis in range(len(self.sizes))]
        self.pixels = math.prod(self.sizes)
        self.guard = sum(self.strides)

    def rows(self, line: Tensor) -> Tensor:
        """The shapes on a line as `(N, pixels)`, a view."""
        return line[self.guard : len(line) - self.guard].view(-1, self.pixels)

    def line(self, rows: Tensor) -> Tensor:
        """A new line that holds `(N, pixels)`."""
        line = rows.new_zeros(rows.numel() + 2 * self.guard)
        self.rows(line).copy_(rows)
        return line

    def pack(self, x: Tensor) -> Tensor:
        """A new line that holds the box of `(N, *grid)`."""
        inner = x[:, *self.box]
        rows = inner.new_zeros(len(inner), *self.sizes)
        rows[:, *(slice(size - 1) for size in self.sizes)] = inner
        return self.line(rows.flatten(1))

    def unpack(self, rows: Tensor) -> Tensor:
        """`(N, pixels)` back on the grid, `(N, *grid)`, 0 outside the box."""
        x = rows.new_zeros(len(rows), *self.grid)
        inner = rows.view(len(rows), *self.sizes)
        x[:, *self.box] = inner[:, *(slice(size - 1) for size in self.sizes)]
        return x


class System:
    """The equation on the shapes that are still in the batch: sweeps and residuals on the lines of a layout.

    Only sums, products, maxima and minima of single entries occur, each rounded once in an order that no symmetry of
    the grid changes, and maxima over all pixels. So the numbers of a shape depend neither on what else is in the batch
    nor on the place and orientation of the shape in its grid. Operations that may fuse a product with a sum (addcmul,
    lerp) are avoided: torch rounds them differently at the end of a run, hence differently in another batch.

    Attributes:
        layout: where the shapes lie.
        inside: 1 on the shapes, 0 elsewhere, `(N, pixels)` of the dtype of v.
        screening: s, `(N, 1)`.
        radius: D, `(N,)` int64.
        compile: whether sweeps are fused by torch.compile.
    """

    def __init__(
        self, layout: Layout, inside: Tensor, screening: Tensor, radius: Tensor, compile: bool = False
    ) -> None:
        self.layout = layout
        self.inside = inside
        self.screening = screening
        self.radius = radius
        self.compile = compile
        self._weight = inside / (2 + screening)
        self._high, self._low, self._pairs = (layout.line(torch.zeros_like(inside)) for _ in range(3))

    def select(self, keep: Tensor) -> "System":
        """The system of the shapes with these indices."""
        return System(self.layout, self.inside[keep], self.screening[keep], self.radius[keep], self.compile)

    def sweep(self, line: Tensor, out: Tensor) -> None:
        """Set out = T v = (M v + N v + 1) / (2 + s) on the shapes and 0 elsewhere, `(N, pixels)`, for v on `line`."""
        if self.compile:
            out.copy_(_compiled_sweep()(line, self._weight, self.layout.strides))
        else:
            high, low = self._extrema(line)
            torch.add(high, low, out=out).add_(1).mul_(self._weight)

    def residual(self, line: Tensor) -> Tensor:
        """R(v) as `torchlinf.field.stencil.residual` takes it, `(N, pixels)`; the next call overwrites it."""
        high, low = self._extrema(line)
        value = self.layout.rows(line)
        high.sub_(value)
        high.sub_(torch.sub(value, low, out=low))
        torch.mul(value, self.screening, out=low)
        return high.add_(torch.sub(1, low, out=low)).mul_(self.inside)

    def _extrema(self, line: Tensor) -> tuple[Tensor, Tensor]:
        """M v and N v, `(N, pixels)` each; right on the shapes, arbitrary elsewhere."""
        for extremum, target in ((torch.maximum, self._high), (torch.minimum, self._low)):
            source = line
            for stride in self.layout.strides:
                pairs = self._pairs[:-stride]
                extremum(source[:-stride], source[stride:], out=pairs)
                extremum(pairs[:-stride], pairs[stride:], out=target[stride:-stride])
                source = target
        return self.layout.rows(self._high), self.layout.rows(self._low)


def fused_sweep(line: Tensor, weight: Tensor, strides: list[int]) -> Tensor:
    """T v, `(N, pixels)`, for v on `line`, without buffers and views: what a compiler turns into one pass."""
    high = low = line
    for stride in strides:
        high = torch.maximum(torch.maximum(high[: -2 * stride], high[stride:-stride]), high[2 * stride :])
        low = torch.minimum(torch.minimum(low[: -2 * stride], low[stride:-stride]), low[2 * stride :])
    return (high + low + 1).view(weight.shape) * weight


@cache
def _compiled_sweep() -> Callable[[Tensor, Tensor, list[int]], Tensor]:
    # shapes leave the batch, so its size must not be part of what is compiled
    return torch.compile(fused_sweep, dynamic=True)
