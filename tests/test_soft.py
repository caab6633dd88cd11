"""Soft distance, field and complexity against the hard ones, finite differences and symmetries."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

import torchlinf
from torchlinf import shapes, soft_chessboard_distance, soft_complexity, soft_linf_field
from torchlinf.field import adjoint, erosions, weighted
from torchlinf.field import soft as soft_field
from torchlinf.measure import soft as soft_measure


@pytest.fixture(params=["compiled", "torch"])
def path(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == "torch":
        for module in (erosions, weighted, adjoint):
            monkeypatch.setattr(module, "usable", lambda x: False)
    return request.param


def generator(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def grey(*shape: int, seed: int = 0) -> Tensor:
    return torch.rand(*shape, generator=generator(seed), dtype=torch.float64)


def binary(*shape: int, seed: int = 0) -> Tensor:
    """Ragged masks, of which the second of each batch is empty."""
    mask = (grey(*shape, seed=seed) < 0.93).double()
    mask[1] = 0
    return mask


def random_shape(seed: int) -> Tensor:
    """One of five kinds of shape on 56 x 64 pixels, with seeded parameters."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[-28:28, -32:32]
    kind, angle = seed % 5, np.arctan2(y, x)
    if kind == 0:
        p, r = rng.uniform(1, 12), rng.uniform(12, 24)
        inside = abs(x / r) ** p + abs(y / r) ** p <= 1
    elif kind == 1:
        inside = np.hypot(x, y) < 17 * (1 + rng.uniform(0, 0.4) * np.cos(rng.integers(2, 9) * angle))
    elif kind == 2:
        t = rng.uniform(0, 1.5)
        u, v = x * np.cos(t) + y * np.sin(t), y * np.cos(t) - x * np.sin(t)
        inside = (abs(u) < rng.uniform(8, 20)) & (abs(v) < rng.uniform(8, 18))
    elif kind == 3:
        inside = (abs(x) < 16) & (abs(y) < 16)
        inside |= (abs(y) < rng.integers(2, 14)) & (x < rng.integers(16, 30)) & (x > 0)
        inside |= (abs(x) < rng.integers(2, 14)) & (y > -rng.integers(16, 27)) & (y < 0)
    else:
        inside = (abs(x) < 18) & (abs(y) < 15)
        for _ in range(rng.integers(1, 30)):
            edge = np.argwhere(inside[1:-1, 1:-1] & ~np.roll(inside, rng.choice([-1, 1]), rng.integers(2))[1:-1, 1:-1])
            i, j = edge[rng.integers(len(edge))]
            inside[max(i - 1, 0) : i + 3, max(j - 1, 0) : j + 3] = rng.random() < 0.5
    return torch.from_numpy(inside)


@pytest.mark.parametrize("spatial", [(19,), (11, 14), (6, 7, 8), (4, 5, 4, 3)])
def test_on_binary_masks_the_soft_distance_and_field_are_the_hard_ones(path: str, spatial: tuple[int, ...]) -> None:
    mask = binary(3, 2, *spatial)
    distance = soft_chessboard_distance(mask)
    assert distance.dtype == torch.float64
    assert torch.equal(distance, torchlinf.chessboard_distance(mask).double())
    torch.testing.assert_close(soft_linf_field(mask), torchlinf.linf_field(mask), rtol=1e-8, atol=0)


def test_the_soft_distance_is_the_mean_over_thresholds(path: str) -> None:
    probability = (grey(2, 1, 13, 17) * 8).round() / 8
    hard = torch.stack([torchlinf.chessboard_distance(probability > t) for t in (torch.arange(8) + 0.5) / 8])
    torch.testing.assert_close(soft_chessboard_distance(probability), hard.double().mean(0))


def test_slices_at_its_greys_make_the_soft_field_the_mean_over_thresholds(path: str) -> None:
    probability = (0.9 * grey(2, 1, 13, 17).sqrt() * 4).round() / 4
    levels = [torchlinf.solve_field(probability > t).value for t in (0.125, 0.375, 0.625, 0.875)]
    mean = torch.stack(levels).mean(0)
    expected = mean / mean.amax(dim=(2, 3), keepdim=True)
    torch.testing.assert_close(soft_linf_field(probability, slices=4), expected, rtol=1e-7, atol=1e-9)


def test_gradcheck_of_the_distance(path: str) -> None:
    for spatial in [(9,), (6, 7), (4, 5, 4)]:
        probability = grey(2, 1, *spatial, seed=3).requires_grad_()
        assert gradcheck(soft_chessboard_distance, probability, eps=1e-8, atol=1e-6, rtol=1e-6)


