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
from torchlinf.kernels import local_distance, local_field
from torchlinf.kernels.grid import make_grid
from torchlinf.kernels.policy_system import PolicySystem

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
    """

    def __init__(self, solved: PolicyIteration, rho: float | None, tol: float) -> None:
        """Take over a solve that has converged to `tol`; with `rho` None the screening goes with the radius."""
        shape = solved.shape
        size = solved.v.size
        self.v, self.distance = solved.v, shape.distance
        self.radius, self.bound = shape.radius, solved.bound
        self.tol = max(solved.bound, min(max(2 * solved.bound, solved.finest), tol))
        self._follows_radius = rho is None
        self._shape = shape
        self._largest = float(shape.profile[-1])
        self._limit = int(SHARE * shape.grid.pixels)
        self._counts = np.bincount(self.distance, minlength=max(shape.grid.shape) + 1)
        # On a grid that is seen as all inside, since any pixel of it may be filled.
        self._system = PolicySystem(replace(shape.grid, pixels=size), shape.screening)
        self._listed = np.zeros(size, np.uint8)
        self._active, self._beside = np.empty((2, size), np.int32)
        self._starts, self._ends = np.empty((2, size), np.int64)
        self._before = np.empty(size)
        self._trail, self._old = np.empty((2, 2 * size), np.int32)
        self._state = np.zeros(local_field.STATES, np.int64)
        self._num_shifted = 0
        self._last: Change | None = None

    def apply(self, pixels: NDArray[np.int32], check: Callable[[], None]) -> Change:
        """Flip pixels, each given once and none of the ring, and solve; `undo` or `keep` has to follow."""
        inside = self.distance[pixels] > 0
        flipped = pixels[inside], pixels[~inside]
        count, radius = local_distance.flip(
            self.distance, *flipped, self._shape.grid.block, self._counts, self._trail, self._old
        )
        self._num_shifted = count
        self._state[local_field.LISTED] = 0
        solved, bound = False, np.inf
        if radius == self.radius or not self._follows_radius:
            bound = max(self.bound, self._solve(*flipped, check))
            solved = bound < np.inf
        moved = self._active[: self._state[local_field.LISTED]]
        self._last = Change(radius, solved, bound, moved, self._trail[:count])
        return self._last

    def undo(self) -> None:
        """Flip back: field and distance are what they were, to the last bit."""
        self._end(True)
        local_distance.undo(self.distance, self._counts, self._trail, self._old, self._num_shifted)
        self._num_shifted = 0

    def keep(self) -> None:
        """Make the last flip, which must have been solved, a part of the shape."""
        assert self._last is not None
        assert self._last.solved
        self._end(False)
        self.radius, self.bound = self._last.radius, self._last.bound
        self._num_shifted = 0

    def whole(self, tol: float, check: Callable[[], None]) -> PolicyIteration:
        """After a flip that was not solved and has left the radius as it was: a solve of all of the shape.

        It starts from the field as it is, and shares no array with this object.
        """
        distance = self.distance.copy()
        grid = make_grid((distance > 0).reshape(self._shape.grid.shape))
        solve = PolicyIteration(replace(self._shape, grid=grid, distance=distance), tol, None, check)
        solve.run_from(self.v)
        return solve

    def _end(self, undo: bool) -> None:
        count = self._state[local_field.LISTED]
        local_field.end(
            self.v, undo, self._listed, self._system.up, self._system.down, self._active, self._before, count
        )
        self._state[local_field.LISTED] = 0

    def _solve(self, removed: NDArray[np.int32], filled: NDArray[np.int32], check: Callable[[], None]) -> float:
        """Solve where the flip reaches; returns the largest residual there, inf where this has to be left undone."""
        grid, screening, system, state = self._shape.grid, self._shape.screening, self._system, self._state
        lists = self._listed, self._active, self._before
        local_field.begin(self.v, self.distance, removed, filled, grid.block, *lists, state)
        while True:
            check()
            residual: float = local_field.advance(
                self.v, self.distance, grid.block, grid.rows, screening, self.tol, PASSES, ROUNDS, self._limit,
                TIE * self._largest, NOISE, *system.scratch, *lists, self._beside, self._starts, self._ends, state,
            )  # fmt: skip
            if state[local_field.END] != local_field.AT_CYCLE:
                return residual if state[local_field.END] == local_field.SOLVED else np.inf
            system.solve_cycle(self.v, state[local_field.CHAINS :], max(NOISE * residual, 1e-13 * self._largest))
