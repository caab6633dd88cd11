import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf.measure import Measure
from torchlinf.measure import options as measure_options
from torchlinf.measure.entropy import ESTIMATORS, level_entropy, level_std, segment_sum
from torchlinf.measure.levels import first_level, level_values
from torchlinf.measure.options import MAX_BINS


def values_of(field: Tensor, distance: Tensor, radius: Tensor, **options: Any) -> Tensor:
    return level_values(field, distance, radius, field.new_zeros(len(field)), Measure(**options))[0]


both = pytest.mark.parametrize("estimate", [level_entropy, level_std])
Estimate = Callable[[Tensor, Tensor, int, int], Tensor]


def naive_entropy(values: NDArray[np.float64], bins: int) -> float:
    edges = (np.arange(bins + 1) - 1e-6) / bins
    edges[-1] = 2.0  # the last bin is closed
    share = np.histogram(values, edges)[0] / len(values)
    share = share[share > 0]
    return float(-(share * np.log2(share)).sum())


def naive_levels(field: Tensor, distance: Tensor, estimator: str, bins: int) -> list[float]:
    values, where = (field / field.max()).numpy(), distance.numpy()
    found = []
    for k in range(1, int(where.max()) + 1):
        level = values[where == k]
        found.append(naive_entropy(level, bins) if estimator == "entropy" else float(np.std(level)))
    return found


def random_levels(seed: int, size: int, num_levels: int) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    values = torch.rand(size, dtype=torch.float64, generator=generator)
    return values, torch.randint(num_levels, (size,), generator=generator)


def is_positive_zero(x: float) -> bool:
    return x == 0.0 and math.copysign(1.0, x) == 1.0


@pytest.mark.parametrize("bins", [1, 2, 7, 1024, 5000])
def test_entropy_of_random_levels_equals_numpy_histograms(bins: int) -> None:
    values, level = random_levels(seed=bins, size=3000, num_levels=13)
    expected = [naive_entropy(values[level == k].numpy(), bins) for k in range(13)]
    np.testing.assert_allclose(level_entropy(values, level, 13, bins).numpy(), expected, rtol=0, atol=1e-12)


def test_std_of_random_levels_equals_numpy() -> None:
    values, level = random_levels(seed=1, size=3000, num_levels=13)
    expected = [np.std(values[level == k].numpy()) for k in range(13)]
    np.testing.assert_allclose(level_std(values, level, 13).numpy(), expected, rtol=1e-13, atol=0)


@pytest.mark.parametrize("spatial", [(40,), (13, 17), (5, 6, 7), (3, 4, 5, 6)])
@pytest.mark.parametrize("estimator", ["entropy", "std"])
def test_level_values_of_a_batch_equal_a_loop_over_shapes_and_levels(spatial: tuple[int, ...], estimator: str) -> None:
    generator = torch.Generator().manual_seed(len(spatial))
    distance = torch.randint(0, 5, (3, *spatial), generator=generator, dtype=torch.int32)
    distance.view(3, -1)[:, :5] = torch.tensor([0, 1, 2, 3, 4])
    distance[1] = distance[1].clamp(max=2)
    field = torch.rand(3, *spatial, generator=generator, dtype=torch.float64).add(0.1).mul(50) * (distance > 0)
    expected = [v for f, d in zip(field, distance, strict=True) for v in naive_levels(f, d, estimator, 64)]
    found = values_of(field, distance, distance.flatten(1).amax(1), estimator=estimator, bins=64)
    np.testing.assert_allclose(found.numpy(), expected, rtol=0, atol=1e-12)


@both
@pytest.mark.parametrize("value", [0.0, 0.1 + 0.2, 1 / 3, 1.0])
@pytest.mark.parametrize("size", [1, 7, 1000])
def test_a_uniform_level_gives_exactly_zero_and_not_minus_zero(estimate: Estimate, value: float, size: int) -> None:
    values = torch.full((size,), value, dtype=torch.float64)
    assert is_positive_zero(estimate(values, torch.zeros(size, dtype=torch.int64), 1, 1024).item())


