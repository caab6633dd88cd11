"""The outline of a mask as polygons with long straight sides, and polygons drawn as a mask.

Points are (row, column) in units of pixels; pixel (i, j) is the square from (i, j) to (i + 1, j + 1). A crack is a
side of a pixel between the inside and the outside. An outline is a closed chain of cracks, with the inside on its
right-hand side as an image is seen.
"""

import numpy as np

from torchlinf.kernels.compiler import kernel

_STEP = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])  # right, down, left, up
_LEAST = 3  # cracks; the direction of a shorter side is too free to be bounded
_TIE = 1e-7  # pixels: a side that runs through the middles of pixels by rounding alone is on one side of them all


@kernel
def trace(mask):  # type: ignore[no-untyped-def]
    """The directions of all cracks, outline after outline, and of each outline its first index, row and column.

    `mask` has a ring of outside pixels. Pixels that meet at a corner are connected. The last entry of the second array
    holds the number of cracks.
    """
    rows, columns = mask.shape
    total = 0
    for i in range(1, rows):
        for j in range(1, columns):
            total += (mask[i, j] != mask[i - 1, j]) + (mask[i, j] != mask[i, j - 1])
    seen = np.zeros((rows, columns), np.bool_)
    code = np.empty(total, np.int8)
    begin = np.empty((total // 4 + 1, 3), np.int64)
    count = used = 0
    for i0 in range(1, rows):
        for j0 in range(1, columns):
            if not mask[i0, j0] or mask[i0 - 1, j0] or seen[i0, j0]:
                continue
            begin[count, 0], begin[count, 1], begin[count, 2] = used, i0, j0
            count += 1
            i, j, way = i0, j0, 0
            while True:
                if way == 0:
                    seen[i, j] = True
                code[used] = way
                used += 1
                i, j = i + _STEP[way, 0], j + _STEP[way, 1]
                if way == 0:
                    left, right = mask[i - 1, j], mask[i, j]
                elif way == 1:
                    left, right = mask[i, j], mask[i, j - 1]
                elif way == 2:
                    left, right = mask[i, j - 1], mask[i - 1, j - 1]
                else:
                    left, right = mask[i - 1, j - 1], mask[i - 1, j]
                if left:
                    way = (way + 3) % 4
                elif not right:
                    way = (way + 1) % 4
                if i == i0 and j == j0 and way == 0:
                    break
    begin[count, 0] = used
    return code, begin[: count + 1]


@kernel
def straight(code, start):  # type: ignore[no-untyped-def]
    """How many cracks of a closed outline, from `start` on, one straight line can have.

    The corners (x, y) of such cracks have low <= a x - b y < low + a + b with integers a, b and low (Debled-Rennesson
    and Reveilles, "A linear algorithm for segmentation of digital curves", 1995). A corner one outside turns the line.
    """
    size = len(code)
    first = code[start]
    n = 1
    while n < size and code[(start + n) % size] == first:
        n += 1
    if n == size or (code[(start + n) % size] - first) % 4 == 2:
        return n
    second = code[(start + n) % size]
    x, y, a, b, low = n, 0, 0, 1, 0
    # The first and the last corner on the upper border of the strip, and on the lower.
    upper_x, upper_y, last_upper_x, last_upper_y = 0, 0, n, 0
    lower_x, lower_y, last_lower_x, last_lower_y = 0, 0, n, 0
    while n < size:
        way = code[(start + n) % size]
        if way == first:
            x += 1
        elif way == second:
            y += 1
        else:
            break
        r = a * x - b * y
        if r < low - 1 or r > low + a + b:
            break
        if r == low - 1:
            lower_x, lower_y = last_lower_x, last_lower_y
            a, b = y - upper_y, x - upper_x
            last_upper_x, last_upper_y = x, y
            low = a * x - b * y
        elif r == low + a + b:
            upper_x, upper_y = last_upper_x, last_upper_y
            a, b = y - lower_y, x - lower_x
            last_lower_x, last_lower_y = x, y
            low = a * x - b * y - a - b + 1
        else:
            if r == low:
                last_upper_x, last_upper_y = x, y
            if r == low + a + b - 1:
                last_lower_x, last_lower_y = x, y
        n += 1
    return n


@kernel
def cut(code, stops, core):  # type: ignore[no-untyped-def]
    """Cut a closed outline into as few straight sides as there can be, or one more.

    Gives the crack at which the first side begins, the start of the longest, and the number of sides. Writes to `stops`
    how many cracks after that one each side ends, and to `core` from where to where no other side claims its cracks.
    """
    size = len(code)
    length = np.empty(size, np.int64)
    first = 0
    for k in range(size):
        length[k] = straight(code, k)
        if length[k] > length[first]:
            first = k
    sides = at = last = 0
    while at < size:
        end = min(size, at + length[(first + at) % size])
        core[sides, 0], core[sides, 1] = at, end
        if sides > 0:  # where two sides claim the same cracks the cut is halfway
            back = at
            while back - 1 > last and back - 1 + length[(first + back - 1) % size] >= end:
                back -= 1
            stops[sides - 1] = (back + at) // 2
            core[sides - 1, 1] = back
        last, at = at, end
        sides += 1
    stops[sides - 1] = size
    for s in range(sides):
        begin = stops[s - 1] if s > 0 else 0
        if core[s, 1] - core[s, 0] < max(_LEAST, (stops[s] - begin + 1) // 2):
            core[s, 0], core[s, 1] = begin, stops[s]
    return first, sides


@kernel
def room(inner, outer, angle):  # type: ignore[no-untyped-def]
    """How far a side's outside pixels lie beyond its inside ones, across a direction, and the middle between."""
    di, dj = np.cos(angle), np.sin(angle)
    inside, outside = -np.float64(1e300), np.float64(1e300)
    for k in range(len(inner)):
        inside = max(inside, di * inner[k, 1] - dj * inner[k, 0])
        outside = min(outside, di * outer[k, 1] - dj * outer[k, 0])
    return outside - inside, (inside + outside) / 2


@kernel
def least_squares(inner, outer):  # type: ignore[no-untyped-def]
    """A point and the angle of the line of least squares through the middles of a side's cracks."""
    n = len(inner)
    mi = mj = 0.0
    for k in range(n):
        mi += inner[k, 0] + outer[k, 0]
        mj += inner[k, 1] + outer[k, 1]
    mi /= 2 * n
    mj /= 2 * n
    if n == 1:
        return mi, mj, np.arctan2(inner[0, 0] - outer[0, 0], outer[0, 1] - inner[0, 1])
    ii = jj = ij = 0.0
    for k in range(n):
        di, dj = (inner[k, 0] + outer[k, 0]) / 2 - mi, (inner[k, 1] + outer[k, 1]) / 2 - mj
        ii += di * di
        jj += dj * dj
        ij += di * dj
    angle = 0.5 * np.arctan2(2 * ij, ii - jj)
    along = np.cos(angle) * (inner[n - 1, 0] - inner[0, 0] + outer[n - 1, 0] - outer[0, 0])
    along += np.sin(angle) * (inner[n - 1, 1] - inner[0, 1] + outer[n - 1, 1] - outer[0, 1])
    return mi, mj, angle + (np.pi if along < 0 else 0.0)


@kernel
def bounds(inner, outer, angle):  # type: ignore[no-untyped-def]
    """The least and the greatest angle of the lines between a side's inside and outside pixels; equal if none is."""
    reach = 2.0 / len(inner)
    low, high = angle - reach, angle + reach
    for _ in range(20):  # the room rises and falls once
        a, b = low + (high - low) / 3, high - (high - low) / 3
        if room(inner, outer, a)[0] < room(inner, outer, b)[0]:
            low = a
        else:
            high = b
    widest = (low + high) / 2
    if room(inner, outer, widest)[0] <= 0:
        return angle, angle
    found = np.empty(2)
    for way in range(2):
        good, bad = widest, angle + (4 * way - 2) * reach
        for _ in range(20):
            a = (good + bad) / 2
            if room(inner, outer, a)[0] > 0:
                good = a
            else:
                bad = a
        found[way] = good
    return found[0], found[1]


@kernel
def sides(mask):  # type: ignore[no-untyped-def]
    """All outlines of a mask, with a ring of outside pixels, cut into straight sides.

    Gives the middles of the pixels inside and outside of every crack; where each side ends; which side each outline
    begins with; of each side a point, the angle of its direction (cos along the rows' axis), and the least and greatest
    angle that its pixels allow, equal if it is too short to say; and the cracks that are its own.
    """
    code, begin = trace(mask)
    inner, outer = np.empty((len(code), 2)), np.empty((len(code), 2))
    stops = np.zeros(len(code) + 1, np.int64)
    core = np.zeros((len(code), 2), np.int64)
    where = np.zeros(len(begin), np.int64)
    count = 0
    for o in range(len(begin) - 1):
        here, size = begin[o, 0], begin[o + 1, 0] - begin[o, 0]
        first, number = cut(code[here : here + size], stops[count + 1 :], core[count:])
        for s in range(count, count + number):
            stops[s + 1] += here
            core[s, 0] += here
            core[s, 1] += here
        count += number
        where[o + 1] = count
        i, j = begin[o, 1], begin[o, 2]
        for k in range(size):
            di, dj = _STEP[code[here + k], 0], _STEP[code[here + k], 1]
            at = here + (k - first + size) % size
            inner[at, 0], inner[at, 1] = i + (di + dj) / 2, j + (dj - di) / 2
            outer[at, 0], outer[at, 1] = i + (di - dj) / 2, j + (dj + di) / 2
            i += di
            j += dj
    lines = np.empty((count, 5))
    for s in range(count):
        a, b = core[s, 0], core[s, 1]
        mi, mj, angle = least_squares(inner[a:b], outer[a:b])
        low = high = angle
        if b - a >= _LEAST:
            low, high = bounds(inner[a:b], outer[a:b], angle)
            if low < high:  # the line that the pixels allow next to that of least squares
                angle = min(max(angle, low), high)
                off = room(inner[a:b], outer[a:b], angle)[1]
                along = np.cos(angle) * mi + np.sin(angle) * mj
                mi, mj = np.cos(angle) * along - np.sin(angle) * off, np.sin(angle) * along + np.cos(angle) * off
        lines[s] = mi, mj, angle, low, high
    return inner, outer, stops[: count + 1], where, lines, core[:count]


@kernel
def polygons(inner, outer, stops, where, lines, core, turn, slack):  # type: ignore[no-untyped-def]
    """Corners of all outlines after a turn by an angle, and where each outline begins.

    The arguments before `turn` are what `sides` gives. A side that may lie along an axis after the turn does, with
    `slack` added to the angles that its pixels allow.
    """
    cos, sin = np.cos(turn), np.sin(turn)
    line = np.empty((len(lines), 4))  # a point and a direction
    for s in range(len(lines)):
        mi, mj, angle = lines[s, 0], lines[s, 1], lines[s, 2] + turn
        line[s] = cos * mi - sin * mj, sin * mi + cos * mj, np.cos(angle), np.sin(angle)
        quarter = np.rint(angle / (np.pi / 2))
        axis = quarter * (np.pi / 2)
        if lines[s, 3] < lines[s, 4] and lines[s, 3] - slack <= axis - turn <= lines[s, 4] + slack:
            off = room(inner[core[s, 0] : core[s, 1]], outer[core[s, 0] : core[s, 1]], axis - turn)[1]
            way = (5 - int(quarter) % 4) % 4  # angle 0 is down, 90 degrees right
            line[s, 2], line[s, 3] = _STEP[way, 0], _STEP[way, 1]
            line[s, int(_STEP[way, 0] != 0)] = off * (line[s, 2] - line[s, 3])
    corners = np.empty((2 * len(lines), 2))
    begin = np.zeros(len(where), np.int64)
    used = 0
    for o in range(len(where) - 1):
        for s in range(where[o], where[o + 1]):
            t = s + 1 if s + 1 < where[o + 1] else where[o]
            a, b = stops[s + 1] - 1, stops[t]  # the cracks on both sides of the cut
            mi = (inner[a, 0] + inner[b, 0] + outer[a, 0] + outer[b, 0]) / 4
            mj = (inner[a, 1] + inner[b, 1] + outer[a, 1] + outer[b, 1]) / 4
            pi, pj = cos * mi - sin * mj, sin * mi + cos * mj
            cross = line[s, 2] * line[t, 3] - line[s, 3] * line[t, 2]
            if abs(cross) > 1e-6:
                u = ((line[t, 0] - line[s, 0]) * line[t, 3] - (line[t, 1] - line[s, 1]) * line[t, 2]) / cross
                ci, cj = line[s, 0] + u * line[s, 2], line[s, 1] + u * line[s, 3]
                if (ci - pi) ** 2 + (cj - pj) ** 2 < 4.0:
                    corners[used, 0], corners[used, 1] = ci, cj
                    used += 1
                    continue
            for q in (s, t):  # they meet too far from the cut: from line to line there
                u = (pi - line[q, 0]) * line[q, 2] + (pj - line[q, 1]) * line[q, 3]
                corners[used, 0], corners[used, 1] = line[q, 0] + u * line[q, 2], line[q, 1] + u * line[q, 3]
                used += 1
        begin[o + 1] = used
    return corners[:used], begin


@kernel
def draw(corners, begin, rows, columns):  # type: ignore[no-untyped-def]
    """The pixels of a (rows, columns) grid whose middles closed polygons wind around."""
    turns = np.zeros((rows, columns + 1), np.int32)
    for o in range(len(begin) - 1):
        previous = begin[o + 1] - 1
        for p in range(begin[o], begin[o + 1]):
            ai, aj, bi, bj, sign = corners[previous, 0], corners[previous, 1], corners[p, 0], corners[p, 1], 1
            previous = p
            if ai > bi:
                ai, aj, bi, bj, sign = bi, bj, ai, aj, -1
            for i in range(max(0, int(np.ceil(ai - 0.5 - _TIE))), min(rows, int(np.ceil(bi - 0.5 - _TIE)))):
                j = aj + (i + 0.5 + _TIE - ai) * (bj - aj) / (bi - ai)
                turns[i, min(columns, max(0, int(np.ceil(j - 0.5 - _TIE))))] += sign
    out = np.empty((rows, columns), np.bool_)
    for i in range(rows):
        winding = 0
        for j in range(columns):
            winding += turns[i, j]
            out[i, j] = winding != 0
    return out


@kernel
def hull(points):  # type: ignore[no-untyped-def]
    """Corners of the convex hull of points that are sorted by the first and then the second number (Andrew)."""
    n = len(points)
    found = np.empty((2 * n + 1, 2))
    size = 0
    for half in range(2):
        base = size
        for k in range(n):
            x, y = points[k if half == 0 else n - 1 - k]
            while size > base + 1:
                ax, ay = found[size - 1, 0] - found[size - 2, 0], found[size - 1, 1] - found[size - 2, 1]
                if ax * (y - found[size - 2, 1]) > ay * (x - found[size - 2, 0]):
                    break
                size -= 1
            found[size, 0], found[size, 1] = x, y
            size += 1
        size -= 1  # the other half begins with this one
    return found[: max(size, 1)]
