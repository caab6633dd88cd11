"""Value iteration, method="monotone": plain sweeps, which decrease to the field without ever crossing it."""

from torch import Tensor

from torchlinf.field.stencil import System


class ValueIteration:
    """Value iteration: v <- T v.

    T is monotone and a contraction by 2 / (2 + s): this always ends, after a multiple of D^2 sweeps.
    """

    step_sweeps = 1

    def __init__(self, system: System, line: Tensor) -> None:
        self.system = system
        self.line = line
        self._next = line.clone()

    @staticmethod
    def limit(radius: Tensor) -> Tensor:
        """Sweeps allowed by default: 40 D^2 + 1000. From zero, and with rho = D, about 17 D^2 are needed."""
        return 40 * radius**2 + 1000

    def step(self) -> None:
        """One application of T to every shape."""
        self.system.sweep(self.line, out=self.system.layout.rows(self._next))
        self.line, self._next = self._next, self.line

    def select(self, keep: Tensor) -> None:
        """Go on with the shapes of these indices only."""
        layout = self.system.layout
        self.system = self.system.select(keep)
        self.line = layout.line(layout.rows(self.line)[keep])
        self._next = self.line.clone()

    def fall_back(self, stalled: Tensor, best: Tensor) -> None:
        """Nothing to do: a contraction needs no safeguard."""
