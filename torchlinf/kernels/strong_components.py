"""Strongly connected components of the policy graph: Tarjan's algorithm on chains, and the solution of a component.

Components are taken dependencies first. One that is a single chain is solved as such. Of the others each chain's
pixels are affine in the two pixels it depends on. Only those that are depended upon inside the component are unknowns,
with rows x = a + b x(below) + c x(above). They are eliminated one by one, those first that leave the fewest numbers
behind: nearly always that is a few operations an unknown.

Where it is not, the rows are taken in the order in which the depth-first search left their chains: nearly all depend on
rows before them, and those that others before them, or they themselves, depend on are the feedback vertices. For given
values of these one pass gives all unknowns, and with them the feedback anew, z -> P z + q, which BiCGStab solves.

A chain is named by its place on Tarjan's stack, so that what is known of it lives in the few arrays that are in cache.
Values below 0 are unsolved, as in `policy_system`.
"""

import numpy as np

from torchlinf.kernels.bicgstab import bicgstab
from torchlinf.kernels.chains import PATH_HEIGHT, follow_chains, solve_chain, solve_chain_affine
from torchlinf.kernels.compiler import inlined, kernel

# Rows of `chains`: the chain's lowest and highest pixel; the pixels beyond these, or these themselves where they are
# their own neighbours; how many pixels it has; low link, dependencies looked at, the chain that asked for it; and the
# chains that the search has left and that are not yet solved, in that order.
HEAD, LAST, BELOW, ABOVE, LENGTH, LOW, VISITED, CALLER, LEFT = range(9)
ROWS = 9
_LOOP = 4  # added to VISITED for every dependency of a chain on itself

# Places of `search`: chains on the stack; chains left and unsolved; the present chain; how many of those left are the
# component that the caller has to solve.
HEIGHT, PENDING, CHAIN, MEMBERS = range(4)
SEARCHED = 4

ROOM = 8  # numbers a row that elimination may need at a time; what needs more is left to BiCGStab
_GONE = -1
_ITERATIONS = 1000  # rarely needed, but a component left inexact ties its pixels into still larger ones next time


def solve_left_over(
    v: np.ndarray,
    tol: float,
    up: np.ndarray,
    down: np.ndarray,
    factors: np.ndarray,
    screening: float,
    owner: np.ndarray,
    chains: np.ndarray,
    search: np.ndarray,
) -> int:
    """Solve the component that `solve_runs` has left over; returns the number of its unknowns.

    The kernels that only this needs compile when they are first needed.
    """
    stop = int(search[PENDING])
    first = stop - int(search[MEMBERS])
    rows = component_rows(v, first, stop, chains, owner, up, factors)
    _iterate(v, tol, *rows)
    solve_members(v, first, stop, chains, up, down, factors, screening)
    return len(rows[0])


def _iterate(
    v: np.ndarray,
    tol: float,
    target: np.ndarray,
    constant: np.ndarray,
    weight: np.ndarray,
    index: np.ndarray,
) -> None:
    """Set v on the unknowns of a component by BiCGStab for its feedback vertices."""
    feedback = np.empty(target.size, np.int64)
    feedback = feedback[: find_feedback(index, feedback)]
    x = np.empty(feedback.size + target.size)

    def passed(share: float, z: np.ndarray) -> np.ndarray:
        substitute(share, constant, weight, index, z, x)
        return x[feedback.size + feedback]

    z = np.abs(v[target[feedback]])
    z += bicgstab(lambda y: y - passed(0.0, y), passed(1.0, z) - z, tol, _ITERATIONS, lambda y: y)
    substitute(1.0, constant, weight, index, z, x)
    v[target] = np.maximum(x[feedback.size :], 0.0)


