"""Shapes on a device that is not the CPU: what makes a trip to the host, and how often the host waits for it.

There is no such device where these tests run. `fake_device` stands in for one.
"""

from collections.abc import Iterator
from typing import Any

import pytest
import torch
from fake_device import DEVICE, FakeDevice
from problems import random_batch
from torch import Tensor

import torchlinf
from torchlinf import complexity, complexity_map, complexity_profile, linf_field, shapes, solve_field
from torchlinf._helpers import transfer
from torchlinf.field import Problem, Status, methods, pose, solve
from torchlinf.losses import ShapeComplexityLoss, gradient, shape_loss


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeDevice]:
    """A device that copies by itself, as CUDA does."""
    # Torch does not run an operator of ours on tensors that only look like its own.
    monkeypatch.setattr(shape_loss, "region_flip_gradient", gradient.region_flip_gradient._init_fn)
    with FakeDevice() as fake:
        monkeypatch.setattr(transfer, "copies_by_itself", lambda device: device.type == DEVICE.type)
        monkeypatch.setattr(transfer, "page_locked", fake.page_locked)
        monkeypatch.setattr(transfer, "wait_for", lambda device: fake.waits.append("wait_for"))
        yield fake


@pytest.fixture
def masks() -> Tensor:
    found = random_batch(5, 6, (17, 24)).reshape(2, 3, 17, 24)
    found[0, 1] = False
    found[1, 0] = True
    return found


def test_the_stand_in_counts_what_has_to_be_waited_for(device: FakeDevice) -> None:
    x = device.put(torch.tensor([1.0, 0.0, 2.0]))
    assert x.device == DEVICE
    y = (x * 2 + torch.zeros(3, device=DEVICE)).sum()
    assert device.waits == []
    for number, read in enumerate(
        [
            lambda: bool(y > 0),
            y.item,
            lambda: y.cpu().numpy(),
            x.tolist,
            lambda: x[x > 0],
            x.nonzero,
            lambda: torch.ones(3).to(DEVICE),
            lambda: torch.tensor([1.0], device=DEVICE),
        ],
        start=1,
    ):
        read()
        assert len(device.waits) == number, device.waits
    with pytest.raises(TypeError, match="can't convert"):
        x.numpy()
    with pytest.raises(AssertionError, match="of the CPU beside"):
        x + torch.ones(3)
    assert x.cpu().tolist() == [1, 0, 2]
    assert y.cpu() == 6


@pytest.mark.parametrize("rho", [None, 3.0])
def test_a_field_makes_one_trip(device: FakeDevice, masks: Tensor, rho: float | None) -> None:
    expected = solve_field(masks, rho=rho, method="compiled")
    there = device.put(masks)
    found = solve_field(there, rho=rho, method="compiled", throw=False)
    assert device.waits == ["wait_for"]
    for name in ("value", "error_bound", "num_sweeps", "num_solves", "status"):
        one = getattr(found, name)
        assert one.device == DEVICE
        assert torch.equal(one.cpu(), getattr(expected, name)), name


def test_a_failure_is_named(device: FakeDevice, masks: Tensor) -> None:
    with pytest.raises(RuntimeError, match=r"\(0, 0\): MAX_SWEEPS"):
        solve_field(device.put(masks), method="compiled", max_sweeps=1)


def test_a_field_in_float32_has_a_larger_bound(device: FakeDevice, masks: Tensor) -> None:
    """As on a device without float64."""
    one = masks[:, 2]
    problem = pose(device.put(one), None, (2,))
    found = solve(
        Problem(problem.mask, problem.distance, problem.radius, problem.screening.float()),
        (2,),
        tol=1e-9,
        method="compiled",
    )
    exact = solve_field(one, tol=1e-13, spatial_ndim=2).value
    value, bound = found.value.cpu(), found.error_bound.cpu()
    assert (value.dtype, bound.dtype) == (torch.float32, torch.float32)
    apart = ((value.double() - exact).abs() / exact.clamp(min=1e-300)).flatten(1).amax(dim=1)
    assert (apart > 1e-9).all()  # rounded to float32, and the bound says so
    assert (apart <= bound.double()).all()
    assert (found.status.cpu() == Status.CONVERGED).all()


