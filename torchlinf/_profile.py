"""The result of `complexity_profile`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchlinf._checks import window
from torchlinf.entropy import first_level, segment_sum


@dataclass(frozen=True, eq=False)
class ComplexityProfile:
    """Complexity of each shape of a batch against scale; made by `complexity_profile`.

    Scale t in (0, 1] is the distance as a fraction of the shape's radius D, and belongs to level k = ceil(t D).
    `lead` stands for the leading dimensions of the mask, (B, C) by default.

    Attributes:
        scales: (L,) the scale grid.
        values: (*lead, L) the level value (bits for "entropy", share of the field's maximum for "std") at each scale;
            NaN for an empty shape.
        radius: (*lead) int64, D in pixels; 0 for an empty shape.
        error_bound: (*lead) float64, the certified relative error of the field at every pixel.
        level_values: (sum of radius,) float64, all levels of all shapes one after the other; `levels` splits it.
    """

    scales: Tensor
    values: Tensor
    radius: Tensor
    error_bound: Tensor
    level_values: Tensor

    def levels(self) -> Any:
        """Values of the levels themselves, without a scale grid.

        Returns:
            Lists nested like the leading dimensions, [b][c] by default, of 1-D tensors of the dtype of `values`: entry
            k - 1 is level k, and a shape of radius D has D entries, an empty one none. For a mask without leading
            dimensions it is that one tensor.

        Example:
            >>> import torchlinf
            >>> profile = torchlinf.complexity_profile(torch.ones(1, 1, 3, 6))
            >>> profile.levels()
            [[tensor([0., 0.], dtype=torch.float64)]]
        """
        parts = torch.split(self.level_values.to(self.values.dtype), self.radius.flatten().tolist())
        return _nest(parts, tuple(self.radius.shape))

    def mean(self, low: float = 0.0, high: float = 1.0) -> Tensor:
        """Exact mean over the scales in (low, high], not a mean over a grid of samples.

        It is sum_k E_k length(((k-1)/D, k/D] ∩ (low, high]) / (high - low).

        Args:
            low: lower end of the window, excluded.
            high: upper end of the window, included; 0 <= low < high <= 1.

        Returns:
            (*lead) tensor of the dtype of `values`, in its unit and range; NaN for an empty shape.

        Raises:
            TypeError: `low` or `high` is no number.
            ValueError: not 0 <= low < high <= 1.

        Example:
            >>> import torchlinf
            >>> profile = torchlinf.complexity_profile(torchlinf.shapes.disc(6), spatial_ndim=2)
            >>> profile.mean(), profile.mean(0.75, 1.0)
            (tensor(0.8227, dtype=torch.float64), tensor(0.1837, dtype=torch.float64))
        """
        low, high = window(low, high)
        shape, number = self._numbered()
        size = self.radius.flatten().to(self.level_values)[shape]  # (sum of radius,) the D that belongs to each level
        overlap = length_within(number, size, low, high)
        bound = torch.full_like(
            self.radius.flatten(), 32
        )  # no level value exceeds 20 bits, and the lengths add up to 1
        total = segment_sum(self.level_values * overlap, shape, bound) / (high - low)
        return self._lead(total.masked_fill(self.radius.flatten() == 0, torch.nan))

    def peak(self) -> tuple[Tensor, Tensor]:
        """Largest level value and the scale it is reached at.

        Returns:
            Two (*lead) tensors of the dtype of `values`: max_k E_k, and k/D of the first level that reaches it; both
            NaN for an empty shape.

        Example:
            >>> import torchlinf
            >>> torchlinf.complexity_profile(torchlinf.shapes.disc(8), spatial_ndim=2).peak()
            (tensor(1.2867, dtype=torch.float64), tensor(0.1667, dtype=torch.float64))
        """
        shape, number = self._numbered()
        radius = self.radius.flatten()
        value = self.level_values.new_full(radius.shape, torch.nan)
        value = value.scatter_reduce(0, shape, self.level_values, "amax", include_self=False)
        # Levels that do not reach the maximum stand behind every level that does.
        rank = torch.where(self.level_values == value[shape], number, number + radius[shape])
        first = radius.scatter_reduce(0, shape, rank, "amin", include_self=False)
        return self._lead(value), self._lead(first / radius.to(value))

    def _numbered(self) -> tuple[Tensor, Tensor]:
        """For each entry of `level_values` its shape in the flattened batch, and its level k."""
        radius = self.radius.flatten()
        shape = torch.repeat_interleave(radius)
        return shape, torch.arange(1, len(shape) + 1, device=radius.device) - first_level(radius)[shape]

    def _lead(self, flat: Tensor) -> Tensor:
        return flat.reshape(self.radius.shape).to(self.values.dtype)


def length_within(level: Tensor, radius: Tensor, low: float, high: float) -> Tensor:
    """Length of the scales in (low, high] that belong to a level: of ((k-1)/D, k/D] ∩ (low, high].

    Args:
        level: k, any shape.
        radius: D, floating point, broadcast with it.
        low: lower end of the window.
        high: its upper end.

    Returns:
        Tensor of the dtype of `radius`, in [0, 1/D].

    Example:
        >>> length_within(torch.arange(1, 5), torch.tensor(4.0), 0.375, 1.0)
        tensor([0.0000, 0.1250, 0.2500, 0.2500])
    """
    return ((level / radius).clamp(max=high) - ((level - 1) / radius).clamp(min=low)).clamp(min=0.0)


def _nest(parts: Sequence[Tensor], lead: tuple[int, ...]) -> Any:
    if not lead:
        return parts[0]
    step = len(parts) // max(lead[0], 1)
    return [_nest(parts[i * step : (i + 1) * step], lead[1:]) for i in range(lead[0])]
