"""ComplexitySampler: which samples are drawn, how often, and by whom."""

import warnings
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.utils.data import DataLoader, TensorDataset

from torchlinf.samplers import ComplexitySampler

SCORES = torch.tensor([2.5, 0.0, torch.nan, 1.0, 4.0, 3.0, 1.0, 0.5])


def drawn(sampler: ComplexitySampler) -> Tensor:
    found = torch.tensor(list(sampler))
    assert len(found) == len(sampler)
    return found


def test_all_samples_with_a_score_are_drawn_once() -> None:
    sampler = ComplexitySampler(SCORES)
    epochs = [drawn(sampler) for _ in range(3)]
    for epoch in epochs:
        assert sorted(epoch.tolist()) == [0, 1, 3, 4, 5, 6, 7]
    assert not torch.equal(epochs[0], epochs[1])


def test_a_range_keeps_what_lies_in_it() -> None:
    sampler = ComplexitySampler(SCORES, between=(0.5, 2.5))
    assert sorted(sampler) == [0, 3, 6, 7]
    assert sorted(ComplexitySampler(SCORES.tolist(), between=(4.0, 9.0))) == [4]


def test_a_curriculum_begins_with_the_simplest_and_ends_with_all() -> None:
    sampler = ComplexitySampler(SCORES, share=lambda epoch: min(1.0, 0.25 * (epoch + 1)))
    pools = [set(drawn(sampler).tolist()) for _ in range(5)]
    assert pools == [{1, 7}, {1, 7, 3, 6}, {1, 7, 3, 6, 0, 5}, {0, 1, 3, 4, 5, 6, 7}, {0, 1, 3, 4, 5, 6, 7}]
    backwards = ComplexitySampler(-SCORES, share=0.25)
    assert set(backwards) == {4, 5}


def test_every_epoch_is_equally_long_and_draws_its_pool_evenly() -> None:
    sampler = ComplexitySampler(SCORES, share=0.4, num_samples=10)
    counts = torch.bincount(drawn(sampler), minlength=8)
    assert counts.sum() == 10
    assert sorted(counts[counts > 0].tolist()) == [3, 3, 4]


def test_weights_are_proportions() -> None:
    sampler = ComplexitySampler(SCORES, weight=torch.square, num_samples=40_000)
    counts = torch.bincount(drawn(sampler), minlength=8)
    expected = SCORES.nan_to_num(0.0).square()
    assert counts[expected == 0].sum() == 0
    torch.testing.assert_close(counts / 40_000, expected / expected.sum(), rtol=0.05, atol=0.005)


def test_the_epoch_and_the_seed_make_the_order() -> None:
    first, second = ComplexitySampler(SCORES), ComplexitySampler(SCORES)
    expected = [drawn(first) for _ in range(3)]
    second.set_epoch(2)
    assert torch.equal(drawn(second), expected[2])
    assert second.epoch == 3
    other = drawn(ComplexitySampler(SCORES, seed=7))
    assert not torch.equal(other, expected[0])


def test_replicas_share_an_epoch() -> None:
    parts = [ComplexitySampler(SCORES, num_replicas=3, rank=rank) for rank in range(3)]
    assert [len(part) for part in parts] == [3, 3, 3]  # 7 samples, so that two are drawn twice
    together = torch.cat([drawn(part) for part in parts])
    assert set(together.tolist()) == {0, 1, 3, 4, 5, 6, 7}
    whole = drawn(ComplexitySampler(SCORES, num_samples=9))
    assert sorted(together.tolist()) == sorted(whole.tolist())


def test_the_default_device_does_not_matter() -> None:
    """On the meta device any tensor that was made on the default device would have no values."""
    for options in ({}, {"weight": torch.exp}):
        with torch.device("meta"):
            indices = list(ComplexitySampler(SCORES.tolist(), **options))
        assert indices == list(ComplexitySampler(SCORES, **options))