@pytest.mark.parametrize("slices", [1, 3])
def test_gradcheck_of_the_field(path: str, slices: int) -> None:
    probability = (0.5 + 0.4 * grey(2, 1, 6, 7, seed=1)).requires_grad_()
    rho = torch.tensor([[2.3], [3.1]], dtype=torch.float64, requires_grad=True)

    def field(probability: Tensor, rho: Tensor) -> Tensor:
        return soft_linf_field(probability, rho=rho, slices=slices, tol=1e-13)

    assert gradcheck(field, (probability, rho), eps=1e-7, atol=1e-6, rtol=1e-6, fast_mode=True)


@pytest.mark.parametrize("options", [{}, {"slices": 3}, {"estimator": "std"}, {"low": 0.1, "high": 0.6}])
def test_gradcheck_of_the_complexity(path: str, options: dict[str, float]) -> None:
    probability = (0.2 + 0.7 * grey(2, 1, 8, 7, seed=4)).requires_grad_()

    def value(probability: Tensor) -> Tensor:
        return soft_complexity(probability, bandwidth=0.05, tol=1e-13, **options)

    (gradient,) = torch.autograd.grad(value(probability).sum(), probability)
    assert gradient.abs().max() > 1e-2
    assert gradcheck(value, probability, eps=1e-6, atol=1e-6, rtol=1e-5, fast_mode=True)


def direct_entropy(values: Tensor, bandwidth: float) -> Tensor:
    """The similarity entropy of equally weighted values, pair by pair."""
    r = (values[:, None] - values).abs() / bandwidth
    return -((1 + r) * torch.exp(-r)).mean(dim=1).log2().mean()


@pytest.mark.parametrize("bandwidth", [1 / 4096, 1 / 256, 0.1])
def test_the_running_sums_are_the_sums_over_all_pairs(bandwidth: float) -> None:
    mask = torch.stack([random_shape(1), random_shape(8)])
    field = torchlinf.linf_field(mask, spatial_ndim=2)
    distance = torchlinf.chessboard_distance(mask, spatial_ndim=2)
    for i in range(2):
        levels = [direct_entropy(field[i][distance[i] == k], bandwidth) for k in range(1, int(distance[i].max()) + 1)]
        found = soft_complexity(mask.double(), bandwidth=bandwidth, spatial_ndim=2)[i]
        torch.testing.assert_close(found, torch.stack(levels).mean(), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("estimator", "least"), [("entropy", 0.95), ("std", 0.99)])
def test_soft_and_hard_rank_shapes_alike(estimator: str, least: float) -> None:
    masks = torch.stack([random_shape(seed) for seed in range(200)])
    hard = torchlinf.complexity(masks, estimator=estimator, spatial_ndim=2)
    soft = soft_complexity(masks.double(), estimator=estimator, spatial_ndim=2)
    assert hard.unique().numel() > 150
    ranks = torch.stack([hard.argsort().argsort(), soft.argsort().argsort()]).double()
    assert torch.corrcoef(ranks)[0, 1] >= least


def test_a_narrow_bandwidth_leads_to_the_hard_value_from_below() -> None:
    disc = shapes.disc(40).double()
    hard = torchlinf.complexity(disc, spatial_ndim=2)
    soft = [soft_complexity(disc, bandwidth=h / 1024, spatial_ndim=2) for h in (16, 4, 1, 0.25)]
    assert soft[0] < soft[1] < soft[2] < soft[3]
    assert 0.97 < soft[3] / hard < 1.03


@pytest.mark.parametrize("estimator", ["entropy", "std"])
def test_simple_shapes_have_none(estimator: str) -> None:
    masks = torch.zeros(4, 40, 50)
    masks[0, 3:30, 5:45] = 1
    masks[1] = 1
    masks[2, 2:22, 2:22] = masks[2, 12:32, 12:32] = 1
    masks[3] = 0.5 * masks[0]
    assert soft_complexity(masks, estimator=estimator, spatial_ndim=2).abs().max() < 1e-3


@pytest.mark.parametrize("slices", [1, 4])
@pytest.mark.parametrize("estimator", ["entropy", "std"])
def test_no_nan_anywhere(path: str, slices: int, estimator: str) -> None:
    batch = torch.zeros(7, 1, 9, 12)
    batch[1] = 1
    batch[2, 0, 4, 5] = 1
    batch[3] = 0.5
    batch[4] = torch.sigmoid(40 * grey(9, 12).float() - 20)
    batch[5, 0, :, ::2] = 1e-20
    batch[6, 0, :5] = (grey(5, 12) > 0.4).float()
    batch.requires_grad_()
    value = soft_complexity(batch, slices=slices, estimator=estimator)
    value.sum().backward()
    assert value.shape == (7, 1)
    assert value.isfinite().all()
    assert batch.grad is not None
    assert batch.grad.isfinite().all()
    assert value[0] == 0
    assert batch.grad[0].abs().max() == 0
    assert batch.grad[6].abs().max() > 0


