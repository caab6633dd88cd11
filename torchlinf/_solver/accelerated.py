"""The fast method in torch operations: lazily averaged Nesterov steps with restart."""

import torch
from torch import Tensor

from torchlinf._solver.layout import System

DAMPING = 1.85
TEST_EVERY = 16


class Accelerated:
    """x <- (y + T y) / 2 at y = x + b (x - x_prev); see docs/method, "How it is solved".

    Without the averaging the momentum diverges. Each shape has its own b = min(1 - 1.85 / D, (k - 1) / (k + 2)), k
    counting its steps since its last restart. The cap is the best one for a chain of pixels of length D: there the
    smallest eigenvalue of the averaged step is q = (1 + pi^2 / 4) / (4 D^2), and the optimal momentum
    (1 - sqrt q) / (1 + sqrt q) is close to 1 - 1.86 / D.

    Every 16th step is tested. A shape restarts if the step y -> x is longer, by its maximum, than at the last test, or
    if at most pixels it points against the step x_prev -> x. The usual test takes the sign of the inner product of
    the two steps. Counting pixels is as good here, and a count, unlike a sum of floats, does not depend on the order
    of the pixels; so neither do the results on the batch or on flips of the mask.

    There is no proof that this converges: the loop certifies, and calls `fall_back` when it does not.
    """

    def __init__(self, system: System, line: Tensor) -> None:
        layout = system.layout
        self.system = system
        self.line = line
        self._ahead, self._new = line.clone(), line.clone()
        self._step = torch.zeros_like(layout.rows(line))
        self._damping = DAMPING / system.radius[:, None].clamp(min=1).to(line.dtype)
        self._since_restart = torch.zeros_like(self._damping)
        self._longest = torch.full_like(self._damping, torch.inf)
        self._steps = 0

    @staticmethod
    def limit(radius: Tensor) -> Tensor:
        """Sweeps allowed by default: 400 D + 2000, where 10 to 40 D are the rule."""
        return 400 * radius + 2000

    def sweep(self) -> None:
        """One step of every shape."""
        rows = self.system.layout.rows
        x, y, new = rows(self.line), rows(self._ahead), rows(self._new)
        self.system.average(self._ahead, out=new)
        torch.sub(new, x, out=self._step)
        self._steps += 1
        self._since_restart += 1
        if self._steps % TEST_EVERY == 0:
            self._restart(y.sub_(new))
        k = self._since_restart
        momentum = torch.minimum((1 - self._damping).clamp_(min=0), (k - 1) / (k + 2))
        torch.add(new, self._step.mul_(momentum), out=y)
        self.line, self._new = self._new, self.line

    def _restart(self, back: Tensor) -> None:
        """Restart the shapes that fail the test; `back` = y - x, overwritten."""
        low, high = back.aminmax(dim=1, keepdim=True)
        longest = torch.maximum(high, -low)
        against = back.mul_(self._step).sign_().sum(dim=1, keepdim=True) > 0
        restart = against | (longest > self._longest)
        self._since_restart.masked_fill_(restart, 1)
        self._longest = longest.masked_fill_(restart, torch.inf)

    def select(self, keep: Tensor) -> None:
        """Go on with the shapes of these indices only."""
        layout = self.system.layout
        self.system = self.system.select(keep)
        self.line, self._ahead = (layout.line(layout.rows(line)[keep]) for line in (self.line, self._ahead))
        self._new = self.line.clone()
        self._step = self._step[keep]
        self._damping, self._since_restart = self._damping[keep], self._since_restart[keep]
        self._longest = self._longest[keep]

    def fall_back(self, stalled: Tensor, best: Tensor) -> None:
        """Restart the shapes marked in `stalled` `(N,)` from `best`, with twice the damping.

        After log2(D) times b = 0 is left, a contraction, which converges from anywhere.
        """
        stalled = stalled[:, None]
        self._damping = torch.where(stalled, 2 * self._damping, self._damping)
        self._since_restart.masked_fill_(stalled, 0)
        self._longest.masked_fill_(stalled, torch.inf)
        for line in (self.line, self._ahead):
            rows = self.system.layout.rows(line)
            torch.where(stalled, best, rows, out=rows)
