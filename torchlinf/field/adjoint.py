"""The transposed linear solve that a gradient takes: compiled on the CPU, in torch operations elsewhere."""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from torchlinf._boxes import bounding_box
from torchlinf._parallel import for_each
from torchlinf.field.linearised import TiedRows, bicgstab
from torchlinf.kernels import usable

TIE = 1e-11  # share of max f within which neighbours are equal, or twice the error bound where that is more
# Relative residual asked for, and what is still a solution, in the 2-norm; rounding stays well below the second.
TOL = {torch.float64: (1e-11, 1e-8), torch.float32: (1e-5, 1e-3)}


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
    found, reached = solve(value, weight, tie, gradient, tol)
    failed = ~(reached <= accepted)
    if failed.any():
        raise RuntimeError(
            f"the gradient of the field must have a relative residual of at most {accepted:g}; got "
            f"{reached[failed].max().item():.1e} on {int(failed.sum())} of {len(failed)} shapes. "
            "Solve the field with a smaller tol."
        )
    return found


def _compiled(value: Tensor, weight: Tensor, tie: Tensor, gradient: Tensor, tol: float) -> tuple[Tensor, Tensor]:
    """Shape by shape: one sparse elimination each."""
    from torchlinf.field.linearised_cpu import TiedSystem
    from torchlinf.kernels import grid

    values, weights, gradients = value.numpy(), weight.numpy(), gradient.numpy()
    found, reached = gradients.copy(), np.zeros(len(values))

    def solve(i: int, check: Callable[[], None]) -> None:
        box = bounding_box(values[i] > 0)
        if not values[i][box].size:
            return
        v, w, b = (grid.pad(array[i][box]) for array in (values, weights, gradients))
        a = np.divide(1.0, w, out=np.zeros_like(w), where=w > 0)
        system = TiedSystem(grid.make_grid(v > 0), v.reshape(-1), a.reshape(-1), tie[i].item())
        y, reached[i] = system.solve(b.reshape(-1), tol, transposed=True)
        check()
        flow = np.zeros_like(v)
        system.spread(y, flow.reshape(-1))
        here, there = _ring(box, values[i].shape)
        found[i][here] += flow[there]

    for_each(solve, len(values))
    return torch.from_numpy(found), torch.from_numpy(reached)


def _ring(box: tuple[slice, ...], shape: tuple[int, ...]) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """The box and what of its ring lies within the array, in the array and in the padded box."""
    here = tuple(slice(max(part.start - 1, 0), min(part.stop + 1, size)) for part, size in zip(box, shape, strict=True))
    there = tuple(
        slice(new.start - old.start + 1, new.stop - old.start + 1) for new, old in zip(here, box, strict=True)
    )
    return here, there


def _batched(value: Tensor, weight: Tensor, tie: Tensor, gradient: Tensor, tol: float) -> tuple[Tensor, Tensor]:
    """All shapes at once, by BiCGStab."""
    rows = TiedRows(value, weight, tie)
    right = rows.pack(gradient) * rows.inside
    y, reached = bicgstab(rows.transposed_product, right, tol)
    return gradient + rows.unpack(rows.spread(y)), reached
