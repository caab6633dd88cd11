"""Connected regions by the kernel and by SciPy's graphs, against SciPy's labels."""

import itertools

import numpy as np
import pytest
from scipy import ndimage

from torchlinf.kernels import has_compiler, regions

PATHS = [
    pytest.param(regions.flood, marks=pytest.mark.skipif(not has_compiler(), reason="needs numba")),
    regions.by_graph,
]


@pytest.mark.parametrize("flood", PATHS)
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("sides", [(30,), (12, 17), (5, 6, 7)])
def test_regions_are_those_of_scipy(sides: tuple[int, ...], share: float, flood: object) -> None:
    rng, ndim = np.random.default_rng(len(sides)), len(sides)
    maps = np.pad((rng.random((3, *sides)) < share).astype(np.uint8), [(0, 0), *[(1, 1)] * ndim])
    steps = np.array([step for step in itertools.product((-1, 0, 1), repeat=ndim) if any(step)])
    offsets = steps @ np.array([np.prod(maps.shape[2 + axis :], dtype=int) for axis in range(ndim)])
    expected = [ndimage.label(one, np.ones((3,) * ndim)) for one in maps]
    flat = maps.reshape(3, -1).copy()
    pixels, begin, owner = flood(flat, offsets)  # type: ignore[operator]
    assert not flat.any()
    assert (np.diff(owner) >= 0).all()
    assert np.bincount(owner, minlength=3).tolist() == [count for _, count in expected]
    for i, n in enumerate(owner):
        region = pixels[begin[i] : begin[i + 1]]
        labels = expected[n][0].reshape(-1)
        assert region[0] == region.min()
        assert len(set(region.tolist())) == len(region) == (labels == labels[region[0]]).sum()
        assert (labels[region] == labels[region[0]]).all()
