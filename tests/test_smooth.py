"""Sweeps with momentum against the same in NumPy and SciPy, in float64 and float32."""

import numpy as np
import pytest
import torch
from scipy import ndimage

from torchlinf.field import Layout, System, pose
from torchlinf.field.smooth import smooth


def swept(v: np.ndarray, mask: np.ndarray, s: float) -> np.ndarray:
    above = ndimage.maximum_filter(v, 3, mode="constant")
    below = ndimage.minimum_filter(v, 3, mode="constant")
    return np.where(mask, (above + below + 1) / (2 + s), 0)


def expected(v: np.ndarray, mask: np.ndarray, s: float, sweeps: int, momentum: bool) -> np.ndarray:
    radius = ndimage.distance_transform_cdt(np.pad(mask, 1), "chessboard").max()
    r = min(1, np.sqrt(s + (np.pi / (2 * radius)) ** 2))
    before = v
    for number in range(sweeps):
        v = swept(v, mask, s)
        if momentum and number % 2 == 1 and number + 2 < sweeps:
            pair = (number + 1) // 2
            before, v = v, v + min((1 - r) / (1 + r), (pair - 1) / (pair + 2)) * (v - before)
    return v


@pytest.mark.parametrize("momentum", [False, True])
@pytest.mark.parametrize("sweeps", [0, 1, 2, 3, 4, 9, 24])
def test_sweeps_are_those_of_the_definition(sweeps: int, momentum: bool) -> None:
    random = np.random.default_rng(sweeps)
    masks = np.stack([ndimage.gaussian_filter(random.normal(size=(31, 44)), 3) > level for level in (-0.05, 0.0)])
    masks[1, 3:8, 3:20] = True
    start = np.where(masks, random.uniform(1, 9, size=masks.shape), 0)
    problem = pose(torch.from_numpy(masks), torch.tensor([30.0, 7.0]), (2,))
    layout = Layout(problem.mask)
    inside = layout.rows(layout.pack(problem.mask.double()))
    system = System(layout, inside, problem.screening[:, None], problem.radius.long())
    for real, rtol in ((torch.float64, 1e-12), (torch.float32, 1e-5)):
        chosen = system if real == torch.float64 else system.float()
        line = smooth(chosen, layout.pack(torch.from_numpy(start).to(real)), sweeps, momentum=momentum)
        found = layout.unpack(layout.rows(line)).numpy()
        assert found.dtype == (np.float64 if real == torch.float64 else np.float32)
        for one, v, mask, rho in zip(found, start, masks, (30.0, 7.0), strict=True):
            np.testing.assert_allclose(one, expected(v, mask, rho**-2, sweeps, momentum), rtol=rtol)
