"""The profile and its means: against naive loops, invariances, input rules; known values are in test_known_values."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
import torch
from scipy import ndimage
from torch import Tensor

import torchlinf
from torchlinf import complexity, complexity_profile, shapes


def random_masks(seed: int, *shape: int, filled: float = 0.75) -> Tensor:
    """Blobs of several sizes, holes and specks; some touch the border."""
    generator = torch.Generator().manual_seed(seed)
    coarse = torch.rand(*shape, generator=generator) < filled
    for axis in range(2, len(shape)):
        coarse = coarse | coarse.roll(1, axis)
    return coarse & (torch.rand(*shape, generator=generator) < 0.97)


def naive_levels(mask: Tensor, estimator: str = "entropy", bins: int = 1024) -> list[float]:
    """Level values of one shape from the field of the plain monotone method, scipy's distance and numpy's histogram."""
    field = torchlinf.solve_field(mask, method="monotone", tol=1e-10, spatial_ndim=mask.ndim).value.numpy()
    distance = ndimage.distance_transform_cdt(np.pad(mask.numpy(), 1), metric="chessboard")
    distance = distance[(slice(1, -1),) * mask.ndim]
    edges = (np.arange(bins + 1) - 1e-6) / bins
    edges[-1] = 2.0
    found = []
    for k in range(1, distance.max() + 1):
        values = field[distance == k] / field.max()
        share = np.histogram(values, edges)[0] / len(values)
        share = share[share > 0]
        found.append(float(np.std(values) if estimator == "std" else -(share * np.log2(share)).sum()))
    return found


def naive_mean(levels: list[float], low: float, high: float) -> float:
    """The integral over (low, high] of the step function E, with exact lengths."""
    low_, high_, total = Fraction(low), Fraction(high), 0.0
    for k, value in enumerate(levels, start=1):
        start, stop = Fraction(k - 1, len(levels)), Fraction(k, len(levels))
        total += value * float(max(Fraction(0), min(stop, high_) - max(start, low_)))
    return total / float(high_ - low_)


@pytest.mark.parametrize("estimator", ["entropy", "std"])
@pytest.mark.parametrize("size", [(60,), (21, 34), (9, 13, 11), (5, 6, 5, 7)])
def test_profiles_of_random_shapes_equal_the_naive_oracle(size: tuple[int, ...], estimator: str) -> None:
    masks = random_masks(len(size), 2, 2, *size)
    profile = complexity_profile(masks, estimator=estimator)
    for b in range(2):
        for c in range(2):
            expected = naive_levels(masks[b, c], estimator)
            assert profile.radius[b, c] == len(expected)
            levels = profile.levels()[b][c]
            np.testing.assert_allclose(levels.numpy(), expected, rtol=0, atol=1e-8)
            on_grid = [expected[math.ceil(Fraction(i, 100) * len(expected)) - 1] for i in range(1, 101)]
            np.testing.assert_allclose(profile.values[b, c].numpy(), on_grid, rtol=0, atol=1e-8)
            for low, high in ((0.0, 1.0), (0.0, 0.25), (0.3, 0.35), (0.5, 1.0)):
                found = profile.mean(low, high)[b, c].item()
                assert found == pytest.approx(naive_mean(expected, low, high), abs=1e-8)


def test_other_bins_and_screening_lengths_equal_the_naive_oracle() -> None:
    mask = shapes.disc(14)
    field = torchlinf.solve_field(mask, rho=3.0, spatial_ndim=2).value
    distance = torchlinf.chessboard_distance(mask, spatial_ndim=2)
    found = complexity_profile(mask, bins=50, rho=3.0, spatial_ndim=2).levels()
    for k, entropy in enumerate(found.tolist(), start=1):
        values = (field[distance == k] / field.max()).numpy()
        share = np.bincount(np.minimum((values * 50 + 1e-6).astype(int), 49)) / len(values)
        assert entropy == pytest.approx(-sum(p * math.log2(p) for p in share if p > 0), abs=1e-12)


@pytest.mark.parametrize("estimator", ["entropy", "std"])
@pytest.mark.parametrize("size", [(50,), (18, 27), (7, 9, 8)])
def test_flips_and_axis_swaps_give_the_same_numbers(size: tuple[int, ...], estimator: str) -> None:
    mask = random_masks(10 + len(size), 2, 1, *size)
    levels = complexity_profile(mask, estimator=estimator).level_values
    for axis in range(2, mask.ndim):
        for moved in (mask.flip(axis), mask.transpose(axis, 2), mask.transpose(axis, 2).flip(2)):
            found = complexity_profile(moved, estimator=estimator).level_values
            torch.testing.assert_close(found, levels, rtol=0, atol=1e-9)


@pytest.mark.parametrize("estimator", ["entropy", "std"])
def test_a_batch_equals_its_shapes_one_by_one_to_the_last_bit(estimator: str) -> None:
    masks = random_masks(20, 3, 2, 19, 26)
    masks[1, 0] = False
    masks[2, 1] = True
    masks[0, 1, 5:, 5:] = False
    batch = complexity_profile(masks, estimator=estimator)
    for b in range(3):
        for c in range(2):
            alone = complexity_profile(masks[b : b + 1, c : c + 1], estimator=estimator)
            assert torch.equal(alone.levels()[0][0], batch.levels()[b][c])
            for name in ("values", "radius", "field_error_bound"):
                found, expected = getattr(alone, name)[0, 0], getattr(batch, name)[b, c]
                torch.testing.assert_close(found, expected, rtol=0, atol=0, equal_nan=True)
            for found, expected in ((alone.mean(0.1, 0.7), batch.mean(0.1, 0.7)), (alone.peak()[1], batch.peak()[1])):
                torch.testing.assert_close(found[0, 0], expected[b, c], rtol=0, atol=0, equal_nan=True)


def test_an_empty_shape_is_nan_and_harms_no_other() -> None:
    masks = torch.zeros(2, 1, 25, 27)
    masks[1, 0, 1:24, 2:25] = shapes.disc(11)
    profile = complexity_profile(masks)
    assert profile.radius.tolist() == [[0], [8]]
    assert profile.values[0].isnan().all()
    assert profile.values[1].isfinite().all()
    assert profile.levels()[0][0].shape == (0,)
    assert profile.mean().isnan().tolist() == [[True], [False]]
    for found in profile.peak():
        assert found.isnan().tolist() == [[True], [False]]
    assert complexity(masks, estimator="std").isnan().tolist() == [[True], [False]]


def test_only_empty_shapes_and_no_shapes_keep_their_leading_dimensions() -> None:
    for masks in (torch.zeros(2, 3, 4, 5), torch.zeros(0, 3, 4, 5), torch.zeros(2, 0, 6)):
        lead = masks.shape[:2]
        profile = complexity_profile(masks, scales=[0.5, 1.0])
        assert profile.values.shape == (*lead, 2)
        assert profile.mean().shape == profile.peak()[0].shape == profile.radius.shape == lead
        assert profile.values.isnan().all()
        assert [len(row) for row in profile.levels()] == [lead[1]] * lead[0]


@pytest.mark.parametrize("size", [(9,), (4, 7), (7, 4), (3, 4, 5), (2, 3, 4, 5)])
def test_full_masks_and_single_pixels_are_exactly_zero(size: tuple[int, ...]) -> None:
    masks = torch.ones(2, 1, *size)
    masks[1] = 0
    masks[(1, 0, *[n // 2 for n in size])] = 1
    profile = complexity_profile(masks)
    assert profile.radius.tolist() == [[(min(size) + 1) // 2], [1]]
    assert profile.values.abs().max().item() == 0.0
    assert profile.mean().tolist() == [[0.0], [0.0]]
    assert [value.tolist() for value in profile.peak()] == [[[0.0], [0.0]], [[1 / ((min(size) + 1) // 2)], [1.0]]]


@pytest.mark.parametrize("dtype", [torch.bool, torch.uint8, torch.int64, torch.float16, torch.bfloat16, torch.float32])
def test_the_dtype_of_the_mask_does_not_matter(dtype: torch.dtype) -> None:
    mask = random_masks(30, 2, 1, 15, 22)
    found = complexity_profile(mask.to(dtype))
    assert found.values.dtype == torch.float64
    assert torch.equal(found.values, complexity_profile(mask.double()).values)


def test_strides_and_expansion_of_the_mask_do_not_matter() -> None:
    mask = random_masks(31, 1, 1, 15, 22)
    expected = complexity(mask)
    assert torch.equal(complexity(mask.expand(3, 2, -1, -1)), expected.expand(3, 2))
    spread = torch.zeros(1, 1, 15, 44, dtype=torch.bool)
    spread[..., ::2] = mask
    assert torch.equal(complexity(spread[..., ::2]), expected)
    assert torch.equal(complexity(mask.transpose(2, 3).contiguous().transpose(2, 3)), expected)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64])
def test_results_come_in_the_dtype_asked_for(dtype: torch.dtype) -> None:
    mask = random_masks(32, 1, 2, 20, 23)
    exact, found = complexity_profile(mask), complexity_profile(mask, dtype=dtype)
    # The bound keeps its own dtype: in float16 it would claim an exact field.
    assert torch.equal(found.field_error_bound, exact.field_error_bound)
    assert found.radius.dtype == torch.int64
    # Computed in float64 and rounded once, at the end.
    assert torch.equal(found.values, exact.values.to(dtype))
    assert torch.equal(found.scales, exact.scales.to(dtype))
    assert torch.equal(found.mean(0.0, 0.3), exact.mean(0.0, 0.3).to(dtype))
    assert torch.equal(found.peak()[0], exact.peak()[0].to(dtype))
    assert torch.equal(found.levels()[0][1], exact.levels()[0][1].to(dtype))
    assert torch.equal(complexity(mask, high=0.3, dtype=dtype), exact.mean(0.0, 0.3).to(dtype))


def test_spatial_ndim_makes_all_other_dimensions_batch() -> None:
    masks = random_masks(33, 2, 3, 12, 17)
    expected = complexity_profile(masks)
    found = complexity_profile(masks[None], spatial_ndim=2)
    assert torch.equal(found.values, expected.values[None])
    assert torch.equal(found.levels()[0][1][2], expected.levels()[1][2])
    alone = complexity_profile(masks[1, 2], spatial_ndim=2)
    assert alone.values.shape == (100,)
    assert alone.radius.shape == alone.mean().shape == ()
    assert torch.equal(alone.levels(), expected.levels()[1][2])


def test_a_tensor_of_screening_lengths_broadcasts_to_the_leading_shape() -> None:
    masks = random_masks(34, 2, 3, 14, 18)
    rho = torch.tensor([[2.0], [30.0]])
    found = complexity_profile(masks, rho=rho)
    assert torch.equal(found.values[0], complexity_profile(masks[:1], rho=2.0).values[0])
    assert torch.equal(found.values[1], complexity_profile(masks[1:], rho=30.0).values[0])
    assert not torch.equal(found.values, complexity_profile(masks).values)


@pytest.mark.parametrize("radius", [7, 10, 13, 35, 50])
def test_scale_k_over_d_belongs_to_level_k_whatever_its_rounding(radius: int) -> None:
    disc = shapes.disc(radius)
    profile = complexity_profile(disc, scales=torch.arange(1, 101).double() / 100, spatial_ndim=2)
    size, levels = int(profile.radius), profile.levels().tolist()
    in_float64 = complexity_profile(disc, scales=[k / size for k in range(1, size + 1)], spatial_ndim=2)
    in_float32 = complexity_profile(disc, scales=torch.arange(1, size + 1) / size, spatial_ndim=2)
    assert in_float64.values.tolist() == in_float32.values.tolist() == levels
    for short in ("<f4", ">f4", "<f2", ">f2", ">f8"):
        rounded = (np.arange(1, size + 1) / size).astype(short)
        assert complexity_profile(disc, scales=rounded, spatial_ndim=2).values.tolist() == levels
    assert profile.values.tolist() == [levels[math.ceil(Fraction(i, 100) * size) - 1] for i in range(1, 101)]
    just_above = complexity_profile(disc, scales=[k / size + 1e-6 for k in range(1, size)], spatial_ndim=2)
    assert just_above.values.tolist() == levels[1:]


def test_the_smallest_scales_belong_to_level_one() -> None:
    profile = complexity_profile(shapes.disc(9), scales=[1e-12, 1e-3], spatial_ndim=2)
    assert profile.values.tolist() == [profile.levels()[0].item()] * 2


def test_the_default_scales_are_hundredths() -> None:
    assert complexity_profile(shapes.square(3), spatial_ndim=2).scales.tolist() == [i / 100 for i in range(1, 101)]


def test_means_of_adjoining_windows_add_up() -> None:
    profile = complexity_profile(random_masks(40, 2, 2, 30, 41, filled=0.9))
    cuts = [0.0, 0.013, 1 / 3, 0.5, 0.77, 1.0]
    parts = sum(profile.mean(low, high) * (high - low) for low, high in itertools.pairwise(cuts))
    torch.testing.assert_close(parts, profile.mean(), rtol=0, atol=1e-14)
    for b in range(2):
        assert profile.mean()[b, 0].item() == pytest.approx(profile.levels()[b][0].mean().item(), abs=1e-14)


def test_a_window_inside_one_level_gives_that_level() -> None:
    profile = complexity_profile(shapes.disc(20), spatial_ndim=2)
    size, levels = int(profile.radius), profile.levels().tolist()
    for k, value in enumerate(levels, start=1):
        assert profile.mean((k - 0.6) / size, (k - 0.4) / size).item() == pytest.approx(value, abs=1e-13)


def test_the_peak_is_the_first_of_the_largest_levels() -> None:
    profile = complexity_profile(torch.stack([shapes.disc(24), shapes.superellipse(24, 1.3)])[None])
    value, scale = profile.peak()
    for c in range(2):
        levels = profile.levels()[0][c].tolist()
        assert value[0, c] == max(levels)
        assert scale[0, c] == (levels.index(max(levels)) + 1) / len(levels)


def test_the_error_bound_is_that_of_the_field() -> None:
    masks = random_masks(41, 2, 2, 16, 19)
    found = complexity_profile(masks, tol=1e-6).field_error_bound
    assert torch.equal(found, torchlinf.solve_field(masks, tol=1e-6).error_bound)
    assert (found <= 1e-6).all()


def test_every_method_gives_the_same_profile() -> None:
    masks = random_masks(42, 2, 1, 17, 24)
    expected = complexity_profile(masks, method="monotone").level_values
    torch.testing.assert_close(complexity_profile(masks).level_values, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"estimator": "variance"}, ValueError, r"estimator must be one of .*; got 'variance'\. Pass"),
        ({"bins": 0}, ValueError, r"bins must be an integer of 1 or more; got 0\. Pass"),
        ({"bins": 2.5}, TypeError, r"bins must be an integer of 1 or more; got 2\.5\. Pass"),
        ({"scales": []}, ValueError, r"scales must be one row of numbers; got shape \(0,\)\. Pass"),
        ({"scales": 0.5}, ValueError, r"scales must be one row of numbers; got shape \(\)\. Pass"),
        ({"scales": [[0.5]]}, ValueError, r"scales must be one row of numbers; got shape \(1, 1\)\. Pass"),
        ({"scales": [0.0, 0.5]}, ValueError, r"scales must lie in \(0, 1\]; got \[0\.0, 0\.5\]\. Pass"),
        ({"scales": [0.5, 1.1]}, ValueError, r"scales must lie in \(0, 1\]; got \[0\.5, 1\.1\]\. Pass"),
        ({"scales": [math.nan]}, ValueError, r"scales must lie in \(0, 1\]; got \[nan\]\. Pass"),
        ({"scales": torch.tensor([0.5j])}, TypeError, r"scales must be real numbers; got torch\.complex64\. Pass"),
        ({"dtype": torch.int32}, TypeError, r"dtype must be a floating-point dtype; got torch\.int32\. Pass"),
        ({"tol": 0.0}, ValueError, r"tol must be finite and above 0; got 0\.0\. Pass"),
        ({"rho": -1.0}, ValueError, r"rho must be .*above 0; got -1\.0\. Pass"),
        ({"method": "magic"}, ValueError, r"method must be one of .*; got 'magic'\. Pass"),
        ({"spatial_ndim": 5}, ValueError, r"spatial_ndim must be from 1 to 4; got 5\. Pass"),
    ],
)
def test_bad_options_are_named(options: dict[str, object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        complexity_profile(torch.ones(1, 1, 4, 5), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("mask", "error", "message"),
    [
        (torch.ones(4, 5), ValueError, r"mask must be \(B, C, \*spatial\).*got \(4, 5\)\. Pass spatial_ndim=2"),
        (torch.full((1, 1, 4, 5), math.nan), ValueError, r"mask must hold only 0 and 1; got NaN\. Pass"),
        (torch.full((1, 1, 4, 5), 2), ValueError, r"mask must hold only 0 and 1; got 2\. Pass"),
        (torch.ones(1, 1, 0, 5), ValueError, r"mask must have spatial dimensions of size 1 or more; got .*\(0, 5\)\."),
        (
            torch.ones(1, 1, 4, 5, dtype=torch.complex64),
            TypeError,
            r"mask must be bool, integer or real; got .*\. Pass",
        ),
        (np.ones((1, 1, 4, 5)), TypeError, r"mask must be a torch\.Tensor; got ndarray\. Pass torch\.from_numpy"),
    ],
)
def test_bad_masks_are_named(mask: Tensor, error: type[Exception], message: str) -> None:
    for function in (complexity_profile, complexity):
        with pytest.raises(error, match=message):
            function(mask)


@pytest.mark.parametrize(("low", "high"), [(0.5, 0.5), (0.6, 0.5), (-0.1, 0.5), (0.0, 1.1), (math.nan, 1.0)])
def test_bad_windows_are_named(low: float, high: float) -> None:
    profile = complexity_profile(shapes.square(3), spatial_ndim=2)
    with pytest.raises(ValueError, match=r"low and high must obey 0 <= low < high <= 1; got low="):
        profile.mean(low, high)
    with pytest.raises(ValueError, match=r"low and high must obey 0 <= low < high <= 1; got low="):
        complexity(torch.ones(1, 1, 3, 3), low=low, high=high)
