"""Gradients that are not those of the operations that found the values: the only file with a backward.

The field obeys f = w K(f) with K(f) = M f + N f + 1 and the weight w = m / (2 + s): 1 / (2 + s) on the shape and 0
outside, or anything between. Where no two neighbours tie, M f and N f have the derivatives P_up and P_down, which pick
the neighbour that holds the maximum and the minimum, so

    df = w (P_up + P_down) df + K dw,    hence    dl/dw = K mu    with    mu = dl/df + (P_up + P_down)^T (w mu).

That is one linear solve with the transposed matrix, whatever number of sweeps went into f, and it needs no more than f
and w. Where neighbours tie there is no derivative but a set of them; P takes the mean over the nearest that tie, an
element of that set which commutes with flips and axis swaps.
"""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from torchlinf.field.adjoint import influence
from torchlinf.field.erosions import pull_back, sum_of_erosions
from torchlinf.field.stencil import block_max, block_min


def attach_gradient(value: Tensor, weight: Tensor, bound: Tensor, everywhere: bool = True) -> Tensor:
    """The solved field as a differentiable function of the weight.

    Args:
        value: f, `(N, *spatial)` float64, solved for `weight`; 0 where the weight is.
        weight: w like f, at least 0 and below 1/2; what the result can be differentiated by, once.
        bound: certified relative error of f, `(N,)`.
        everywhere: whether the derivative is wanted where w is 0 as well; elsewhere K f is f / w, which saves two
            passes with the stencil.

    Returns:
        f. Its backward raises RuntimeError where the linear solve fails, and has no derivative itself.

    >>> weight = torch.full((1, 1), 0.25, dtype=torch.float64, requires_grad=True)
    >>> field = attach_gradient(weight.detach() / (1 - weight.detach()), weight, torch.zeros(1))  # f = w (f + 0 + 1)
    >>> torch.autograd.grad(field.sum(), weight)[0].item()  # 1 / (1 - w)^2
    1.7777...
    """
    field: Tensor = _Implicit.apply(weight, value, bound, everywhere)  # type: ignore[no-untyped-call]
    return field


class _Implicit(torch.autograd.Function):
    @staticmethod
    def forward(weight: Tensor, value: Tensor, bound: Tensor, everywhere: bool) -> Tensor:
        return value.clone()

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        weight, _, bound, ctx.everywhere = inputs
        ctx.save_for_backward(weight, output, bound)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None, None]:
        weight, value, bound = ctx.saved_tensors
        mu = influence(value, weight, bound, gradient)
        if not ctx.everywhere:
            return torch.where(weight > 0, value / weight, 0).mul_(mu), None, None, None
        ndim = value.ndim - 1
        return (block_max(value, ndim) + block_min(value, ndim) + 1) * mu, None, None, None

    @staticmethod
    def vmap(*args: object) -> None:
        raise NotImplementedError(
            "the field must be called outside torch.func.vmap; got a call inside. It is batched: stack the shapes."
        )


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
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        return pull_back(ctx.saved_tensors[0], gradient)
