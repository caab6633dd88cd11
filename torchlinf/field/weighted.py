"""The field for weights that differ from pixel to pixel, f = w (M f + N f + 1): compiled, or in torch operations.

With s(x) = 1 / w(x) - 2 this is the equation with a screening of its own at every pixel. The certificate holds as it
is: its proof asks no more of s than that it is positive.
"""

import torch
from torch import Tensor

from torchlinf.field.accelerated_value_iteration import AcceleratedValueIteration
from torchlinf.field.distance import distance_of
from torchlinf.field.iterate import Batch, unsolved
from torchlinf.field.solution import FieldSolution
from torchlinf.field.stencil import Layout, System
from torchlinf.kernels import usable


def solve_weighted(weight: Tensor, tol: float) -> FieldSolution:
    """Solve every shape to the relative error `tol`.

    Args:
        weight: w, (N, *spatial) float64 (float32 on devices without it), in [0, 1/2); 0 outside the shapes.
        tol: relative error to certify.

    Returns:
        The solution; a shape that was not certified has status MAX_SWEEPS.
    """
    if usable(weight):
        from torchlinf.field.weighted_policy_iteration import solve_compiled

        return solve_compiled(weight, tol)
    return _solve_batched(weight, tol)


def _solve_batched(weight: Tensor, tol: float) -> FieldSolution:
    """All shapes at once, by accelerated value iteration."""
    mask = weight > 0
    radius = distance_of(mask).flatten(1).amax(dim=1).long()
    answer = unsolved(radius, torch.zeros_like(weight))
    shape = radius.nonzero()[:, 0]
    if len(shape):
        layout = Layout(mask)
        values = layout.pack(weight[shape])  # one sweep from 0
        rows = layout.rows(values)
        inside = rows > 0
        screening = torch.where(inside, 1 / torch.where(inside, rows, 1) - 2, 0)
        system = System(layout, inside.to(weight), screening, radius[shape])
        Batch(AcceleratedValueIteration, system, values, shape, None).solve(tol, answer)
    return answer
