"""ShapeComplexityLoss: its value is the hard complexity, its gradient moves boundaries."""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import torchlinf
from torchlinf import shapes
from torchlinf.losses import ShapeComplexityLoss
from torchlinf.losses.gradient import region_flip_gradient
from torchlinf.losses.region_flips import differences


def bumpy(margin: int = 4) -> Tensor:
    """A 14 x 18 box with two appendages, bool (25, 28) at margin 4."""
    appended = [shapes.Appendage("top", 4, 3, offset=2), shapes.Appendage("right", 5, 2, offset=6)]
    return shapes.with_appendages((14, 18), appended, margin=margin)


def batch() -> Tensor:
    """(2, 3, 25, 28) probabilities: bumpy shapes, one flipped, one grey, one empty, one full."""
    shape = bumpy().float()
    found = torch.stack([shape, shape.flip(1), 0.2 + 0.6 * shape, 0 * shape, 0 * shape + 1, shape.flip(0)])
    return found.reshape(2, 3, *shape.shape)


def gradient(loss: Callable[..., Tensor], probability: Tensor, *args: Tensor) -> Tensor:
    leaf = probability.detach().clone().requires_grad_()
    loss(leaf, *args).backward()
    assert leaf.grad is not None
    return leaf.grad


def test_the_value_is_the_hard_complexity() -> None:
    probability = batch()
    expected = torchlinf.complexity(probability > 0.5, low=0.0, high=0.6)
    found = ShapeComplexityLoss(high=0.6, reduction="none")(probability)
    there = ~expected.isnan()
    assert there.sum() == 5
    torch.testing.assert_close(found[there], expected[there].float())
    assert found[~there].tolist() == [10.0]


def test_reductions_and_weights() -> None:
    probability = batch()
    each = ShapeComplexityLoss(reduction="none")(probability)
    assert ShapeComplexityLoss()(probability).item() == pytest.approx(each.mean().item())
    assert ShapeComplexityLoss(reduction="sum")(probability).item() == pytest.approx(each.sum().item())
    weighted = ShapeComplexityLoss(weight=[0.0, 2.0, 0.5], reduction="none")(probability)
    torch.testing.assert_close(weighted, each * torch.tensor([0.0, 2.0, 0.5]))
    without = ShapeComplexityLoss(include_background=False, weight=[2.0, 0.5], reduction="none")(probability)
    torch.testing.assert_close(without, weighted[:, 1:])


def test_shapes_that_are_not_in_the_target_are_left_out() -> None:
    probability = batch()
    target = (probability > 0.5).long()
    target[0, 0] = 0
    each = ShapeComplexityLoss(reduction="none")(probability)
    found = ShapeComplexityLoss(reduction="none")(probability, target)
    assert found[0, 0] == found[1, 0] == 0
    assert ShapeComplexityLoss()(probability, target).item() == pytest.approx(found.sum().item() / 4)
    torch.testing.assert_close(found[:, 1:], each[:, 1:])
    slope = gradient(ShapeComplexityLoss(), probability, target)
    assert not slope[0, 0].any()
    assert slope[0, 1].any()
    nothing = ShapeComplexityLoss()(probability, torch.zeros_like(probability))
    assert nothing == 0


def test_descent_removes_the_appendages() -> None:
    shape = bumpy()
    slope = gradient(ShapeComplexityLoss(), shape[None, None].float())[0, 0]
    opened = torch.zeros_like(shape)
    opened[7:21, 4:22] = True
    assert bool((shape & ~opened).any())
    assert bool((slope[shape & ~opened] > 0).all())


def test_steps_along_the_gradient_lower_the_hard_complexity() -> None:
    shape = bumpy()
    logits = (4.0 * shape - 2.0)[None, None].requires_grad_()
    loss = ShapeComplexityLoss(activation="sigmoid", reduction="sum", keep_area=False)
    optimiser = torch.optim.Adam([logits], lr=0.3)
    before = loss(logits).item()
    for _ in range(12):
        optimiser.zero_grad()
        loss(logits).backward()
        optimiser.step()
    assert loss(logits).item() < 0.1 * before
    assert (logits > 0).sum() > 0.7 * shape.sum()


