"""A sampler for loaders that draws samples by their complexity."""

from collections.abc import Callable, Iterator, Sequence
from math import ceil, inf

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor
from torch.utils.data import Sampler

from torchlinf._helpers.checks import count, integer, number

__all__ = ["ComplexitySampler"]


class ComplexitySampler(Sampler[int]):
    """Draws samples of a dataset by their complexity: a range, weights, or a curriculum from simple to complex.

    Pass it as the `sampler` of a `DataLoader`. The scores are taken once, before training, by a pass over the dataset
    with `ShapeComplexityScore` or from the table of `torchlinf score`. Every epoch draws equally many indices, whatever
    the share, so that schedules of the learning rate need not know of it; a small pool is gone through several times.

    Args:
        scores: (N,) the complexity of each sample, a tensor, array, list or column of a table. Samples with NaN, those
            without a mask, are never drawn. Pass `-scores` to begin with the most complex ones.
        between: keep only samples whose score is in this closed range, for example (0.0, 3.0).
        share: the share of the kept samples, the simplest ones, that an epoch draws from: a number in (0, 1], or a
            function of the epoch (0, 1, 2 ...).
        weight: a function from scores (n,) to weights (n,), 0 or more; samples are drawn with replacement in proportion
            to them. None draws all alike, each as often as any other, up to one.
        num_samples: indices an epoch, over all replicas; None means as many as samples are kept.
        seed: of the order, which depends on it and on the epoch alone.
        num_replicas: number of processes that train together, each of which gets its own part.
        rank: which of them this is.

    The epoch advances with every pass; `set_epoch` sets it, as that of `DistributedSampler` does.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value, or no sample is kept.

    Example:
        >>> scores = torch.tensor([2.5, 0.0, torch.nan, 1.0, 4.0])
        >>> sampler = ComplexitySampler(scores, share=lambda epoch: min(1.0, 0.5 + 0.25 * epoch))
        >>> [sorted(sampler) for epoch in range(3)]
        [[1, 1, 3, 3], [0, 1, 1, 3], [0, 1, 3, 4]]
    """

    def __init__(
        self,
        scores: Tensor | ArrayLike,
        *,
        between: tuple[float, float] | None = None,
        share: float | Callable[[int], float] = 1.0,
        weight: Callable[[Tensor], Tensor] | None = None,
        num_samples: int | None = None,
        seed: int = 0,
        num_replicas: int = 1,
        rank: int = 0,
    ) -> None:
        values = _scores(scores)
        low, high = _range(between)
        kept = ((values >= low) & (values <= high)).nonzero()[:, 0]
        if not len(kept):
            raise ValueError(
                f"scores must hold a number between {low} and {high}; got none among {len(values)}. Widen `between`."
            )
        order = kept[values[kept].argsort(stable=True)]
        self.indices, self.scores = order, values[order]  # (n,) from simple to complex
        self.share = share if callable(share) else _share(share)
        if weight is not None and not callable(weight):
            raise TypeError(f"weight must be a function of the scores, or None; got {weight!r}. Pass torch.exp.")
        self.weight, self.seed = weight, integer(seed, "seed", 0)
        self.num_replicas, self.rank = count(num_replicas, "num_replicas"), integer(rank, "rank", 0)
        if self.rank >= self.num_replicas:
            raise ValueError(f"rank must be from 0 to {num_replicas - 1}; got {rank}. Pass that of this process.")
        self.length = ceil((len(order) if num_samples is None else count(num_samples, "num_samples")) / num_replicas)
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of the next pass, an integer of 0 or more."""
        self.epoch = integer(epoch, "epoch", 0)

    def __len__(self) -> int:
        """Indices an epoch, of this replica."""
        return self.length

    def __iter__(self) -> Iterator[int]:
        """One epoch."""
        generator = torch.Generator("cpu").manual_seed(self.seed + self.epoch)
        pool = self._pool(self.epoch)
        self.epoch += 1
        total = self.length * self.num_replicas
        if self.weight is None:
            rounds = [torch.randperm(pool, generator=generator, device="cpu") for _ in range(ceil(total / pool))]
            drawn = torch.cat(rounds)[:total]
        else:
            drawn = _draw(self._weights(pool), total, generator)
        return iter(self.indices[drawn[self.rank :: self.num_replicas]].tolist())

    def _pool(self, epoch: int) -> int:
        """How many of the samples, from the simplest on, an epoch draws from."""
        share = _share(self.share(epoch), f" in epoch {epoch}") if callable(self.share) else self.share
        return ceil(share * len(self.indices))

    def _weights(self, pool: int) -> Tensor:
        assert self.weight is not None
        answer = self.weight(self.scores[:pool])
        try:
            weights = _row(answer)
        except (TypeError, ValueError, RuntimeError):
            weights = torch.empty(0)
        good = weights.shape == (pool,) and bool((weights.isfinite() & (weights >= 0)).all()) and weights.sum() > 0
        if not good:
            raise ValueError(
                f"weight must give {pool} finite numbers of 0 or more, not all 0; got {answer}. "
                "Pass for example weight=torch.exp."
            )
        return weights


def _draw(weights: Tensor, number: int, generator: torch.Generator) -> Tensor:
    """Indices in proportion to their weights, with replacement; `torch.multinomial` takes 2^24 weights at most.

    Example:
        >>> _draw(torch.tensor([0.0, 2.0, 0.0]), 3, torch.Generator().manual_seed(0))
        tensor([1, 1, 1])
    """
    below = weights.double().cumsum(0)
    place = torch.rand(number, dtype=torch.float64, device="cpu", generator=generator) * below[-1]
    # A product that is rounded up to the sum belongs to the last that has a weight.
    return torch.searchsorted(below, place, right=True).clamp(max=int(weights.nonzero()[-1]))


def _row(numbers: Tensor | ArrayLike) -> Tensor:
    """Numbers as float64 on the CPU; columns of tables and read-only arrays too. What is masked is NaN."""
    if isinstance(numbers, Tensor):
        return numbers.detach().to("cpu", torch.float64)
    if np.ma.isMaskedArray(numbers):
        numbers = np.ma.filled(np.ma.asarray(numbers, dtype=np.float64), np.nan)
    array = np.asarray(numbers)
    if array.dtype.kind not in "biufO" or numbers is None:
        raise TypeError("no numbers")
    return torch.from_numpy(array.astype(np.float64))  # a copy, which may be written to


def _scores(scores: Tensor | ArrayLike) -> Tensor:
    try:
        values = _row(scores)
    except (TypeError, ValueError, RuntimeError):
        raise TypeError(
            f"scores must be a row of numbers; got {type(scores).__name__}. Pass a tensor or a list of floats."
        ) from None
    if values.ndim != 1:
        raise ValueError(f"scores must be (N,), one a sample; got {tuple(values.shape)}. Pass scores.flatten().")
    return values


def _range(between: tuple[float, float] | None) -> tuple[float, float]:
    if between is None:
        return -inf, inf
    if isinstance(between, np.ndarray):
        between = between.tolist()
    wanted = "a pair (lowest, highest) or None"
    if isinstance(between, str) or not isinstance(between, Sequence) or len(between) != 2:
        raise TypeError(f"between must be {wanted}; got {between!r}. Pass for example (0.0, 3.0).")
    low, high = (number(end, "between", wanted, "Pass for example (0.0, 3.0).") for end in between)
    if not low <= high:
        raise ValueError(f"between must be ordered, lowest first; got {between!r}. Pass for example (0.0, 3.0).")
    return low, high


def _share(share: float, when: str = "") -> float:
    found = number(share, "share", "a number in (0, 1] or a function that gives one", "Pass for example 0.5.")
    if not 0 < found <= 1:
        raise ValueError(f"share must be in (0, 1]; got {share!r}{when}. Pass for example 0.5.")
    return found
