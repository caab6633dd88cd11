"""Connected regions of binary maps, compiled; called by `regions.gather`."""

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel


@kernel
def gather_maps(  # type: ignore[no-untyped-def]
    maps, offsets, whole, within, limit, left, most, tally, pixels, begin, owner, code, count, marked
):
    """Append regions as `regions.gather` does; returns how many there are then. `tally` and `marked` are scratch."""
    end = begin[count]
    for n in range(maps.shape[1]):
        total = 0
        for g in range(maps.shape[0]):
            for x in range(maps.shape[2]):
                total += maps[g, n, x]
        if total > left[n]:
            continue
        left[n] -= total
        for g in range(maps.shape[0]):
            row = maps[g, n]
            stop = 0
            for x in range(row.size):
                marked[stop] = x
                stop += row[x]
            first = count
            if whole and 0 < stop <= limit[n]:
                for k in range(stop):
                    pixels[end + k] = within[marked[k]]
                count, end = _close(n, end, end + stop, count, pixels, begin, owner, code)
            for k in range(stop):
                if row[marked[k]] == 0:
                    continue
                following = end
                stop_at = _spread(row, marked[k], offsets[g], pixels, end)
                size = stop_at - following
                kind = size if size < tally.size else 0
                tally[kind] += 1
                if size <= limit[n] and (kind == 0 or tally[kind] <= most + 1):
                    for j in range(following, stop_at):
                        pixels[j] = within[pixels[j]]
                    count, end = _close(n, end, stop_at, count, pixels, begin, owner, code)
            for i in range(first, count):
                size = begin[i + 1] - begin[i]
                tally[size if size < tally.size else 0] = 0
            tally[0] = 0
    return count


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
