"""The sum of all erosions of a grey mask, and how a gradient flows back through it.

With m the mask and N the minimum over the 3^n block, the sum is m + N m + N N m + ...; it ends where nothing is left,
since m is 0 beyond the array. An erosion is taken axis by axis. It passes the gradient at a pixel to the pixel itself
if that holds the minimum, else to the neighbours that do, in equal parts; what is eroded to 0 has no derivative.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

import torch
from torch import Tensor

from torchlinf._kernels import usable
from torchlinf._parallel import for_each
from torchlinf._stencil import block_min


def sum_of_erosions(occupancy: Tensor) -> Tensor:
    """m + N m + N N m + ... for m in [0, 1], `(N, *spatial)`.

    >>> sum_of_erosions(torch.tensor([[0.5, 1.0, 1.0, 1.0]]))
    tensor([[0.5000, 1.5000, 2.0000, 1.0000]])
    """
    if usable(occupancy):
        from torchlinf._kernels.erosions import erode

        return _shape_by_shape(lambda m: _sum(m, erode), occupancy)
    return _sum(occupancy, _erode)


def pull_back(occupancy: Tensor, gradient: Tensor) -> Tensor:
    """The gradient by m from the one by the sum of erosions, both `(N, *spatial)`.

    >>> pull_back(torch.tensor([[0.5, 1.0, 1.0, 1.0]]), torch.tensor([[0.0, 1.0, 0.0, 0.0]]))
    tensor([[1., 1., 0., 0.]])
    """
    if usable(occupancy):
        from torchlinf._kernels.erosions import erode, through_erosion

        return _shape_by_shape(lambda m, g: _pull(m, g, erode, through_erosion), occupancy, gradient)
    return _pull(occupancy, gradient, _erode, _through_erosion)


def _sum(m: Any, erode: Callable[[Any], Any]) -> Any:
    """The sum, for arrays or tensors."""
    total = m + 0
    eroded = erode(m)
    while eroded.any():
        total += eroded
        eroded = erode(eroded)
    return total


def _pull(m: Any, gradient: Any, erode: Callable[[Any], Any], through: Callable[[Any, Any], Any]) -> Any:
    """The gradient by m, for arrays or tensors: from the last erosion to the first, each adds its part."""
    count, eroded = 0, m
    while eroded.any():
        count, eroded = count + 1, erode(eroded)
    flow = 0 * gradient
    for eroded in _reversed_iterates(m, erode, count):
        flow = through(flow, eroded) + gradient * (eroded > 0)
    return flow


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
    from torchlinf._kernels.grid import crop

    arrays = [tensor.numpy() for tensor in tensors]
    found = torch.zeros_like(tensors[0], memory_format=torch.contiguous_format)

    def apply(i: int, check: Callable[[], None]) -> None:
        check()
        box = crop(arrays[0][i] > 0)
        if arrays[0][i][box].size:
            found[i][box] = torch.from_numpy(function(*(array[i][box].copy() for array in arrays)))

    for_each(apply, len(found))
    return found


def _erode(x: Tensor) -> Tensor:
    return block_min(x, x.ndim - 1)


def _through_erosion(flow: Tensor, before: Tensor) -> Tensor:
    """The gradient by a batch of masks from the one by its erosion."""
    stages = [before]
    for dim in range(1, before.ndim):
        lines = stages[-1].movedim(dim, -1)
        stages.append(_erode(lines.flatten(0, -2)).view_as(lines).movedim(-1, dim))
    for dim in range(before.ndim - 1, 0, -1):
        after = stages.pop()
        flow = _through_axis(flow, stages[-1], after, dim)
    return flow


def _through_axis(flow: Tensor, before: Tensor, after: Tensor, dim: int) -> Tensor:
    """The gradient by `before` from the one by `after`, its erosion along one axis."""
    kept = flow * (before == after)
    moved = (flow - kept).movedim(dim, -1)
    padded = torch.nn.functional.pad(before.movedim(dim, -1), (1, 1))
    least = after.movedim(dim, -1)
    left, right = padded[..., :-2] == least, padded[..., 2:] == least
    moved = moved / (left.to(flow.dtype) + right).clamp(min=1)
    found = kept.movedim(dim, -1)
    found[..., :-1] += (moved * left)[..., 1:]
    found[..., 1:] += (moved * right)[..., :-1]
    return found.movedim(-1, dim)