def test_an_empty_shape_is_never_rewarded() -> None:
    empty, tiny = torch.zeros(1, 1, 9, 8), torch.zeros(1, 1, 9, 8)
    tiny[..., 3, 2:4] = 0.7
    loss = ShapeComplexityLoss()
    assert loss(empty) > torchlinf.complexity(bumpy(), spatial_ndim=2)
    assert not gradient(loss, empty).any()
    # All flips that would leave less than half of it are left out: none pushes the two pixels out together.
    assert bool((gradient(loss, tiny).flatten(2).sum(dim=2) <= 0).all())


@pytest.mark.parametrize("activation", ["sigmoid", "softmax", torch.sigmoid])
def test_activations(activation: str | Callable[[Tensor], Tensor]) -> None:
    logits = 6 * batch() - 3
    probability = torch.softmax(logits, dim=1) if activation == "softmax" else torch.sigmoid(logits)
    expected = ShapeComplexityLoss(reduction="none")(probability)
    torch.testing.assert_close(ShapeComplexityLoss(activation=activation, reduction="none")(logits), expected)
    assert gradient(ShapeComplexityLoss(activation=activation), logits).any()


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float64])
def test_dtypes(dtype: torch.dtype) -> None:
    probability = batch()
    expected = gradient(ShapeComplexityLoss(), probability)
    found = gradient(ShapeComplexityLoss(), probability.to(dtype))
    assert found.dtype == dtype
    torch.testing.assert_close(found.float(), expected, rtol=0.02, atol=1e-4)
    loss = ShapeComplexityLoss()(probability.to(dtype))
    assert loss.dtype == (torch.float64 if dtype == torch.float64 else torch.float32)


def test_under_autocast() -> None:
    layer = torch.nn.Conv2d(3, 3, 3, padding=1)
    torch.nn.init.dirac_(layer.weight)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        logits = layer(8 * batch() - 4)
        assert logits.dtype == torch.bfloat16
        loss = ShapeComplexityLoss(activation="sigmoid")(logits)
    loss.backward()
    assert loss.dtype == torch.float32
    assert layer.weight.grad is not None
    assert bool(torch.isfinite(layer.weight.grad).all())
    assert layer.weight.grad.any()


def test_with_keep_area_a_common_shift_of_the_logits_is_worth_nothing() -> None:
    logits = 6 * batch() - 3
    free = gradient(ShapeComplexityLoss(activation="sigmoid", keep_area=False), logits)
    kept = gradient(ShapeComplexityLoss(activation="sigmoid"), logits)  # the default
    assert free.sum((2, 3)).abs().max() > 1e-3
    assert kept.sum((2, 3)).abs().max() < 1e-6
    assert kept.any()
    binary = (logits > 0).float()  # in doubt nowhere: there is nothing to balance with
    assert torch.equal(gradient(ShapeComplexityLoss(), binary), gradient(ShapeComplexityLoss(keep_area=False), binary))
    mask = torch.ones(2, 1, 25, 28, dtype=torch.bool)
    mask[..., 14:] = False
    half = gradient(lambda x: ShapeComplexityLoss(activation="sigmoid", keep_area=True)(x, None, mask), logits)
    assert not half[..., 14:].any()
    assert half.sum((2, 3)).abs().max() < 1e-6


def test_masked_pixels_get_no_gradient_and_keep_the_value() -> None:
    probability = batch()
    mask = torch.ones(2, 1, 25, 28, dtype=torch.bool)
    mask[..., :, 14:] = False
    loss = ShapeComplexityLoss(keep_area=False)
    torch.testing.assert_close(loss(probability, None, mask), loss(probability))
    slope = gradient(lambda p: loss(p, None, mask), probability)
    assert not slope[..., 14:].any()
    torch.testing.assert_close(slope[..., :14], gradient(loss, probability)[..., :14])


def test_the_batch_does_not_matter_and_runs_repeat() -> None:
    probability = batch()
    loss = ShapeComplexityLoss(reduction="sum")
    slope = gradient(loss, probability)
    assert torch.equal(slope, gradient(loss, probability))
    for b in range(2):
        assert torch.equal(slope[b : b + 1], gradient(loss, probability[b : b + 1]))


