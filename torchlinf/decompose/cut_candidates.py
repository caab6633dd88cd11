"""Where a part may be cut: candidates for `torchlinf.decompose`, each a label map of the pieces."""

import math
from collections.abc import Callable, Iterator
from itertools import groupby
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray

from torchlinf._helpers.morphology import opened
from torchlinf.field import chessboard_distance, linf_field
from torchlinf.measure import Measure, complexity_map

Mask: TypeAlias = NDArray[np.bool_]
Cut: TypeAlias = NDArray[np.int32]  # pieces 1, 2 ... of a part, 0 outside

SIDES = 16  # at most so many sides of squares, in equal ratios: all of them up to a radius of about 8
ALONE = 4  # components that are also cut off alone, those with the largest shares
PERSISTENCES = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)  # of the maxima of f / max f


def openings(mask: Mask, measure: Measure) -> Iterator[Cut]:
    """Cut along the boundaries of the unions of all squares of a side that fit into the part.

    Squares of side 2k - 1, larger than the contact of an appendage, do not reach into it; so this cuts off the
    appendage along its contact. Level k is the first that it does not act on. What sticks out is ranked by the
    complexity that sits there, which is where f leaves the values of a square. The rank is that of the entropy, for
    "std" too, which is no sum over pixels.

    Example:
        >>> cuts = openings(np.array([[1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 0]], dtype=bool), Measure())
        >>> next(cuts)
        array([[1, 1, 1, 2],
               [1, 1, 1, 2],
               [1, 1, 1, 0]], dtype=int32)
    """
    inside = torch.from_numpy(np.ascontiguousarray(mask))
    options = {**measure.options(), "estimator": "entropy", "tol_bits": math.inf}  # shares only rank the cuts
    share = complexity_map(inside, spatial_ndim=mask.ndim, **options).numpy()
    radius = int(chessboard_distance(inside, spatial_ndim=mask.ndim).max())
    for k in np.unique(np.geomspace(1, radius, SIDES).round().astype(int)).tolist():
        core = opened(inside[None], (2 * k - 1,) * mask.ndim)[0].numpy()
        yield from _separate(mask, core, share)


def watershed(mask: Mask, measure: Measure) -> Iterator[Cut]:
    """Cut along the watersheds of f between its maxima of some persistence; all at once, or one basin off the rest.

    Of the measure only `rho` and `tol` matter.

    Example:
        >>> rooms = np.ones((9, 19), dtype=bool)
        >>> rooms[[0, 1, 2, 6, 7, 8], 9] = False
        >>> next(watershed(rooms, Measure()))[4]
        array([1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 2, 2], dtype=int32)
    """
    from skimage.measure import label
    from skimage.morphology import h_maxima
    from skimage.segmentation import watershed as flood

    inside = torch.from_numpy(np.ascontiguousarray(mask))
    field = linf_field(inside, rho=measure.rho, tol=measure.tol, spatial_ndim=mask.ndim).numpy()
    for persistence in PERSISTENCES:
        peaks = h_maxima(field, persistence).astype(bool) & mask  # type: ignore[no-untyped-call]
        seeds = label(peaks, connectivity=1)  # type: ignore[no-untyped-call]
        basins = flood(-field, seeds, mask=mask).astype(np.int32)  # type: ignore[no-untyped-call]
        # Components without a maximum of that persistence are not reached from any seed.
        missed = label(mask & (basins == 0), connectivity=1)  # type: ignore[no-untyped-call]
        basins = np.where(missed > 0, missed + basins.max(), basins).astype(np.int32)
        if (count := int(basins.max())) > 1:
            yield basins
            for i in range(1, count + 1) if count > 2 else ():
                yield _cut_off(mask, basins == i)


def _separate(mask: Mask, core: Mask, share: NDArray[np.float64]) -> Iterator[Cut]:
    """Cut off what the core does not hold: its components with the largest shares, one, two, four ... or all of them.

    Components of equal share and size go together, so that the cuts commute with flips. What is left need not hold
    together, and falls into its own components.
    """
    from scipy.ndimage import label
    from scipy.ndimage import sum as sum_over

    rest, count = label(mask & ~core)
    numbers = np.arange(1, count + 1)
    # In steps that rounding does not reach: sums depend on the order of the pixels.
    shares = np.rint(np.multiply(sum_over(share, rest, numbers), 1e9)).astype(np.int64)
    sizes = np.bincount(rest.ravel(), minlength=count + 1)[1:]
    keys = list(zip((-shares).tolist(), (-sizes).tolist(), strict=True))
    ranked = sorted(range(count), key=keys.__getitem__)
    groups = [numbers[list(same)] for _, same in groupby(ranked, key=keys.__getitem__)]
    firsts = sorted({min(2**i, len(groups)) for i in range(len(groups).bit_length() + 1)})
    for chosen in [groups[:n] for n in firsts] + [[group] for group in groups[1:ALONE]]:
        off = np.isin(rest, np.concatenate([np.zeros(0, int), *chosen])) & mask & ~core
        cut = _cut_off(mask, off)
        if cut.max() > 1:
            yield cut


def _cut_off(mask: Mask, off: Mask) -> Cut:
    """The components of what is left and of what is cut off, through faces of pixels."""
    from scipy.ndimage import label

    body, bodies = label(mask & ~off)
    limbs, _ = label(off)
    return np.where(off, limbs + bodies, body).astype(np.int32)


CANDIDATES: dict[str, Callable[[Mask, Measure], Iterator[Cut]]] = {"openings": openings, "watershed": watershed}
