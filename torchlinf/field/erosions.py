"""The sum of all erosions of a grey mask, and how a gradient flows back through it.

With m the mask and N the minimum over the 3^n block, the sum is m + N m + N N m + ...; it ends where nothing is left,
since m is 0 beyond the array. So an erosion is 0 on the outermost pixels, and is kept without them: each is smaller by
one pixel on every side. It is taken axis by axis. It passes the gradient at a pixel to the pixel itself if that holds
the minimum, else to the neighbours that do, in equal parts; what is eroded to 0 has no derivative.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.parallel import for_each
from torchlinf.field.once import differentiable_once
from torchlinf.kernels import usable


def soft_distance_of(occupancy: Tensor) -> Tensor:
    """The sum of all erosions of `(N, *spatial)`, differentiable once, without keeping the erosions."""
    total: Tensor = _Erosions.apply(occupancy)  # type: ignore[no-untyped-call]
    return total


class _Erosions(torch.autograd.Function):
    @staticmethod
    def forward(occupancy: Tensor) -> Tensor:
        return sum_of_erosions(occupancy)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor], output: Tensor) -> None:
        ctx.save_for_backward(inputs[0])

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        (occupancy,) = ctx.saved_tensors
        with torch.no_grad():
            slope = pull_back(occupancy, gradient)
        return differentiable_once(slope, occupancy, gradient)


def sum_of_erosions(occupancy: Tensor) -> Tensor:
    """m + N m + N N m + ... for m in [0, 1], `(N, *spatial)`.

    >>> sum_of_erosions(torch.tensor([[0.5, 1.0, 1.0, 1.0]]))
    tensor([[0.5000, 1.5000, 2.0000, 1.0000]])
    """
    if usable(occupancy):
        from torchlinf.kernels.erosions import erode

        return _shape_by_shape(lambda m: _sum(m, erode, m.ndim), occupancy)
    return _sum(occupancy, _erode, occupancy.ndim - 1)


def pull_back(occupancy: Tensor, gradient: Tensor) -> Tensor:
    """The gradient by m from the one by the sum of erosions, both `(N, *spatial)`.

    >>> pull_back(torch.tensor([[0.5, 1.0, 1.0, 1.0]]), torch.tensor([[0.0, 1.0, 0.0, 0.0]]))
    tensor([[1., 1., 0., 0.]])
    """
    if usable(occupancy):
        from torchlinf.kernels.erosions import erode, through_erosion

        return _shape_by_shape(lambda m, g: _pull(m, g, erode, through_erosion, m.ndim), occupancy, gradient)
    return _pull(occupancy, gradient, _erode, _through_erosion, occupancy.ndim - 1)


def _sum(m: Any, erode: Callable[[Any], Any], ndim: int) -> Any:
    """The sum, for arrays or tensors with `ndim` spatial dimensions."""
    total = m + 0
    number, eroded = 1, erode(m)
    while eroded.any():
        _within(total, number, ndim)[...] += eroded
        number, eroded = number + 1, erode(eroded)
    return total


def _pull(m: Any, gradient: Any, erode: Callable[[Any], Any], through: Callable[[Any, Any], Any], ndim: int) -> Any:
    """The gradient by m, for arrays or tensors: from the last erosion to the first, each adds its part."""
    count, eroded = 0, m
    while eroded.any():
        count, eroded = count + 1, erode(eroded)
    if count == 0:
        return 0 * gradient
    flow = 0 * eroded
    for eroded in _reversed_iterates(m, erode, count):
        count -= 1
        flow = through(flow, eroded) + _within(gradient, count, ndim) * (eroded > 0)
    return flow


def _within(x: Any, rim: int, ndim: int) -> Any:
    """x without the pixels nearer than `rim` to an end of the array."""
    return x[(..., *(slice(rim, size - rim) for size in x.shape[x.ndim - ndim :]))]


def _reversed_iterates(first: Any, advance: Callable[[Any], Any], count: int) -> Iterator[Any]:
    """x_(count - 1) ... x_0 of x_0 = first, x_(k + 1) = advance(x_k), holding some 2 sqrt(count) of them at a time."""
    step = math.isqrt(count) + 1
    kept, x = [], first
    for k in range(count):
        if k % step == 0:
            kept.append(x)
        x = advance(x)
    while kept:
        segment = [kept.pop()]
        while len(segment) < min(step, count - len(kept) * step):
            segment.append(advance(segment[-1]))
        while segment:
            yield segment.pop()


def _shape_by_shape(function: Callable[..., Any], *tensors: Tensor) -> Tensor:
    """Apply a function of arrays to every shape, several at a time, each cropped to where the first array is not 0."""
    arrays = [tensor.numpy() for tensor in tensors]
    total = torch.zeros_like(tensors[0], memory_format=torch.contiguous_format)

    def apply(i: int, check: Callable[[], None]) -> None:
        check()
        box = bounding_box(arrays[0][i] > 0)
        if arrays[0][i][box].size:
            total[i][box] = torch.from_numpy(
                function(*(array[i][box].astype(np.float64, order="C") for array in arrays))
            )

    for_each(apply, len(total))
    return total


def _erode(x: Tensor) -> Tensor:
    """Minimum over the 3^n block of every pixel but the outermost."""
    for dim in range(1, x.ndim):
        x = _least(x, dim)
    return x


def _least(x: Tensor, dim: int) -> Tensor:
    left, middle, right = _threes(x, dim)
    return torch.minimum(torch.minimum(left, right), middle)


def _threes(x: Tensor, dim: int) -> list[Tensor]:
    """Of all three adjacent places along a dimension the first, the second and the third."""
    size = x.shape[dim]
    return [x.narrow(dim, min(k, size), max(0, size - 2)) for k in range(3)]


def _through_erosion(flow: Tensor, before: Tensor) -> Tensor:
    """The gradient by a batch of masks from the one by its erosion."""
    stages = [before]
    for dim in range(1, before.ndim):
        stages.append(_least(stages[-1], dim))
    for dim in range(before.ndim - 1, 0, -1):
        after = stages.pop()
        flow = _through_axis(flow, stages[-1], after, dim)
    return flow


def _through_axis(flow: Tensor, before: Tensor, after: Tensor, dim: int) -> Tensor:
    """The gradient by `before` from the one by `after`, its erosion along one axis."""
    left, middle, right = (part == after for part in _threes(before, dim))
    kept = flow * middle
    moved = (flow - kept) / (left.to(flow) + right).clamp(min=1)
    gradient = torch.zeros_like(before)
    for part, share in zip(_threes(gradient, dim), (moved * left, kept, moved * right), strict=True):
        part += share
    return gradient
