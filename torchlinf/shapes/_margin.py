"""Outside pixels around a shape, which every function of the package offers.

Shapes are drawn by NumPy, which starts no threads of OpenMP: a forked child would wait for them without end.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.checks import integer


def with_margin(shape: NDArray[np.bool_], margin: int) -> Tensor:
    """Return the shape as a tensor, with `margin` outside pixels on every side."""
    return torch.from_numpy(np.pad(shape, integer(margin, "margin", 0)))
