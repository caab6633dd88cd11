"""Sparse systems eliminated in torch operations against dense solves, and chains against their tridiagonal systems."""

import numpy as np
import pytest
import torch

from torchlinf.field import elimination
from torchlinf.field.elimination import Terms, solve_by_elimination
from torchlinf.field.policy_graph import _chain_weights


def random_system(seed: int, counts: list[int]) -> tuple[Terms, torch.Tensor, torch.Tensor, np.ndarray]:
    """Two terms an equation, twice the same or its own unknown at times, circles all over; terms, rank, shape, x."""
    random = np.random.default_rng(seed)
    total = sum(counts)
    dense, constant = np.eye(total), random.uniform(0.1, 1, total)
    row, of, weight = list(range(total)), [total] * total, list(constant)
    first = 0
    for count in counts:
        for i in range(first, first + count):
            for other in first + random.integers(count, size=2):
                value = random.uniform(0.2, 0.49)
                dense[i, other] -= value
                row.append(i), of.append(int(other)), weight.append(value)
        first += count
    terms = Terms(torch.tensor(row), torch.tensor(of), torch.tensor(weight, dtype=torch.float64))
    rank = torch.cat([torch.arange(count) for count in counts])
    shape = torch.repeat_interleave(torch.arange(len(counts)), torch.tensor(counts))
    return terms, rank, shape, np.linalg.solve(dense, constant)


@pytest.mark.parametrize("few", [0, 7, 160])
@pytest.mark.parametrize("counts", [[1], [40], [150, 3, 61]])
def test_the_solution_is_that_of_a_dense_solve(counts: list[int], few: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elimination, "FEW", few)
    terms, rank, shape, expected = random_system(len(counts), counts)
    np.testing.assert_allclose(solve_by_elimination(terms, rank, shape).numpy(), expected, rtol=1e-10)


def test_a_system_does_not_depend_on_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elimination, "FEW", 7)
    terms, rank, shape, _ = random_system(5, [80, 50])
    together = solve_by_elimination(terms, rank, shape)
    second = (terms.row >= 80).nonzero()[:, 0]
    alone = Terms(terms.row[second] - 80, terms.of[second] - 80, terms.weight[second])
    assert torch.equal(solve_by_elimination(alone, rank[80:], shape[80:] - 1), together[80:])


def test_a_system_without_a_solution_does_not_touch_the_others() -> None:
    """x = y + 1 and y = x in one shape; x = y / 2 + 1 and y = 1 in the other."""
    terms = Terms(torch.tensor([0, 0, 1, 2, 2, 3]), torch.tensor([1, 4, 0, 3, 4, 4]), torch.ones(6).double())
    terms.weight[3] = 0.5
    found = solve_by_elimination(terms, torch.tensor([0, 1, 0, 1]), torch.tensor([0, 0, 1, 1]))
    assert not found[:2].isfinite().any()
    assert found[2:].tolist() == [1.5, 1.0]


def test_the_solution_does_not_follow_the_number_of_threads() -> None:
    """A batched torch.linalg.solve of torch 2.13 is wrong after torch.set_num_threads, from about 150 unknowns on."""
    terms, rank, shape, expected = random_system(3, [150, 158, 155, 160])
    before = torch.get_num_threads()
    try:
        for threads in (1, 2, 4):
            torch.set_num_threads(threads)
            np.testing.assert_allclose(solve_by_elimination(terms, rank, shape).numpy(), expected, rtol=1e-10)
    finally:
        torch.set_num_threads(before)


@pytest.mark.parametrize("rho", [0.01, 3.0, 1e6])
@pytest.mark.parametrize("length", [1, 2, 9])
@pytest.mark.parametrize("peak", [False, True])
def test_a_chain_is_its_tridiagonal_system(length: int, peak: bool, rho: float) -> None:
    s = rho**-2
    dense = (2 + s) * np.eye(length) - np.eye(length, k=1) - np.eye(length, k=-1)
    below, above, source = (np.zeros(length) for _ in range(3))
    below[0], source[:] = 1, 1
    if peak:
        dense[-1, -1] -= 1  # the highest is its own up neighbour
    else:
        above[-1] = 1
    expected = np.linalg.solve(dense, np.stack([below, above, source], axis=1)).T
    ones = torch.ones(length, dtype=torch.int64)
    weights = _chain_weights(torch.arange(1, length + 1), length * ones, ones.bool() & peak, ones.double() * s)
    for found, wanted in zip(weights, expected, strict=True):
        np.testing.assert_allclose(found.numpy(), wanted, rtol=1e-7, atol=1e-300)