@both
def test_a_level_without_values_is_nan(estimate: Estimate) -> None:
    found = estimate(torch.tensor([0.5, 0.7]).double(), torch.tensor([2, 2]), 4, 1024)
    assert found.isnan().tolist() == [True, True, False, True]


@both
def test_no_values_and_no_levels_give_an_empty_tensor(estimate: Estimate) -> None:
    found = estimate(torch.zeros(0, dtype=torch.float64), torch.zeros(0, dtype=torch.int64), 0, 1024)
    assert found.shape == (0,)
    assert found.dtype == torch.float64


@pytest.mark.parametrize("edge", [1, 512, 1023])
def test_rounding_at_the_edge_of_a_bin_does_not_split_equal_values(edge: int) -> None:
    noise = torch.linspace(-1e-12, 1e-12, 11, dtype=torch.float64)
    zeros = torch.zeros(11, dtype=torch.int64)
    assert level_entropy(edge / 1024 + noise, zeros, 1).item() == 0.0
    # What differs by more than the slack is told apart.
    assert level_entropy(edge / 1024 + noise * 1e4, zeros, 1).item() > 0.5


def test_the_last_bin_is_closed() -> None:
    values = torch.tensor([1.0, 1.0 - 1 / 2048, 1023 / 1024], dtype=torch.float64)
    assert level_entropy(values, torch.zeros(3, dtype=torch.int64), 1).item() == 0.0


def test_equal_counts_in_two_to_the_k_bins_are_k_bits() -> None:
    values = torch.arange(1024, dtype=torch.float64).add(0.5).div(1024).repeat(3)
    assert level_entropy(values, torch.zeros(3072, dtype=torch.int64), 1).item() == 10.0
    assert level_entropy(values, torch.zeros(3072, dtype=torch.int64), 1, 8).item() == 3.0


@both
def test_the_order_of_the_values_changes_no_bit(estimate: Estimate) -> None:
    values, level = random_levels(seed=3, size=5000, num_levels=9)
    order = torch.randperm(5000, generator=torch.Generator().manual_seed(4))
    assert torch.equal(estimate(values, level, 9, 1024), estimate(values[order], level[order], 9, 1024))


@both
def test_other_levels_in_the_batch_change_no_bit(estimate: Estimate) -> None:
    values, level = random_levels(seed=5, size=5000, num_levels=9)
    alone = torch.cat([estimate(values[level == k], torch.zeros_like(level[level == k]), 1, 1024) for k in range(9)])
    assert torch.equal(estimate(values, level, 9, 1024), alone)


def test_memory_does_not_grow_with_levels_times_bins() -> None:
    # A dense table would have 2^37 cells.
    num_levels = 2**17
    values, _ = random_levels(seed=6, size=2 * num_levels, num_levels=1)
    level = torch.arange(num_levels).repeat(2)
    found = level_entropy(values, level, num_levels, MAX_BINS)
    assert found.shape == (num_levels,)
    assert (found == 1.0).double().mean() > 0.99


def test_std_of_tiny_deviations_is_not_lost() -> None:
    # Values apart by 2^-40: squaring them without a shift would leave nothing.
    values = 0.75 + torch.tensor([0.0, 1.0, 2.0, 5.0], dtype=torch.float64) * 2**-40
    expected = np.std([0.0, 1.0, 2.0, 5.0]) * 2**-40
    assert level_std(values, torch.zeros(4, dtype=torch.int64), 1).item() == pytest.approx(expected, rel=1e-14)


@both
def test_float32_values_stay_float32(estimate: Estimate) -> None:
    values, level = random_levels(seed=7, size=500, num_levels=3)
    found = estimate(values.float(), level, 3, 64)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found.double(), estimate(values.float().double(), level, 3, 64), rtol=0, atol=1e-6)


def test_segment_sum_equals_exactly_rounded_sums() -> None:
    terms, segment = random_levels(seed=8, size=4000, num_levels=6)
    expected = [math.fsum(terms[segment == k].tolist()) for k in range(6)]
    found = segment_sum(terms, segment, torch.bincount(segment, minlength=6))
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-15, atol=0)


