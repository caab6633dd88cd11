"""Connected regions of binary maps, compiled; called by `regions.flood`."""

from torchlinf.kernels.compiler import kernel


@kernel
def flood_maps(maps, offsets, pixels, begin, owner):  # type: ignore[no-untyped-def]
    """Fill in the regions as `regions.flood` returns them; returns how many they are."""
    count = end = 0
    for n in range(maps.shape[0]):
        for x in range(maps.shape[1]):
            if maps[n, x]:
                begin[count], owner[count] = end, n
                count += 1
                maps[n, x] = 0
                pixels[end] = x
                following = end
                end += 1
                while following < end:
                    for offset in offsets:
                        y = pixels[following] + offset
                        if maps[n, y]:
                            maps[n, y] = 0
                            pixels[end] = y
                            end += 1
                    following += 1
    begin[count] = end
    return count
