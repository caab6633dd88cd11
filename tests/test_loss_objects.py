"""The loss of objects and of shapes in their own frames."""

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from torch import Tensor

from torchlinf import complexity, shapes
from torchlinf.losses import ShapeComplexityLoss
from torchlinf.losses.parts import cut_out, others_of, parts_of
from torchlinf.measure import Measure, turned

BUMPED = shapes.with_appendages((20, 24), [shapes.Appendage("right", 5, 4)], margin=10)  # H != W
DISC = shapes.disc(9)


def placed(*objects: Tensor, size: tuple[int, int] = (60, 110)) -> Tensor:
    mask, left = torch.zeros(size, dtype=torch.bool), 4
    for one in objects:
        mask[3 : 3 + one.shape[0], left : left + one.shape[1]] = one
        left += one.shape[1] + 12
    return mask


def grey(mask: Tensor, seed: int = 0) -> Tensor:
    """Probabilities, nowhere near the threshold or the levels of doubt, and 0 in the outside."""
    noise = torch.rand(mask.shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return torch.where(mask, 0.8 + 0.15 * noise, 0.0)


def run(x: Tensor, **options: Any) -> tuple[float, Tensor]:
    mask = options.pop("mask", None)
    x = x.detach().clone().requires_grad_()
    loss = ShapeComplexityLoss(**options)(x, mask=mask)
    loss.backward()
    assert x.grad is not None
    return loss.item(), x.grad


@pytest.mark.parametrize("keep_area", [True, False])
def test_one_object_along_the_axes_has_the_plain_loss(keep_area: bool) -> None:
    x = grey(BUMPED)[None, None]
    value, gradient = run(x, keep_area=keep_area)
    assert value > 0.1
    assert gradient.abs().max() > 1e-4
    for options in ({"per": "object"}, {"orientation": "own"}, {"per": "object", "orientation": "own"}):
        found, same = run(x, keep_area=keep_area, **options)
        assert found == value, options
        torch.testing.assert_close(same, gradient, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("pool", [None, "mean", "area"])
def test_the_loss_of_a_prediction_is_the_mean_of_its_objects(pool: str | None) -> None:
    both, first, second = placed(BUMPED, DISC), placed(BUMPED), placed(BUMPED, DISC) & ~placed(BUMPED)
    x = grey(both)
    weights = np.array([int(first.sum()), int(second.sum())]) if pool == "area" else np.ones(2)
    weights = weights / weights.sum()
    value, gradient = run(x[None, None], per="object", pool=pool)
    (one, to_one), (two, to_two) = (run((x * part)[None, None]) for part in (first, second))
    assert value == pytest.approx(weights @ [one, two], rel=1e-12)
    assert value == pytest.approx(complexity(both, per="object", pool=pool, spatial_ndim=2).item(), rel=1e-12)
    expected = weights[0] * to_one + weights[1] * to_two
    torch.testing.assert_close(gradient, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "options",
    [
        {"orientation": "own"},
        {"orientation": 25.0, "per": "object"},
        {"orientation": "mean", "rotations": 2, "per": "object"},
        {"orientation": "least", "rotations": 3},
        {"per": "object", "min_pixels": 250, "estimator": "std"},
        {"per": "object", "connectivity": 1, "high": 0.4, "levels": "rim"},
    ],
)
def test_the_value_is_the_complexity_of_the_thresholded_prediction(options: dict[str, Any]) -> None:
    x = torch.stack([grey(placed(BUMPED, DISC)), grey(placed(DISC, BUMPED.T, size=(60, 110)))])[None]
    loss = ShapeComplexityLoss(reduction="none", max_flips=2, **options)(x)
    torch.testing.assert_close(loss, complexity(x > 0.5, **options), rtol=1e-12, atol=0)


@pytest.mark.parametrize("mode", [torch.no_grad, torch.inference_mode])
def test_a_value_alone_is_the_same(mode: Any) -> None:
    x = grey(placed(BUMPED, DISC))[None, None]
    loss = ShapeComplexityLoss(max_flips=1, per="object", orientation=25.0)
    expected = loss(x.clone().requires_grad_()).item()
    assert expected > 0.1
    with mode():
        found = loss(x.clone())
    assert found.item() == expected
    assert not found.requires_grad


def test_a_tilted_rectangle_has_little_to_lose() -> None:
    mask = torch.from_numpy(np.pad(turned(np.ones((30, 50), dtype=bool), 27.0), ((4, 9), (6, 3))))
    x = grey(mask)[None, None]
    assert run(x)[0] > 1.5
    assert run(x, orientation="own")[0] < 0.2


def test_descent_removes_a_bump_from_a_tilted_rectangle() -> None:
    block = np.zeros((40, 56), dtype=bool)
    block[6:36, 3:48] = True
    block[18:23, 48:53] = True
    mask = torch.from_numpy(np.pad(turned(block, 33.0), 5))
    bump = mask & ~torch.from_numpy(np.pad(turned_like(block, 33.0), 5))
    assert 15 < int(bump.sum()) < 60
    _, gradient = run(grey(mask)[None, None], orientation="own", keep_area=False)
    assert gradient[0, 0][bump].mean() > 5 * gradient.abs().mean()
    assert gradient[0, 0][bump].sum() > 0.9 * gradient[0, 0][bump].abs().sum()


def turned_like(block: NDArray[np.bool_], degrees: float) -> NDArray[np.bool_]:
    """The block without its bump, turned and placed as the block with it."""
    whole = turned(block, degrees)
    plain = block.copy()
    plain[18:23, 48:53] = False
    part = turned(plain, degrees)
    best, most = whole, -1
    for row in range(whole.shape[0] - part.shape[0] + 1):
        for column in range(whole.shape[1] - part.shape[1] + 1):
            at = np.zeros_like(whole)
            at[row : row + part.shape[0], column : column + part.shape[1]] = part
            if (overlap := int((at & whole).sum())) > most:
                best, most = at, overlap
    return best


@pytest.mark.parametrize("degrees", [13.0, 33.0, 77.0, -20.0])
def test_parts_are_cut_out_where_they_are(degrees: float) -> None:
    """The interpolated mask is the turned one, but for a few pixels at the boundary."""
    block = np.zeros((40, 56), dtype=bool)
    block[3:33, 2:43] = True
    block[10:20, 43:55] = True
    mask = np.pad(turned(block, degrees), ((7, 1), (2, 5)))
    for options in ({"orientation": "own"}, {"orientation": 31.0}, {"orientation": "own", "per": "object"}):
        (part,) = parts_of(mask[None], Measure(**options))
        cut = cut_out(torch.from_numpy(mask).double(), part)
        different = (cut > 0.5).numpy() ^ part.inside
        assert different.sum() < 0.06 * part.inside.sum()
        # Both have the same centre of mass.
        centres = [np.argwhere(one).mean(axis=0) for one in ((cut > 0.5).numpy(), part.inside)]
        assert np.abs(centres[0] - centres[1]).max() < 0.15


def test_a_cut_is_linear_in_the_pixels() -> None:
    mask = placed(DISC, BUMPED).numpy()
    for options in ({"orientation": 20.0, "per": "object"}, {"per": "object"}):
        first, second = parts_of(mask[None], Measure(**options))
        others = others_of(first, mask)
        assert (others | mask)[mask].all()
        assert int((others & mask).sum()) == int(mask.sum()) - int(DISC.sum())
        image = torch.rand(mask.shape, dtype=torch.float64, requires_grad=True)
        assert torch.autograd.gradcheck(lambda x: cut_out(x, first, others), image, fast_mode=True)  # noqa: B023
        (gradient,) = torch.autograd.grad(cut_out(image, first, others).sum(), image)
        assert not gradient[torch.from_numpy(others)].any()
        near = torch.from_numpy(mask & ~others)
        torch.testing.assert_close(gradient[near], torch.ones(int(DISC.sum()), dtype=torch.float64), rtol=0, atol=0.35)
        assert second.owner == first.owner == 0


def test_no_gradient_goes_where_it_must_not() -> None:
    mask = placed(BUMPED, DISC)
    allowed = torch.ones(1, 1, *mask.shape, dtype=torch.bool)
    allowed[..., :20, :] = False
    for options in ({"per": "object", "orientation": 20.0}, {"per": "object"}):
        _, gradient = run(grey(mask)[None, None], mask=allowed, **options)
        assert gradient.isfinite().all()
        assert not gradient[~allowed].any()
        assert gradient[allowed].any()
    _, gradient = run(grey(mask)[None, None], per="object", min_pixels=int(DISC.sum()) + 1)
    assert not gradient[0, 0][placed(BUMPED, DISC) & ~placed(BUMPED)].any()


def test_empty_predictions_cost_the_most_and_pass_no_gradient() -> None:
    x = torch.full((2, 2, 15, 19), 0.1, dtype=torch.float64)
    x[1, 0, 3:5, 4:6] = 0.9
    for options in ({"per": "object", "min_pixels": 5}, {"orientation": "own", "per": "object", "min_pixels": 5}):
        value, gradient = run(x, bins=256, **options)
        assert value == 8.0
        assert not gradient.any()
    loss = ShapeComplexityLoss(per="object", reduction="none")(x)
    assert loss.tolist() == [[10.0, 10.0], [0.0, 10.0]]


def test_nan_stays_nan() -> None:
    x = grey(placed(DISC)).repeat(2, 1, 1, 1)
    x[0, 0, 50, 100] = torch.nan
    loss = ShapeComplexityLoss(per="object", orientation="own", reduction="none")(x)
    assert loss.isnan().tolist() == [[True], [False]]
    with pytest.raises(ValueError, match=r"input must hold probabilities in \[0, 1\]; got values from"):
        ShapeComplexityLoss(per="object")(3 * grey(placed(DISC))[None, None])


def test_a_batch_is_its_parts() -> None:
    masks = [placed(BUMPED, DISC), placed(DISC), placed(DISC, BUMPED), torch.zeros(60, 110, dtype=torch.bool)]
    x = torch.stack([grey(mask, seed) for seed, mask in enumerate(masks)]).reshape(2, 2, 60, 110)
    for options in ({"per": "object", "orientation": "own"}, {"orientation": "least", "rotations": 2}):
        _, gradient = run(x, reduction="sum", **options)
        for b in range(2):
            for c in range(2):
                _, single = run(x[b : b + 1, c : c + 1], reduction="sum", **options)
                assert torch.equal(gradient[b, c], single[0, 0])


def test_volumes_are_turned_by_a_matrix() -> None:
    x = torch.zeros(1, 1, 20, 18, 22, dtype=torch.float64)
    x[0, 0, 4:14, 3:12, 5:15] = 0.9
    turn = Rotation.from_euler("z", 25, degrees=True)
    value, gradient = run(x, orientation=turn, per="object", max_flips=3)
    assert value == complexity(x > 0.5, orientation=turn, per="object").item() > 0.1
    assert gradient.isfinite().all()
    assert gradient.any()
    with pytest.raises(ValueError, match="orientation must be None for masks of 3 dimensions"):
        ShapeComplexityLoss(orientation="own")(x)


def test_float32_and_bfloat16_and_logits() -> None:
    logits = (8.0 * placed(BUMPED, DISC) - 4.0)[None, None]
    values = [
        ShapeComplexityLoss(activation="sigmoid", per="object", orientation="own")(logits.to(dtype)).item()
        for dtype in (torch.float64, torch.float32, torch.bfloat16)
    ]
    assert values[1] == pytest.approx(values[0], rel=1e-6)
    assert values[2] == pytest.approx(values[0], rel=1e-6)


@pytest.mark.slow
def test_compiled_with_a_graph_break() -> None:
    torch.compiler.reset()
    loss = ShapeComplexityLoss(activation="sigmoid", per="object", orientation="own", max_flips=4)
    logits = (8.0 * placed(BUMPED, DISC) - 4.0)[None, None].double().requires_grad_()
    compiled = torch.compile(loss, backend="aot_eager")
    gradients = [torch.autograd.grad(one(logits), logits)[0] for one in (loss, compiled)]
    torch.testing.assert_close(*gradients)
