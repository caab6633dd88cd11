"""What is measured of predicted masks: overlap, boundary, and complexity, image by image."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, label
from torch import Tensor

import torchlinf

NEAR = 2  # pixels within which two boundaries meet
EIGHT = np.ones((3, 3), bool)
MIN_PIXELS = 16  # of an object whose complexity counts
COMPLEXITIES = {
    "object, own frame": {"per": "object", "orientation": "own", "min_pixels": MIN_PIXELS},
    "object, grid": {"per": "object", "min_pixels": MIN_PIXELS},
    "mask, own frame": {"orientation": "own"},
    "mask, grid": {},
}
Values = dict[str, list[float]]


ALL = ("IoU", "boundary F", *COMPLEXITIES, "objects")


def measured(masks: Tensor, truth: Tensor, names: tuple[str, ...] = ALL) -> Values:
    """A list of one number an image for every measure; NaN where an image has none.

    Args:
        masks: (N, 1, H, W) bool.
        truth: like masks.
        names: the measures.
    """
    return {name: [round(value, 5) for value in _one(name, masks, truth)] for name in names}


def _one(name: str, masks: Tensor, truth: Tensor) -> list[float]:
    if name == "IoU":
        return ((masks & truth).sum((1, 2, 3)) / (masks | truth).sum((1, 2, 3)).clamp(min=1)).tolist()
    if name == "boundary F":
        return [boundary_f(a, b) for a, b in zip(masks[:, 0].numpy(), truth[:, 0].numpy(), strict=True)]
    if name == "objects":
        return [float(label(mask, EIGHT)[1]) for mask in masks[:, 0].numpy()]
    return complexity(name, masks)


def complexity(name: str, masks: Tensor) -> list[float]:
    """Complexity in bits, per mask or per object, on the grid or in own frames."""
    return torchlinf.complexity(masks, **COMPLEXITIES[name])[:, 0].tolist()


def boundary_f(mask: NDArray[np.bool_], truth: NDArray[np.bool_]) -> float:
    """F-score of boundary pixels, which count as found within `NEAR` pixels (chessboard distance)."""
    if not mask.any() or not truth.any():
        return float(mask.any() == truth.any())
    edges = [inside & ~binary_erosion(inside, border_value=1) for inside in (mask, truth)]
    near = [binary_dilation(edge, EIGHT, iterations=NEAR) for edge in edges]
    precision = (edges[0] & near[1]).sum() / max(edges[0].sum(), 1)
    recall = (edges[1] & near[0]).sum() / max(edges[1].sum(), 1)
    return float(2 * precision * recall / max(precision + recall, 1e-12))