def turned(function: Callable[[Tensor], Tensor], probability: Tensor, dims: tuple[int, ...] | str) -> Tensor:
    def turn(x: Tensor) -> Tensor:
        return x.mT if isinstance(dims, str) else x.flip(dims)

    leaf = turn(probability).clone().requires_grad_()
    return turn(torch.autograd.grad(function(leaf).sum(), leaf)[0])


@pytest.mark.parametrize("dims", [(2,), (3,), (2, 3), "swap"])
def test_gradients_turn_with_the_mask(path: str, dims: tuple[int, ...] | str) -> None:
    """On shapes that are nearly symmetric, where most neighbours tie; a blurred one too."""
    body = shapes.with_appendages((13, 13), [shapes.Appendage("right", 5, 4), shapes.Appendage("top", 3, 2)], margin=2)
    blurred = torch.nn.functional.avg_pool2d(body.double()[None, None], 3, 1, 1)
    probability = torch.cat([body.double()[None, None], blurred])
    straight = turned(soft_complexity, probability, ())
    assert straight[0].abs().max() > 1e-3
    assert straight[1].abs().max() > 1e-3
    torch.testing.assert_close(turned(soft_complexity, probability, dims), straight, rtol=1e-5, atol=1e-6)


def test_the_same_bits_every_time_and_the_same_value_in_every_batch(path: str) -> None:
    probability = torch.cat([grey(2, 1, 14, 11), binary(3, 1, 14, 11)])

    def gradient(part: Tensor) -> Tensor:
        leaf = part.clone().requires_grad_()
        return torch.autograd.grad(soft_complexity(leaf).sum(), leaf)[0]

    assert torch.equal(gradient(probability), gradient(probability))
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(1 if before > 1 else 3)
        other = gradient(probability)
    finally:
        torch.set_num_threads(before)
    assert torch.equal(other, gradient(probability))
    torch.testing.assert_close(gradient(probability[1:3]), gradient(probability)[1:3], rtol=1e-4, atol=1e-6)


def test_the_paths_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    probability = grey(2, 1, 15, 12)

    def result() -> tuple[Tensor, Tensor]:
        leaf = probability.clone().requires_grad_()
        value = soft_complexity(leaf, slices=2, tol=1e-12)
        return value.detach(), torch.autograd.grad(value.sum(), leaf)[0]

    compiled = result()
    for module in (erosions, weighted, adjoint):
        monkeypatch.setattr(module, "usable", lambda x: False)
    torch.testing.assert_close(result(), compiled, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64])
def test_dtypes_stay(dtype: torch.dtype) -> None:
    mask = binary(2, 1, 9, 8).to(dtype).requires_grad_()
    value = soft_complexity(mask)
    value.sum().backward()
    assert value.dtype == dtype
    assert mask.grad is not None
    assert mask.grad.dtype == dtype
    assert soft_linf_field(mask).dtype == soft_chessboard_distance(mask).dtype == dtype
    assert value[0] == soft_complexity(mask.detach().double()).to(dtype)[0]


def test_under_autocast() -> None:
    layer = torch.nn.Conv2d(1, 1, 3, padding=1)
    torch.nn.init.dirac_(layer.weight)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        logits = layer(8 * binary(2, 1, 9, 8).float() - 4)
        assert logits.dtype == torch.bfloat16
        value = soft_complexity(torch.sigmoid(logits))
    value.sum().backward()
    assert layer.weight.grad is not None
    assert layer.weight.grad.isfinite().all()
    assert layer.weight.grad.any()