def test_the_number_of_threads_does_not_matter() -> None:
    probability = batch()
    before = torch.get_num_threads()
    try:
        slopes = []
        for threads in (1, 3):
            torch.set_num_threads(threads)
            slopes.append(gradient(ShapeComplexityLoss(), probability))
    finally:
        torch.set_num_threads(before)
    assert slopes[0].any()
    assert torch.equal(*slopes)


@pytest.mark.parametrize("keep_area", [False, True])
def test_gradients_turn_with_the_shapes(keep_area: bool) -> None:
    """The same choice of regions for flipped and swapped input, or descent would favour a direction."""
    loss = ShapeComplexityLoss(activation="sigmoid", keep_area=keep_area)
    logits = (6 * batch() - 3).double()
    straight = gradient(loss, logits)
    assert straight.abs().max() > 1e-4
    for dims in ((2,), (3,), (2, 3)):
        torch.testing.assert_close(gradient(loss, logits.flip(dims)).flip(dims), straight)
    torch.testing.assert_close(gradient(loss, logits.mT).mT, straight)


@pytest.mark.parametrize("keep_area", [False, True])
def test_no_nan_anywhere(keep_area: bool) -> None:
    probability = torch.zeros(2, 3, 9, 12)
    probability[0, 1] = 1
    probability[0, 2, 4, 5] = 1
    probability[1, 0] = 0.5
    probability[1, 1, 2:6] = 1
    probability[1, 2] = torch.rand(9, 12, generator=torch.Generator().manual_seed(0)).round()
    loss = ShapeComplexityLoss(keep_area=keep_area)
    assert torch.isfinite(loss(probability))
    slope = gradient(loss, probability)
    assert bool(torch.isfinite(slope).all())
    assert slope[1, 2].any()
    extreme = ShapeComplexityLoss(activation="sigmoid", keep_area=keep_area)
    assert bool(torch.isfinite(gradient(extreme, 2000 * probability - 1000)).all())


def test_a_mask_of_channels_beside_a_background_that_is_dropped() -> None:
    probability = batch()
    mask = torch.zeros(3, 25, 28, dtype=torch.bool)  # without the batch dimension
    mask[1] = True
    slope = gradient(lambda p: ShapeComplexityLoss(include_background=False)(p, None, mask), probability)
    assert slope[:, 1].any()
    assert not slope[:, [0, 2]].any()


def test_labels_to_be_ignored_become_a_mask() -> None:
    probability = batch()
    labels = torch.zeros(2, 25, 28, dtype=torch.long)
    labels[:, :6] = 255
    loss = ShapeComplexityLoss(keep_area=False)
    slope = gradient(lambda p: loss(p, None, (labels != 255)[:, None]), probability)
    assert not slope[:, :, :6].any()
    torch.testing.assert_close(slope[:, :, 6:], gradient(loss, probability)[:, :, 6:])


def test_second_derivatives_see_a_constant_gradient() -> None:
    leaf = batch().requires_grad_()
    (first,) = torch.autograd.grad(ShapeComplexityLoss()(leaf), leaf, create_graph=True)
    assert first.any()
    assert not first.requires_grad
    found = torch.func.grad(ShapeComplexityLoss())(leaf.detach())
    torch.testing.assert_close(found, first)


def test_strides_do_not_matter() -> None:
    probability = batch()
    expected = gradient(ShapeComplexityLoss(), probability)
    transposed = probability.permute(3, 2, 1, 0).contiguous().permute(3, 2, 1, 0)
    assert not transposed.is_contiguous()
    assert torch.equal(gradient(ShapeComplexityLoss(), transposed), expected)
    wide = ShapeComplexityLoss()(bumpy().float().expand(2, 3, -1, -1))
    assert wide.item() == pytest.approx(float(torchlinf.complexity(bumpy(), spatial_ndim=2)))


def cross(ndim: int) -> tuple[Tensor, Tensor]:
    """A cube (square, ...) of side 6 with a bar of side 2 and depth 2 on one face, and the pixels of the bar."""
    cube, bar = torch.zeros(2, *[12] * ndim, dtype=torch.bool)
    cube[(slice(2, 8),) * ndim] = True
    bar[(slice(8, 10), *[slice(4, 6)] * (ndim - 1))] = True
    return cube | bar, bar


