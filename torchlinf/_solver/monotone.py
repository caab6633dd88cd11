"""The reference method: plain sweeps, which decrease from the start to the field without ever crossing it."""

import torch
from torch import Tensor

from torchlinf._solver.layout import System


class Monotone:
    """v <- T v. T is monotone and a contraction by 2 / (2 + s), so this always ends, after about D^2 sweeps."""

    def __init__(self, system: System, line: Tensor) -> None:
        self.system = system
        self.line = line
        self._next = line.clone()

    @staticmethod
    def limit(radius: Tensor) -> Tensor:
        """Sweeps allowed by default: 40 D^2 + 1000. Plain sweeps from zero need about 17 D^2 where rho = D."""
        return 40 * radius**2 + 1000

    def sweep(self) -> None:
        self.system.sweep(self.line, out=self.system.layout.rows(self._next))
        self.line, self._next = self._next, self.line

    def select(self, keep: Tensor) -> None:
        self.system = self.system.select(keep)
        self.line = self.system.layout.line(self.system.layout.rows(self.line)[keep])
        self._next = self.line.clone()

    def fall_back(self, stalled: Tensor, best: Tensor) -> None:
        """Nothing to fall back to: this is the method that others fall back to."""
