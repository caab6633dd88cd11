"""The derivative of the field: one linear solve with the transposed operator, whatever found the field.

The field obeys f = w K(f) with K(f) = M f + N f + 1 and the weight w = m / (2 + s): 1 / (2 + s) on the shape and 0
outside, or anything between. Where no two neighbours tie, M f and N f have the derivatives P_up and P_down, which pick
the neighbour that holds the maximum and the minimum, so

    df = w (P_up + P_down) df + K dw,    hence    dl/dw = K mu    with    mu = dl/df + (P_up + P_down)^T (w mu).

That takes no more than f and w. Where neighbours tie there is no derivative but a set of them; P takes the mean over
the nearest that tie, an element of that set which commutes with flips and axis swaps. The solve is compiled on the CPU
(`torchlinf.kernels.linearised`), and BiCGStab in torch operations elsewhere.
"""

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.parallel import for_each
from torchlinf.field.once import differentiable_once
from torchlinf.field.stencil import block_max, block_min
from torchlinf.kernels import usable

TIE = 1e-11  # share of max f within which neighbours are equal, or twice the error bound where that is more
# The tolerance of the backward solve: the relative residual asked for, and the largest that is accepted, in the 2-norm;
# rounding stays well below the second.
TOL = {torch.float64: (1e-11, 1e-8), torch.float32: (1e-5, 1e-3)}
ITERATIONS = 20_000  # of BiCGStab in torch operations, each time it starts
STARTS = 4


