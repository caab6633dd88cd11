"""Whether a set of pixels can be flipped without a change of topology: pixel by pixel, each flip being simple."""

import numpy as np

from torchlinf.kernels.compiler import kernel


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