@kernel
def solve_runs(v, starts, ends, up, down, factors, screening, owner, path, chains, state, search):  # type: ignore[no-untyped-def]
    """Solve chain by chain, and at each cycle the components it depends on, until elimination has no room for one.

    That one is left to the caller, as the last `search[MEMBERS]` chains of the pending ones; when it is solved, this is
    to be called again. Cycles are many and mostly small, so that a return to Python at each would cost as much as they
    do. `path` and `state` are those of `follow_chains`.

    Returns the number of unknowns in components that were no chain.
    """
    unknowns = 0
    height, left, chain = search[HEIGHT], search[PENDING], search[CHAIN]
    resumed = search[MEMBERS] > 0
    search[MEMBERS] = 0
    searching = resumed
    caller, opening = np.int64(-1), np.int64(-1)
    while True:
        if not searching:
            if not follow_chains(v, starts, ends, up, down, factors, screening, owner, path, state):
                return unknowns
            searching = True
            caller, opening = np.int64(-1), np.int64(path[state[PATH_HEIGHT] - 1])
        if opening >= 0:
            chain = height
            height += 1
            _open_chain(opening, chain, chains, owner, up, down)
            chains[CALLER, chain] = caller
            opening = np.int64(-1)
        if not resumed:
            side = chains[VISITED, chain] % _LOOP
            if side < 2:
                chains[VISITED, chain] += 1
                target = np.int64(chains[BELOW + side, chain])
                if v[target] < 0.0 and target != chains[side, chain]:
                    mark = owner[target]
                    if mark <= 0:
                        opening = target
                        caller = chain
                    elif mark - 1 == chain:
                        chains[VISITED, chain] += _LOOP
                    else:
                        chains[LOW, chain] = min(chains[LOW, chain], mark - 1)
                continue
            chains[LEFT, left] = chain
            left += 1
        low = np.int64(chains[LOW, chain])
        above = np.int64(chains[CALLER, chain])
        if low != chain:
            chains[LOW, above] = min(chains[LOW, above], low)
        else:
            if not resumed:
                if height == chain + 1 and chains[VISITED, chain] < _LOOP:
                    solve_members(v, left - 1, left, chains, up, down, factors, screening)
                else:
                    first = left - (height - chain)
                    target, constant, weight, index = component_rows(v, first, left, chains, owner, up, factors)
                    if not eliminate(constant, weight, index):
                        for k in range(first, left):
                            member = np.int64(chains[LEFT, k])
                            _write_owner(member + 1, member, chains, owner, up)
                        search[HEIGHT], search[PENDING], search[CHAIN] = height, left, chain
                        search[MEMBERS] = height - chain
                        return unknowns
                    for j in range(target.size):  # not below 0, which would say that it is unsolved
                        v[target[j]] = max(constant[j], 0.0)
                    solve_members(v, first, left, chains, up, down, factors, screening)
                    unknowns += target.size
            resumed = False
            for done in range(chain, height):
                _write_owner(0, done, chains, owner, up)
            left -= height - chain
            height = chain
        chain = above
        searching = chain >= 0


@inlined
def _open_chain(x, number, chains, owner, up, down):  # type: ignore[no-untyped-def]
    """Find the chain through x and write 1 + its number on all its pixels."""
    y = np.int64(down[x])
    while y != x and up[y] == x:
        x = y
        y = np.int64(down[y])
    chains[HEAD, number] = x
    chains[BELOW, number] = y
    owner[x] = number + 1
    length = 1
    y = np.int64(up[x])
    while y != x and down[y] == x:
        x = y
        owner[x] = number + 1
        y = np.int64(up[y])
        length += 1
    chains[LAST, number] = x
    chains[ABOVE, number] = y
    chains[LENGTH, number] = length
    chains[LOW, number] = number
    chains[VISITED, number] = 0


@inlined
def _write_owner(value, number, chains, owner, up):  # type: ignore[no-untyped-def]
    """Write a number on all pixels of a chain."""
    x = chains[HEAD, number]
    owner[x] = value
    while x != chains[LAST, number]:
        x = up[x]
        owner[x] = value


@kernel
def solve_members(v, first, stop, chains, up, down, factors, screening):  # type: ignore[no-untyped-def]
    """Solve each of the pending chains first .. stop, given the values at the pixels that it depends on."""
    for k in range(first, stop):
        chain = chains[LEFT, k]
        head, last, length = chains[HEAD, chain], chains[LAST, chain], chains[LENGTH, chain]
        solve_chain(v, head, last, length, up, down, factors, screening)