def attach_gradient(value: Tensor, weight: Tensor, bound: Tensor, everywhere: bool = True) -> Tensor:
    """The solved field as a differentiable function of the weight.

    Args:
        value: f, `(N, *spatial)` float64, solved for `weight`; 0 where the weight is.
        weight: w like f, at least 0 and below 1/2; what the result can be differentiated by, once.
        bound: certified relative error of f, `(N,)`.
        everywhere: whether the derivative is wanted where w is 0 as well; elsewhere K f is f / w, which saves two
            passes with the stencil.

    Returns:
        f. Its backward raises RuntimeError where the linear solve fails, and so does that of a second derivative.

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
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None, None]:
        weight, value, bound = ctx.saved_tensors
        with torch.no_grad():
            mu = influence(value, weight, bound, gradient)
            if ctx.everywhere:
                ndim = value.ndim - 1
                slope = (block_max(value, ndim) + block_min(value, ndim) + 1) * mu
            else:
                slope = torch.where(weight > 0, value / weight, 0).mul_(mu)
        return differentiable_once(slope, weight, gradient), None, None, None

    @staticmethod
    def vmap(*args: object) -> None:
        raise NotImplementedError(
            "the field must be called outside torch.func.vmap; got a call inside. It is batched: stack the shapes."
        )


def influence(value: Tensor, weight: Tensor, bound: Tensor, gradient: Tensor) -> Tensor:
    """mu with mu - (P_up + P_down)^T (w mu) = gradient: what a change of w (M f + N f + 1) at a pixel does to the loss.

    P_up and P_down take the mean over the neighbours that hold the maximum and the minimum of the block of f; of those
    that are equal the nearest. w is 0 outside the shapes, where mu gathers what flows there from boundary pixels.

    Args:
        value: f, `(N, *spatial)`, 0 where w is.
        weight: w = 1 / (2 + s(x)) on the shapes, 0 outside, like f.
        bound: certified relative error of f, `(N,)`.
        gradient: of the loss with respect to f, like f.

    Returns:
        mu, like f.

    Raises:
        RuntimeError: the gradient is not finite, or the residual of some shape stayed too large.
    """
    if not gradient.isfinite().all():
        raise RuntimeError("the gradient of a loss by the field must be finite; got NaN or infinity. Check the loss.")
    tol, accepted = TOL[value.dtype]
    tie = value.flatten(1).amax(dim=1) * (2 * bound).clamp(min=TIE)
    solve = _compiled if usable(value) else _batched
    solution, reached = solve(value, weight, tie, gradient, tol)
    failed = ~(reached <= accepted)
    if failed.any():
        raise RuntimeError(
            f"the gradient of the field must have a relative residual of at most {accepted:g}; got "
            f"{reached[failed].max().item():.1e} on {int(failed.sum())} of {len(failed)} shapes. "
            "Solve the field with a smaller tol."
        )
    return solution


def _compiled(value: Tensor, weight: Tensor, tie: Tensor, gradient: Tensor, tol: float) -> tuple[Tensor, Tensor]:
    """Shape by shape: one sparse elimination each."""
    from torchlinf.kernels import grid
    from torchlinf.kernels.linearised import LinearisedOperator

    values, weights, gradients = value.numpy(), weight.numpy(), gradient.numpy()
    solution, reached = gradients.copy(), np.zeros(len(values))

    def solve(i: int, check: Callable[[], None]) -> None:
        box = bounding_box(values[i] > 0)
        if not values[i][box].size:
            return
        v, w, b = (grid.pad(array[i][box]) for array in (values, weights, gradients))
        a = np.divide(1.0, w, out=np.zeros_like(w), where=w > 0)
        operator = LinearisedOperator(grid.make_grid(v > 0), v.reshape(-1), a.reshape(-1), tie[i].item())
        y, reached[i] = operator.solve(b.reshape(-1), tol, transposed=True)
        check()
        flow = np.zeros_like(v)
        operator.spread(y, flow.reshape(-1))
        in_array, in_box = _ring(box, values[i].shape)
        solution[i][in_array] += flow[in_box]

    for_each(solve, len(values))
    return torch.from_numpy(solution), torch.from_numpy(reached)


def _ring(box: tuple[slice, ...], shape: tuple[int, ...]) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """The box and what of its ring lies within the array, in the array and in the padded box."""
    in_array = tuple(
        slice(max(part.start - 1, 0), min(part.stop + 1, size)) for part, size in zip(box, shape, strict=True)
    )
    in_box = tuple(
        slice(new.start - old.start + 1, new.stop - old.start + 1) for new, old in zip(in_array, box, strict=True)
    )
    return in_array, in_box


def _batched(value: Tensor, weight: Tensor, tie: Tensor, gradient: Tensor, tol: float) -> tuple[Tensor, Tensor]:
    """All shapes at once, by BiCGStab."""
    rows = LinearisedOperators(value, weight, tie)
    right = rows.pack(gradient) * rows.inside
    y, reached = bicgstab(rows.transposed_product, right, tol)
    return gradient + rows.unpack(rows.spread(y)), reached


class LinearisedOperators:
    """The linearised operator with ties split, for N shapes on padded lines `(N, P)`.

    It is y(x) - w(x) (mean of y over up(x) + mean of y over down(x)). up(x) are, of the neighbours within `tie` of the
    block's maximum, those that differ from x along the fewest axes; down(x) likewise. `torchlinf.kernels.linearised`
    says why. Kept are 2 * 3^n bools a pixel.
    """

    def __init__(self, value: Tensor, weight: Tensor, tie: Tensor) -> None:
        """Linearise at `value` f with weights w, (N, *spatial); `tie` is absolute, (N,)."""
        self.spatial = tuple(value.shape[1:])
        v = self.pack(value)
        self.inside = v > 0
        self.weight = self.pack(weight) * self.inside
        self.offsets = _nearest_first(self.spatial)
        around = [v.roll(-offset, 1) for _, offset in self.offsets]
        high, low = around[0], around[0]
        for other in around[1:]:
            high, low = torch.maximum(high, other), torch.minimum(low, other)
        self.sides = [
            self._nearest([other >= high - tie[:, None] for other in around]),
            self._nearest([other <= low + tie[:, None] for other in around]),
        ]

    def _nearest(self, hits: list[Tensor]) -> tuple[list[Tensor], Tensor]:
        """Of the neighbours that hit, which are the nearest, and the share of each."""
        kept: list[Tensor] = []
        open_rows, count = self.inside, torch.zeros_like(self.inside, dtype=torch.int8)
        for axes in range(self.offsets[-1][0] + 1):
            ring = [hit & open_rows for (steps, _), hit in zip(self.offsets, hits, strict=True) if steps == axes]
            for hit in ring:
                count += hit
            kept += ring
            open_rows = self.inside & (count == 0)
        return kept, 1 / count.clamp(min=1).to(self.weight)

    def pack(self, x: Tensor) -> Tensor:
        """`(N, *spatial)` with a ring of zeros, as lines."""
        return torch.nn.functional.pad(x, [1] * (2 * len(self.spatial))).flatten(1)

    def unpack(self, lines: Tensor) -> Tensor:
        """Lines back to `(N, *spatial)`; what lies on the ring is beyond the array."""
        padded = lines.view(-1, *(size + 2 for size in self.spatial))
        return padded[:, *(slice(1, -1) for _ in self.spatial)]

    def spread(self, y: Tensor) -> Tensor:
        """At every pixel its shares of the w y of those that have it as a neighbour; outside the shapes as well."""
        total = torch.zeros_like(y)
        for kept, share in self.sides:
            part = self.weight * y * share
            for (_, offset), hit in zip(self.offsets, kept, strict=True):
                total += (part * hit).roll(offset, 1)
        return total

    def transposed_product(self, y: Tensor) -> Tensor:
        """A^T y for y that is 0 outside the shapes; 0 there."""
        return y - self.spread(y) * self.inside


def _nearest_first(spatial: tuple[int, ...]) -> list[tuple[int, int]]:
    """The block's neighbours as (axes along which they step, offset on a padded line), nearest first."""
    stride, strides = 1, []
    for size in reversed(spatial):
        strides.append(stride)
        stride *= size + 2
    steps = product((-1, 0, 1), repeat=len(spatial))
    return sorted(
        (sum(map(abs, step)), sum(k * stride for k, stride in zip(step, reversed(strides), strict=True)))
        for step in steps
    )


