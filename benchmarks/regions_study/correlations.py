"""Rank correlations over the classifiers of one data set and seed, and their means over seeds and sets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

Numbers = NDArray[np.float64]
Columns = Mapping[str, Sequence[float]]  # one number a classifier, by what is measured


@dataclass(frozen=True)
class Mean:
    """A mean and its standard error; `above` of the numbers are greater than 0."""

    value: float
    error: float
    above: int
    count: int


def spearman(first: Sequence[float], second: Sequence[float]) -> float:
    """Spearman's rank correlation; NaN where either is constant."""
    return partial(first, second, [])


def partial(first: Sequence[float], second: Sequence[float], given: Sequence[Sequence[float]]) -> float:
    """Spearman's partial rank correlation: of the ranks, less what is linear in the ranks of the given numbers.

    NaN where nothing of either is left.
    """
    left = _left_over(np.stack([rankdata(first), rankdata(second)]), given)
    length = np.sqrt((left**2).sum(axis=1))
    if (length < 1e-6 * len(first)).any():
        return float("nan")
    return float(left[0] @ left[1] / length.prod())


def _left_over(ranks: Numbers, given: Sequence[Sequence[float]]) -> Numbers:
    terms = np.stack([np.ones(ranks.shape[1]), *(rankdata(one) for one in given)], axis=1)
    left: Numbers = (ranks.T - terms @ np.linalg.lstsq(terms, ranks.T, rcond=None)[0]).T
    return left


def over_seeds(runs: Sequence[Columns], first: str, second: str, given: Sequence[str] = ()) -> Numbers:
    """The correlation for each seed of one data set, those without one left out."""
    found = np.array([partial(run[first], run[second], [run[name] for name in given]) for run in runs])
    return found[~np.isnan(found)]


def mean_of(values: Sequence[float] | Numbers) -> Mean:
    """Mean of independent numbers, those that are NaN left out; its error is NaN if fewer than two are left."""
    numbers = np.asarray(values)
    numbers = numbers[~np.isnan(numbers)]
    mean = float(numbers.mean()) if len(numbers) else np.nan
    error = float(numbers.std(ddof=1) / np.sqrt(len(numbers))) if len(numbers) > 1 else np.nan
    return Mean(mean, error, int((numbers > 0).sum()), len(numbers))
