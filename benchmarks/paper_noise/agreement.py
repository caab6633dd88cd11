"""Kendall's tau of the data sets, and how far its means are from the paper's."""

import ast
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from benchmarks.paper_noise.squares import FACTORS, Assumptions, noisy_squares
from torchlinf import ComplexityProfile, complexity_profile
from torchlinf.order import kendall_tau

PAGE = Path(__file__).parents[2] / "examples" / "paper" / "plot_paper_07_noise.py"
SCALES = tuple(k / 10 for k in range(1, 10))
PAPER_SETS = 50
DRAWS = 4000

Numbers = NDArray[np.float64]


def paper_table(name: str) -> dict[str, tuple[float, ...]]:
    """A table of the paper by its rows, from the gallery page, where it stands: "PAPER_MEANS" or "PAPER_STDS"."""
    for node in ast.parse(PAGE.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            return ast.literal_eval(node.value)
    raise AssertionError(f"the page holds no {name}")


def taus(assumptions: Assumptions, measure: str, sets: int) -> Numbers:
    """Modified Kendall tau of each data set: (sets, rows of the paper's table, scales).

    `measure` is "at" for the complexity at t, "up to" for its mean over (0, t].
    """
    found = [[_measured(profile, measure) for profile in row] for row in _profiles(assumptions, sets)]
    size = len(FACTORS)
    return np.array([_rows(found[number * size : (number + 1) * size]) for number in range(sets)])


def _rows(table: Sequence[Sequence[ComplexityProfile]]) -> list[list[float]]:
    """By the number of additions for each factor, then by the factor for each number."""
    return [kendall_tau(row).tolist() for row in [*table, *zip(*table, strict=True)]]


@lru_cache(maxsize=1)
def _profiles(assumptions: Assumptions, sets: int) -> list[list[ComplexityProfile]]:
    """For each data set and factor the profiles of its squares."""
    keys, console = list(product(range(sets), FACTORS)), Console(stderr=True)

    def solve(key: tuple[int, int]) -> list[ComplexityProfile]:
        masks = noisy_squares(assumptions, key[1], key[0])
        return [complexity_profile(mask, scales=SCALES, spatial_ndim=2) for mask in masks]

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        done = pool.map(solve, keys)
        return list(track(done, "rows of squares", len(keys), console=console, disable=not console.is_terminal))


def _measured(profile: ComplexityProfile, measure: str) -> ComplexityProfile:
    if measure == "at":
        return profile
    means, bounds = (torch.stack([of(0.0, t) for t in SCALES]) for of in (profile.mean, profile.error_bound))
    # As the levels of a shape of that many levels, so that each mean has its own error bound.
    size = torch.tensor(len(SCALES))
    scales = torch.arange(1, len(SCALES) + 1, dtype=torch.float64) / size
    return replace(profile, scales=scales, values=means, radius=size, level_values=means, level_error_bound=bounds)


@dataclass(frozen=True)
class Fit:
    """How far a table is from the paper's, and how far that of the same data would be by chance.

    Attributes:
        mean: |difference|, mean over the table.
        largest: |difference|, largest of the table.
        expected: what `mean` would be, on average, if the paper's data sets were made as ours.
        limit: what it would exceed in 5 % of such papers.
    """

    mean: float
    largest: float
    expected: float
    limit: float

    @property
    def fits(self) -> bool:
        """Whether chance alone explains the difference."""
        return self.mean <= self.limit


def fit_means(tau: Numbers, paper: Numbers) -> Fit:
    """Compare means, and draw papers and repetitions from our data sets to see what chance does."""
    papers, ours = (redrawn_means(tau, size, seed) for seed, size in enumerate((PAPER_SETS, len(tau))))
    return _fit(tau.mean(axis=0), paper, papers, ours)


def fit_stds(tau: Numbers, paper: Numbers) -> Fit:
    """The same of the standard deviations."""
    papers, ours = (redrawn_stds(tau, size, seed) for seed, size in enumerate((PAPER_SETS, len(tau))))
    return _fit(tau.std(axis=0, ddof=1), paper, papers, ours)


def _fit(found: Numbers, paper: Numbers, papers: Numbers, ours: Numbers) -> Fit:
    """`papers` and `ours` are tables that chance would make: (draws, rows, scales)."""
    apart = np.abs(found - paper)
    chance = np.abs(papers.round(2) - ours).mean(axis=(1, 2))
    return Fit(apart.mean(), apart.max(), chance.mean(), np.quantile(chance, 0.95))


def redrawn_means(tau: Numbers, size: int, seed: int) -> Numbers:
    """Means that papers of `size` data sets would report: (draws, rows, scales)."""
    return (_redrawn(tau, size, seed) @ _flat(tau)).reshape(-1, *tau.shape[1:])


def redrawn_stds(tau: Numbers, size: int = PAPER_SETS, seed: int = 2) -> Numbers:
    """Standard deviations that papers of `size` data sets would report: (draws, rows, scales)."""
    weights = _redrawn(tau, size, seed)
    variance = weights @ _flat(tau) ** 2 - (weights @ _flat(tau)) ** 2
    unbiased = variance.clip(min=0) * size / (size - 1)
    return np.sqrt(unbiased).reshape(-1, *tau.shape[1:])


def _redrawn(tau: Numbers, size: int, seed: int) -> Numbers:
    """Shares with which each data set is in `size` of them drawn with replacement: (draws, sets)."""
    return np.random.default_rng(seed).multinomial(size, np.full(len(tau), 1 / len(tau)), DRAWS) / size


def _flat(tau: Numbers) -> Numbers:
    return tau.reshape(len(tau), -1)
