"""Connected regions of binary maps, compiled; called by `regions.gather`."""

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel


@kernel
def sort_by_size(sizes, kind, order, ends):  # type: ignore[no-untyped-def]
    """The pixels of each map (row of `sizes`), those of the first kind first.

    `kind` is the number of the kind of each size, from 0, and ends[m, k] becomes the number of pixels of map m of the
    kinds up to k. Sizes from kind.size on are left out.
    """
    for m in range(sizes.shape[0]):
        row, end, places = sizes[m], ends[m], order[m]
        end[:] = 0
        for x in range(row.size):
            if row[x] < kind.size:
                end[kind[row[x]]] += 1
        total = 0
        for k in range(end.size):
            total += end[k]
            end[k] = total - end[k]
        for x in range(row.size):
            if row[x] < kind.size:
                k = kind[row[x]]
                places[end[k]] = x
                end[k] += 1


@kernel
def gather_maps(  # type: ignore[no-untyped-def]
    order, ends, kind, offsets, whole, place, within, limit, left, most, tally, pixels, begin, owner, code, count, row
):
    """Append regions as `regions.gather` does; returns how many there are then. `tally` and `row` are scratch, 0."""
    end = begin[count]
    for n in range(order.shape[1]):
        total = 0
        for g in range(order.shape[0]):
            total += _new(ends[g, n], kind)
        if total > left[n]:
            continue
        left[n] -= total
        for g in range(order.shape[0]):
            marked = order[g, n, : _new(ends[g, n], kind)]
            for x in marked:
                row[place[x]] = 1
            first = count
            if whole and 0 < marked.size <= limit[n]:
                for k in range(marked.size):
                    pixels[end + k] = marked[k]
                count, end = _close(n, end, end + marked.size, count, pixels, begin, owner, code)
            for x in marked:
                if row[place[x]] == 0:
                    continue
                following = end
                stop = _spread(row, place[x], offsets[g], pixels, end)
                size = stop - following
                same = size if size < tally.size else 0
                tally[same] += 1
                if size <= limit[n] and (same == 0 or tally[same] <= most + 1):
                    for j in range(following, stop):
                        pixels[j] = within[pixels[j]]
                    count, end = _close(n, end, stop, count, pixels, begin, owner, code)
            for i in range(first, count):
                size = begin[i + 1] - begin[i]
                tally[size if size < tally.size else 0] = 0
            tally[0] = 0
    return count


@inlined
def _new(ends, kind):  # type: ignore[no-untyped-def]
    """How many pixels the map of the kinds up to `kind` has; 0 if it is the one before."""
    return 0 if kind > 0 and ends[kind] == ends[kind - 1] else ends[kind]


@kernel
def _spread(row, x, offsets, pixels, end):  # type: ignore[no-untyped-def]
    """Erase the region of a pixel, and write it behind `end`; returns where it ends."""
    row[x] = 0
    pixels[end] = x
    following = end
    end += 1
    while following < end:
        for offset in offsets:
            y = pixels[following] + offset
            if row[y]:
                row[y] = 0
                pixels[end] = y
                end += 1
        following += 1
    return end


@kernel
def code_of(pixels):  # type: ignore[no-untyped-def]
    """The sum of random bits of the pixels, which is the same in whatever order they come."""
    total = np.uint64(0)
    for x in pixels:
        total += _random_bits(x)
    return total


@inlined
def _close(n, first, end, count, pixels, begin, owner, code):  # type: ignore[no-untyped-def]
    """Note a region; returns how many there are, and where the next one begins."""
    owner[count], code[count] = n, code_of(pixels[first:end])
    begin[count + 1] = end
    return count + 1, end


@inlined
def _random_bits(number):  # type: ignore[no-untyped-def]
    """64 bits that depend on a number, as good as random: the finaliser of SplitMix64."""
    bits = np.uint64(number + 1) * np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))