def bicgstab(operator: Callable[[Tensor], Tensor], right: Tensor, tol: float) -> tuple[Tensor, Tensor]:
    """Solve operator(y) = right, row by row `(N, P)`, until each residual is below `tol` in the 2-norm.

    Returns:
        y and the relative residual reached, `(N,)`: the true one, and not finite where `right` is not.
    """
    size = _dot(right, right).sqrt()
    y = torch.zeros_like(right)
    for _ in range(STARTS):
        r = right - operator(y)
        reached = _dot(r, r).sqrt() / torch.where(size == 0, 1, size)
        if (reached <= tol).all() or not reached.isfinite().all():
            break
        y = y + _bicgstab(operator, r, 0.1 * tol * size)
    return y, reached[:, 0]


def _bicgstab(operator: Callable[[Tensor], Tensor], r: Tensor, target: Tensor) -> Tensor:
    """What is to be added to reduce the residuals to the targets `(N, 1)`, as far as BiCGStab gets.

    A row that is done, or breaks down, has its steps set to 0 and stays as it is.
    """
    y, shadow, p = torch.zeros_like(r), r, r
    rho = _dot(shadow, r)
    going = _dot(r, r).sqrt() > target
    for _ in range(ITERATIONS):
        v = operator(p)
        alpha = _ratio(rho, _dot(shadow, v), going)
        half = r - alpha * v
        t = operator(half)
        omega = _ratio(_dot(t, half), _dot(t, t), going)
        y = y + alpha * p + omega * half
        r = torch.where(going, half - omega * t, r)
        following = _dot(shadow, r)
        beta = _ratio(following, rho, going) * _ratio(alpha, omega, going)
        going = going & (_dot(r, r).sqrt() > target) & (beta != 0)
        if not going.any():
            break
        p = r + beta * (p - omega * v)
        rho = following
    return y


def _ratio(a: Tensor, b: Tensor, where: Tensor) -> Tensor:
    return torch.where(where & (b != 0), a / torch.where(b == 0, 1, b), 0)


def _dot(a: Tensor, b: Tensor) -> Tensor:
    return (a * b).sum(dim=1, keepdim=True)
