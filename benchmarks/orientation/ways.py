"""Ways of turning a mask; all but the library's sample it on the turned grid."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates

from torchlinf._helpers.boxes import bounding_box
from torchlinf.kernels.outlines import draw, polygons, sides
from torchlinf.measure import turned
from torchlinf.measure.frames import centred_grid

Mask = NDArray[np.bool_]
Way = Callable[[Mask, float], Mask]


def sampled(order: int = 1, over: int = 1, centred: bool = False, smooth: float = 0.0) -> Way:
    """Interpolation of an order, at the middles of the pixels or over x over points in each, cut at one half.

    centred: the grid has the middle of the box around the turned middles of the pixels, which for most angles is within
        a tenth of a pixel of the true one; otherwise its middle is that of the mask's array.
    smooth: if positive, the signed distance smoothed by so many pixels is sampled instead, and cut at 0.
    """

    def way(mask: Mask, degrees: float) -> Mask:
        cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        rotation = np.array([[cos, -sin], [sin, cos]])
        middles = np.argwhere(mask) @ rotation.T
        low, high = middles.min(axis=0), middles.max(axis=0)
        if centred:
            begin, size = centred_grid(low, high)
        else:
            centre = rotation @ ((np.array(mask.shape) - 1) / 2)
            below = np.ceil(centre - low).astype(int) + 1
            begin = centre - below - 0.5
            size = (below + np.ceil(high - centre).astype(int) + 2).tolist()
        values, border = mask.astype(float), 0.5
        if smooth > 0:
            far = np.pad(mask, 4)
            values = gaussian_filter(distance_transform_edt(far) - distance_transform_edt(~far), smooth)[4:-4, 4:-4]
            border = 0.0
        offsets = (np.arange(over) + 0.5) / over - 0.5
        found = np.zeros([n + 4 for n in size])
        for di in offsets:
            for dj in offsets:
                places = [
                    begin[0] + np.arange(-2, size[0] + 2) + 0.5 + di,
                    begin[1] + np.arange(-2, size[1] + 2) + 0.5 + dj,
                ]
                points = np.stack(np.meshgrid(*places, indexing="ij"), -1) @ rotation
                beyond = -4.0 if smooth > 0 else 0.0
                found += map_coordinates(
                    values, points.reshape(-1, 2).T, order=order, mode="grid-constant", cval=beyond
                ).reshape(found.shape)
        inside = found / over**2 > border - 1e-9
        return np.ascontiguousarray(inside[bounding_box(inside)])

    return way


def outline(axes: bool = True, phase: float | None = None) -> Way:
    """The library's way with a part left out.

    axes: sides that may lie along an axis do.
    phase: if given, the grid is moved by so many pixels off its centred place.
    """

    def way(mask: Mask, degrees: float) -> Mask:
        points, begin = polygons(*sides(np.pad(mask, 1)), math.radians(degrees), 1e-6 if axes else -9.0)
        low, size = centred_grid(points.min(axis=0), points.max(axis=0))
        if phase is not None:
            low, size = low - 1 + phase, [n + 2 for n in size]
        found = draw(points - low, begin, *size)
        return np.ascontiguousarray(found[bounding_box(found)])

    return way


WAYS: dict[str, Way] = {
    "nearest pixel": sampled(order=0),
    "linear": sampled(),
    "cubic": sampled(order=3),
    "majority of 3 x 3": sampled(order=0, over=3),
    "majority of 5 x 5": sampled(order=0, over=5),
    "majority of 9 x 9 (area)": sampled(order=0, over=9),
    "signed distance, smoothed by 1": sampled(smooth=1.0),
    "linear, grid centred": sampled(centred=True),
    "cubic, grid centred": sampled(order=3, centred=True),
    "majority of 5 x 5, grid centred": sampled(order=0, over=5, centred=True),
    "outline, no side put along an axis": outline(axes=False),
    "outline, grid 0.37 pixels off": outline(phase=0.37),
    "outline (turned)": turned,
}