def test_memory_of_the_distance_does_not_grow_with_the_radius(path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is kept for the backward pass is one tensor, and at any time some 2 sqrt(K) erosions are there."""
    saved: list[int] = []
    with torch.autograd.graph.saved_tensors_hooks(lambda x: saved.append(x.numel()) or x, lambda x: x):  # type: ignore[func-returns-value]
        soft_chessboard_distance(torch.ones(1, 1, 81, 90, requires_grad=True))
    assert sum(saved) <= 2 * 81 * 90


def test_reversed_iterates_are_all_of_them() -> None:
    for count in range(30):
        assert list(erosions._reversed_iterates(0, lambda k: k + 1, count)) == list(reversed(range(count)))


@pytest.mark.parametrize("function", [soft_chessboard_distance, soft_linf_field, soft_complexity])
def test_arguments_are_checked(function: Callable[..., Tensor]) -> None:
    with pytest.raises(TypeError, match=r"Pass mask.float\(\)"):
        function(torch.ones(1, 1, 3, 4, dtype=torch.bool))
    with pytest.raises(TypeError, match="got ndarray"):
        function(np.ones((1, 1, 3, 4)))
    with pytest.raises(ValueError, match=r"in \[0, 1\]; got values from -1 to 2"):
        function(torch.tensor([[[-1.0, 2.0]]]))
    with pytest.raises(ValueError, match="probability must lie"):
        function(torch.full((1, 1, 3), torch.nan))
    with pytest.raises(ValueError, match="spatial_ndim"):
        function(torch.ones(3, 4))
    assert function(torch.ones(0, 2, 3, 4)).numel() == 0


@pytest.mark.parametrize("function", [soft_chessboard_distance, soft_linf_field, soft_complexity])
def test_what_does_not_work_says_so(function: Callable[..., Tensor]) -> None:
    probability = grey(2, 1, 6, 5)
    with pytest.raises(NotImplementedError, match="Stack shapes"):
        torch.func.vmap(lambda x: function(x, spatial_ndim=2))(probability)
    with pytest.raises(NotImplementedError, match=r"torch.autograd.grad for a derivative"):
        torch.func.grad(lambda x: function(x).sum())(probability)
    leaf = probability.requires_grad_()
    (first,) = torch.autograd.grad(function(leaf).square().sum(), leaf, create_graph=True)
    with pytest.raises(RuntimeError, match="can be differentiated once"):
        first.sum().backward()


def test_options_are_checked() -> None:
    mask = torch.ones(1, 1, 3, 4)
    with pytest.raises(ValueError, match="bandwidth"):
        soft_complexity(mask, bandwidth=0.0)
    with pytest.raises(ValueError, match="slices"):
        soft_complexity(mask, slices=0)
    with pytest.raises(ValueError, match="estimator"):
        soft_complexity(mask, estimator="variance")
    with pytest.raises(ValueError, match="low"):
        soft_complexity(mask, low=0.5, high=0.5)
    with pytest.raises(ValueError, match="rho"):
        soft_linf_field(mask, rho=torch.tensor(-1.0))


@pytest.mark.parametrize("slices", [1, 3])
def test_complexity_by_groups_of_shapes(slices: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Groups bound the memory and change nothing, nor does solving only once for forward and backward."""
    probability = grey(3, 2, 11, 9)
    rho = torch.tensor([[2.0], [3.0], [5.0]], dtype=torch.float64)
    solves: list[int] = []
    solve = soft_field.solve_weighted
    monkeypatch.setattr(soft_field, "solve_weighted", lambda *given: solves.append(1) or solve(*given))
    found = []
    for pixels in (1 << 16, 4 * 99, 1):
        monkeypatch.setattr(soft_measure, "GROUP_PIXELS", pixels)
        leaves = [x.clone().requires_grad_() for x in (probability, rho)]
        solves.clear()
        value = torchlinf.soft_complexity(leaves[0], rho=leaves[1], slices=slices)
        found.append((value.detach(), *torch.autograd.grad(value.sum(), leaves)))
        assert len(solves) == slices * math.ceil(6 / max(1, pixels // 99))
    assert all(part.abs().max() > 1e-3 for part in found[0])
    for other in found[1:]:
        torch.testing.assert_close(found[0][0], other[0], rtol=1e-9, atol=1e-12)
        for one, two in zip(found[0][1:], other[1:], strict=True):  # running sums over a group round by its length
            torch.testing.assert_close(one, two, rtol=1e-4, atol=1e-6)
    step = 1e-4
    up, down = (torchlinf.soft_complexity(probability, rho=rho + e, slices=slices).sum() for e in (step, -step))
    torch.testing.assert_close(found[0][2].sum(), (up - down) / (2 * step), rtol=1e-4, atol=1e-7)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # torch.compile warns of its own doing where a graph breaks
@pytest.mark.parametrize("function", [soft_chessboard_distance, soft_linf_field, soft_complexity])
def test_compiled_on_inputs_of_any_strides(function: Callable[..., Tensor]) -> None:
    """With graph breaks: how often the mask is eroded depends on its values."""
    for order in ((0, 1, 2, 3), (0, 2, 3, 1), (1, 0, 3, 2)):  # contiguous, channels last, permuted
        torch.compiler.reset()
        compiled = torch.compile(function, backend="aot_eager")
        found = []
        for call in (function, compiled):
            back = [order.index(axis) for axis in range(4)]
            leaf = grey(2, 3, 9, 12).permute(order).contiguous().permute(back).requires_grad_()
            value = call(leaf)
            (slope,) = torch.autograd.grad(value.square().sum(), leaf)
            found.append((value.detach(), slope))
        torch.testing.assert_close(found[1], found[0], rtol=1e-9, atol=1e-9)
