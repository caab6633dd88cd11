"""Accelerated value iteration, method="accelerated": Nesterov steps over pairs of sweeps, with restart."""

import math

import torch
from torch import Tensor

from torchlinf.field.stencil import System

TEST_EVERY = 16


class AcceleratedValueIteration:
    """Accelerated value iteration: x <- T T y at y = x + b (x - x_prev); see docs/method, "How it is solved".

    Momentum on single sweeps diverges: on a chain of pixels T has eigenvalues down to -1. Those of T T are all
    positive. Averaging, (y + T y) / 2, would achieve the same, but pairs of sweeps also damp the waves that momentum
    excites along ridges, where neighbours are nearly equal and policies keep changing.

    Each shape has its own b, (k - 1) / (k + 2) at most, k counting its steps since its last restart, and
    (1 - r) / (1 + r) at most, the best for a chain of length D: there 1 - r^2 = 1 - (s + pi^2 / (4 D^2)) is the
    largest eigenvalue of T T.

    About every D sweeps a shape is tested: it restarts if the step y -> x is longer, by its maximum, than at the last
    test, or if at most pixels it points against the step x_prev -> x. (The usual test takes the sign of their inner
    product. A count does as well, and unlike a sum of floats it does not depend on the order of the pixels, so
    neither do the results on the batch or on flips of the mask.) Tests much more often keep breaking off good runs.

    There is no proof that this converges: the loop certifies, and calls `fall_back` when it does not.
    """

    step_sweeps = 2

    def __init__(self, system: System, line: Tensor) -> None:
        self.system = system
        self.line = line
        self._ahead, self._new, self._middle = line.clone(), line.clone(), line.clone()
        self._damping = (system.least_screening + (math.pi / (2 * system.radius[:, None])) ** 2).sqrt()
        self._since_restart = torch.zeros_like(self._damping)
        self._since_test = torch.zeros_like(self._damping)
        self._longest = torch.full_like(self._damping, torch.inf)
        self._sweeps = 0

    @staticmethod
    def limit(radius: Tensor) -> Tensor:
        """Sweeps allowed by default: 400 D + 2000, where 15 to 35 D are the rule."""
        return 400 * radius + 2000

    def step(self) -> None:
        """Two sweeps and the momentum."""
        rows = self.system.layout.rows
        x, y, new, middle = rows(self.line), rows(self._ahead), rows(self._new), rows(self._middle)
        self.system.sweep(self._ahead, out=middle)
        self.system.sweep(self._middle, out=new)
        step = torch.sub(new, x, out=middle)
        self._sweeps += self.step_sweeps
        self._since_restart += 1
        if self._sweeps % TEST_EVERY == 0:
            self._test(y.sub_(new), step)
        k, r = self._since_restart, self._damping.clamp(max=1)
        momentum = torch.minimum((1 - r) / (1 + r), (k - 1) / (k + 2))
        torch.add(new, step.mul_(momentum), out=y)
        self.line, self._new = self._new, self.line

    def _test(self, back: Tensor, step: Tensor) -> None:
        """Restart the shapes that are due and fail the test; `back` = y - x is overwritten."""
        self._since_test += TEST_EVERY
        due = self._since_test >= self.system.radius[:, None]
        longest = torch.maximum(back.amax(dim=1, keepdim=True), -back.amin(dim=1, keepdim=True))
        against = back.mul_(step).sign_().sum(dim=1, keepdim=True) > 0
        restart = due & (against | (longest > self._longest))
        # in place like all else here: a captured graph knows the buffers by their addresses
        self._longest.copy_(torch.where(due, longest.masked_fill(restart, torch.inf), self._longest))
        self._since_test.masked_fill_(due, 0)
        self._since_restart.masked_fill_(restart, 1)

    def select(self, keep: Tensor) -> None:
        """Go on with the shapes of these indices only."""
        layout = self.system.layout
        self.system = self.system.select(keep)
        self.line, self._ahead = (layout.line(layout.rows(line)[keep]) for line in (self.line, self._ahead))
        self._new, self._middle = self.line.clone(), self.line.clone()
        self._damping, self._longest = self._damping[keep], self._longest[keep]
        self._since_restart, self._since_test = self._since_restart[keep], self._since_test[keep]

    def fall_back(self, stalled: Tensor, best: Tensor) -> None:
        """Restart the shapes marked in `stalled`, (N,), from `best`, with twice the damping.

        After about log2(D) times b is 0, which leaves plain sweeps: they converge from anywhere.
        """
        stalled = stalled[:, None]
        self._damping.mul_(1 + stalled.to(self._damping))
        self._since_restart.masked_fill_(stalled, 0)
        self._longest.masked_fill_(stalled, torch.inf)
        for line in (self.line, self._ahead):
            rows = self.system.layout.rows(line)
            torch.where(stalled, best, rows, out=rows)
