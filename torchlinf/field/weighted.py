"""The field for weights that differ from pixel to pixel, f = w (M f + N f + 1): compiled, or in torch operations.

With s(x) = 1 / w(x) - 2 this is the equation with a screening of its own at every pixel. The certificate holds as it
is: its proof asks no more of s than that it is positive.
"""

import torch
from torch import Tensor

from torchlinf.field.accelerated_value_iteration import Accelerated
from torchlinf.field.cuda_graphs import Rounds
from torchlinf.field.distance import distance_of
from torchlinf.field.iterate import _Batch
from torchlinf.field.layout import Layout, System
from torchlinf.field.solution import FieldSolution, Status
from torchlinf.kernels import usable


def solve_graded(weight: Tensor, tol: float) -> FieldSolution:
    """Solve every shape to the relative error `tol`.

    Args:
        weight: w, (N, *spatial) float64 (float32 on devices without it), in [0, 1/2); 0 outside the shapes.
        tol: relative error to certify.

    Returns:
        What was found; a shape that was not certified has status MAX_SWEEPS.
    """
    if usable(weight):
        from torchlinf.field.weighted_cpu import solve_compiled

        return solve_compiled(weight, tol)
    return _solve_batched(weight, tol)


class GradedSystem(System):
    """A `System` whose screening is given by pixel; `screening` is a lower bound of it, which sets the momentum."""

    def __init__(self, layout: Layout, weight: Tensor, radius: Tensor) -> None:
        self._given = weight
        inside = (weight > 0).to(weight)
        self._own = torch.where(weight > 0, 1 / torch.where(weight > 0, weight, 1) - 2, 0)
        least = torch.where(weight > 0, self._own, torch.inf).amin(dim=1, keepdim=True)
        super().__init__(layout, inside, least, radius)
        self._weight = weight

    def select(self, keep: Tensor) -> "GradedSystem":
        """The system of the shapes with these indices."""
        return GradedSystem(self.layout, self._given[keep], self.radius[keep])

    def residual(self, line: Tensor) -> Tensor:
        """R(v), `(N, pixels)`; the next call overwrites it."""
        high, low = self._extrema(line)
        value = self.layout.rows(line)
        high.sub_(value)
        high.sub_(torch.sub(value, low, out=low))
        torch.mul(value, self._own, out=low)
        return high.add_(torch.sub(1, low, out=low)).mul_(self.inside)


class _GradedBatch(_Batch):
    """All shapes of one call in the loop of `iterate`."""

    def __init__(self, weight: Tensor, shape: Tensor, radius: Tensor) -> None:
        layout = Layout(weight > 0)
        rows = layout.rows(layout.pack(weight))[shape]
        self.layout = layout
        self.shape = shape
        self.max_sweeps = None
        self.limit = Accelerated.limit(radius)
        self.best = rows.clone()  # one sweep from 0
        self.bound = torch.full_like(rows[:, 0], torch.inf)
        self.mark, self.marked = self.bound, torch.zeros_like(radius)
        self.done = 0
        self.method = Accelerated(GradedSystem(layout, rows, radius), layout.line(rows))
        self.rounds = Rounds(self.method)


def _solve_batched(weight: Tensor, tol: float) -> FieldSolution:
    mask = weight > 0
    radius = distance_of(mask).flatten(1).amax(dim=1).long()
    answer = FieldSolution(
        value=torch.zeros_like(weight),
        error_bound=weight.new_zeros(len(weight)),
        num_sweeps=torch.zeros_like(radius),
        num_solves=torch.zeros_like(radius),
        status=torch.full_like(radius, int(Status.EMPTY)),
    )
    shape = radius.nonzero()[:, 0]
    if len(shape):
        _GradedBatch(weight, shape, radius[shape]).solve(tol, answer)
    return answer
