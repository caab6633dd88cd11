"""What is summed over each of many regions: their price, what they change, and how uneven the field is near them."""

from torchlinf.kernels.compiler import kernel


@kernel
def weigh(  # type: ignore[no-untyped-def]
    pixels, begin, numbers, sign, price, closed, unit, most, most_changed, most_pixels, place, share, around, steps,
    ahead, seen, prices, changes, near,
):  # fmt: skip
    """Fill in the price of each region, how many changes it adds, and the complexity near it.

    That is the sum of `share` over it and `around` it, and -1 where it may not be flipped.

    `pixels` are flat, those of region r from begin[r] to begin[r + 1]; `numbers` are the regions asked for. `sign` is
    +1 where a flip changes a pixel and -1 where it changes it back, `closed` tells where nothing may be flipped. A
    region may not be flipped if its price times `unit` is `most` or more, or if it adds more than `most_changed`
    changes, or has more than `most_pixels`. `place` is that of a pixel in `share` (int64), which has room for the
    offsets `around`; `ahead` are those of them that a step of one pixel, one of `steps`, brings in. `seen` is twice as
    long as `share`, int32, and 0.
    """
    begun = share.size
    for k in range(numbers.size):
        first, end = begin[numbers[k]], begin[numbers[k] + 1]
        total = 0
        changed = 0
        free = end - first <= most_pixels
        for j in range(first, end):
            x = pixels[j]
            total += sign[x] * price[x]
            changed += sign[x]
            free = free and not closed[x]
        prices[k], changes[k] = total, changed
        near[k] = -1
        if not free or changed > most_changed or total * unit >= most:
            continue
        nearby = 0
        for j in range(first, end):
            x = place[pixels[j]]
            seen[begun + x] = k + 1
            new = around
            for i in range(steps.size):
                if seen[begun + x - steps[i]] == k + 1:
                    new = ahead[i]
                    break
            for offset in new:
                y = x + offset
                if seen[y] <= k:
                    seen[y] = k + 1
                    nearby += share[y]
        near[k] = nearby