@pytest.mark.parametrize("ndim", [2, 3, 4])
def test_descent_removes_a_bar_in_two_to_four_dimensions(ndim: int) -> None:
    shape, bar = cross(ndim)
    probability = shape[None, None].double()
    loss = ShapeComplexityLoss()
    assert loss(probability).item() == float(torchlinf.complexity(shape, spatial_ndim=ndim)) > 0.01
    slope = gradient(loss, probability)[0, 0]
    assert bool((slope[bar] > 0).all())


def test_a_line_and_five_dimensions() -> None:
    line = torch.tensor([0.9, 0.9, 0.1, 0.9, 0.9, 0.9, 0.9])[None, None]
    # Of segments of unlike length the complexity is not zero: the field is divided by the largest value of all.
    expected = torchlinf.complexity(line > 0.5)
    assert ShapeComplexityLoss()(line).item() == pytest.approx(float(expected))
    assert torch.isfinite(gradient(ShapeComplexityLoss(), line)).all()
    with pytest.raises(ValueError, match="1 to 4 spatial dimensions"):
        ShapeComplexityLoss()(torch.zeros(1, 1, 2, 2, 2, 2, 2))


OPTIONS: list[dict[str, Any]] = [
    {"low": 0.1, "high": 0.6},
    {"bins": 32},
    {"estimator": "std"},
    {"rho": 3.0},
    {"estimator": "std", "rho": 1.5, "tol": 1e-4, "high": 0.5},
]


@pytest.mark.parametrize("options", OPTIONS)
def test_the_options_of_the_measure_reach_value_and_gradient(options: dict[str, Any]) -> None:
    probability = batch().double()
    expected = torchlinf.complexity(probability > 0.5, **options)
    loss = ShapeComplexityLoss(reduction="none", **options)
    worst = 0.5 if options.get("estimator") == "std" else math.log2(options.get("bins", 1024))
    torch.testing.assert_close(loss(probability), expected.nan_to_num(worst), rtol=0, atol=0)
    assert not torch.equal(expected, torchlinf.complexity(probability > 0.5))
    assert loss.measure == torchlinf.Measure(**options)
    # The slope along the flip of an appendage, from the loss and from two complexities: the only region here.
    shape, bar = cross(2)
    region = [[bar.flatten().nonzero()[:, 0].numpy()]]
    change = differences(shape[None], region, loss.measure)[1][0][0]
    both = torchlinf.complexity(torch.stack([shape, shape & ~bar]), spatial_ndim=2, **options)
    assert change == float(both[1] - both[0])
    slope = gradient(ShapeComplexityLoss(**options), probability)
    assert not torch.allclose(slope, gradient(ShapeComplexityLoss(), probability))


def test_the_default_device_does_not_matter() -> None:
    """On the meta device any tensor that was made on the default device would have no values."""
    probability = batch()
    loss = ShapeComplexityLoss(weight=[0.3, 0.2, 0.1], deformations=True, max_flips=4)
    expected = loss(probability)
    with torch.device("meta"):
        found = ShapeComplexityLoss(weight=[0.3, 0.2, 0.1], deformations=True, max_flips=4)(probability)
    assert found == expected


def test_weights_of_every_kind() -> None:
    probability = batch()
    expected = ShapeComplexityLoss(weight=[0.0, 2.0, 0.5])(probability)
    for weight in ((0, 2, 0.5), torch.tensor([0.0, 2.0, 0.5]), np.array([0.0, 2.0, 0.5])):
        assert ShapeComplexityLoss(weight=weight)(probability) == expected
    loss = ShapeComplexityLoss(weight=torch.tensor(3.0))
    assert loss.weight == 3.0
    loss.half()  # of a model with the loss inside; the weight stays exact
    loss.weight = 0.06
    torch.testing.assert_close(loss(probability), 0.06 * ShapeComplexityLoss()(probability))
    with pytest.raises(ValueError, match="weight must be finite and 0 or more"):
        loss.weight = -1.0


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_low_precision_becomes_float32_before_the_activation(dtype: torch.dtype) -> None:
    """The sigmoid of a logit of 0.0001 is 1/2 in low precision, which is not above the threshold."""
    logits = torch.where(bumpy(), 1e-4, -1e-4)[None, None].to(dtype)
    assert bool((torch.sigmoid(logits) == 0.5).all())
    expected = torchlinf.complexity(bumpy(), spatial_ndim=2).float()
    for activation in ("sigmoid", torch.sigmoid):
        assert ShapeComplexityLoss(activation=activation)(logits) == expected
    pair = torch.cat([logits, 0 * logits], dim=1)
    assert ShapeComplexityLoss(activation="softmax", reduction="none")(pair)[0, 0] == expected


