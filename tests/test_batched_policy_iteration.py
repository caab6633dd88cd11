"""The batched method where its linear solves fail, on devices without float64, and in any batch."""

import problems
import pytest
import torch
from torch.overrides import TorchFunctionMode

from torchlinf import Status, shapes, solve_field
from torchlinf.field import batched_policy_iteration, pose
from torchlinf.field.batched_policy_iteration import solve_batched
from torchlinf.field.certificate import RESOLUTION
from torchlinf.field.problem import Problem


def masks() -> torch.Tensor:
    """Random shapes, one of them large and nearly full, one a slab with slots in two components."""
    found = problems.random_batch(26, 6, (38, 51))
    found[0] = torch.rand(38, 51, generator=torch.Generator().manual_seed(0)) < 0.99
    found[1] = False
    found[1, 2:36, 3:30] = found[1, 5:30, 33:48] = True
    found[1, 9:30, 11], found[1, 12, 33:40] = False, False
    return found


class WithoutFloat64(TorchFunctionMode):
    """Fails where a call makes a tensor in float64."""

    def __torch_function__(self, func, types, args=(), kwargs=None):  # type: ignore[no-untyped-def]
        made = func(*args, **(kwargs or {}))
        assert not isinstance(made, torch.Tensor) or made.dtype != torch.float64, func
        return made


def test_where_linear_solves_fail_sweeps_converge(monkeypatch: pytest.MonkeyPatch) -> None:
    given = masks()
    expected = solve_field(given, tol=1e-11, method="accelerated", spatial_ndim=2)
    asked = []

    def nothing(pixels: batched_policy_iteration.Pixels, *_: object) -> torch.Tensor:
        asked.append(1)
        return torch.full_like(pixels.place, torch.nan, dtype=torch.float64)

    monkeypatch.setattr(batched_policy_iteration, "solve_policies", nothing)
    found = solve_field(given, method="batched", spatial_ndim=2)
    assert asked
    assert (found.status == Status.CONVERGED).all()
    torch.testing.assert_close(found.value, expected.value, rtol=2e-9, atol=0)


def test_float32_is_certified_as_far_as_it_goes() -> None:
    """As on devices without float64, where nothing may be of that dtype."""
    given = masks()
    problem = pose(given, None, (len(given),))
    exact = solve_field(given, tol=1e-11, method="accelerated", spatial_ndim=2).value
    single = Problem(given, problem.distance, problem.radius, problem.screening.float())
    with WithoutFloat64():
        found = solve_batched(single, 1e-9, None)
    assert found.value.dtype == found.error_bound.dtype == torch.float32
    assert (found.status == Status.CONVERGED).all()
    floor = RESOLUTION * torch.finfo(torch.float32).eps * found.value.flatten(1).amax(dim=1)
    assert (found.error_bound <= floor).all()
    error = torch.where(given, (found.value.double() - exact).abs() / exact, 0).flatten(1).amax(dim=1)
    assert (error <= found.error_bound + 1e-6).all()


@pytest.mark.parametrize("max_sweeps", [None, 1, 27, 60])
def test_a_shape_has_the_same_bits_in_every_batch(max_sweeps: int | None) -> None:
    given = torch.cat([masks(), torch.nn.functional.pad(shapes.disc(15), (3, 17, 0, 7))[None]])
    given[3] = False
    options = {"method": "batched", "max_sweeps": max_sweeps, "throw": False, "spatial_ndim": 2}
    rho = torch.tensor([3.0, 40, 1e4, 7, 0.3, 20, 1e6])
    together = solve_field(given, rho=rho, **options)
    for order in ([6, 0, 3, 1, 5, 2, 4], [0], [6, 1]):
        found = solve_field(given[order], rho=rho[order], **options)
        for name in found.__dataclass_fields__:
            assert torch.equal(getattr(found, name), getattr(together, name)[order]), name
    if max_sweeps is not None:
        assert (together.num_sweeps <= max_sweeps).all()
