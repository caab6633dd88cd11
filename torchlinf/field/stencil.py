"""The stencil of the equation in torch operations: block maximum and minimum, sweeps and residual.

Shifted slices are used instead of pooling: on a CPU they are an order of magnitude faster, they exist for every number
of dimensions, and what is derived from them is deterministic on every device.
"""

import math
from collections.abc import Callable, Iterator
from functools import cache

import torch
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box


def block_max(x: Tensor, ndim: int) -> Tensor:
    """Maximum over the 3^n block of every pixel; what lies beyond the array counts as 0.

    Args:
        x: `(..., *spatial)`, any real dtype.
        ndim: n, the number of spatial (last) dimensions.

    Returns:
        Tensor like `x`.

    >>> block_max(torch.tensor([1, 5, 2, -3]), 1).tolist()
    [5, 5, 5, 2]
    """
    return _block(torch.maximum, x, ndim)


def block_min(x: Tensor, ndim: int) -> Tensor:
    """Minimum over the 3^n block of every pixel; what lies beyond the array counts as 0.

    Args:
        x: `(..., *spatial)`, any real dtype.
        ndim: n, the number of spatial (last) dimensions.

    Returns:
        Tensor like `x`.

    >>> block_min(torch.tensor([1, 5, 2, 3]), 1).tolist()
    [0, 1, 2, 0]
    """
    return _block(torch.minimum, x, ndim)


def _block(extremum: Callable[..., Tensor], x: Tensor, ndim: int) -> Tensor:
    for dim in range(-ndim, 0):
        padded = torch.nn.functional.pad(x.movedim(dim, -1), (1, 1))
        pairs = extremum(padded[..., 1:], padded[..., :-1])
        x = extremum(pairs[..., 1:], pairs[..., :-1]).movedim(-1, dim)
    return x


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
        screening: s, `(N, 1)`, or `(N, pixels)` where it differs from pixel to pixel.
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
        self._partial: list[Tensor] = []

    @property
    def least_screening(self) -> Tensor:
        """The smallest s of each shape, `(N, 1)`."""
        if self.screening.shape[1] == 1:
            return self.screening
        return torch.where(self.inside > 0, self.screening, torch.inf).amin(dim=1, keepdim=True)

    def select(self, keep: Tensor) -> "System":
        """The system of the shapes with these indices."""
        return System(self.layout, self.inside[keep], self.screening[keep], self.radius[keep], self.compile)

    def float(self) -> "System":
        """The same system in float32."""
        return System(self.layout, self.inside.float(), self.screening.float(), self.radius, self.compile)

    def sweep(self, line: Tensor, out: Tensor) -> None:
        """Set out = T v = (M v + N v + 1) / (2 + s) on the shapes and 0 elsewhere, `(N, pixels)`, for v on `line`."""
        if self.compile:
            out.copy_(_compiled_sweep()(line, self._weight, self.layout.strides))
        else:
            high, low = self._extrema(line)
            torch.add(high, low, out=out).add_(1).mul_(self._weight)

    def sweeps(self, line: Tensor) -> Callable[[], None]:
        """A sweep of `line` in place, to be repeated: what it works on is laid out once, for calls cost time."""
        if self.compile:
            return lambda: self.sweep(line, out=self.layout.rows(line))
        calls = [
            (extremum, arguments, out)
            for extremum, target in ((torch.maximum, self._high), (torch.minimum, self._low))
            for arguments, out in self._steps(line, target)
        ]
        rows, high, low = self.layout.rows(line), self.layout.rows(self._high), self.layout.rows(self._low)

        def sweep() -> None:
            for extremum, arguments, out in calls:
                extremum(*arguments, out=out)
            torch.add(high, low, out=rows).add_(1).mul_(self._weight)

        return sweep

    def residual(self, line: Tensor) -> Tensor:
        """R(v) = M v + N v + 1 - (2 + s) v on the shapes and 0 elsewhere, `(N, pixels)`; the next call overwrites it.

        The sum is taken as ((M v - v) - (v - N v)) + (1 - s v): neighbouring values are so close that their differences
        are exact in floating point, so R is known to a few ulps of 1 and of s v instead of ulps of 2 v.
        """
        high, low = self._extrema(line)
        value = self.layout.rows(line)
        high.sub_(value)
        high.sub_(torch.sub(value, low, out=low))
        torch.mul(value, self.screening, out=low)
        return high.add_(torch.sub(1, low, out=low)).mul_(self.inside)

    def _extrema(self, line: Tensor) -> tuple[Tensor, Tensor]:
        """M v and N v, `(N, pixels)` each; right on the shapes, arbitrary elsewhere."""
        for extremum, target in ((torch.maximum, self._high), (torch.minimum, self._low)):
            for arguments, out in self._steps(line, target):
                extremum(*arguments, out=out)
        return self.layout.rows(self._high), self.layout.rows(self._low)

    def partial_extrema(self, line: Tensor) -> tuple[list[Tensor], list[Tensor]]:
        """Of the field on `line`: itself, and its maxima over the block along the last axis, the last two ..., all.

        And the same with minima. The next call overwrites them; they are arbitrary outside the shapes.
        """
        if not self._partial:
            self._partial = [torch.zeros_like(line) for _ in range(2 * len(self.layout.strides))]
        found = []
        for number, extremum in enumerate((torch.maximum, torch.minimum)):
            lines = [line, *self._partial[number::2]]
            for source, target, stride in zip(lines[:-1], lines[1:], reversed(self.layout.strides), strict=True):
                pairs = self._pairs[:-stride]
                extremum(source[:-stride], source[stride:], out=pairs)
                extremum(pairs[:-stride], pairs[stride:], out=target[stride:-stride])
            found.append(lines)
        return found[0], found[1]

    def _steps(self, line: Tensor, target: Tensor) -> Iterator[tuple[tuple[Tensor, Tensor], Tensor]]:
        """What an extremum is taken of, and where it goes, until `target` has it over the block."""
        source = line
        for stride in self.layout.strides:
            pairs = self._pairs[:-stride]
            yield (source[:-stride], source[stride:]), pairs
            yield (pairs[:-stride], pairs[stride:]), target[stride:-stride]
            source = target


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


def residual(value: Tensor, mask: Tensor, screening: Tensor) -> Tensor:
    """Residual R(v) = M v + N v + 1 - (2 + s) v of the equation on the shapes, 0 outside; see `System.residual`.

    Args:
        value: v, `(N, *spatial)`; what it is outside the shapes counts for the pixels beside it.
        mask: `(N, *spatial)` bool.
        screening: s = 1 / rho^2, `(N,)`.

    Returns:
        Tensor like `value`.

    >>> residual(torch.tensor([[0.5]]), torch.tensor([[True]]), torch.tensor([1.0])).tolist()
    [[0.0]]
    """
    layout = Layout(mask | (value != 0))
    inside = layout.rows(layout.pack(mask.to(value)))
    system = System(
        layout, inside, screening.to(value)[:, None], torch.zeros(len(mask), dtype=torch.int64, device=mask.device)
    )
    return layout.unpack(system.residual(layout.pack(value)))
