"""The fast method in torch operations: lazily averaged Nesterov steps with restart."""

import torch
from torch import Tensor

from torchlinf._solver.layout import System


class Accelerated:
    """x <- (y + T y) / 2 at y = x + b (x - x_prev), docs/method.

    Each shape has its own momentum b = min(1 - 2/D, (k-1) / (k+2)), k counting its steps since its last restart. It
    restarts when a step points against the one before, (y - x_new) . (x_new - x) > 0. Without the averaging the momentum
    diverges. There is no proof that it converges: the loop certifies, and falls back to b = 0, a contraction.
    """

    def __init__(self, system: System, line: Tensor) -> None:
        self.system = system
        self.line = line
        self._ahead, self._step = line.clone(), torch.zeros_like(system.inside)
        self._count = torch.zeros_like(system.screening)
        self._top = (1 - 2 / system.radius[:, None].to(self._count.dtype)).clamp(min=0)

    @staticmethod
    def limit(radius: Tensor) -> Tensor:
        """Sweeps allowed by default: 400 D + 2000; 15 to 40 D are the rule."""
        return 400 * radius + 2000

    def sweep(self) -> None:
        rows = self.system.layout.rows
        x, y = rows(self.line), rows(self._ahead)
        new = torch.empty_like(x)
        self.system.sweep(self._ahead, out=new)
        new.add_(y).mul_(0.5)
        y.sub_(new)
        torch.sub(new, x, out=self._step)
        restart = (y * self._step).sum(dim=1, keepdim=True) > 0
        self._count.add_(1).masked_fill_(restart, 1)
        momentum = torch.minimum(self._top, (self._count - 1) / (self._count + 2))
        x.copy_(new)
        torch.add(new, self._step.mul_(momentum), out=y)

    def select(self, keep: Tensor) -> None:
        layout = self.system.layout
        self.system = self.system.select(keep)
        self.line, self._ahead = (layout.line(layout.rows(line)[keep]) for line in (self.line, self._ahead))
        self._step, self._count, self._top = self._step[keep], self._count[keep], self._top[keep]

    def fall_back(self, stalled: Tensor, best: Tensor) -> None:
        """Go on from ``best`` without momentum on the shapes marked in ``stalled`` ``(N,)``."""
        stalled = stalled[:, None]
        self._top.masked_fill_(stalled, 0)
        for line in (self.line, self._ahead):
            rows = self.system.layout.rows(line)
            torch.where(stalled, best, rows, out=rows)
