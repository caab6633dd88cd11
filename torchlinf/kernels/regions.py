"""Connected regions of binary maps."""

import numpy as np

from torchlinf.kernels.compiler import kernel


@kernel
def flood(maps, offsets):  # type: ignore[no-untyped-def]
    """Split the marked pixels of each map into connected regions; the marks are erased.

    `maps` is (N, P) uint8, each row a flat grid with a ring of zeros, so that no offset leads out of it; two pixels are
    connected if they differ by one of `offsets`, which hold their negatives too.

    Returns the pixels region by region, each region's first one being its smallest, the position at which each region
    begins (and the last one ends), and the map it lies on.
    """
    total = 0
    for row in maps:
        for mark in row:
            total += mark
    pixels = np.empty(total, np.int64)
    begin = np.empty(total + 1, np.int64)
    owner = np.empty(total, np.int64)
    count = end = 0
    for n in range(maps.shape[0]):
        row = maps[n]
        for x in range(row.size):
            if row[x]:
                begin[count], owner[count] = end, n
                count += 1
                row[x] = 0
                pixels[end] = x
                next_one = end
                end += 1
                while next_one < end:
                    for offset in offsets:
                        y = pixels[next_one] + offset
                        if row[y]:
                            row[y] = 0
                            pixels[end] = y
                            end += 1
                    next_one += 1
    begin[count] = end
    return pixels, begin[: count + 1], owner[:count]
