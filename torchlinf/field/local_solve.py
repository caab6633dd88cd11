"""The field of a shape after some of its pixels were flipped, solved anew only where the flip reaches.

Where pixels are removed the field falls, where they are filled it rises, and elsewhere it stays what it was. So the
solve starts from the field of the shape, and works on a list of pixels that grows where a residual is left: passes of
relaxation, then one linear solve of the list's policies, the rest of the field being given. Outside the list and the
pixels beside it no residual has changed. So the largest of the residual before and of that on and beside the list
bounds the error of the whole field.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from torchlinf.field.policy_iteration import NOISE, TIE, PolicyIteration
from torchlinf.kernels import local_field, local_flips
from torchlinf.kernels.grid import make_grid
from torchlinf.kernels.policy_system import PolicySystem
from torchlinf.kernels.strong_components import SEARCHED

PASSES = 3  # over the list before each linear solve
ROUNDS = 16  # linear solves after which the flip is left to a complete solve
SHARE = 0.3  # of the shape's pixels, from which on a complete solve costs no more


@dataclass(frozen=True)
class Change:
    """What a flip has changed; the arrays are views, overwritten by the next flip.

    Attributes:
        radius: the new D.
        solved: whether the field was solved; if not it is left unfinished, and only the distance is right.
        bound: certified relative error of the field, at every pixel.
        moved: flat indices of the pixels whose field was touched.
        shifted: those whose distance was changed; a pixel may come twice.
    """

    radius: int
    solved: bool
    bound: float
    moved: NDArray[np.int32]
    shifted: NDArray[np.int32]


class LocalSolve:
    """The solved field of one shape, in which pixels can be flipped and flipped back.

    Attributes:
        v: the field, flat, on the padded grid.
        distance: the chessboard distance, like `v`.
        bound: certified relative error of the field of the shape, without a flip that is neither kept nor undone.
        tol: what that error is solved to after a flip; not below `bound`.
        radius: D of that shape.
        distances: what the kernels of `local_flips` know of the distance.
        field: what they know of the field.
    """

    def __init__(self, solved: PolicyIteration, rho: float | None, tol: float) -> None:
        """Take over a solve that has converged to `tol`; with `rho` None the screening goes with the radius."""
        shape = solved.shape
        size = solved.v.size
        self.v, self.distance = solved.v, shape.distance
        self.radius, self.bound = shape.radius, solved.bound
        self.tol = max(solved.bound, min(max(2 * solved.bound, solved.finest), tol))
        self._follows_radius = rho is None
        self._shape, grid = shape, shape.grid
        self._last: Change | None = None
        # On a grid that is seen as all inside, since any pixel of it may be filled.
        system = PolicySystem(replace(grid, pixels=size), shape.screening)
        trail, old, parts = np.empty((3, 2 * size), np.int32)
        counts = np.bincount(self.distance, minlength=max(grid.shape) + 1)
        self.distances = local_flips.Distances(self.distance, grid.block, counts, trail, old, parts)
        up, down, factors, owner, path, chains = system.scratch
        active, beside = np.empty((2, size), np.int32)
        starts, ends = np.empty((2, size), np.int64)
        self.field = local_flips.Field(
            self.v, grid.rows, float(shape.screening), float(self.tol), PASSES, ROUNDS, int(SHARE * grid.pixels),
            TIE * float(shape.profile[-1]), solved.finest, NOISE, up, down, factors, owner, path, chains,
            np.zeros(SEARCHED, np.int64), np.zeros(size, np.uint8), active, np.empty(size), beside, starts, ends,
            np.zeros(local_flips.ALL_STATES, np.int64),
        )  # fmt: skip

    def apply(self, pixels: NDArray[np.int32], check: Callable[[], None]) -> Change:
        """Flip pixels, each given once and none of the ring, and solve; `undo` or `keep` has to follow."""
        local_flips.begin(self.distances, self.field, pixels)
        bound = np.inf
        if self.field.state[local_flips.RADIUS] == self.radius or not self._follows_radius:
            check()
            residual: float = local_flips.solve(self.distances, self.field)
            if self.field.state[local_field.SOLVED]:
                bound = max(self.bound, residual)
        return self.change(bound)

    def change(self, bound: float) -> Change:
        """What the flip that stands has changed; `bound` is inf if it is not solved."""
        state = self.field.state
        moved = self.field.active[: state[local_field.LISTED]]
        shifted = self.distances.trail[: state[local_flips.SHIFTED]]
        self._last = Change(int(state[local_flips.RADIUS]), bound < np.inf, bound, moved, shifted)
        return self._last

    def undo(self) -> None:
        """Flip back: field and distance are what they were, to the last bit."""
        local_flips.settle(self.distances, self.field, True)

    def keep(self) -> None:
        """Make the last flip, which must have been solved, a part of the shape."""
        assert self._last is not None
        assert self._last.solved
        local_flips.settle(self.distances, self.field, False)
        self.radius, self.bound = self._last.radius, self._last.bound

    def whole(self, tol: float, check: Callable[[], None]) -> PolicyIteration:
        """After a flip that was not solved and has left the radius as it was: a solve of all of the shape.

        It starts from the field as it is, and shares no array with this object.
        """
        distance = self.distance.copy()
        grid = make_grid((distance > 0).reshape(self._shape.grid.shape))
        solve = PolicyIteration(replace(self._shape, grid=grid, distance=distance), tol, None, check)
        solve.run_from(self.v)
        return solve