@kernel
def component_rows(v, first, stop, chains, owner, up, factors):  # type: ignore[no-untyped-def]
    """The rows of the component of the pending chains first .. stop, which `owner` is above 0 on.

    Returns the unknowns' pixels; their constants; and weight and index of the two rows that row j depends on, at 2 j
    and 2 j + 1, with index -1 for none. What comes from solved pixels is in the constant. `owner` is overwritten on the
    unknowns.
    """
    size = 0
    longest = np.int64(0)
    for k in range(first, stop):  # make `owner` negative where a chain depends on it
        chain = chains[LEFT, k]
        longest = max(longest, np.int64(chains[LENGTH, chain]))
        for side in range(2):
            y = chains[BELOW + side, chain]
            if owner[y] > 0 and y != chains[side, chain]:
                owner[y] = -owner[y]
                size += 1
    target, index = np.empty(size, np.int64), np.empty(2 * size, np.int64)
    constant, weight = np.empty(size), np.empty(2 * size)
    a, b, c = np.empty(longest), np.empty(longest), np.empty(longest)
    end = 0
    for k in range(first, stop):
        chain = chains[LEFT, k]
        begin = end
        x = chains[HEAD, chain]
        for place in range(chains[LENGTH, chain]):
            if owner[x] < 0:
                target[end] = x
                owner[x] = -1 - end
                index[2 * end] = place
                end += 1
            x = up[x]
        if end > begin:
            peak = chains[ABOVE, chain] == chains[LAST, chain]
            solve_chain_affine(chains[LENGTH, chain], peak, factors, a, b, c)
        for j in range(begin, end):
            place = index[2 * j]
            constant[j] = a[place]
            for side in range(2):
                y = chains[BELOW + side, chain]
                share = c[place] if side else b[place]
                weight[2 * j + side] = 0.0
                index[2 * j + side] = -1
                if owner[y] < 0 and y != chains[side, chain]:
                    weight[2 * j + side] = share
                    index[2 * j + side] = y
                else:
                    constant[j] += share * abs(v[y])
    for j in range(index.size):
        if index[j] >= 0:
            index[j] = -1 - owner[index[j]]
    return target, constant, weight, index


@kernel
def find_feedback(index, feedback):  # type: ignore[no-untyped-def]
    """Find the rows that rows before them, or they themselves, depend on; returns how many these are.

    In `index` a feedback row becomes its place among the feedback, and any other row its number behind all of these.
    """
    size = index.size // 2
    count = 0
    place = np.empty(size, np.int64)
    for j in range(size):
        place[j] = -1
    for j in range(size):
        for k in range(2 * j, 2 * j + 2):
            i = index[k]
            if i >= j and place[i] < 0:
                place[i] = count
                count += 1
    for j in range(size):
        if place[j] >= 0:
            feedback[place[j]] = j
        for k in range(2 * j, 2 * j + 2):
            i = index[k]
            if i >= j:
                index[k] = place[i]
            else:
                index[k] = count + i if i >= 0 else 0  # with a weight of 0
    return count


@kernel
def substitute(share, constant, weight, index, z, x):  # type: ignore[no-untyped-def]
    """x = z, then all rows in order: share constant_j + weight x_index + weight x_index."""
    count = z.size
    for j in range(count):
        x[j] = z[j]
    for j in range(constant.size):
        k = 2 * j
        x[count + j] = share * constant[j] + weight[k] * x[index[k]] + weight[k + 1] * x[index[k + 1]]


