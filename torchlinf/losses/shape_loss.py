"""Losses that simplify what a network predicts."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from torchlinf._checks import MAX_SPATIAL_NDIM, choice, count, fraction, window

__all__ = ["ShapeComplexityLoss"]

WORST = 10.0  # bits: log2 of the 1024 bins, which the complexity of no shape exceeds

Activation = str | Callable[[Tensor], Tensor] | None
ACTIVATIONS: dict[str, Callable[[Tensor], Tensor]] = {
    "sigmoid": torch.sigmoid,
    "softmax": lambda logits: torch.softmax(logits, dim=1),
}
REDUCTIONS = ("none", "mean", "sum")


class ShapeComplexityLoss(nn.Module):
    """Hard complexity of predicted shapes, with a gradient that moves their boundaries.

    The value is `torchlinf.complexity` of the thresholded prediction, so that what is logged is what a user would
    measure. Its gradient comes from exact moves: regions of the shape that might be removed or
    filled as a whole are tried one by one, and the change dC that each of them makes to the complexity is spread over
    its pixels. Moving the probability of a region R by a small e changes the loss by e dC(R), up to other moves that
    overlap R.

    It regularises; it does not know what is in the image. Add it to a data term, such as Dice or cross-entropy. A
    `weight` of 0.1 to 10 beside a cross-entropy averaged over pixels is a range to begin with. It is most useful once
    the predicted shapes resemble something: let a network train some epochs without it.

    Args:
        low: lower end of the window of scales, excluded. Scales are fractions of each shape's own radius.
        high: upper end, included; 0 <= low < high <= 1. Small scales are near the boundary: (0, 0.25] asks for a
            smooth outline and leaves the gross form alone.
        weight: factor of the loss, a number or one for each channel (after the background is dropped), 0 or more.
        activation: what makes probabilities of the input: None if it holds them already, "sigmoid", "softmax" (over
            the channels), or a callable.
        reduction: "mean" over the shapes, "sum", or "none" for a (B, C) tensor.
        include_background: if False, channel 0 is dropped.
        keep_area: if True, a constant is added to the density wherever the prediction is in doubt, such that the loss
            neither gains nor loses when all logits of a shape rise or fall together. Most moves that simplify remove
            pixels; a network soon learns what they have in common, which is to shrink everything. Recommended for
            networks; leave it False where pixels are free parameters and what is to go is larger than what stays in
            doubt.
        threshold: a pixel is inside a shape if its probability is larger; in (0, 1).
        max_moves: moves tried per shape at most, spread over all sizes of regions. Each is one solve; the time of a
            step is about that of `torchlinf.complexity` on (1 + max_moves) B C masks.
        deformations: if True, each shape is also scaled, stretched, sheared, turned and squared, a little to and fro,
            and the gradient corrected so that its slope along them is right, unless the shape is rough. It then knows
            better what slivers along all sides at once are worth, for 20 more solves a shape (44 in three dimensions).

    Shape:
        - input: (B, C, *spatial) with 1 to 3 spatial dimensions, each (b, c) one shape, floating point, any device; the
          moves are computed on the CPU. float16 and bfloat16 give a float32 loss.
        - target: like input, optional. The loss needs no target. If one is given, shapes that are empty in it (classes
          that are not in the image) are left out: they count neither in the loss nor in the mean.
        - mask: broadcastable to input, bool, optional; where it is False no gradient goes. The shape's geometry is
          still that of the whole prediction. For labels (B, *spatial) with an `ignore_index` pass
          `(labels != ignore_index)[:, None]`.
        - output: a number, or (B, C) for reduction "none", with zeros for shapes left out.

    An empty shape is not a simple shape: it costs 10 bits, which the complexity of no shape exceeds, and no move that
    removes more than half of a shape is tried. No gradient can bring an empty shape back; that is the data term's task.
    A full prediction is a box: value 0. NaN in the input gives NaN.

    Differentiable once in the input; second derivatives see a constant gradient. Deterministic, the same for flipped
    input, and independent of the rest of the batch. It works under `torch.compile` (the moves are one opaque step) and
    under autocast.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value, or the input a wrong shape or values outside [0, 1].

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020; the gradient is this library's.

    Example:
        >>> from torchlinf import shapes
        >>> shape = shapes.with_appendages((9, 9), [shapes.Appendage("right", 3, 2)], margin=2)
        >>> logits = (4.0 * shape - 2.0)[None, None].requires_grad_()
        >>> loss = ShapeComplexityLoss(activation="sigmoid")(logits)
        >>> loss.backward()
        >>> loss.item(), bool((logits.grad[0, 0, 5:8, 11:13] > 0).all())  # descent removes the appendage
        (0.2368..., True)
    """

    def __init__(
        self,
        low: float = 0.0,
        high: float = 1.0,
        weight: float | Sequence[float] | Tensor = 1.0,
        activation: Activation = None,
        reduction: str = "mean",
        *,
        include_background: bool = True,
        keep_area: bool = False,
        threshold: float = 0.5,
        max_moves: int = 16,
        deformations: bool = False,
    ) -> None:
        super().__init__()
        self.low, self.high = window(low, high)
        self.activation = _activation(activation)
        self.reduction = choice(reduction, REDUCTIONS, "reduction")
        self.include_background = bool(include_background)
        self.keep_area = bool(keep_area)
        self.threshold = fraction(threshold, "threshold")
        self.max_moves = count(max_moves, "max_moves")
        self.deformations = bool(deformations)
        self.weight: Tensor
        self.register_buffer("weight", _weight(weight), persistent=False)

    def forward(self, input: Tensor, target: Tensor | None = None, mask: Tensor | None = None) -> Tensor:
        """The loss of a batch; see the class."""
        _check_input(input, target)
        if self.activation is ACTIVATIONS["softmax"] and input.shape[1] == 1:
            raise ValueError(
                'activation="softmax" needs 2 channels or more; got 1, of which every probability is 1. Pass "sigmoid".'
            )
        probability = input if self.activation is None else self.activation(input)
        if probability.dtype in (torch.float16, torch.bfloat16):
            probability = probability.float()
        if not self.include_background:
            if input.shape[1] == 1:
                raise ValueError(
                    "include_background=False needs 2 channels or more; got 1, which would leave nothing. "
                    "Pass include_background=True."
                )
            probability = probability[:, 1:]
            target = target if target is None else target[:, 1:]
            mask = mask if mask is None or mask.shape[1] == 1 else mask[:, 1:]
        return self._reduce(self._complexity(probability, mask), target)

    def extra_repr(self) -> str:
        """The options, for print."""
        return (
            f"low={self.low}, high={self.high}, reduction={self.reduction!r}, max_moves={self.max_moves}, "
            f"deformations={self.deformations}"
        )

    def _complexity(self, probability: Tensor, mask: Tensor | None) -> Tensor:
        """(B, C): the hard values, with the gradient of the moves."""
        flat = probability.flatten(0, 1)
        value, density = exact_moves(
            flat.detach(), self.threshold, self.low, self.high, self.max_moves, self.deformations
        )
        here = torch.ones_like(flat) if mask is None else mask.expand_as(probability).flatten(0, 1).to(flat)
        density = density * here
        if self.keep_area:
            density = _without_area(density, here * (flat * (1 - flat)).detach())
        # A zero that has the gradient of sum(density * p).
        carrier = density * (flat - flat.detach())
        return (value + carrier.flatten(1).sum(dim=1)).reshape(probability.shape[:2])

    def _reduce(self, value: Tensor, target: Tensor | None) -> Tensor:
        weight = self.weight.to(value)
        if weight.ndim and len(weight) != value.shape[1]:
            raise ValueError(
                f"weight must be a number or hold one for each of the {value.shape[1]} channels; got {len(weight)}. "
                "With include_background=False leave out that of the background."
            )
        value = value * weight
        number = value.new_tensor(value.numel())
        if target is not None:
            there = (target != 0).flatten(2).any(dim=2)
            value = torch.where(there, value, 0.0)
            number = there.sum().clamp(min=1)
        if self.reduction == "none":
            return value
        return value.sum() / number if self.reduction == "mean" else value.sum()


def _without_area(density: Tensor, doubt: Tensor) -> Tensor:
    """Subtract the multiple of p (1 - p) that makes the density neutral to a common shift of the logits, (N, *spatial).

    Such a shift changes p by p (1 - p), so that is the density's product with p (1 - p).

    Example:
        >>> _without_area(torch.tensor([[2.0, 0.0, 5.0]]), torch.tensor([[0.25, 0.25, 0.0]]))
        tensor([[ 1., -1.,  5.]])
    """
    flat, doubt = density.flatten(1), doubt.flatten(1)
    excess = (flat * doubt).sum(dim=1) / doubt.square().sum(dim=1).clamp(min=torch.finfo(doubt.dtype).tiny)
    return (flat - excess[:, None] * doubt).reshape(density.shape)


@torch.library.custom_op("torchlinf::exact_moves", mutates_args=())
def exact_moves(
    probability: Tensor, threshold: float, low: float, high: float, max_moves: int, deformations: bool = False
) -> tuple[Tensor, Tensor]:
    """Complexity (N,) of thresholded shapes (N, *spatial) and the density of its exact differences, like them.

    An operator of its own, so that torch.compile sees one opaque step and no graph breaks. The values of empty shapes
    are `WORST`. Not differentiable; `ShapeComplexityLoss` makes a gradient of the density.

    Example:
        >>> exact_moves(torch.ones(1, 4, 6), 0.5, 0.0, 1.0, 16)[0]
        tensor([0.])
    """
    from torchlinf.losses.region_flips import move_gradient

    there = probability.detach().cpu()
    if bool(((there < 0) | (there > 1)).any()):
        raise ValueError(
            f"input must hold probabilities in [0, 1]; got values from {there.min():.4g} to {there.max():.4g}. "
            'Pass activation="sigmoid" or "softmax" for logits.'
        )
    value, density = move_gradient(
        there, threshold=threshold, low=low, high=high, max_moves=max_moves, deformations=deformations
    )
    return value.nan_to_num(nan=WORST).to(probability), density.to(probability)


@exact_moves.register_fake
def _(
    probability: Tensor, threshold: float, low: float, high: float, max_moves: int, deformations: bool = False
) -> tuple[Tensor, Tensor]:
    return probability.new_empty(len(probability)), torch.empty_like(probability)


def _activation(activation: Activation) -> Callable[[Tensor], Tensor] | None:
    if activation is None or callable(activation):
        return activation
    if not isinstance(activation, str):
        raise TypeError(
            f"activation must be None, a name or a callable; got {activation!r}. Pass for example torch.sigmoid."
        )
    return ACTIVATIONS[choice(activation, tuple(ACTIVATIONS), "activation")]


def _weight(weight: float | Sequence[float] | Tensor) -> Tensor:
    tensor = torch.as_tensor(weight, dtype=torch.float64).detach().clone()
    if tensor.ndim > 1 or not bool((torch.isfinite(tensor) & (tensor >= 0)).all()):
        raise ValueError(
            f"weight must be one number or a row of them, finite and 0 or more; got {weight!r}. Pass for example 1.0."
        )
    return tensor


def _check_input(input: Tensor, target: Tensor | None) -> None:
    if not isinstance(input, Tensor):
        raise TypeError(f"input must be a torch.Tensor; got {type(input).__name__}. Pass torch.as_tensor(...).")
    if not input.is_floating_point():
        raise TypeError(f"input must be floating point; got {input.dtype}. Pass probabilities or logits.")
    if not 3 <= input.ndim <= MAX_SPATIAL_NDIM + 2 or 0 in input.shape:
        raise ValueError(
            f"input must be (B, C, *spatial) with 1 to {MAX_SPATIAL_NDIM} spatial dimensions and not empty; "
            f"got {tuple(input.shape)}. Pass input[None, None] for one image."
        )
    if target is not None and target.shape != input.shape:
        raise ValueError(
            f"target must have the shape of input, {tuple(input.shape)}; got {tuple(target.shape)}. "
            "Pass one channel for each class (one-hot)."
        )
