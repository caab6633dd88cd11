"""Bounding boxes of masks, and the largest value of each shape of a batch."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor


def bounding_box(mask: NDArray[np.bool_]) -> tuple[slice, ...]:
    """The smallest box that holds the inside of a mask, one slice an axis; slices of length 0 if nothing is inside.

    >>> bounding_box(np.array([[False, False, False], [False, True, True]]))
    (slice(1, 2, None), slice(1, 3, None))
    """
    box = []
    for axis in range(mask.ndim):
        hit = np.flatnonzero(mask.any(axis=tuple(other for other in range(mask.ndim) if other != axis)))
        box.append(slice(int(hit[0]), int(hit[-1]) + 1) if hit.size else slice(0, 0))
    return tuple(box)


def maxima(x: Tensor) -> Tensor:
    """The largest value of each shape of (N, *spatial), without a derivative; on the CPU without OpenMP's threads.

    >>> maxima(torch.tensor([[[1, 5], [2, 0]]]))
    tensor([5])
    """
    if x.device.type != "cpu":
        return x.detach().flatten(1).amax(dim=1)
    return torch.from_numpy(x.numpy(force=True).max(axis=tuple(range(1, x.ndim))))
