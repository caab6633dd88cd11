"""The bound of a complexity in bits: the interval holds the exact value, at every tolerance and by every method."""

import math
from functools import cache

import numpy as np
import pytest
import torch
from torch import Tensor

from torchlinf import complexity_profile, shapes

TOLERANCES = [10.0**-k for k in range(1, 10)]
# Sums of the same terms in another order, and the rounding of the exact solve itself.
ROUNDING = 1e-12


def random_masks(count: int, spatial: tuple[int, ...], seed: int) -> Tensor:
    """Noise of every density, noisy boxes, and unions of boxes: neither square nor convex nor connected."""
    random = np.random.default_rng(seed)
    masks = random.random((count, *spatial)) < random.choice([0.5, 0.8, 0.95], (count, *[1] * len(spatial)))
    for mask in masks[::2]:
        for _ in range(3):
            low = random.integers(0, np.array(spatial))
            mask[tuple(slice(a, a + b) for a, b in zip(low, random.integers(1, 9, len(spatial)), strict=True))] ^= True
    return torch.from_numpy(masks)


def exact(masks: Tensor, estimator: str = "entropy") -> Tensor:
    return complexity_profile(masks, tol=1e-12, estimator=estimator, spatial_ndim=masks.ndim - 1).level_values


@pytest.mark.parametrize("spatial", [(37,), (9, 13), (5, 6, 7)])
@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("method", ["compiled", "batched", "accelerated"])
def test_the_interval_of_every_level_holds_its_exact_value(spatial: tuple[int, ...], tol: float, method: str) -> None:
    masks = random_masks(20, spatial, seed=len(spatial))
    found = complexity_profile(masks, tol=tol, tol_bits=math.inf, method=method, spatial_ndim=len(spatial))
    assert ((found.level_values - exact(masks)).abs() <= found.level_error_bound + ROUNDING).all()
    assert (found.error_bound() >= 0)[found.radius > 0].all()


@cache
def thousand(seed: int) -> tuple[Tensor, Tensor]:
    """A thousand shapes and the exact values of their levels, once for all tolerances."""
    masks = random_masks(1000, (11, 14), seed)
    return masks, exact(masks)


@pytest.mark.slow
@pytest.mark.parametrize("tol", TOLERANCES)
def test_ten_thousand_shapes_lie_in_their_intervals(tol: float) -> None:
    for seed in range(10):
        masks, expected = thousand(seed)
        found = complexity_profile(masks, tol=tol, tol_bits=math.inf, method="accelerated", spatial_ndim=2)
        assert ((found.level_values - expected).abs() <= found.level_error_bound + ROUNDING).all()


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("estimator", ["entropy", "std"])
def test_flips_lie_in_each_others_intervals(tol: float, estimator: str) -> None:
    masks = random_masks(30, (12, 15), seed=7)
    options = {"tol": tol, "tol_bits": math.inf, "estimator": estimator, "spatial_ndim": 2}
    one = complexity_profile(masks, **options)
    for axes in ((1,), (2,), (1, 2)):
        other = complexity_profile(masks.flip(axes), **options)
        difference = (one.level_values - other.level_values).abs()
        assert (difference <= one.level_error_bound + other.level_error_bound + ROUNDING).all()


@pytest.mark.parametrize("tol", TOLERANCES)
def test_the_interval_of_a_standard_deviation_holds_its_exact_value(tol: float) -> None:
    masks = random_masks(20, (12, 15), seed=3)
    options = {"tol": tol, "tol_bits": math.inf, "estimator": "std", "spatial_ndim": 2}
    for method in ("compiled", "accelerated"):
        found = complexity_profile(masks, method=method, **options)
        assert ((found.level_values - exact(masks, "std")).abs() <= found.level_error_bound + ROUNDING).all()
        assert (found.level_error_bound > 0).all()


@pytest.mark.parametrize("method", ["compiled", "batched", "accelerated"])
def test_at_the_defaults_every_digit_is_proven(method: str) -> None:
    masks = torch.cat([random_masks(30, (12, 15), seed=5), shapes.box(12, 15)[None], torch.zeros(1, 12, 15).bool()])
    found = complexity_profile(masks, method=method, spatial_ndim=2)
    assert found.level_error_bound.tolist() == [0.0] * len(found.level_error_bound)
    assert found.error_bound()[-1].isnan()


@pytest.mark.parametrize("method", ["compiled", "batched", "accelerated"])
@pytest.mark.parametrize("tol_bits", [0.0, 0.01, 0.5])
def test_a_rough_field_is_solved_on_until_the_bits_are_known(method: str, tol_bits: float) -> None:
    masks = torch.stack([torch.nn.functional.pad(shapes.disc(9), (0, 2, 3, 0)), random_masks(1, (22, 21), seed=1)[0]])
    rough = complexity_profile(masks, tol=0.1, tol_bits=math.inf, method=method, spatial_ndim=2)
    assert (rough.level_error_bound > 0.5).any()
    found = complexity_profile(masks, tol=0.1, tol_bits=tol_bits, method=method, spatial_ndim=2)
    assert (found.level_error_bound <= tol_bits).all()
    assert ((found.level_values - exact(masks)).abs() <= found.level_error_bound + ROUNDING).all()
    assert (found.field_error_bound <= rough.field_error_bound).all()


def test_a_mean_is_bounded_by_the_mean_of_the_bounds() -> None:
    found = complexity_profile(shapes.disc(12), tol=0.01, tol_bits=math.inf, method="accelerated", spatial_ndim=2)
    radius, bounds = int(found.radius), found.level_error_bound
    assert found.error_bound(0.0, 1.0) == pytest.approx(float(bounds.mean()))
    assert found.error_bound(0.0, 2 / radius) == pytest.approx(float(bounds[:2].mean()))


def test_without_the_compiler_the_bounds_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reference in torch operations against the kernels, on the same field."""
    from torchlinf.field import solve_field
    from torchlinf.kernels import histograms
    from torchlinf.measure import Measure
    from torchlinf.measure.entropy import EDGE_SLACK
    from torchlinf.measure.levels import level_values

    masks = random_masks(12, (14, 17), seed=2)
    for error in (1e-6, 1e-3, 0.05, 0.5, math.inf):
        for bins in (2, 50, 1024):
            solved = solve_field(masks, tol=1e-3, spatial_ndim=2)
            from torchlinf import chessboard_distance

            distance = chessboard_distance(masks, spatial_ndim=2)
            radius = distance.flatten(1).amax(dim=1)
            known = torch.full((len(masks),), error, dtype=torch.float64)
            values, bounds = level_values(solved.value, distance, radius, known, Measure(bins=bins))
            for i, (found, bound) in enumerate(
                zip(values.split(radius.tolist()), bounds.split(radius.tolist()), strict=True)
            ):
                sorted_, begin = histograms.sort_by_level(
                    solved.value[i].reshape(-1).numpy(), distance[i].reshape(-1).numpy(), int(radius[i])
                )
                expected = histograms.entropies(sorted_, begin, bins, EDGE_SLACK)
                np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
                certain = error + 4 * 2.0**-52 * sorted_.max()
                limits = histograms.entropy_bounds(sorted_, begin, bins, EDGE_SLACK, certain, expected)
                np.testing.assert_allclose(bound, limits, rtol=0, atol=1e-12)
