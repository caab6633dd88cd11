"""A closed outline as the fewest straight sides that stay near it, each fitted to its run of the outline.

Points are (x, y) in units of the tolerance: no side may be farther than 1 from the outline. A run is a part of the
outline between two of its points; its line is the least-squares line of all that lies between, not of the corners
alone, so stairs of pixels give the wall that they were drawn from. The corners are where the lines of runs that follow
each other cross. Which runs are taken is found by dynamic programming over pairs of runs.
"""

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel

ALL, LAST = 48, 32  # of the runs from a point, those with so few points are tried, and so many of the longest
_FAR = 1e300  # stands for infinity: compiled code takes it that there is none
_SLACKS = (1.0, 4.0, _FAR)  # prices above the least that is possible, up to which chains are looked for
_TURN = 0.35  # sine of the largest angle that a line is turned by into the frame: 20 degrees
_EXACT = 1e-9
# Both sides at a right angle may lie 1 off the true walls; then their corner is sqrt(2) off.
_CORNER = 1.41421356


@kernel
def runs(points, sums, frame, free):  # type: ignore[no-untyped-def]
    """All runs that have a line within the tolerance.

    Args:
        points: (N, 2) in the order of the ring.
        sums: (2 N + 1, 6) sums of length, x, y, xx, xy, yy along the outline from point 0, twice around.
        frame: angle in radians of the object's own frame.
        free: price, in sides, of a line that does not lie along the frame; 0 if there is no frame.

    Returns:
        The first and last point (R, 2) of each run, the first below N; its line (R, 3) as the direction of travel and
        the distance from the origin, to the left of that direction; and its price (R,). They are sorted by the first.
    """
    number = len(points)
    room = 1024
    ends = np.empty((room, 2), np.int64)
    lines = np.empty((room, 3))
    prices = np.empty(room)
    count = 0
    hull = np.empty((4 * number + 8, 2))
    around = sums[number, 0]
    for i in range(number):
        begin = count
        x0, y0 = points[i, 0], points[i, 1]
        middle = 2 * number
        stop = _reach(points, i)
        # Of very many only the short and the longest ones: a wall ends where its run can go no farther. The longest
        # are looked for near `stop` first, and if they are not there, everywhere.
        for near in (stop - 3 * LAST, i):
            count = begin
            low, high = middle, middle + 2  # of the hull, a deque of points in counter-clockwise order, closed
            for j in range(i + 1, stop):
                x, y = points[j % number, 0], points[j % number, 1]
                if j == i + 1:
                    hull[low, 0], hull[low, 1] = x, y
                    hull[low + 1, 0], hull[low + 1, 1] = x0, y0
                    hull[high, 0], hull[high, 1] = x, y
                else:
                    low, high = _grown(hull, low, high, x, y)
                if i + ALL < j < near:
                    continue
                length, sx, sy, xx, xy, yy = _moments(sums, i, j)
                mx, my = sx / length, sy / length
                xx, xy, yy = xx / length - mx * mx, xy / length - mx * my, yy / length - my * my
                angle = 0.5 * np.arctan2(2 * xy, xx - yy)
                c, s = np.cos(angle), np.sin(angle)
                if c * (x - x0) + s * (y - y0) < 0:
                    c, s = -c, -s
                for kind in range(1 if free == 0.0 else 2):
                    price = 1.0 + free
                    if kind == 1:
                        price = 1.0
                        quarter = np.rint((np.arctan2(s, c) - frame) / (np.pi / 2)) * (np.pi / 2) + frame
                        c0, s0 = np.cos(quarter), np.sin(quarter)
                        if abs(c0 * s - s0 * c) > _TURN:
                            break
                        c, s = c0, s0
                    least, most, back, front = _FAR, -_FAR, _FAR, -_FAR
                    for k in range(low, high):
                        off, along = c * hull[k, 1] - s * hull[k, 0], c * hull[k, 0] + s * hull[k, 1]
                        least, most = min(least, off), max(most, off)
                        back, front = min(back, along), max(front, along)
                    if most - least > 2.0 or c * x + s * y < front - 1.0 or c * x0 + s * y0 > back + 1.0:
                        continue
                    offset = min(max(c * my - s * mx, most - 1.0), least + 1.0)
                    spread = s * s * xx - 2 * c * s * xy + c * c * yy + (offset - (c * my - s * mx)) ** 2
                    if count == room:
                        ends, lines, prices = _doubled(ends), _doubled(lines), _doubled_row(prices)
                        room *= 2
                    ends[count, 0], ends[count, 1] = i, j
                    lines[count, 0], lines[count, 1], lines[count, 2] = c, s, offset
                    prices[count] = price + max(spread, 0.0) * length / around
                    count += 1
            if near <= i + ALL or (count > begin and ends[count - 1, 1] >= near + LAST):
                break
        if count > begin:
            farthest = ends[count - 1, 1]
            kept = begin
            for r in range(begin, count):
                if ends[r, 1] - i <= ALL or ends[r, 1] > farthest - LAST:
                    ends[kept], lines[kept], prices[kept] = ends[r], lines[r], prices[r]
                    kept += 1
            count = kept
    return ends[:count].copy(), lines[:count].copy(), prices[:count].copy()


