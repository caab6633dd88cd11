"""The bound of a level's entropy holds for every field within the field's bound, and is 0 where no bin is in doubt."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torchlinf.kernels.histograms import entropies, entropy_bounds

SLACK = 1e-6


def naive_entropy(values: np.ndarray, peak: float, bins: int) -> float:
    cells = np.minimum(np.floor(values / peak * bins + SLACK), bins - 1)
    shares = np.unique(cells, return_counts=True)[1] / len(values)
    return float(-(shares * np.log2(shares)).sum())


def audenaert(values: np.ndarray, peak: float, bins: int, factor: float) -> float:
    """The bound from the share of pixels in doubt alone (Audenaert 2007)."""
    low = np.minimum(np.floor(values / factor / peak * bins + SLACK), bins - 1)
    high = np.minimum(np.floor(np.minimum(values * factor, peak) / peak * bins + SLACK), bins - 1)
    share = (low != high).mean()
    if share > 1 - 1 / bins:
        return np.log2(bins)
    entropy = sum(-x * np.log2(x) for x in (share, 1 - share) if x > 0)
    return float(share * np.log2(bins - 1) + entropy)


@settings(max_examples=200, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(2, 60),
    st.sampled_from([2, 8, 64, 1024]),
    st.sampled_from([0.0, 1e-9, 1e-6, 1e-4, 1e-2, 0.1, 0.4]),
)
def test_every_field_within_the_bound_has_an_entropy_within_the_interval(
    seed: int, size: int, bins: int, error: float
) -> None:
    random = np.random.default_rng(seed)
    values = random.choice([random.random(size), np.round(random.random(size) * 8) / 8 + 0.01])
    values = np.append(values, 1.2)  # a level of one pixel that holds the maximum
    begin = np.array([0, size, size + 1])
    found = entropies(values, begin, bins, SLACK)
    bounds = entropy_bounds(values, begin, bins, SLACK, error, found)
    for _ in range(30):
        # any exact field between v / (1 + e) and v / (1 - e), the ends of the interval among them
        ends = random.choice([1 / (1 + error), 1.0, 1 / (1 - error)], size + 1)
        inner = random.uniform(1 / (1 + error), 1 / (1 - error), size + 1)
        exact = values * np.where(random.random(size + 1) < 0.7, ends, inner)
        entropy = naive_entropy(exact[:size], exact.max(), bins)
        assert abs(entropy - found[0]) <= bounds[0] + 1e-12
    factor = (1 + error) / (1 - error) * (1 + 1e-12)
    assert bounds[0] <= audenaert(values[:size], 1.2, bins, factor) + 1e-12
    assert bounds[1] == 0.0


def test_no_value_near_an_edge_means_no_doubt() -> None:
    values = np.append((np.arange(64) + 0.5) / 64, 1.0)
    begin = np.array([0, 64, 65])
    found = entropies(values, begin, 64, SLACK)
    assert entropy_bounds(values, begin, 64, SLACK, 1e-3, found).tolist() == [0.0, 0.0]
    assert entropy_bounds(values, begin, 64, SLACK, 1e-2, found)[0] > 0


def test_one_value_at_an_edge_may_leave_its_bin() -> None:
    """Four values, one of which may join the three: 0.8113 bits now, 0 bits then."""
    values = np.array([0.3, 0.3, 0.3, 0.5, 1.0])
    begin = np.array([0, 4, 5])
    found = entropies(values, begin, 2, SLACK)
    assert found[0] == pytest.approx(0.8112781)
    assert entropy_bounds(values, begin, 2, SLACK, 1e-4, found)[0] == pytest.approx(0.8112781)


@pytest.mark.parametrize("error", [1.0, np.inf, np.nan])
def test_where_nothing_is_certified_the_interval_is_that_of_all_entropies(error: float) -> None:
    values = np.array([0.1, 0.1, 0.4, 0.9, 1.0])
    begin = np.array([0, 4, 5])
    found = entropies(values, begin, 1024, SLACK)
    assert entropy_bounds(values, begin, 1024, SLACK, error, found)[0] == pytest.approx(max(found[0], 2 - found[0]))
