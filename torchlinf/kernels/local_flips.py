"""Flips of one solved shape, tried one after another: distance, field and histograms, in one call for all of them.

Where a flip needs more than these kernels do, it is left as it stands, and the caller goes on with it.
"""

from typing import Any, NamedTuple

import numpy as np

from torchlinf.kernels import local_distance, local_field, local_histograms
from torchlinf.kernels.compiler import kernel
from torchlinf.kernels.local_field import LISTED, SOLVED, STATES

# Places of `Field.state` behind those of `local_field`: how a flip ended; how many distances have changed; the radius;
# how many pixels of the histograms have moved.
FLIP, SHIFTED, RADIUS, PLACED = range(STATES, STATES + 4)
ALL_STATES = STATES + 4
# How a flip ended: well; with another radius, and nothing solved; unsolved; with levels that need a count of the whole,
# since a pixel is in doubt or the peak has moved.
DONE, OTHER_RADIUS, NOT_SOLVED, NOT_COUNTED = range(4)

Array = np.ndarray[Any, Any]


class Distances(NamedTuple):
    """What `local_distance` works on; `parts` is scratch for the pixels of a flip."""

    distance: Array
    block: Array
    counts: Array
    trail: Array
    old: Array
    parts: Array


class Field(NamedTuple):
    """What `local_field.advance` works on, in its order."""

    v: Array
    rows: Array
    screening: float
    tol: float
    passes: int
    rounds: int
    limit: int
    tie: float
    finest: float
    noise: float
    up: Array
    down: Array
    factors: Array
    owner: Array
    path: Array
    chains: Array
    search: Array
    listed: Array
    active: Array
    old: Array
    beside: Array
    starts: Array
    ends: Array
    state: Array


class Histograms(NamedTuple):
    """What `local_histograms.place` works on; `summit` is the pixel of the peak, `same` the share that rounding is."""

    faces: Array
    around: Array
    peak: float
    summit: int
    same: float
    bins: int
    slack: float
    error: float
    cell: Array
    doubtful: Array
    tally: Array
    sizes: Array
    kinds: Array
    touched: Array
    trail: Array
    old: Array


@kernel
def try_each(distances, field, histograms, pixels, starts, hold, radius, bound, values, bounds):  # type: ignore[no-untyped-def]
    """The levels of a shape after each of some flips; returns which flip it has left as it stands, or their number.

    The pixels of flip k, on the padded grid, are those from starts[k] to starts[k + 1]. `radius` and `bound` are those
    of the shape. values[k], which holds the levels of the shape, becomes those after the flip, and bounds[k] the error
    of the field. All flips are undone, but with `hold` the last one.
    """
    state = field.state
    number = starts.size - 1
    for k in range(number):
        begin(distances, field, pixels[starts[k] : starts[k + 1]])
        if state[RADIUS] != radius:
            state[FLIP] = OTHER_RADIUS
            return k
        residual = solve(distances, field)
        if not state[SOLVED]:
            state[FLIP] = NOT_SOLVED
            return k
        bounds[k] = max(bound, residual)
        if not _count(distances, field, histograms, values[k]):
            state[FLIP] = NOT_COUNTED
            return k
        state[FLIP] = DONE
        if not hold or k < number - 1:
            put_back(field, histograms)
            settle(distances, field, True)
    return number


@kernel
def begin(distances, field, pixels):  # type: ignore[no-untyped-def]
    """Flip pixels: their distances, and the list of the pixels to be solved where the radius stays."""
    state, parts = field.state, distances.parts
    removed = 0
    filled = parts.size
    for x in pixels:
        if distances.distance[x] > 0:
            parts[removed] = x
            removed += 1
        else:
            filled -= 1
            parts[filled] = x
    state[LISTED] = state[PLACED] = 0
    state[SHIFTED], state[RADIUS] = local_distance.flip(
        distances.distance, parts[:removed], parts[filled:], distances.block, distances.counts, distances.trail,
        distances.old,
    )  # fmt: skip
    local_field.begin(
        field.v, distances.distance, parts[:removed], parts[filled:], distances.block, field.listed, field.active,
        field.old, state[:STATES],
    )  # fmt: skip


@kernel
def solve(distances, field):  # type: ignore[no-untyped-def]
    """Solve the listed pixels by `local_field.advance`; returns the largest residual."""
    return local_field.advance(
        field.v, distances.distance, distances.block, field.rows, field.screening, field.tol, field.passes,
        field.rounds, field.limit, field.tie, field.finest, field.noise, field.up, field.down, field.factors,
        field.owner, field.path, field.chains, field.search, field.listed, field.active, field.old, field.beside,
        field.starts, field.ends, field.state,
    )  # fmt: skip


@kernel
def _count(distances, field, histograms, values):  # type: ignore[no-untyped-def]
    """Move the pixels that have changed to their cells, and update the levels; False where that does not do."""
    h, state = histograms, field.state
    highest, count = _place(distances, field, h, field.active[: state[LISTED]], h.around[:1], 0)
    also, count = _place(distances, field, h, distances.trail[: state[SHIFTED]], h.around, count)
    state[PLACED] = count
    highest = max(highest, also)
    if highest > h.peak or h.cell[h.summit] < 0 or field.v[h.summit] != h.peak:
        highest = local_histograms.largest_on_levels(field.v, h.cell)
    else:
        highest = h.peak
    found = h.sizes[0] == 0 and abs(highest - h.peak) <= h.same * h.peak
    if found:
        local_histograms.update_entropies(h.tally, h.sizes, h.kinds, h.touched, h.bins, values)
    h.touched[:] = 0
    return found


@kernel
def _place(distances, field, histograms, pixels, around, count):  # type: ignore[no-untyped-def]
    h = histograms
    return local_histograms.place(
        pixels, around, field.v, distances.distance, h.faces, h.peak, h.bins, h.slack, h.error, h.cell, h.doubtful,
        h.tally, h.sizes, h.kinds, h.touched, h.trail, h.old, count,
    )  # fmt: skip


@kernel
def count_all(distances, field, histograms, pixels):  # type: ignore[no-untyped-def]
    """Put all pixels that are on levels into their cells."""
    _place(distances, field, histograms, pixels, histograms.around[:1], 0)
    histograms.touched[:] = 0


@kernel
def settle(distances, field, undo):  # type: ignore[no-untyped-def]
    """End the flip that stands; with `undo` field and distance are what they were, to the last bit."""
    state = field.state
    local_field.end(field.v, undo, field.listed, field.up, field.down, field.active, field.old, state[LISTED])
    if undo:
        local_distance.undo(distances.distance, distances.counts, distances.trail, distances.old, state[SHIFTED])
    state[LISTED] = state[SHIFTED] = 0
    state[FLIP] = DONE


@kernel
def put_back(field, histograms):  # type: ignore[no-untyped-def]
    """Put the pixels that the flip has moved back into their cells."""
    h = histograms
    local_histograms.undo(
        h.bins, h.cell, h.doubtful, h.tally, h.sizes, h.kinds, h.trail, h.old, field.state[PLACED]
    )  # fmt: skip
    field.state[PLACED] = 0
