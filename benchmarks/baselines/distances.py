"""Distance transforms of other libraries, those that are installed."""

import importlib.util
from collections.abc import Callable

import numpy as np
from scipy import ndimage
from torch import Tensor

Transform = Callable[[Tensor], object]


def transforms(mask: Tensor) -> dict[str, Callable[[], object]]:
    """Calls that measure the distance of one mask `(*spatial)`, by name; the mask has an outside ring already.

    Each library is given its own input type, prepared beforehand.
    """
    array = mask.numpy()
    calls: dict[str, Callable[[], object]] = {
        "scipy": lambda: ndimage.distance_transform_cdt(array, metric="chessboard")
    }
    if mask.ndim == 2 and importlib.util.find_spec("cv2"):
        import cv2

        bytes_ = array.astype(np.uint8)
        calls["opencv"] = lambda: cv2.distanceTransform(bytes_, cv2.DIST_C, 3)
    if mask.ndim == 2 and importlib.util.find_spec("kornia"):
        from kornia.contrib import distance_transform

        # Kornia measures the distance of zeros to the nearest nonzero, Euclidean and approximately.
        outside = (~mask).float()[None, None]
        calls["kornia"] = lambda: distance_transform(outside)
    return calls
