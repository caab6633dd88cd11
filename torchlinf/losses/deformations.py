"""Deformations of a whole shape, and the correction that they make to the finite-difference gradient.

A region flip changes one region. A rotation or the rounding of all corners changes a sliver along every side at once;
it is no region flip, and the gradient under region flips predicts its effect hardly better than chance. So the shape is
deformed as a whole, backwards and forwards, and the gradient is corrected: as little as it takes for its slope along
each deformation to be the difference of the complexities.
"""

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, ndimage

from torchlinf._helpers.boxes import bounding_box

REACHES = (1.5, 3.0)  # pixels that the outermost points move; one distance alone feels the pixel grid more
SMOOTH = 0.7  # pixels of Gaussian smoothing of the signed distance, whose staircases would move as steps
CLEAR = 1e-9  # signed distance that is inside for certain, so that rounding does not tell flipped shapes apart
STEADY = 0.5  # share of the ups and downs along a deformation that has to remain from one end to the other

Reals = NDArray[np.float64]


def deformed(shape: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The shape under each deformation: (M, 4, *spatial) bool, from most backwards to most forwards.

    With u the position from the centre of the bounding box, as a share of half its longest side, the deformations are
    all linear ones, of velocity A u (scale, and for each pair of axes stretch, shear and rotation), and one that moves
    the boundary along its normal by sum_i e_i^4 - 3 / (n + 2), e = u / |u|: the smoothest function of the direction
    that treats all axes alike and is not constant. It leads from a diamond to a square. Deformations
    that would take more than half of the shape away are left out. An empty shape has none.

    Example:
        >>> deformed(np.arange(20) > 7)[0].sum(axis=1)  # 12 pixels scaled, outwards as far as the array goes
        array([ 8, 10, 14, 16])
    """
    n, ring = shape.ndim, int(max(REACHES)) + 1
    if not shape.any():
        return np.empty((0, 2 * len(REACHES), *shape.shape), bool)
    padded = np.pad(shape, ring)
    level = ndimage.distance_transform_edt(padded) - ndimage.distance_transform_edt(~padded)
    level = ndimage.gaussian_filter(level, SMOOTH, mode="nearest")
    box = bounding_box(padded)
    half = max(side.stop - side.start for side in box) / 2
    centre = np.array([(side.start + side.stop - 1) / 2 for side in box]).reshape(-1, *[1] * n)
    u = (np.indices(padded.shape) - centre) / half
    within = (slice(ring, -ring),) * n
    lines = []
    for levels in itertools.chain(_linear(level, u, centre, half), _fourth_order(level, u)):
        line = np.stack([moved[within] > CLEAR for moved in levels])
        if line.reshape(len(line), -1).sum(axis=1).min() >= shape.sum() / 2:
            lines.append(line)
    return np.array(lines, bool).reshape(-1, 2 * len(REACHES), *shape.shape)


def _steps() -> list[float]:
    return [-reach for reach in reversed(REACHES)] + list(REACHES)


def _linear(level: Reals, u: Reals, centre: Reals, half: float) -> Iterator[list[Reals]]:
    """The signed distance, carried along by each linear velocity."""
    n = len(u)
    matrices = [np.eye(n)]
    for i, j in itertools.combinations(range(n), 2):
        stretch, shear, rotation = np.zeros((3, n, n))
        stretch[i, i], stretch[j, j] = 1, -1
        shear[i, j] = shear[j, i] = rotation[i, j] = 1
        rotation[j, i] = -1
        matrices += [stretch, shear, rotation]
    for matrix in matrices:
        sources = [centre + half * np.tensordot(linalg.expm(-step / half * matrix), u, 1) for step in _steps()]
        yield [ndimage.map_coordinates(level, source, order=1, mode="nearest") for source in sources]


def _fourth_order(level: Reals, u: Reals) -> Iterator[list[Reals]]:
    """The signed distance, raised on the diagonals and lowered on the axes."""
    n = len(u)
    if n > 1:
        square = (u**2).sum(axis=0)
        speed = (u**4).sum(axis=0) / np.maximum(square**2, np.finfo(float).tiny) - 3 / (n + 2)
        yield [level - step * speed / (1 - 3 / (n + 2)) for step in _steps()]


def correct(gradient: Reals, before: float, lines: NDArray[np.bool_], values: Reals) -> Reals:
    """The gradient closest to the given one whose slope along each steady deformation is its difference.

    Args:
        gradient: (*spatial) or flat, under region flips.
        before: complexity of the shape.
        lines: (M, 4, *spatial), the deformed shapes that `deformed` gives.
        values: (M, 4), their complexities.

    A deformation is steady if the change from one end to the other is more than half of all ups and downs on the way.
    Where the shape is rough, all deformations make it worse both ways, and their differences mean nothing.

    Example:
        >>> lines = np.array([[[0, 1, 0, 0], [0, 1, 0, 0], [0, 1, 1, 0], [0, 1, 1, 1]]], bool)
        >>> correct(np.zeros(4), 2.0, lines, np.array([[2.0, 2.0, 3.0, 5.0]]))  # 2 G_2 + G_3 = 3 - 2 + 5 - 2
        array([0. , 0. , 1.6, 0.8])
    """
    count = values.shape[1] // 2
    whole = np.insert(values, count, before, axis=1)
    steady = np.abs(whole[:, -1] - whole[:, 0]) > STEADY * np.abs(np.diff(whole)).sum(axis=1)
    maps = lines[steady].reshape(-1, 2 * count, gradient.size).astype(float)
    rows = maps[:, count:].sum(axis=1) - maps[:, :count].sum(axis=1)
    gain = values[steady, count:].sum(axis=1) - values[steady, :count].sum(axis=1)
    size = np.maximum(np.linalg.norm(rows, axis=1), 1)
    rows = rows / size[:, None]
    share = np.linalg.lstsq(rows @ rows.T, gain / size - rows @ gradient.ravel(), rcond=1e-6)[0]
    return gradient + (share @ rows).reshape(gradient.shape)
