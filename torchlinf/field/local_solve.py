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
from torchlinf.kernels.policy_system import PolicySystem

PASSES = 8  # over the list before each linear solve
ROUNDS = 12  # linear solves after which the flip is left to a complete solve
SHARE = 0.4  # of the shape's pixels, from which on a complete solve costs no more


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
        bound: certified relative error of the field of the shape as it is without the last flip.
        tol: what that error is solved to after a flip; not below `bound`.
        radius: D of that shape.
    """

    def __init__(self, solved: PolicyIteration, rho: float | None, tol: float) -> None:
        """Take over a solve that has converged to `tol`; with `rho` None the screening goes with the radius."""
        shape = solved.shape
        size = solved.v.size
        self.v, self.distance = solved.v, shape.distance
        self.radius, self.bound = shape.radius, solved.bound
        self._follows_radius = rho is None
        self._screening, self._block = shape.screening, shape.grid.block
        self.tol = max(solved.bound, min(max(2 * solved.bound, solved.finest), tol))
        self._largest = float(shape.profile[-1])
        self._limit = int(SHARE * shape.grid.pixels)
        self._counts = np.bincount(self.distance, minlength=max(shape.grid.shape) + 1)
        # On a grid that is seen as all inside, since any pixel of it may be filled.
        self._system = PolicySystem(replace(shape.grid, pixels=size), self._screening)
        self._listed = np.zeros(size, np.uint8)
        self._active, self._beside, self._inside = (np.empty(size, np.int32) for _ in range(3))
        self._before = np.empty(size)
        self._trail, self._old = np.empty(2 * size, np.int32), np.empty(2 * size, np.int32)
        self._num_listed = self._num_shifted = 0
        self._last: Change | None = None

    def apply(self, pixels: NDArray[np.int32], check: Callable[[], None]) -> Change:
        """Flip pixels, each given once and none of the ring, and solve; `undo` or `keep` has to follow."""
        inside = self.distance[pixels] > 0
        count = 0
        if inside.any():
            removed = np.ascontiguousarray(pixels[inside])
            count = local_distance.remove(self.distance, removed, self._block, self._trail, self._old, count)
        if not inside.all():
            filled = np.ascontiguousarray(pixels[~inside])
            count = local_distance.fill(self.distance, filled, self._block, self._trail, self._old, count)
        self._num_shifted = count
        counts = self._counts.copy()
        radius = local_distance.change_counts(counts, self.distance, self._trail, self._old, count)
        bound, solved = np.inf, False
        if radius == self.radius or not self._follows_radius:
            bound = max(self.bound, self._solve(pixels, check))
            solved = bool(bound < np.inf)
        self._last = Change(radius, solved, bound, self._active[: self._num_listed], self._trail[:count])
        return self._last

    def undo(self) -> None:
        """Flip back: field and distance are what they were, to the last bit."""
        local_distance.undo(self.v, self._active, self._before, self._num_listed)
        local_distance.undo(self.distance, self._trail, self._old, self._num_shifted)
        self._num_listed = self._num_shifted = 0

    def keep(self) -> None:
        """Make the last flip, which must have been solved, a part of the shape."""
        assert self._last is not None and self._last.solved
        local_distance.change_counts(self._counts, self.distance, self._trail, self._old, self._num_shifted)
        self.radius, self.bound = self._last.radius, self._last.bound
        self._num_listed = self._num_shifted = 0

    def _solve(self, pixels: NDArray[np.int32], check: Callable[[], None]) -> float:
        """Solve where the flip reaches; returns the largest residual there, inf where this has to be left undone."""
        v, distance, block, system = self.v, self.distance, self._block, self._system
        lists = self._listed, self._active, self._before
        count = local_field.add_around(v, distance, pixels, block, *lists, 0)
        residual = np.inf
        for number in range(ROUNDS + 1):
            check()
            count = local_field.relax(
                v, distance, block, self._screening, self.tol, PASSES, self._limit, *lists, count
            )
            if count > self._limit:
                break
            residual, count = self._residual(count)
            if residual <= self.tol or number == ROUNDS:
                break
            tie = max(TIE * self._largest, NOISE * residual)
            local_field.choose_policies_at(v, distance, block, tie, self._active, count, system.up, system.down)
            size = local_field.inside_of(distance, self._active, count, self._inside)
            system.solve_pixels(v, self._inside[:size], max(NOISE * residual, 1e-13 * self._largest))
            residual, count = self._residual(count)
            if residual <= self.tol:
                break
        local_field.forget(self._listed, system.up, system.down, self._active, count)
        self._num_listed = count
        return residual if residual <= self.tol else np.inf

    def _residual(self, count: int) -> tuple[float, int]:
        return local_field.measure(  # type: ignore[no-any-return]
            self.v, self.distance, self._block, self._screening, self.tol, self._listed, self._active, self._before,
            count, self._beside,
        )  # fmt: skip