@kernel
def _reach(points, i):  # type: ignore[no-untyped-def]
    """One more than the last point, counted from i on around the ring, that a run from point i may end at.

    A line within 1 of two points has an angle to the line through them of at most asin(2 / distance). So the directions
    that are left are a cone, here of at most 60 degrees, from `right` to `left`.
    """
    number = len(points)
    x0, y0 = points[i, 0], points[i, 1]
    started = False
    left_x, left_y, right_x, right_y = 0.0, 0.0, 0.0, 0.0
    for j in range(i + 1, i + number):
        x, y = points[j % number, 0] - x0, points[j % number, 1] - y0
        away = x * x + y * y
        if away <= 16.0:
            continue
        away = np.sqrt(away)
        x, y, s = x / away, y / away, 2.0 / away
        c = np.sqrt(1.0 - s * s)
        lx, ly, rx, ry = c * x - s * y, c * y + s * x, c * x + s * y, c * y - s * x
        if not started:
            started, left_x, left_y, right_x, right_y = True, lx, ly, rx, ry
            continue
        if x * (left_x + right_x) + y * (left_y + right_y) <= 0:
            return j
        if lx * left_y - ly * left_x > 0:
            left_x, left_y = lx, ly
        if right_x * ry - right_y * rx > 0:
            right_x, right_y = rx, ry
        if right_x * left_y - right_y * left_x < 0:
            return j
    return i + number


@kernel
def cheapest(points, ends, lines, prices, anchor):  # type: ignore[no-untyped-def]
    """The cheapest closed chain of runs that has one of them in it, joined where their lines cross.

    Args:
        points: (N, 2) as for `runs`.
        ends: what `runs` returns.
        lines: the same.
        prices: the same.
        anchor: which run must be a part of it.

    Returns:
        The runs (K,) of the chain, the anchor first; the corner (K, 2) at the beginning of each; and the price. K is 0
        if there is no such chain.
    """
    number, count = len(points), len(ends)
    start = ends[anchor, 0]
    # Plain loops for what NumPy has: its sorting and searching take seconds to compile.
    first = np.zeros(number + 1, np.int64)
    for r in range(count):
        first[ends[r, 0] + 1] += 1
    for i in range(number):
        first[i + 1] += first[i]
    # The runs by their last point, as seen from the start of the anchor.
    into = np.zeros(number + 2, np.int64)
    for r in range(count):
        last = (ends[r, 0] - start) % number + ends[r, 1] - ends[r, 0]
        if last <= number:
            into[last + 1] += 1
    for k in range(number + 1):
        into[k + 1] += into[k]
    by_end = np.empty(into[-1], np.int64)
    fill = into.copy()
    for step in range(number):
        i = (start + step) % number
        for r in range(first[i], first[i + 1]):
            last = step + ends[r, 1] - ends[r, 0]
            if last <= number:
                by_end[fill[last]] = r
                fill[last] += 1
    # What is left from each step on costs at least so much, whether the runs can be joined or not.
    rest = np.full(number + 1, _FAR)
    rest[number] = 0.0
    for step in range(number - 1, 0, -1):
        i = (start + step) % number
        for q in range(first[i], first[i + 1]):
            last = step + ends[q, 1] - ends[q, 0]
            if last <= number:
                rest[step] = min(rest[step], prices[q] + rest[last])
    best = np.empty(count)
    before = np.empty(count, np.int64)
    corner = np.zeros((count, 2))
    closing = np.zeros(2)
    whole, final = _FAR, -1
    # Chains that must cost more than a limit are left out. A chain below it is the one that is found without a limit.
    for slack in _SLACKS:
        limit = prices[anchor] + rest[ends[anchor, 1] - start] + slack
        best[:] = _FAR
        before[:] = -1
        best[anchor] = prices[anchor]
        whole, final = _passed(
            points, ends, lines, prices, anchor, first, into, by_end.copy(), rest, limit, best, before, corner, closing
        )
        if final >= 0:
            break
    length = 0
    r = final
    while r >= 0:
        length += 1
        r = before[r]
    chain = np.empty(length, np.int64)
    corners = np.empty((length, 2))
    r = final
    for k in range(length - 1, -1, -1):
        chain[k] = r
        corners[k] = corner[r]
        r = before[r]
    if length:
        corners[0] = closing
    return chain, corners, whole