@pytest.mark.parametrize("activation", [None, "sigmoid", "softmax", torch.tanh])
def test_it_pickles(activation: Any) -> None:
    loss = ShapeComplexityLoss(activation=activation, weight=[1.0, 2.0, 0.5], high=0.5, estimator="std")
    again = pickle.loads(pickle.dumps(loss))
    assert repr(again) == repr(loss)
    assert "high=0.5" in repr(loss)
    assert again(batch().clamp(0, 0.9)) == loss(batch().clamp(0, 0.9))
    assert copy.deepcopy(loss)(batch().clamp(0, 0.9)) == loss(batch().clamp(0, 0.9))


@pytest.mark.parametrize("default", [torch.float16, torch.float64])
def test_the_default_dtype_does_not_matter(default: torch.dtype) -> None:
    probability = batch()
    loss = ShapeComplexityLoss(weight=[0.3, 0.2, 0.1], deformations=True, max_flips=4)
    expected, slope = loss(probability), gradient(loss, probability)
    before = torch.get_default_dtype()
    torch.set_default_dtype(default)
    try:
        found, other = loss(probability), gradient(loss, probability)
    finally:
        torch.set_default_dtype(before)
    assert found.dtype == torch.float32
    assert found == expected
    assert torch.equal(other, slope)


def test_softmax_of_one_channel_is_refused() -> None:
    with pytest.raises(ValueError, match='Pass "sigmoid"'):
        ShapeComplexityLoss(activation="softmax")(torch.zeros(2, 1, 5, 6))


def test_nan_stays_visible() -> None:
    probability = batch()
    probability[0, 1, 3, 3] = torch.nan
    found = ShapeComplexityLoss(reduction="none")(probability)
    assert found.isnan().nonzero().tolist() == [[0, 1]]


@pytest.mark.parametrize("options", [{}, *OPTIONS[2:], {"weight": [1.0, 0.5, 2.0], "keep_area": False}])
def test_compiled_without_a_graph_break(options: dict[str, Any]) -> None:
    torch.compiler.reset()  # the cases share one function, which may be compiled a few times only
    probability = batch()
    loss = ShapeComplexityLoss(activation="sigmoid", **options)
    compiled = torch.compile(loss, fullgraph=True, backend="aot_eager")
    logits = 8 * probability - 4
    torch.testing.assert_close(compiled(logits), loss(logits))
    torch.testing.assert_close(gradient(compiled, logits), gradient(loss, logits))


