"""What counts as equal must not stall a solve: on large shapes that is above the tolerance; here on a small one."""

import numpy as np
import pytest
import torch
from scipy import ndimage

from torchlinf import solve_field
from torchlinf.field import batched_policy_iteration, solve_locally, solve_shape
from torchlinf.kernels import has_compiler

LIMIT = 1e-3  # share of the largest value, in place of 1e-11


def blobs() -> torch.Tensor:
    noise = np.random.default_rng(4).normal(size=(150, 190))
    return torch.from_numpy(ndimage.gaussian_filter(noise, 6) > -0.01)


def test_the_batched_method_does_not_stall(monkeypatch: pytest.MonkeyPatch) -> None:
    mask = blobs()
    exact = solve_field(mask, method="batched", spatial_ndim=2)
    monkeypatch.setattr(batched_policy_iteration, "TIE", LIMIT)
    found = solve_field(mask, method="batched", spatial_ndim=2)
    assert found.num_solves <= 3 * exact.num_solves
    assert found.error_bound <= 1e-9
    torch.testing.assert_close(found.value, exact.value, rtol=2e-9, atol=0)


@pytest.mark.skipif(not has_compiler(), reason="needs numba")
def test_weights_do_not_stall(monkeypatch: pytest.MonkeyPatch) -> None:
    from torchlinf.field import weighted_policy_iteration

    mask = blobs()
    weight = torch.stack([mask / (2 + rho**-2) for rho in (25.0, 60.0)]).double()
    exact = weighted_policy_iteration.solve_compiled(weight, 1e-9)
    monkeypatch.setattr(weighted_policy_iteration, "TIE", LIMIT)
    found = weighted_policy_iteration.solve_compiled(weight, 1e-9)
    assert (found.num_sweeps <= 2 * exact.num_sweeps).all()
    assert (found.error_bound <= 1e-9).all()
    torch.testing.assert_close(found.value, exact.value, rtol=2e-9, atol=0)


@pytest.mark.skipif(not has_compiler(), reason="needs numba")
def test_flips_are_solved_locally(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where that stalls, the flip is left to a solve of the whole shape."""
    from torchlinf.field import local_solve

    monkeypatch.setattr(local_solve, "TIE", LIMIT)
    mask = blobs().numpy()
    field = solve_locally(solve_shape(mask, 25.0, 1e-9, lambda: None), 25.0, 1e-9)
    index = np.arange(152 * 192, dtype=np.int32).reshape(152, 192)[1:-1, 1:-1]
    for y, x in np.random.default_rng(1).integers((150, 190), size=(20, 2)):
        assert field.apply(index[y : y + 4, x : x + 4].ravel(), lambda: None).solved
        field.undo()