@pytest.mark.parametrize(
    "options",
    [{}, {"estimator": "std", "high": 0.5}, {"rho": 3.0, "levels": "rim"}, {"orientation": 20.0}, {"per": "object"}],
)
def test_complexity_waits_once(device: FakeDevice, masks: Tensor, options: dict[str, Any]) -> None:
    there = device.put(masks)
    found = complexity(there, method="compiled", **options)
    assert device.waits == ["wait_for"]
    assert found.device == DEVICE
    torch.testing.assert_close(found.cpu(), complexity(masks, **options), rtol=0, atol=0, equal_nan=True)


@pytest.mark.parametrize("dtype", [None, torch.float32])
def test_profiles_and_maps_wait_once(device: FakeDevice, masks: Tensor, dtype: torch.dtype | None) -> None:
    there = device.put(masks)
    profile = complexity_profile(there, scales=[0.3, 1.0], method="compiled", dtype=dtype)
    share = complexity_map(there, method="compiled", dtype=dtype)
    assert device.waits == ["wait_for", "wait_for"]
    expected = complexity_profile(masks, scales=[0.3, 1.0], dtype=dtype)
    for name in ("scales", "values", "radius", "field_error_bound", "level_values", "level_error_bound"):
        one = getattr(profile, name)
        assert one.device == DEVICE
        torch.testing.assert_close(one.cpu(), getattr(expected, name), rtol=0, atol=0, equal_nan=True)
    torch.testing.assert_close(share.cpu(), complexity_map(masks, dtype=dtype), rtol=0, atol=0, equal_nan=True)
    assert (share.device, share.dtype) == (DEVICE, dtype or torch.float64)


def test_a_profile_on_a_device_can_be_averaged_there(device: FakeDevice, masks: Tensor) -> None:
    profile = complexity_profile(device.put(masks), method="compiled")
    found = profile.mean(0.2, 0.7)
    assert found.device == DEVICE
    expected = complexity(masks, low=0.2, high=0.7)
    torch.testing.assert_close(found.cpu(), expected, rtol=0, atol=0, equal_nan=True)


def test_without_a_measurement_auto_stays_on_the_device(device: FakeDevice, masks: Tensor) -> None:
    assert methods.STAYS["cuda"] == ((float("inf"), 1),)
    masks = masks[:1]
    found = solve_field(device.put(masks), method="auto")
    expected = solve_field(masks, method=methods.automatic(pose(device.put(masks[0]), None, (3,))))
    assert torch.equal(found.value.cpu(), expected.value)
    assert torch.equal(found.num_sweeps.cpu(), expected.num_sweeps)
    assert (expected.num_sweeps != solve_field(masks, method="compiled").num_sweeps).any()


@pytest.mark.parametrize(
    ("count", "side", "trip"),
    [(1, 10, True), (2, 10, False), (2, 11, True), (5, 20, True), (6, 20, False), (6, 21, True), (60, 21, True)],
)
def test_the_table_chooses_for_auto(
    device: FakeDevice, monkeypatch: pytest.MonkeyPatch, count: int, side: int, trip: bool
) -> None:
    monkeypatch.setitem(methods.STAYS, DEVICE.type, ((100, 2), (400, 6), (float("inf"), float("inf"))))
    there = torch.ones(count, side, side, dtype=torch.bool, device=DEVICE)
    assert methods.uses_kernels(there, "auto") is trip
    assert (methods.automatic(pose(there, None, (count,))) == "compiled") is trip
    assert methods.automatic(pose(there, None, (count,), compile=True)) != "compiled"
    assert methods.uses_kernels(there, "compiled")
    assert not methods.uses_kernels(there, "accelerated")
    device.waits.clear()
    complexity(there, spatial_ndim=2)
    assert (device.waits == ["wait_for"]) is trip