@pytest.mark.parametrize("rho", [None, 3.0])
def test_the_operator_keeps_its_promises(rho: float | None) -> None:
    torch.library.opcheck(
        region_flip_gradient,
        (batch().flatten(0, 1), 0.5, 4, False, 0.0, 1.0, 1024, "entropy", "distance", rho, 1e-9, 0.0),
    )


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"low": 0.5, "high": 0.5}, ValueError, "low < high"),
        ({"activation": "none"}, ValueError, "activation must be None, one of 'sigmoid', 'softmax', or a callable"),
        ({"activation": 3}, TypeError, "activation must be None"),
        ({"reduction": "max"}, ValueError, "reduction must be one of"),
        ({"low": "a"}, TypeError, "low must be a number"),
        ({"bins": 0}, ValueError, "bins must be"),
        ({"estimator": "mean"}, ValueError, "estimator must be one of"),
        ({"tol": 0.0}, ValueError, "tol must be"),
        ({"rho": torch.ones(2)}, TypeError, "rho must be None or one number"),
        ({"rho": -1.0}, ValueError, "rho must be"),
        ({"windows": {"fine": (0.0, 0.5)}}, TypeError, "windows is not an option here"),
        ({"max_moves": 3}, TypeError, "max_moves is not an option here"),
        ({"reduction": 3}, TypeError, "reduction must be one of"),
        ({"weight": -1.0}, ValueError, "weight must be"),
        ({"weight": [1.0, math.nan]}, ValueError, "weight must be"),
        ({"weight": [[1.0]]}, TypeError, "weight must be"),
        ({"weight": "heavy"}, TypeError, "weight must be"),
        ({"include_background": "no"}, TypeError, "include_background must be True or False"),
        ({"keep_area": 1}, TypeError, "keep_area must be True or False"),
        ({"deformations": None}, TypeError, "deformations must be True or False"),
        ({"max_flips": 2.0}, TypeError, "max_flips must be"),
        ({"threshold": 1.0}, ValueError, "threshold must lie"),
        ({"threshold": "half"}, TypeError, "threshold must be"),
        ({"max_flips": 0}, ValueError, "max_flips must be"),
    ],
)
def test_wrong_options(options: dict[str, object], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        ShapeComplexityLoss(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("input", "error", "words"),
    [
        (torch.zeros(4, 5), ValueError, "input must be"),
        (torch.zeros(0, 1, 4, 5), ValueError, "not empty"),
        (torch.zeros(1, 1, 4, 5, dtype=torch.long), TypeError, "floating point"),
        (3 * torch.ones(1, 1, 4, 5), ValueError, 'activation="sigmoid"'),
        ([[0.5]], TypeError, "torch.Tensor"),
    ],
)
def test_wrong_input(input: Tensor, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        ShapeComplexityLoss()(input)


def test_wrong_sizes_beside_the_input() -> None:
    probability = batch()
    with pytest.raises(ValueError, match="target must have the shape"):
        ShapeComplexityLoss()(probability, probability[:, :1])
    with pytest.raises(TypeError, match=r"target must be a torch\.Tensor; got str"):
        ShapeComplexityLoss()(probability, "target")
    with pytest.raises(TypeError, match=r"mask must be bool; got torch\.float32"):
        ShapeComplexityLoss()(probability, None, probability[:, :1])
    with pytest.raises(ValueError, match="mask must broadcast to the shape of input"):
        ShapeComplexityLoss()(probability, None, probability[:, :2] > 0)
    with pytest.raises(ValueError, match="each of the 3 channels"):
        ShapeComplexityLoss(weight=[1.0, 2.0])(probability)
    with pytest.raises(ValueError, match="2 channels or more"):
        ShapeComplexityLoss(include_background=False)(probability[:, :1])


@pytest.mark.parametrize("order", [(0, 2, 3, 1), (1, 0, 2, 3), (0, 1, 3, 2)])
def test_compiled_on_inputs_of_any_strides(order: tuple[int, ...]) -> None:
    torch.compiler.reset()
    dense = torch.rand(
        tuple(torch.tensor([2, 3, 8, 9])[list(order)].tolist()), generator=torch.Generator().manual_seed(0)
    )
    permuted = dense.permute(tuple(order.index(axis) for axis in range(4)))
    assert not permuted.is_contiguous()
    loss = ShapeComplexityLoss(max_flips=2)
    compiled = torch.compile(loss, fullgraph=True, backend="aot_eager")
    gradients = []
    for function in (loss, compiled):
        leaf = permuted.detach().requires_grad_()
        gradients.append(torch.autograd.grad(function(leaf), leaf)[0])
    torch.testing.assert_close(*gradients)


def test_the_loss_measures_by_all_options() -> None:
    disc = shapes.disc(8)[None, None].float()
    for options in ({"levels": "rim"}, {"levels": "rim", "estimator": "std"}, {"tol": 0.1, "tol_bits": float("inf")}):
        assert ShapeComplexityLoss(**options)(disc) == torchlinf.complexity(disc, **options).float()


def test_probabilities_a_rounding_above_1() -> None:
    disc = shapes.disc(8)[None, None].float() * (1 + 2**-23)
    assert disc.max() > 1
    assert ShapeComplexityLoss()(disc) == torchlinf.complexity(disc > 0).float()
    assert torch.equal(torchlinf.soft_complexity(disc), torchlinf.soft_complexity((disc > 0).float()))
    with pytest.raises(ValueError, match=r"must hold probabilities in \[0, 1\]"):
        ShapeComplexityLoss()(disc * 1.00001)
