"""Whether a set of pixels can be flipped without a change of topology, pixel by pixel, each flip being simple.

And whether that has cut a slit, or drawn a spike, which topology allows.
"""

import numpy as np

from torchlinf.kernels.compiler import inlined, kernel

DEEP = 2  # times its width that a notch may be deep, or a bump high, which was not there before


def simple_neighbourhoods() -> np.ndarray:
    """(256,) bool: whether the flip of a pixel is simple, by its eight neighbours, bit k for the k-th around it.

    Inside is connected through faces and corners, outside through faces. The flip is simple where exactly one connected
    part of the outside among the neighbours touches the pixel through a face, which is the number of Yokoi.
    """
    bits = (np.arange(256)[:, None] >> np.arange(8)) & 1
    outside = 1 - bits
    following, second = np.roll(outside, -1, axis=1), np.roll(outside, -2, axis=1)
    number = (outside - outside * following * second)[:, ::2].sum(axis=1)
    return number == 1


@kernel
def flip_simply(mask, pixels, around, simple, waiting):  # type: ignore[no-untyped-def]
    """Flip the pixels of a flat padded mask (uint8) if simple flips one after another lead there, else none.

    Returns whether they are flipped. `around` are the offsets of the neighbours: of two in 1-D, or of eight in 2-D, in
    their order around a pixel, beginning with one beyond a face. `waiting` is scratch.
    """
    left = pixels.size
    for k in range(left):
        waiting[k] = pixels[k]
    while True:
        kept = 0
        for k in range(left):
            x = waiting[k]
            bits = 0
            for i in range(around.size):
                bits |= int(mask[x + around[i]]) << i
            if (bits == 1 or bits == 2) if around.size == 2 else simple[bits]:
                mask[x] = 1 - mask[x]
            else:
                waiting[kept] = x
                kept += 1
        if kept == 0:
            return True
        if kept == left:
            break
        left = kept
    for x in pixels:  # those still waiting were not flipped
        mask[x] = 1 - mask[x]
    for k in range(left):
        mask[waiting[k]] = 1 - mask[waiting[k]]
    return False


@kernel
def has_slit(mask, before, pixels, around, strides):  # type: ignore[no-untyped-def]
    """Whether there is a new slit or spike at some of these pixels: more than `DEEP` times as deep as it is wide.

    A slit is made of pixels that all were inside before, a spike of pixels that all were outside: run beside run, each
    of which ends at the other kind. `mask` and `before` are flat, padded and 2-D (uint8), of these `strides`; `around`
    are the offsets of the neighbours of a pixel, whose runs a flip may have made, or cut.
    """
    for pixel in pixels:
        for k in range(around.size + 1):
            x = pixel if k == around.size else pixel + around[k]
            if mask[x] != before[x] and (
                _is_in_slit(mask, before, x, strides[0], strides[1])
                or _is_in_slit(mask, before, x, strides[1], strides[0])
            ):
                return True
    return False


@kernel
def _is_in_slit(mask, before, x, along, across):  # type: ignore[no-untyped-def]
    """Whether a pixel is in a slit or spike whose runs go along one axis."""
    first, last = _new_run(mask, before, x, along)
    if first < 0:
        return False
    rows, total = 1, (last - first) // along + 1
    for side in (across, -across):
        here, there = first, last
        while rows * rows <= DEEP * total:
            beside, end = -1, -1
            for y in range(here + side - along, there + side + along + 1, along):
                if mask[y] == mask[x]:
                    beside, end = _new_run(mask, before, y, along)
                    if beside >= 0:
                        break
            if beside < 0:
                break
            here, there = beside, end
            rows += 1
            total += (there - here) // along + 1
    return rows * rows > DEEP * total


@inlined
def _new_run(mask, before, x, along):  # type: ignore[no-untyped-def]
    """The first and last pixel of the run through a pixel, -1 if some of it was there before."""
    kind = mask[x]
    first, last = x, x
    while mask[first] == kind and before[first] != kind:
        first -= along
    while mask[last] == kind and before[last] != kind:
        last += along
    if first == x or mask[first] == kind or mask[last] == kind:
        return -1, -1
    return first + along, last - along
