"""A shape that is solved once, and what its levels become when pixels are flipped.

Most flips change the field near them and nowhere else. So the field is solved anew only there, and the histograms of
the levels are changed by the pixels that moved. The whole is solved where the radius changes, which changes everything,
and where a flip reaches far.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from torchlinf._helpers.boxes import bounding_box
from torchlinf._helpers.parallel import for_each
from torchlinf.field import ROUNDING, Status, raise_failures, solve_locally, solve_shape
from torchlinf.kernels import has_compiler
from torchlinf.kernels.grid import row_strides
from torchlinf.measure.entropy import EDGE_SLACK
from torchlinf.measure.levels import estimates, levels_of_each, numbers_of, refined_estimates
from torchlinf.measure.options import Measure
from torchlinf.measure.profile import mean_of_levels

Pixels = NDArray[np.signedinteger]  # flat indices into the mask of a shape, each once
Keep = Callable[["SolvedLevels"], bool]

CELLS = 1 << 22  # levels times bins up to which the histograms are kept, of 4 bytes each
CLOSE = 1e-11  # error bound to which a shape is solved on if its flips are to be exact: else too many are in doubt


@dataclass(frozen=True, eq=False)
class SolvedLevels:
    """The levels of one shape.

    Attributes:
        values: (radius,) float64; none for an empty shape.
        error_bound: (radius,) float64, how far each can be from that of the exact field.
        field_error_bound: certified relative error of the field at every pixel.
        local: whether only a part of the shape was solved for it.
    """

    values: NDArray[np.float64]
    error_bound: NDArray[np.float64]
    field_error_bound: float
    local: bool


class SolvedShape:
    """One shape with its field and the histograms of its levels, ready for flips. Needs numba.

    Args:
        mask: bool, one shape.
        measure: how complexity is measured; `rho` must be None or one number.
        check: called now and then, so that it can end the work by an exception.

    Attributes:
        mask: the shape.
        levels: its levels.

    Raises:
        RuntimeError: a field could not be solved.

    Example:
        >>> mask = np.ones((6, 8), bool)
        >>> mask[0, 3:5] = False
        >>> shape = SolvedShape(mask, Measure())
        >>> shape.levels.values.round(3), shape.after(np.array([3, 4])).values  # the notch, filled
        (array([0.779, 0.544, 0.   ]), array([0., 0., 0.]))
    """

    def __init__(self, mask: NDArray[np.bool_], measure: Measure, check: Callable[[], None] = lambda: None) -> None:
        from torchlinf.kernels import local_flips, local_histograms

        self.mask, self._flips, self._kernels = mask.copy(), local_flips, local_histograms
        self._measure, self._rho, self._check = measure, measure.scalar_rho(), check
        padded = np.zeros([size + 2 for size in mask.shape], np.bool_)
        padded[(slice(1, -1),) * mask.ndim] = True
        self._place = np.flatnonzero(padded).astype(np.int32)  # of the mask's pixels on the padded grid
        strides = row_strides(padded.shape)
        self._strides = np.array(strides)
        self._faces = np.array([*strides, *(-stride for stride in strides)] if measure.levels == "rim" else [], int)
        self._solve()

    def after(self, pixels: Pixels, keep: bool | Keep = False) -> SolvedLevels:
        """The levels after these pixels are flipped.

        Args:
            pixels: those that are flipped.
            keep: whether the shape stays so, or a function that tells it from the levels.

        Raises:
            RuntimeError: a field could not be solved.
        """
        decide = keep if callable(keep) else lambda _: bool(keep)
        found, stands = self._tried([pixels], hold=True)
        if not found:
            return self._otherwise(pixels, stands, decide)
        if decide(found[0]):
            self._field.change(found[0].field_error_bound)
            self._field.keep()
            self.levels = found[0]
            self.mask.reshape(-1)[pixels] ^= True
        else:
            self._flips.put_back(self._field.field, self._histograms)
            self._field.undo()
        return found[0]

    def after_each(self, flips: Sequence[Pixels]) -> list[SolvedLevels]:
        """The levels after each of some flips alone; the shape stays as it is.

        Raises:
            RuntimeError: a field could not be solved.
        """
        found: list[SolvedLevels] = []
        while len(found) < len(flips):
            some, stands = self._tried(flips[len(found) :], hold=False)
            found += some
            if len(found) < len(flips):
                found.append(self._otherwise(flips[len(found)], stands, lambda _: False))
        return found

    def shares(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """How much each pixel adds to the sum of the values of the levels, each times its weight; like the mask.

        For "entropy" that is the information in the pixel's bin; else all pixels of a level share its value evenly.
        """
        found = np.zeros(self.mask.shape)
        if self._field is not None and self._counted:
            cell = self._histograms.cell[self._place]
            on = np.flatnonzero(cell >= 0)
            level = cell[on] // self._measure.bins
            size = self._histograms.sizes[level + 1]
            found.reshape(-1)[on] = weights[level] * np.log2(size / self._histograms.tally[cell[on]]) / size
        elif self._field is not None:
            number = self._numbers()[self._place]
            on = np.flatnonzero(number)
            each = weights * self.levels.values / np.bincount(number[on], minlength=len(weights) + 1)[1:]
            found.reshape(-1)[on] = each[number[on] - 1]
        return found

    def _solve(self) -> None:
        """Solve the whole of the shape as it is."""
        whole = self._whole(self.mask)
        self._adopt(whole, self._of_solve(whole))

    def _whole(self, mask: NDArray[np.bool_]) -> Any:
        """A solve of the whole of a mask; None for an empty one."""
        self._check()
        return solve_shape(mask, self._rho, self._measure.tol, self._check) if mask.any() else None

    def _of_solve(self, solved: Any) -> SolvedLevels:
        """The levels of a solve."""
        if solved is None:
            return SolvedLevels(np.zeros(0), np.zeros(0), 0.0, False)
        if solved.status != Status.CONVERGED:
            status, bound, sweeps = (torch.tensor([x]) for x in (int(solved.status), solved.bound, solved.sweeps()))
            raise_failures(status, bound, sweeps, self._measure.tol, ())
        number = numbers_of(solved.shape.distance, solved.shape.grid.strides, self._measure)
        return SolvedLevels(*refined_estimates(solved, number, self._measure), solved.bound, False)

    def _adopt(self, solved: Any, levels: SolvedLevels) -> None:
        """Take over a solve of the shape as it is, and count the histograms if they are few enough."""
        self.levels = levels
        if solved is not None and self._measure.tol_bits == 0 and solved.bound > CLOSE:
            solved.refine(CLOSE)
        self._field: Any = None if solved is None else solve_locally(solved, self._rho, self._measure.tol)
        self._count()

    def _count(self) -> None:
        """Count the histograms of the shape as it is, if they are few enough."""
        field, measure, radius = self._field, self._measure, len(self.levels.values)
        self._counted = field is not None and measure.estimator == "entropy" and radius * measure.bins <= CELLS
        if not self._counted:
            return
        number, size = self._numbers(), field.v.size
        on_levels = np.where(number > 0, field.v, 0)
        summit = int(on_levels.argmax())
        peak = float(on_levels[summit])
        error = field.tol + 2 * ROUNDING * peak
        # (1 + e) / (1 - e) is less than 1 + 4 e up to there.
        error = 4 * error if error < 0.25 else np.inf
        around = np.concatenate([[0], self._faces]).astype(np.int64)
        self._histograms = self._flips.Histograms(
            self._faces, around, peak, summit, ROUNDING, measure.bins, EDGE_SLACK, error,
            *self._kernels.empty(size, radius, measure.bins, len(self._faces)),
        )  # fmt: skip
        self._flips.count_all(field.distances, field.field, self._histograms, np.flatnonzero(number).astype(np.int32))

    def _tried(self, flips: Sequence[Pixels], hold: bool) -> tuple[list[SolvedLevels], Any]:
        """The levels after the first of some flips, as far as only a part of the shape has to be solved.

        Then the next one stands, as the change that is returned; or with `hold` the last one that was tried.
        """
        if not self._counted:
            return [], None
        kernels, field = self._flips, self._field
        places = self._place[flips[0] if len(flips) == 1 else np.concatenate(flips)]
        starts = np.array([0, *itertools.accumulate(map(len, flips))])
        values, bounds = np.empty((len(flips), len(self.levels.values))), np.empty(len(flips))
        values[:] = self.levels.values
        self._check()
        done = kernels.try_each(
            field.distances, field.field, self._histograms, places, starts, hold, field.radius, field.bound, values,
            bounds,
        )  # fmt: skip
        state = field.field.state
        exact = np.zeros(values.shape[1])
        found = [SolvedLevels(values[i], exact, float(bounds[i]), True) for i in range(done)]
        if done == len(flips):
            return found, None
        if state[kernels.FLIP] == kernels.OTHER_RADIUS and self._rho is not None:
            field.undo()  # with a given rho it can be solved locally, but has other levels
            return found, None
        counted = state[kernels.FLIP] == kernels.NOT_COUNTED
        if counted:
            kernels.put_back(field.field, self._histograms)
        return found, field.change(float(bounds[done]) if counted else np.inf)

    def _otherwise(self, pixels: Pixels, stands: Any, keep: Keep) -> SolvedLevels:
        """The levels after a flip whose change of the histograms does not do."""
        if self._field is not None:
            change = self._field.apply(self._place[pixels], self._check) if stands is None else stands
            found, kept = self._from(change, keep)
            if found is not None:
                if kept:
                    self.mask.reshape(-1)[pixels] ^= True
                return found
        after = self.mask.copy()
        after.reshape(-1)[pixels] ^= True
        whole = self._whole(after)
        levels = self._of_solve(whole)
        if keep(levels):
            self.mask[:] = after
            self._adopt(whole, levels)
        return levels

    def _from(self, change: Any, keep: Keep) -> tuple[SolvedLevels | None, bool]:
        """The levels after the flip that stands, from the whole field, and whether it was kept.

        None where that does not do.
        """
        found = whole = None
        kept = False
        if change.solved and change.radius > 0:
            found = self._counted_anew(change.radius, change.bound)
            kept = found is not None and keep(found)
        elif change.radius == self._field.radius:
            whole = self._field.whole(self._measure.tol, self._check)
            found = self._of_solve(whole)
            kept = keep(found)
        if found is None or not kept:
            self._field.undo()
        elif whole is not None:
            self._adopt(whole, found)
        else:
            self._field.keep()
            self.levels = found
            self._count()
        return found, kept

    def _counted_anew(self, radius: int, bound: float) -> SolvedLevels | None:
        """The levels from the whole field; None if they are not sure enough."""
        measure = self._measure
        values, bounds = estimates(self._field.v, self._numbers(), radius, bound, measure)
        unsure = bounds.max() > measure.tol_bits and not (measure.estimator == "std" and measure.tol_bits == 0)
        return None if unsure else SolvedLevels(values, bounds, bound, True)

    def _numbers(self) -> NDArray[np.int32]:
        """The level of each pixel, 0 for none."""
        return numbers_of(self._field.distance, self._strides, self._measure)


def complexities_after_flips(
    masks: Sequence[NDArray[np.bool_]], flips: Sequence[Sequence[Pixels]], measure: Measure
) -> list[tuple[float, NDArray[np.float64]]]:
    """The complexity of each shape, and what it is after each of its flips, one at a time.

    Args:
        masks: N bool arrays, one shape each, on the CPU; they need not be of one size.
        flips: of each shape, the pixels that are flipped together.
        measure: how complexity is measured.

    Returns:
        For each shape its complexity, and (number of its flips,) float64; NaN where nothing is left. The numbers are
        those of `complexity`, within the bounds of their errors: at the default options in every digit, on all shapes
        that were tried.

    Raises:
        RuntimeError: a field could not be solved.

    Example:
        >>> mask = np.ones((6, 8), bool)
        >>> mask[0, 3:5] = False
        >>> [(before, after)] = complexities_after_flips([mask], [[np.array([3, 4])]], Measure())
        >>> round(before, 3), after
        (0.441, array([0.]))
    """
    # A shape's flips go to as many threads as there would else be nothing to do for, each with its own solve of it.
    parts = max(1, torch.get_num_threads() // max(1, len(masks)))
    levels: list[list[NDArray[np.float64]]] = [[] for _ in range(parts * len(masks))]

    def solve(number: int, check: Callable[[], None]) -> None:
        i, part = divmod(number, parts)
        size = ceil(len(flips[i]) / parts)
        some = flips[i][part * size : (part + 1) * size]
        if some or part == 0:
            levels[number] = _levels_after(masks[i], some, measure, check)

    for_each(solve, len(levels))
    found = [
        [levels[i * parts][0], *(values for part in range(parts) for values in levels[i * parts + part][1:])]
        for i in range(len(masks))
    ]
    flat = [values for of_shape in found for values in of_shape]
    radius = np.array([len(values) for values in flat], np.int64)
    means = mean_of_levels(np.concatenate([np.zeros(0), *flat]), radius, measure.low, measure.high)
    ends = np.cumsum([len(of_shape) for of_shape in found])
    return [(float(part[0]), part[1:]) for part in np.split(means, ends[:-1])] if found else []


def _levels_after(
    mask: NDArray[np.bool_], flips: Sequence[Pixels], measure: Measure, check: Callable[[], None]
) -> list[NDArray[np.float64]]:
    """The levels of a shape, and those after each flip."""
    reached = mask.copy()
    for pixels in flips:
        reached.reshape(-1)[pixels] = True
    box = bounding_box(reached)
    inner = np.ascontiguousarray(mask[box])
    within = np.empty(mask.shape, np.int64)
    within[box] = np.arange(inner.size).reshape(inner.shape)
    flips = [within.reshape(-1)[pixels] for pixels in flips]
    if has_compiler():
        shape = SolvedShape(inner, measure, check)
        return [shape.levels.values, *(levels.values for levels in shape.after_each(flips))]

    def mask_at(i: int) -> NDArray[np.bool_]:
        after = inner.copy()
        if i > 0:
            after.reshape(-1)[flips[i - 1]] ^= True
        return after

    found = levels_of_each(mask_at, 1 + len(flips), (1 + len(flips),), measure)
    return [part.numpy() for part in found.values.split(found.radius.tolist())]
