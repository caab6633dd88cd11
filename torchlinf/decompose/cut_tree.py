"""Parts of a shape that are simpler than the whole: the tree of cuts. Where cuts are tried is in `cut_candidates`.

A tree of cuts is grown from the whole down, each cut the one that most lowers the mean of the complexity over the area.
Then it is cut back, from the leaves up, to the parts of least objective. Growing and cutting back, as for decision
trees, finds what single steps do not: often no cut alone lowers the sum of the complexities, though many together do.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, Unpack

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.checks import as_mask, choice, not_negative
from torchlinf.decompose.cut_candidates import CANDIDATES, Cut, Mask
from torchlinf.measure import Measure, WindowOptions, complexities_after_flips, ragged_profile, takes

__all__ = ["Decomposition", "parts"]

Key: TypeAlias = tuple[tuple[int, ...], bytes]

SLACK = 1e-9  # bits; what is not lower by more counts as equal
OBJECTIVES = ("sum", "mean")
MOST_OF = 0.7  # share of a part from which on a piece is solved from the field of the part, which it changes little
FEW = 3  # such pieces of one part, from which on that pays: the part is solved for it once more


@dataclass(frozen=True, eq=False)
class Decomposition:
    """The parts of each shape of a batch; made by `parts`.

    `batch` stands for the batch shape of the mask, (B, C) by default.

    Attributes:
        label_map: int64 like the mask, 0 outside; the parts of each shape are 1, 2 ... from the largest on, equal ones
            by their place. `torchlinf.labels.complexity_table` takes it, for a row of numbers on each part.
        before: (*batch) float64, the complexity of the whole in bits (share of the field's maximum for "std"); NaN for
            an empty shape.
        after: (*batch) float64, the objective of the parts, without the penalty, in the same unit: never higher than
            `before`; NaN for an empty shape.
        num_parts: (*batch) int64; 0 for an empty shape, 1 for one that is left whole.
        num_solves: (*batch) int64, the certified fields that it took: one for each different piece that was tried,
            and one for each part that was cut.
        measure: how complexity was measured.
    """

    label_map: Tensor
    before: Tensor
    after: Tensor
    num_parts: Tensor
    num_solves: Tensor
    measure: Measure


@takes(WindowOptions)
def parts(
    mask: Tensor,
    *,
    penalty_per_part: float = 0.0,
    objective: Literal["sum", "mean"] = "sum",
    candidates: Literal["openings", "watershed"] = "openings",
    spatial_ndim: int | None = None,
    **options: Unpack[WindowOptions],
) -> Decomposition:
    """Cut shapes into parts that together are less complex than the whole.

    A shape stays whole if no decomposition that was found is strictly lower: boxes and all else of complexity zero do.
    A box with narrower boxes on its faces falls apart into them, of complexity zero. What is found is the best of one
    tree of cuts, not of all: no optimum is promised.

    Args:
        mask: (B, C, *spatial) with 1 to 4 spatial dimensions, values 0 or 1, nonzero is inside; each (b, c) is one
            shape.
        penalty_per_part: what every part beyond the first must save, 0 or more, in the unit of the complexity. Without
            a penalty most shapes fall into very many boxes.
        objective: what is to be lowered: "sum", of the complexities of the parts, or their "mean", weighted by area. A
            part of a complex shape is often hardly less complex than the whole, so that few parts lower the mean but
            not the sum.
        candidates: where cuts are tried: "openings", along the boundary of the union of all squares (cubes) of a side
            that fit into the part, for sides of all sizes; or "watershed", along the saddles of f.
        spatial_ndim: if given, that many last dimensions are spatial and all others are batch.
        {measure options}
            Scales are fractions of each part's own radius. Here rho must be None or one number, not a tensor.

    Returns:
        A `Decomposition`. A part is connected through faces of pixels, unless the shape was left whole. An empty shape
        has no parts and NaN values; a full mask is a box and stays whole. Deterministic, and what else is in the batch
        does not matter. Flips and axis swaps of a shape flip and swap its parts (the numbers of equal ones aside), as
        far as the errors of the fields allow: at the default `tol` they did on all shapes that were tried. The work is
        done on the CPU. Not differentiable.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong rank or value.
        RuntimeError: a field could not be solved to `tol`.

    Source: the complexity is that of Arslan and Tari, IEEE TIP 2020, who leave decomposition to future work; the rule:
    docs/method, "Parts".

    Example:
        >>> from torchlinf import shapes
        >>> shape = shapes.with_appendages((5, 5), [shapes.Appendage("right", 3, 2), shapes.Appendage("top", 1, 1)])
        >>> found = parts(shape, spatial_ndim=2)
        >>> found.label_map
        tensor([[0, 0, 3, 0, 0, 0, 0],
                [1, 1, 1, 1, 1, 0, 0],
                [1, 1, 1, 1, 1, 2, 2],
                [1, 1, 1, 1, 1, 2, 2],
                [1, 1, 1, 1, 1, 2, 2],
                [1, 1, 1, 1, 1, 0, 0]])
        >>> float(found.before) > 0.5, float(found.after)
        (True, 0.0)
    """
    measure = Measure.of(options, WindowOptions)
    measure.scalar_rho()
    rule = _Rule(
        penalty_per_part=not_negative(penalty_per_part, "penalty_per_part"),
        objective=choice(objective, OBJECTIVES, "objective"),
        candidates=choice(candidates, tuple(CANDIDATES), "candidates"),
        measure=measure,
    )
    shapes, batch_shape = as_mask(mask, spatial_ndim)
    label_map = torch.zeros(shapes.shape, dtype=torch.int64, device="cpu")
    values = torch.full((2, len(shapes)), torch.nan, dtype=torch.float64, device="cpu")  # before, after
    counts = torch.zeros((2, len(shapes)), dtype=torch.int64, device="cpu")  # parts, solves
    for i, shape in enumerate(shapes.numpy(force=True)):
        if shape.any():
            tree = _Tree(shape, rule)
            leaves = tree.leaves()
            _number(label_map[i].numpy(), leaves)
            values[0, i], values[1, i] = tree.root.value, tree.objective(leaves)
            counts[0, i], counts[1, i] = len(leaves), tree.num_solves
    before, after, num_parts, num_solves = (row.reshape(batch_shape).to(mask.device) for row in (*values, *counts))
    return Decomposition(label_map.reshape(mask.shape).to(mask.device), before, after, num_parts, num_solves, measure)


@dataclass(frozen=True)
class _Rule:
    penalty_per_part: float
    objective: str
    candidates: str
    measure: Measure


@dataclass(eq=False)
class _Part:
    """A part in its own box, the low corner of that box, its complexity, and what it was cut into."""

    mask: Mask
    corner: tuple[int, ...]
    value: float = np.nan
    area: int = 0
    pieces: list["_Part"] = field(default_factory=list)


class _Tree:
    """The cuts of one shape, from the whole (the root) down, and the fields that they took."""

    def __init__(self, shape: Mask, rule: _Rule) -> None:
        self.rule, self.num_solves = rule, 0
        self._known: dict[Key, float] = {}
        (self.root,) = _boxed(shape.astype(np.int32))
        self._measure([self.root])
        waiting = [self.root]
        while waiting:
            part = waiting.pop()
            if part.value > SLACK:
                part.pieces = self._best_cut(part)
                waiting += part.pieces

    def leaves(self) -> list[_Part]:
        """The parts of least objective, penalties included, that the tree can be cut back to."""
        return self._cut_back(self.root)[1]

    def objective(self, parts: list[_Part]) -> float:
        """Sum of the complexities, or their mean over the area; the same in whatever order the parts come."""
        return sum(sorted(self._weighted(part) for part in parts))

    def _weighted(self, part: _Part) -> float:
        return part.value if self.rule.objective == "sum" else part.value * part.area / self.root.area

    def _measure(self, pieces: list[_Part], part: _Part | None = None) -> None:
        """Set area and complexity of pieces, of that part if they are of one; each different mask is solved once."""
        keys = [_key(piece.mask) for piece in pieces]
        new = {key: piece for key, piece in zip(keys, pieces, strict=True) if key not in self._known}
        self.num_solves += len(new)
        for piece in pieces:
            piece.area = int(piece.mask.sum())
        if part is not None:
            near = {key: piece for key, piece in new.items() if piece.area >= MOST_OF * part.area}
            if len(near) >= FEW:
                self._known.update(zip(near, self._solved_from(part, list(near.values())), strict=True))
        rest = {key: piece.mask for key, piece in new.items() if key not in self._known}
        self._known.update(zip(rest, self._solved(list(rest.values())), strict=True))
        for key, piece in zip(keys, pieces, strict=True):
            piece.value = self._known[key]

    def _solved(self, masks: Sequence[Mask]) -> list[float]:
        """The complexities of masks."""
        measure = self.rule.measure
        found: list[float] = (
            ragged_profile(masks.__getitem__, len(masks), measure).mean(measure.low, measure.high).tolist()
        )
        return found

    def _solved_from(self, part: _Part, pieces: list[_Part]) -> list[float]:
        """The complexities of pieces of a part, each solved only where its field is another than that of the part."""
        flips = []
        for piece in pieces:
            off = part.mask.copy()
            off[_box_in(part, piece)] &= ~piece.mask
            flips.append(np.flatnonzero(off))
        ((_, found),) = complexities_after_flips([part.mask], [flips], self.rule.measure)
        values: list[float] = found.tolist()
        return values

    def _best_cut(self, part: _Part) -> list[_Part]:
        """The pieces of the candidate that most lowers the mean over the area, with penalties; none if none does."""
        self.num_solves += 1  # that of the candidates
        tried = [_boxed(cut, part.corner) for cut in CANDIDATES[self.rule.candidates](part.mask, self.rule.measure)]
        self._measure([piece for pieces in tried for piece in pieces], part)
        best: list[_Part] = []
        most = SLACK
        for pieces in tried:
            mean = sum(piece.value * piece.area for piece in pieces) / part.area
            gain = part.value - mean - self.rule.penalty_per_part * (len(pieces) - 1)
            # Gains that are equal up to rounding are told apart by what flips do not change.
            if gain > most + SLACK or (best and gain > most - SLACK and len(pieces) < len(best)):
                best, most = pieces, gain
        return best

    def _cut_back(self, part: _Part) -> tuple[float, list[_Part]]:
        """The least objective of what a part can be left as, penalties included, and the parts that reach it."""
        whole = self._weighted(part)
        below = [self._cut_back(piece) for piece in part.pieces]
        cut = sum(least for least, _ in below) + self.rule.penalty_per_part * (len(below) - 1)
        if below and cut < whole - SLACK:
            return cut, [leaf for _, leaves in below for leaf in leaves]
        return whole, [part]


def _boxed(cut: Cut, corner: tuple[int, ...] = ()) -> list[_Part]:
    """The pieces of a cut, each in its box; `corner` is that of the box of the cut."""
    from scipy.ndimage import find_objects

    pieces = []
    for number, box in enumerate(find_objects(cut), start=1):
        inner = tuple(side.start for side in box)
        pieces.append(_Part(cut[box] == number, tuple(map(sum, zip(inner, corner, strict=True))) if corner else inner))
    return pieces


def _key(mask: Mask) -> Key:
    """The same for the same masks, wherever they lie, and for different ones as good as never."""
    return mask.shape, hashlib.blake2b(np.packbits(mask).tobytes(), digest_size=16).digest()


def _box_in(part: _Part, piece: _Part) -> tuple[slice, ...]:
    """The box of a piece in the array of the part that it is of."""
    sides = zip(piece.corner, part.corner, piece.mask.shape, strict=True)
    return tuple(slice(low - base, low - base + size) for low, base, size in sides)


def _number(label_map: NDArray[np.int64], parts: list[_Part]) -> None:
    """Write the parts into a map of zeros, the largest as 1."""
    for number, part in enumerate(sorted(parts, key=lambda part: (-part.area, part.corner)), start=1):
        box = tuple(slice(low, low + size) for low, size in zip(part.corner, part.mask.shape, strict=True))
        label_map[box][part.mask] = number
