"""Batches of shapes through the compiled kernels, several at a time; imported only where these are usable."""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from torchlinf._kernels import distance, grid, histograms
from torchlinf._parallel import for_each

ESTIMATORS = {"entropy": histograms.entropies, "std": histograms.deviations}


def compiled_distance(mask: Tensor) -> Tensor:
    """Chessboard distance of bool (N, *spatial); int32 like it."""
    masks = mask.numpy()
    found = np.zeros(masks.shape, np.int32)

    def measure(i: int, _: Callable[[], None]) -> None:
        box = grid.crop(masks[i])
        geometry = grid.make_grid(grid.pad(masks[i][box]))
        found[i][box] = distance.chessboard_of(geometry).reshape(geometry.shape)[grid.interior(masks.ndim - 1)]

    for_each(measure, len(masks))
    return torch.from_numpy(found)


def compiled_level_values(
    field: Tensor, distance: Tensor, radius: Tensor, estimator: str, bins: int, slack: float
) -> Tensor:
    """What `torchlinf.entropy.level_values` describes, shape by shape."""
    fields, distances = field.flatten(1).numpy(), distance.flatten(1).numpy()
    stops = radius.cumsum(0).tolist()
    found = np.zeros(stops[-1] if stops else 0, fields.dtype)

    def measure(i: int, _: Callable[[], None]) -> None:
        levels = int(radius[i])
        if levels:
            values, begin = histograms.sort_by_level(fields[i], distances[i], levels)
            found[stops[i] - levels : stops[i]] = ESTIMATORS[estimator](values, begin, bins, slack)

    for_each(measure, len(fields))
    return torch.from_numpy(found)
