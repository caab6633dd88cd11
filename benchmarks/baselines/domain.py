"""A shape as all baselines of the field see it: cropped, with a ring of outside pixels, and its screening."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Domain:
    """A shape in its box.

    Attributes:
        inside: bool, one outside pixel on every side.
        distance: chessboard distance, like `inside`.
        radius: D.
        screening: s = 1 / D^2.
        box: where the box without its ring lies in the mask that it was made from.
    """

    inside: NDArray[np.bool_]
    distance: NDArray[np.int32]
    radius: int
    screening: float
    box: tuple[slice, ...]

    @classmethod
    def of(cls, mask: Tensor) -> "Domain":
        """Crop, pad and measure a mask `(*spatial)`."""
        array = mask.numpy()
        box = ndimage.find_objects(array.astype(np.uint8))[0]
        inside = np.pad(array[box], 1)
        distance = ndimage.distance_transform_cdt(inside, metric="chessboard")
        radius = int(distance.max())
        return cls(inside, distance, radius, 1 / radius**2, box)

    def like_mask(self, v: Array, shape: tuple[int, ...]) -> Array:
        """The values of the box, in an array of the mask's shape, 0 elsewhere."""
        full = np.zeros(shape)
        full[self.box] = v[(slice(1, -1),) * v.ndim]
        return full


def bound(above: float, below: float) -> float:
    """Relative error bound from the largest positive and negative residual; see docs/method, "The certificate"."""
    return max(above, below) if above < 1 else np.inf