def test_an_empty_batch_is_solved_anywhere(device: FakeDevice) -> None:
    none = device.put(torch.zeros(0, 2, 5, 6))
    assert solve_field(none, method="compiled").value.shape == (0, 2, 5, 6)
    assert complexity(none, method="compiled").shape == (0, 2)
    assert linf_field(none).shape == (0, 2, 5, 6)


def test_without_numba_compiled_is_refused(device: FakeDevice, monkeypatch: pytest.MonkeyPatch, masks: Tensor) -> None:
    monkeypatch.setattr(methods, "has_compiler", lambda: False)
    there = device.put(masks)
    for call in (solve_field, complexity, complexity_profile, complexity_map):
        with pytest.raises(ImportError, match="numba"):
            call(there, method="compiled")
    assert not methods.uses_kernels(there, "auto")


BUMPED = shapes.with_appendages((9, 12), [shapes.Appendage("right", 3, 2)], margin=3)  # H != W


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"weight": (0.5, 0.2), "keep_area": False},
        {"activation": "softmax", "include_background": False, "reduction": "sum"},
        {"deformations": True},
        {"per": "object", "weight": (0.5, 0.2)},
        {"orientation": 30.0, "activation": "sigmoid"},
        {"orientation": "mean", "rotations": 2, "per": "object", "keep_area": False},
    ],
)
def test_the_loss_waits_once(device: FakeDevice, options: dict[str, Any], masked: bool) -> None:
    generator = torch.Generator().manual_seed(3)
    logits = torch.where(torch.stack([BUMPED, BUMPED.flip(1)]), 0.9, 0.1) - 0.05 * torch.rand(
        2, 2, *BUMPED.shape, generator=generator
    )
    target = torch.ones_like(logits)
    target[0, 1] = 0
    mask = torch.rand(2, 1, *BUMPED.shape, generator=generator) > 0.1 if masked else None
    loss = ShapeComplexityLoss(max_flips=4, **options)
    here = logits.clone().requires_grad_()
    expected = loss(here, target, mask)
    (slope,) = torch.autograd.grad(expected, here)
    assert slope.abs().max() > 0
    there = [None if x is None else device.put(x) for x in (logits, target, mask)]
    there[0].requires_grad_()
    found = loss(*there)
    (of_found,) = torch.autograd.grad(found, there[0])
    assert device.waits == ["wait_for"]
    assert device.copies <= 4  # prediction and mask there, value and gradient back
    assert (found.device, of_found.device) == (DEVICE, DEVICE)
    torch.testing.assert_close(found.cpu(), expected.detach())
    torch.testing.assert_close(of_found.cpu(), slope)


def test_a_loss_without_a_gradient_waits_once_too(device: FakeDevice) -> None:
    there = device.put(torch.where(BUMPED, 0.9, 0.1)[None, None])
    for options in ({}, {"per": "object"}):
        device.waits.clear()
        with torch.no_grad():
            found = ShapeComplexityLoss(max_flips=2, **options)(there)
        assert device.waits == ["wait_for"]
        assert found.cpu().item() == pytest.approx(torchlinf.complexity(BUMPED, spatial_ndim=2).item(), abs=1e-6)


def test_a_device_without_page_locked_memory_gives_the_same(masks: Tensor) -> None:
    with FakeDevice() as fake:
        there = fake.put(masks)
        found = complexity(there, method="compiled")
        assert fake.waits == ["aten::_to_copy"] * 2  # there and back
        torch.testing.assert_close(found.cpu(), complexity(masks), rtol=0, atol=0, equal_nan=True)
        assert solve_field(there, method="compiled").value.device == DEVICE
