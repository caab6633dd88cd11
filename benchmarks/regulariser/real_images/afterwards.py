"""What can be done with finished predictions, without any training."""

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_opening, label
from torch import Tensor

import torchlinf

MARGIN = 8  # around a mask, so that its border is no side of it


def opened_and_closed(masks: Tensor, side: int) -> Tensor:
    """An opening, then a closing, by a square."""
    block = np.ones((side, side), bool)

    def one(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        padded = np.pad(mask, MARGIN, mode="edge")
        done = binary_closing(binary_opening(padded, block), block)
        return done[MARGIN:-MARGIN, MARGIN:-MARGIN]

    return torch.from_numpy(np.stack([one(mask) for mask in masks[:, 0].numpy()]))[:, None]


def regularised(masks: Tensor, tolerance: float) -> Tensor:
    """Outlines by buildingregulariser, drawn as masks again; its lengths are in pixels."""
    import geopandas
    import shapely
    from buildingregulariser import regularize_geodataframe

    rows, columns = np.indices(masks.shape[2:]) + 0.5

    def one(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        numbers, count = label(mask, np.ones((3, 3)))
        outlines = [shapely.union_all(_runs(numbers == i)) for i in range(1, count + 1)]
        if not outlines:
            return mask
        frame = geopandas.GeoDataFrame(geometry=outlines, crs="EPSG:32633")
        done = regularize_geodataframe(
            frame, parallel_threshold=2 * tolerance, simplify_tolerance=tolerance, num_cores=1
        )
        return shapely.contains_xy(shapely.union_all(done.geometry.make_valid()), columns, rows)

    return torch.from_numpy(np.stack([one(mask) for mask in masks[:, 0].numpy()]))[:, None]


def _runs(mask: NDArray[np.bool_]) -> list[object]:
    """Boxes, one for each run of pixels in a row."""
    import shapely

    steps = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    begins, ends = np.argwhere(steps == 1), np.argwhere(steps == -1)
    return [shapely.box(b, row, e, row + 1) for (row, b), (_, e) in zip(begins, ends, strict=True)]


def simplified(logits: Tensor, weight: float, *, keep_topology: bool = False, orientation: str | None = None) -> Tensor:
    """`torchlinf.simplify`, each object alone."""
    return torchlinf.simplify(
        torch.sigmoid(logits), weight=weight, keep_topology=keep_topology, orientation=orientation
    ).mask
