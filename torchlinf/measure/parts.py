"""The parts of masks that are measured one by one, objects or rotations, and how their numbers become one."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchlinf.measure.entropy import segment_sum
from torchlinf.measure.levels import first_level, owners

if TYPE_CHECKING:
    from torchlinf.measure.profile import ComplexityProfile


@dataclass(frozen=True, eq=False)
class Parts:
    """What a profile was pooled from: the objects of each mask, or the rotations of each shape.

    P parts of N masks, those of the first mask first.

    Attributes:
        profile: of the leading shape (P,), the parts alone. Of objects with orientation="mean" it has parts itself, the
            rotations of each object.
        owner: (P,) int64, ascending: the number of the mask that each part belongs to, in the flattened batch.
        weight: (P,) int64, how much each part counts in the mean: 1, or for pool="area" its pixels.
        pixels: (P,) int64, pixels of each object in the mask, before any turn; None for rotations.
        box: (P, spatial dimensions, 2) int64, the box of each object in the mask: first row and the one behind the
            last, first column and the one behind the last, and so on; None for rotations.

    Example:
        >>> import torchlinf
        >>> mask = torch.tensor([[1, 1, 0, 0, 0], [1, 1, 0, 1, 1]])
        >>> parts = torchlinf.complexity_profile(mask, per="object", spatial_ndim=2).parts
        >>> parts.owner, parts.pixels, parts.box[1].tolist()
        (tensor([0, 0]), tensor([4, 2]), [[1, 2], [3, 5]])
    """

    profile: "ComplexityProfile"
    owner: Tensor
    weight: Tensor
    pixels: Tensor | None
    box: Tensor | None

    def number(self) -> Tensor:
        """(P,) int64: the number of each part within its mask, from 1.

        Example:
            >>> import torchlinf
            >>> masks = torch.tensor([[[1, 0, 1]], [[0, 1, 0]]])
            >>> torchlinf.complexity_profile(masks, per="object", spatial_ndim=2).parts.number()
            tensor([1, 2, 1])
        """
        begin = torch.searchsorted(self.owner, self.owner)
        return torch.arange(1, len(self.owner) + 1, device=self.owner.device) - begin

    def counts(self, masks: int) -> Tensor:
        """(masks,) int64: how many parts each mask has."""
        return torch.zeros(masks, dtype=torch.int64, device=self.owner.device).index_add(
            0, self.owner, torch.ones_like(self.owner)
        )

    def pooled(self, values: Tensor, masks: int) -> Tensor:
        """The weighted mean of the numbers of the parts of each mask.

        It does not depend on the order of the parts. The numbers of a single part are kept to the last bit. The
        rotations of an empty mask are NaN, and so is their mean.

        Args:
            values: (P, L), any count of numbers a part.
            masks: how many masks there are.

        Returns:
            (masks, L); NaN for a mask without parts.
        """
        length = values.shape[1]
        counts, column = self.counts(masks), torch.arange(length, device=values.device)
        total = torch.zeros_like(counts).index_add(0, self.owner, self.weight)
        terms = values.nan_to_num(nan=0.0) * self.weight.to(values)[:, None]
        # No value exceeds 32, as no level does.
        bound = (32 * total)[:, None].expand(-1, length).flatten()
        summed = segment_sum(terms.flatten(), (self.owner[:, None] * length + column).flatten(), bound)
        mean = summed.reshape(masks, length) / total.to(values)[:, None]
        alone = (counts == 1)[self.owner]
        mean[self.owner[alone]] = values[alone]
        empty = torch.zeros_like(counts).index_add(0, self.owner, values.isnan().any(dim=1).long()) > 0
        return mean.masked_fill(((counts == 0) | empty)[:, None], torch.nan)

    def total(self, values: Tensor, masks: int) -> Tensor:
        """The sum of one number a part, for each mask."""
        return values.new_zeros(masks).index_add(0, self.owner.to(values.device), values)

    def largest(self, values: Tensor, masks: int) -> Tensor:
        """The largest of one number of 0 or more a part, for each mask; 0 for a mask without parts."""
        return values.new_zeros(masks).scatter_reduce(0, self.owner, values, "amax")

    def select(self, masks: Tensor, count: int) -> "Parts":
        """The parts of some of the masks, (M,) of their numbers, in this order; they are numbered anew."""
        counts = self.counts(count)
        size, begin = counts[masks], first_level(counts)[masks]
        owner = owners(size)
        index = torch.arange(len(owner), device=masks.device) - (first_level(size) - begin)[owner]
        pixels, box = (None if one is None else one[index] for one in (self.pixels, self.box))
        return Parts(self.profile[index], owner, self.weight[index], pixels, box)

    def mapped(self, move: Callable[["ComplexityProfile"], "ComplexityProfile"], device: torch.device) -> "Parts":
        """The parts on a device, where `move` brings their profile."""
        return replace(
            self,
            profile=move(self.profile),
            owner=self.owner.to(device),
            weight=self.weight.to(device),
            pixels=None if self.pixels is None else self.pixels.to(device),
            box=None if self.box is None else self.box.to(device),
        )

    def steps(self) -> tuple[Tensor, Tensor, Tensor]:
        """The steps of the mean of all parts against scale: see `ComplexityProfile.steps`."""
        each = [self.profile[i].steps() for i in range(len(self.owner))]
        ends = torch.unique(torch.cat([end for end, _, _ in each]))
        middles = (ends + torch.cat([ends.new_zeros(1), ends[:-1]])) / 2
        weight = self.weight.to(ends) / self.weight.sum()
        values, bounds = torch.zeros_like(ends), torch.zeros_like(ends)
        for share, (end, value, bound) in zip(weight, each, strict=True):
            at = torch.searchsorted(end, middles)
            values += share * value[at]
            bounds += share * bound[at]
        return ends, values, bounds