def test_segment_sum_reaches_its_bound_without_overflow() -> None:
    ones = torch.ones(2**20, dtype=torch.float64)
    zeros = torch.zeros(2**20, dtype=torch.int64)
    assert segment_sum(ones, zeros, torch.tensor([2**20])).item() == 2**20


def test_first_level_skips_empty_shapes() -> None:
    assert first_level(torch.tensor([0, 2, 0, 3], dtype=torch.int32)).tolist() == [0, 0, 2, 2]


def test_level_values_do_not_depend_on_the_scale_of_the_field() -> None:
    field, _ = random_levels(seed=9, size=60, num_levels=1)
    distance = torch.arange(60).remainder(3).add(1)[None]
    radius = torch.tensor([3])
    assert torch.equal(values_of(field[None], distance, radius), values_of(field[None] * 2048, distance, radius))


def test_level_values_of_empty_shapes_have_no_entry() -> None:
    field, distance = torch.zeros(3, 4, 5, dtype=torch.float64), torch.zeros(3, 4, 5, dtype=torch.int32)
    assert values_of(field, distance, torch.zeros(3, dtype=torch.int64)).shape == (0,)
    field[1, 2, 3], distance[1, 2, 3] = 0.5, 1
    assert values_of(field, distance, torch.tensor([0, 1, 0])).tolist() == [0.0]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_field_that_is_not_finite_is_an_error(bad: float) -> None:
    field = torch.tensor([[1.0, bad, 1.0]], dtype=torch.float64)
    with pytest.raises(ValueError, match="field must be finite"):
        values_of(field, torch.tensor([[1, 2, 1]]), torch.tensor([2]))


@pytest.mark.parametrize(
    ("estimator", "bins", "error", "message"),
    [
        ("variance", 1024, ValueError, r"estimator must be one of 'entropy', 'std'; got 'variance'\. Pass"),
        ("entropy", 0, ValueError, r"bins must be an integer of 1 or more; got 0\. Pass"),
        ("entropy", 2**20 + 1, ValueError, r"bins must be at most 1048576; got 1048577\. Pass"),
        ("entropy", 10.0, TypeError, r"bins must be an integer of 1 or more; got 10\.0\. Pass"),
        ("entropy", True, TypeError, r"bins must be an integer of 1 or more; got True\. Pass"),
    ],
)
def test_unusable_options_are_named(estimator: str, bins: int, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        Measure(estimator=estimator, bins=bins)


def test_the_table_of_estimators_is_the_public_one() -> None:
    assert tuple(ESTIMATORS) == measure_options.ESTIMATORS


@pytest.mark.parametrize(("dtype", "near", "far"), [(torch.float32, 0.7e-6, 1.9e-6), (torch.float64, 1.0e-15, 5.0e-15)])
def test_the_rounding_of_a_field_is_that_of_its_dtype(dtype: torch.dtype, near: float, far: float) -> None:
    """A residual is known to 4 eps max f: so that is how far the field is in doubt, to either side, and a value twice.

    With two bins the edge lies at (1 - 1e-6) / 2. A value above it by a share of less than (1 + e) / (1 - e) - 1, e = 4
    eps, may lie in the lower bin, and then the two values of the level differ. 4 more eps are the rounding of that.
    """
    edge, eps = 0.5 * (1 - 1e-6), torch.finfo(dtype).eps
    for above, in_doubt in ((near, True), (far, False)):
        assert (above < 8 * eps) == in_doubt
        assert in_doubt or above > 12.1 * eps
        field = torch.tensor([[edge * (1 + above), 0.75, 1.0]], dtype=dtype)
        distance = torch.tensor([[1, 1, 2]])
        values, bounds = level_values(field, distance, torch.tensor([2]), torch.zeros(1, dtype=dtype), Measure(bins=2))
        assert values.tolist() == [0.0, 0.0]
        assert bounds.tolist() == [pytest.approx(1.0) if in_doubt else 0.0, 0.0]