@kernel
def eliminate(constant, weight, index):  # type: ignore[no-untyped-def]
    """Solve x_j = constant_j + weight_2j x(index_2j) + weight_2j+1 x(index_2j+1), an M-matrix, into `constant`.

    Rows are eliminated in passes, in each those that put no more than so many numbers into other rows. Of every row the
    numbers are a list through `after`, and a list through `beside` has those at which other rows depend on it.

    Returns False, with nothing changed, if there is not room for all numbers.
    """
    size = constant.size
    room = ROOM * size + 64
    row, column = np.empty(room, np.int32), np.empty(room, np.int32)
    after, beside = np.empty(room, np.int32), np.empty(room, np.int32)
    value, x = np.empty(room), np.empty(size)
    first, dependent, pivot = np.empty(size, np.int32), np.empty(size, np.int32), np.empty(size, np.int32)
    added, pairs = np.empty(size, np.int64), 0  # by column, the last pair of rows in which it was in both; pairs so far
    # how many numbers are on the lists, the diagonal left out; of rows that are eliminated the first is _GONE
    needs, needed = np.empty(size, np.int32), np.empty(size, np.int32)
    order, left = np.empty(size, np.int32), np.empty(size, np.int64)
    end, spare = np.int64(0), np.int64(-1)
    for j in range(size):  # np.zeros and the like would each be compiled
        x[j] = constant[j]
        first[j] = dependent[j] = pivot[j] = -1
        added[j] = needs[j] = needed[j] = 0
        left[j] = j
    for j in range(size):
        for k in range(2 * j, 2 * j + 2):
            i = index[k]
            if k % 2 == 1 and i == index[k - 1] and i >= 0:
                value[first[j]] += weight[k]
            elif i >= 0:
                _link(end, j, i, weight[k], row, column, value, after, beside, first, dependent)
                end += 1
                if i != j:
                    needs[j] += 1
                    needed[i] += 1
    done, allowed, count = 0, 2, size
    while count > 0:
        kept = 0
        for k in range(count):
            j = left[k]
            if needs[j] * needed[j] > allowed:
                left[kept] = j
                kept += 1
                continue
            own = _unlink(j, j, first, column, after)
            scale = 1.0 / (1.0 - value[own]) if own >= 0 else 1.0
            x[j] *= scale
            e = np.int64(first[j])
            while e >= 0:
                value[e] *= scale
                needed[column[e]] -= 1
                e = np.int64(after[e])
            needs[j] = _GONE
            order[done] = j
            done += 1
            e = np.int64(first[j])
            while e >= 0:
                pivot[column[e]] = e
                e = np.int64(after[e])
            d = np.int64(dependent[j])
            while d >= 0:
                following = np.int64(beside[d])
                i = np.int64(row[d])
                if needs[i] != _GONE:
                    share = value[d]
                    x[i] += share * x[j]
                    pairs += 1
                    before = np.int64(-1)
                    e = np.int64(first[i])
                    while e >= 0:  # add where row i has a number already, and take its number in column j out
                        behind = np.int64(after[e])
                        y = np.int64(column[e])
                        if e != d:
                            before = e
                            if pivot[y] >= 0:
                                value[e] += share * value[pivot[y]]
                                added[y] = pairs
                        elif before < 0:
                            first[i] = behind
                        else:
                            after[before] = behind
                        e = behind
                    needs[i] -= 1
                    after[d] = spare
                    spare = d
                    e = np.int64(first[j])
                    while e >= 0:
                        y = np.int64(column[e])
                        if added[y] != pairs:
                            place = spare
                            if spare >= 0:
                                spare = np.int64(after[spare])
                            elif end < room:
                                place = end
                                end += 1
                            else:
                                return False
                            _link(place, i, y, share * value[e], row, column, value, after, beside, first, dependent)
                            if y != i:
                                needs[i] += 1
                                needed[y] += 1
                        e = np.int64(after[e])
                d = following
            e = np.int64(first[j])
            while e >= 0:
                pivot[column[e]] = -1
                e = np.int64(after[e])
        if kept == count:
            allowed += max(1, allowed // 4)
        count = kept
    for k in range(size - 1, -1, -1):
        j = order[k]
        total = x[j]
        e = np.int64(first[j])
        while e >= 0:
            total += value[e] * constant[column[e]]
            e = np.int64(after[e])
        constant[j] = total
    return True


@inlined
def _link(e, j, i, weight, row, column, value, after, beside, first, dependent):  # type: ignore[no-untyped-def]
    """Put a number, in place e, into row j and column i."""
    row[e] = j
    column[e] = i
    value[e] = weight
    after[e] = first[j]
    first[j] = e
    beside[e] = dependent[i]
    dependent[i] = e


@inlined
def _unlink(j, i, first, column, after):  # type: ignore[no-untyped-def]
    """Take the number in column i out of row j; returns its place, -1 for none."""
    before = np.int64(-1)
    place = np.int64(first[j])
    while place >= 0 and column[place] != i:
        before = place
        place = np.int64(after[place])
    if place >= 0:
        if before < 0:
            first[j] = after[place]
        else:
            after[before] = after[place]
    return place
