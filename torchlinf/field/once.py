"""Gradients that are not differentiable themselves: a second derivative raises, however it is asked for.

`torch.autograd.function.once_differentiable` is not enough. It cuts the gradient off from its sources, and
`torch.autograd.grad` runs only what leads to the inputs that it is given: it never comes to the cut, and returns what
the other paths add up to, which is a wrong number.
"""

from typing import Any

from torch import Tensor
from torch.autograd import Function


def differentiable_once(gradient: Tensor, *sources: Tensor) -> Tensor:
    """The gradient, as a function of what it was made of, whose derivative raises RuntimeError.

    Args:
        gradient: computed without a graph.
        sources: the tensors that it depends on.

    Example:
        >>> import torch
        >>> x = torch.ones(2, requires_grad=True)
        >>> slope = differentiable_once(2 * x.detach(), x)
        >>> torch.autograd.grad(slope.sum(), x)
        Traceback (most recent call last):
        RuntimeError: a field and a soft distance can be differentiated once; got a second derivative. Pass...
    """
    result: Tensor = _Once.apply(gradient, *sources)  # type: ignore[no-untyped-call]
    return result


class _Once(Function):
    @staticmethod
    def forward(gradient: Tensor, *sources: Tensor) -> Tensor:
        return gradient.clone()

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        """Nothing is kept."""

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        raise RuntimeError(
            "a field and a soft distance can be differentiated once; got a second derivative. "
            "Pass create_graph=False, or take differences of first derivatives."
        )
