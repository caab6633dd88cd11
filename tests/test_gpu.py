"""What needs a GPU: on CUDA everything gives what it gives on the CPU. `make test-gpu` runs these."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from problems import random_batch
from torch import Tensor

import torchlinf
from torchlinf import complexity, complexity_map, complexity_profile, linf_field, shapes, solve_field
from torchlinf.field import METHODS, cuda_graphs
from torchlinf.labels import complexity_table
from torchlinf.losses import ShapeComplexityLoss
from torchlinf.metrics import ShapeComplexity

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no CUDA device"),
]
CUDA = torch.device("cuda", 0)


def batch(*sizes: int) -> Tensor:
    """Random shapes, one of them empty and one full."""
    found = random_batch(len(sizes), 6, sizes).reshape(2, 3, *sizes)
    found[0, 1] = False
    found[1, 0] = True
    return found


def prediction() -> Tensor:
    """Logits of shapes with an appendage, near the threshold at some pixels."""
    shape = shapes.with_appendages((17, 24), [shapes.Appendage("right", 5, 3)], margin=4)
    noise = torch.rand(2, 2, *shape.shape, generator=torch.Generator().manual_seed(1))
    return torch.where(torch.stack([shape, shape.flip(1)]), 2.0, -2.0) - noise


@pytest.mark.parametrize("sizes", [(70,), (34, 45), (9, 12, 10), (5, 6, 5, 4)])
@pytest.mark.parametrize("method", ["auto", *METHODS])
def test_fields(method: str, sizes: tuple[int, ...]) -> None:
    masks = batch(*sizes)
    for rho in (None, 4.0):
        expected = solve_field(masks, rho=rho, method="compiled")
        found = solve_field(masks.to(CUDA), rho=rho, method=method)
        assert found.value.device == CUDA
        assert (found.error_bound <= 1e-9).all()
        assert torch.equal(found.status.cpu(), expected.status)
        torch.testing.assert_close(found.value.cpu(), expected.value, rtol=2.1e-9, atol=0)


def test_sweeps_run_as_captured_graphs(monkeypatch: pytest.MonkeyPatch) -> None:
    captures = []

    def captured(steps: Callable[[], None]) -> Callable[[], None]:
        captures.append(steps)
        return original(steps)

    original = cuda_graphs.captured
    monkeypatch.setattr(cuda_graphs, "captured", captured)
    masks = torch.stack([shapes.disc(30), shapes.disc(30).roll(9, 0)])
    found = solve_field(masks.to(CUDA), method="accelerated", spatial_ndim=2)
    assert captures
    expected = solve_field(masks, method="compiled", spatial_ndim=2)
    torch.testing.assert_close(found.value.cpu(), expected.value, rtol=2.1e-9, atol=0)


def test_fused_sweeps() -> None:
    masks = batch(34, 45)
    found = solve_field(masks.to(CUDA), compile=True)
    torch.testing.assert_close(found.value.cpu(), solve_field(masks).value, rtol=2.1e-9, atol=0)


@pytest.mark.parametrize("sizes", [(70,), (34, 45), (9, 12, 10)])
def test_distance(sizes: tuple[int, ...]) -> None:
    masks = batch(*sizes)
    assert torch.equal(torchlinf.chessboard_distance(masks.to(CUDA)).cpu(), torchlinf.chessboard_distance(masks))


@pytest.mark.parametrize("method", ["auto", "compiled", "accelerated"])
@pytest.mark.parametrize("options", [{}, {"estimator": "std"}, {"levels": "rim", "rho": 3.0}, {"bins": 64, "low": 0.3}])
def test_complexity(method: str, options: dict[str, Any]) -> None:
    masks = batch(34, 45)
    there = masks.to(CUDA)
    expected = complexity(masks, **options)
    found = complexity(there, method=method, **options)
    assert found.device == CUDA
    torch.testing.assert_close(found.cpu(), expected, rtol=0, atol=1e-9, equal_nan=True)
    low = options.pop("low", 0.0)
    profile = complexity_profile(there, method=method, **options)
    torch.testing.assert_close(profile.mean(low, 1.0).cpu(), expected, rtol=0, atol=1e-9, equal_nan=True)
    if "estimator" not in options:
        share = complexity_map(there, method=method, low=low, **options)
        torch.testing.assert_close(share.flatten(2).sum(2).cpu(), expected, rtol=0, atol=1e-9, equal_nan=True)


@pytest.mark.parametrize("options", [{"per": "object"}, {"orientation": 30.0}, {"orientation": "own", "per": "object"}])
def test_objects_and_frames(options: dict[str, Any]) -> None:
    masks = batch(34, 45)
    found = complexity(masks.to(CUDA), **options)
    assert found.device == CUDA
    torch.testing.assert_close(found.cpu(), complexity(masks, **options), rtol=0, atol=0, equal_nan=True)


def test_soft_functions_and_derivatives() -> None:
    grey = torch.rand(2, 1, 14, 19, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    for function in (torchlinf.soft_complexity, torchlinf.soft_linf_field, torchlinf.soft_chessboard_distance):
        gradients = []
        for device in ("cpu", CUDA):
            x = grey.to(device).requires_grad_()
            value = function(x)
            (gradient,) = torch.autograd.grad(value.sum(), x)
            gradients.append((value.detach().cpu(), gradient.cpu()))
        torch.testing.assert_close(*gradients, rtol=1e-6, atol=1e-8)
    slopes = []
    for device in ("cpu", CUDA):
        rho = torch.tensor([[3.0], [5.0]], dtype=torch.float64, device=device, requires_grad=True)
        slopes.append(torch.autograd.grad(linf_field((grey > 0.3).to(device), rho=rho).sum(), rho)[0].cpu())
    torch.testing.assert_close(*slopes, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize(
    "options",
    [{}, {"weight": (0.5, 0.2)}, {"deformations": True}, {"per": "object"}, {"orientation": "own", "keep_area": False}],
)
def test_the_loss_waits_for_the_device_no_oftener_than_for_its_trip(options: dict[str, Any]) -> None:
    loss = ShapeComplexityLoss(activation="sigmoid", max_flips=4, **options)
    here = prediction().requires_grad_()
    expected = loss(here)
    expected.backward()
    there = prediction().to(CUDA).requires_grad_()
    # Torch raises on every copy and read that makes the host wait, other than the one wait that the trip asks for.
    torch.cuda.set_sync_debug_mode("error")
    try:
        found = loss(there)
        found.backward()
    finally:
        torch.cuda.set_sync_debug_mode("default")
    torch.testing.assert_close(found.cpu(), expected)
    torch.testing.assert_close(there.grad.cpu(), here.grad)


def test_the_loss_on_a_stream_of_its_own() -> None:
    """The trip waits for the work queued before it, and what follows waits for the copies back."""
    expected = prediction().requires_grad_()
    ShapeComplexityLoss(activation="sigmoid", max_flips=2)(expected).backward()
    logits, stream = prediction().to(CUDA), torch.cuda.Stream()
    stream.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(stream):
        for _ in range(10):
            slow = torch.rand(2000, 2000, device=CUDA)
            for _ in range(20):
                slow = slow @ slow / 1000
            leaf = (logits + 0 * slow.nan_to_num(0, 0, 0)[0, 0]).detach().requires_grad_()
            ShapeComplexityLoss(activation="sigmoid", max_flips=2)(leaf).backward()
            found = leaf.grad * 1.0
            leaf.grad.zero_()
    stream.synchronize()
    torch.testing.assert_close(found.cpu(), expected.grad)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_the_loss_under_autocast(dtype: torch.dtype) -> None:
    layer = torch.nn.Conv2d(2, 2, 1, device=CUDA)
    with torch.autocast("cuda", dtype=dtype):
        found = ShapeComplexityLoss(activation="sigmoid", max_flips=2)(layer(prediction().to(CUDA)))
    found.backward()
    assert found.dtype == torch.float32
    assert layer.weight.grad.isfinite().all()


def test_metric_simplification_and_labels() -> None:
    logits = prediction()
    here, there = ShapeComplexity(2, average="none"), ShapeComplexity(2, average="none").to(CUDA)
    here.update(logits > 0)
    there.update((logits > 0).to(CUDA))
    torch.testing.assert_close(there.compute().cpu(), here.compute())
    probability = torch.sigmoid(logits)
    found = torchlinf.simplify(probability.to(CUDA), max_flips=2)
    alone = torchlinf.simplify(probability, max_flips=2)
    assert found.mask.device == CUDA
    assert torch.equal(found.mask.cpu(), alone.mask)
    labels = torch.arange(1, 5).reshape(2, 2).repeat_interleave(8, 0).repeat_interleave(11, 1)
    expected = complexity_table(labels)
    for name, column in complexity_table(labels.to(CUDA)).items():
        if name != "seconds":
            assert np.array_equal(column, expected[name]), name