def test_in_a_loader() -> None:
    data = TensorDataset(torch.arange(8))
    loader = DataLoader(data, batch_size=3, sampler=ComplexitySampler(SCORES, between=(0.0, 1.0)))
    assert len(loader) == 2
    assert sorted(torch.cat([batch[0] for batch in loader]).tolist()) == [1, 3, 6, 7]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"scores": torch.zeros(2, 3)}, r"scores must be \(N,\)"),
        ({"scores": torch.full((4,), torch.nan)}, "got none among 4"),
        ({"scores": []}, "got none among 0"),
        ({"between": (7.0, 9.0)}, "between 7.0 and 9.0"),
        ({"rank": 2, "num_replicas": 2}, "rank must be from 0 to 1"),
        ({"num_samples": 0}, "num_samples must be"),
        ({"num_replicas": 0}, "num_replicas must be"),
        ({"rank": -1}, "rank must be an integer of 0 or more"),
        ({"seed": -1}, "seed must be an integer of 0 or more"),
        ({"between": (3.0, 1.0)}, "between must be ordered"),
        ({"between": (float("nan"), 1.0)}, "between must be ordered"),
        ({"share": 0.0}, r"share must be in \(0, 1\]; got 0.0"),
        ({"share": 1.5}, r"share must be in \(0, 1\]; got 1.5"),
    ],
)
def test_wrong_options(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        ComplexitySampler(**{"scores": SCORES, **options})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"scores": "many"}, "scores must be a row of numbers"),
        ({"scores": None}, "scores must be a row of numbers"),
        ({"between": 3.0}, "between must be a pair"),
        ({"between": "ab"}, "between must be a pair"),
        ({"between": ("a", "b")}, "between must be a pair"),
        ({"share": "half"}, "share must be a number"),
        ({"share": None}, "share must be a number"),
        ({"weight": 2.0}, "weight must be a function"),
        ({"num_samples": 2.5}, "num_samples must be"),
        ({"seed": "a"}, "seed must be"),
        ({"rank": 0.0}, "rank must be"),
        ({"num_replicas": "two"}, "num_replicas must be"),
    ],
)
def test_options_of_a_wrong_type(options: dict[str, Any], words: str) -> None:
    with pytest.raises(TypeError, match=words):
        ComplexitySampler(**{"scores": SCORES, **options})
    with pytest.raises(TypeError, match="epoch must be"):
        ComplexitySampler(SCORES).set_epoch("first")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"share": lambda epoch: 1.5}, r"share must be in \(0, 1\]; got 1.5 in epoch 0"),
        ({"weight": lambda scores: -scores}, "weight must give 7 finite numbers"),
        ({"weight": lambda scores: 0 * scores}, "not all 0"),
        ({"weight": lambda scores: scores[:2]}, "weight must give 7"),
        ({"weight": lambda scores: scores * torch.nan}, "finite"),
    ],
)
def test_wrong_schedules(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        list(ComplexitySampler(SCORES, **options))


def test_scores_of_any_kind() -> None:
    pandas = pytest.importorskip("pandas")
    plain = [1.0, 2.0, 3.0]
    frozen = np.array(plain)
    frozen.flags.writeable = False
    expected = list(ComplexitySampler(torch.tensor(plain)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for scores in (frozen, np.array(plain, ">f4"), pandas.Series(plain, index=[5, 6, 7]), tuple(plain)):
            assert list(ComplexitySampler(scores)) == expected
            weighted = ComplexitySampler(scores, weight=lambda s: pandas.Series(s.numpy() == 2, index=[7, 8, 9]))
            assert list(weighted) == [1, 1, 1]
        for scores in (
            pandas.Series([1.0, None, 3.0], dtype="Float64"),
            np.ma.masked_array(plain, [False, True, False]),
        ):
            assert sorted(ComplexitySampler(scores)) == [0, 2]


def test_more_samples_than_multinomial_takes() -> None:
    scores = torch.zeros(2**24 + 2, dtype=torch.float32)
    scores[-3:] = 1
    sampler = ComplexitySampler(scores, weight=lambda s: s, num_samples=99)
    drawn = list(sampler)
    assert set(drawn) == {2**24 - 1, 2**24, 2**24 + 1}