@kernel
def _passed(  # type: ignore[no-untyped-def]
    points, ends, lines, prices, anchor, first, into, by_end, rest, limit, best, before, corner, closing
):
    """One pass around the ring: fills `best`, `before` and `corner` of each run, and `closing`, the anchor's corner.

    Returns the price of the cheapest closed chain, and its last run, -1 if none is within the limit.
    """
    number = len(points)
    start = ends[anchor, 0]
    whole, final = _FAR, -1
    for step in range(1, number + 1):
        i = (start + step) % number
        closes = step == number
        # By price, so that the first that fits is the cheapest.
        for k in range(into[step] + 1, into[step + 1]):
            r = by_end[k]
            while k > into[step] and best[by_end[k - 1]] > best[r]:
                by_end[k] = by_end[k - 1]
                k -= 1
            by_end[k] = r
        for q in range(first[i], first[i + 1]):
            if (closes and q != anchor) or (not closes and step + ends[q, 1] - ends[q, 0] > number):
                continue
            left = 0.0 if closes else prices[q] + rest[step + ends[q, 1] - ends[q, 0]]
            for k in range(into[step], into[step + 1]):
                r = by_end[k]
                if best[r] >= _FAR or best[r] + left > limit:
                    break
                fits, x, y = _joined(points, ends, lines, r, q)
                # Along run r its first corner must come before its last one.
                if not fits or (
                    r != anchor and lines[r, 0] * (x - corner[r, 0]) + lines[r, 1] * (y - corner[r, 1]) <= 0
                ):
                    continue
                if closes:
                    whole, final = best[r], r
                    closing[0], closing[1] = x, y
                else:
                    best[q], before[q] = best[r] + prices[q], r
                    corner[q, 0], corner[q, 1] = x, y
                break
    return whole, final


@inlined
def _moments(sums, i, j):  # type: ignore[no-untyped-def]
    a, b = sums[i], sums[j]
    return b[0] - a[0], b[1] - a[1], b[2] - a[2], b[3] - a[3], b[4] - a[4], b[5] - a[5]


@kernel
def _grown(hull, low, high, x, y):  # type: ignore[no-untyped-def]
    """The convex hull of a chain that does not cross itself, with one more point (Melkman's algorithm)."""
    if _left(hull, low, x, y) > 0 and _left(hull, high - 1, x, y) > 0:
        return low, high
    while high - low > 1 and _left(hull, high - 1, x, y) <= 0:
        high -= 1
    high += 1
    hull[high, 0], hull[high, 1] = x, y
    while high - low > 2 and _left(hull, low, x, y) <= 0:
        low += 1
    low -= 1
    hull[low, 0], hull[low, 1] = x, y
    return low, high


@inlined
def _left(hull, k, x, y):  # type: ignore[no-untyped-def]
    return (hull[k + 1, 0] - hull[k, 0]) * (y - hull[k, 1]) - (hull[k + 1, 1] - hull[k, 1]) * (x - hull[k, 0])


@kernel
def _joined(points, ends, lines, r, q):  # type: ignore[no-untyped-def]
    """Whether two runs may follow each other, and the corner: it, and all that it cuts off, is within the tolerance."""
    number = len(points)
    ca, sa, oa = lines[r, 0], lines[r, 1], lines[r, 2]
    cb, sb, ob = lines[q, 0], lines[q, 1], lines[q, 2]
    turn = ca * sb - sa * cb
    if abs(turn) < _EXACT:
        return False, 0.0, 0.0
    x, y = (cb * oa - ca * ob) / turn, (sb * oa - sa * ob) / turn
    middle = ends[r, 1]
    # The corner lies near the outline: on a line, between the ends of its run, or near the point where the runs meet.
    begin, end = ends[r, 0] % number, ends[q, 1] % number
    bx, by = points[middle % number, 0], points[middle % number, 1]
    if ca * (x - points[begin, 0]) + sa * (y - points[begin, 1]) < 0:
        return False, 0.0, 0.0
    if cb * (points[end, 0] - x) + sb * (points[end, 1] - y) < 0:
        return False, 0.0, 0.0
    if ca * (x - bx) + sa * (y - by) > 0 and cb * (bx - x) + sb * (by - y) > 0 and np.hypot(x - bx, y - by) > _CORNER:
        return False, 0.0, 0.0
    # What lies beyond the corner along one line is near the corner, or near the other line.
    for k in range(middle, ends[r, 0] - 1, -1):
        px, py = points[k % number, 0], points[k % number, 1]
        along = ca * (px - x) + sa * (py - y)
        if along < -2.0:
            break
        if along > 0 and np.hypot(px - x, py - y) > 1.0 and abs(cb * py - sb * px - ob) > 1.0:
            return False, 0.0, 0.0
    for k in range(middle, middle + ends[q, 1] - ends[q, 0] + 1):
        px, py = points[k % number, 0], points[k % number, 1]
        along = cb * (px - x) + sb * (py - y)
        if along > 2.0:
            break
        if along < 0 and np.hypot(px - x, py - y) > 1.0 and abs(ca * py - sa * px - oa) > 1.0:
            return False, 0.0, 0.0
    return True, x, y


@kernel
def _doubled(rows):  # type: ignore[no-untyped-def]
    larger = np.empty((2 * len(rows), rows.shape[1]), rows.dtype)
    larger[: len(rows)] = rows
    return larger


@kernel
def _doubled_row(row):  # type: ignore[no-untyped-def]
    larger = np.empty(2 * len(row), row.dtype)
    larger[: len(row)] = row
    return larger
