"""What several questions share."""

import statistics
from collections.abc import Sequence

import numpy as np
from torch import Tensor

import torchlinf
from benchmarks.baselines.domain import Domain
from benchmarks.baselines.policy import Outcome, policy_iteration
from benchmarks.timing import Ratio, Times

TOL = 1e-9


class Solve:
    """The library as a contender, which keeps its last solution."""

    def __init__(self, mask: Tensor, method: str = "auto") -> None:
        """Of one shape `(*spatial)`."""
        self.mask = mask
        self.method = method
        self.found: torchlinf.FieldSolution | None = None

    def __call__(self) -> None:
        """Certify to `TOL`."""
        self.found = torchlinf.solve_field(self.mask, spatial_ndim=self.mask.ndim, tol=TOL, method=self.method)

    @property
    def solution(self) -> torchlinf.FieldSolution:
        """Of the last run."""
        assert self.found is not None
        return self.found


class Policy:
    """Policy iteration as a contender, which keeps what it found last."""

    def __init__(self, mask: Tensor, patience: float, *, sweeping: bool) -> None:
        """With `sweeping` D/2 sweeps come before each solve."""
        self.mask = mask
        self.patience = patience
        self.sweeping = sweeping
        self.found: Outcome | None = None

    def __call__(self) -> None:
        """Crop, measure the distance and solve, as the library does in its one call."""
        self.domain = Domain.of(self.mask)
        sweeps = max(1, self.domain.radius // 2) if self.sweeping else 0
        self.found = policy_iteration(self.domain, sweeps=sweeps, tol=TOL, patience=self.patience)

    @property
    def outcome(self) -> Outcome:
        """Of the last run."""
        assert self.found is not None
        return self.found

    def check(self, value: Tensor) -> None:
        """Raise unless the library's field agrees, as far as both are certified."""
        if self.outcome.converged:
            theirs = self.domain.like_mask(self.outcome.value, tuple(self.mask.shape))
            apart = float(np.max(np.abs(theirs - value.numpy())[self.mask.numpy()] / theirs[self.mask.numpy()]))
            if apart > 2.1 * TOL:
                raise AssertionError(f"certified fields must agree to 2e-9; got {apart:.1e}")


def times_as_long(ratio: Ratio, at_least: bool = False) -> str:
    """A ratio as a cell; `at_least` where the slower one had not finished."""
    return f"{'> ' if at_least else ''}{ratio.median:,.3g} ({ratio.low:,.3g} to {ratio.high:,.3g})"


def spread(times: Times) -> str:
    """Milliseconds as a cell: median, least and most."""
    return f"{1e3 * times.median:.3g} ({1e3 * min(times.wall):.3g} to {1e3 * max(times.wall):.3g})"


def median(values: Sequence[float]) -> float:
    """Of what must not be empty."""
    return float(statistics.median(values))
