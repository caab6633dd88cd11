"""Losses that simplify what a network predicts. Their gradient is computed in `torchlinf.losses.gradient`."""

from collections.abc import Callable, Sequence
from typing import Literal, Unpack

import torch
from torch import Tensor, nn

from torchlinf._helpers.checks import MAX_SPATIAL_NDIM, choice, count, flag, fraction, not_negative
from torchlinf._helpers.transfer import to_device, to_host
from torchlinf.losses.gradient import region_flip_gradient, require_probabilities, without_area
from torchlinf.losses.parts import consistent, cut_out, like_sizes, others_of, padded_to, parts_of
from torchlinf.measure import MeanOptions, Measure, takes

__all__ = ["ShapeComplexityLoss"]

Activation = Literal["sigmoid", "softmax"] | Callable[[Tensor], Tensor] | None
Weight = float | Sequence[float] | Tensor


def _softmax_over_channels(logits: Tensor) -> Tensor:
    return torch.softmax(logits, dim=1)  # a function with a name, which pickles


ACTIVATIONS: dict[str, Callable[[Tensor], Tensor]] = {"sigmoid": torch.sigmoid, "softmax": _softmax_over_channels}
REDUCTIONS = ("none", "mean", "sum")
LOW_PRECISION = (torch.float16, torch.bfloat16)


@takes(MeanOptions)
class ShapeComplexityLoss(nn.Module):
    """Hard complexity of predicted shapes, with a gradient that moves their boundaries.

    The value is `torchlinf.complexity` of the thresholded prediction, so that what is logged is what a user would
    measure. The gradient is a finite difference under region flips: regions of the shape are removed or filled as a
    whole, one by one, and the change dC that each flip makes to the complexity is spread over the pixels of its region.
    Moving the probability of a region R by a small e changes the loss by e dC(R), up to other regions that overlap R.

    With `per="object"` every object of a thresholded prediction is a shape of its own, and the loss of a prediction
    is the mean over its objects, as `pool` says. With an `orientation` every shape is turned first. What is flipped
    then are regions of the turned shape, and the gradient comes back to the pixels that it was interpolated from.

    It regularises; it does not know what is in the image. Add it to a data term, such as Dice or cross-entropy. It is
    most useful once the predicted shapes resemble something: let a network train some epochs without it. On photographs
    it did not make held-out shapes simpler, where `torchlinf.simplify` afterwards did: docs/regulariser.

    The right `weight` depends on the data term and on the task; begin low. Measured beside the sum of Dice and a
    cross-entropy averaged over pixels, on a small U-Net for 64 x 64 footprints of buildings: 0.06 lowered the
    complexity by 15 to 32 % and raised the IoU; 0.15 emptied shapes in one run. Watch the number of empty predictions
    (`torchlinf.metrics.ShapeComplexity` counts them), and lower the weight when it grows.

    Args:
        weight: factor of the loss, a number or one for each channel (after the background is dropped), 0 or more. It
            may be assigned between steps: `loss.weight = 0.06`.
        activation: what makes probabilities of the input: None if it holds them already, "sigmoid", "softmax" (over
            the channels), or a callable. float16 and bfloat16 inputs become float32 before it.
        reduction: "mean" over the shapes, "sum", or "none" for a (B, C) tensor.
        include_background: if False, channel 0 is dropped.
        keep_area: if True, the gradient is balanced wherever the prediction is in doubt, such that the loss neither
            gains nor loses when all logits of a shape rise or fall together. Most flips that simplify remove pixels,
            and a network soon learns what they have in common, which is to shrink everything: with False, in the
            training named above, all held-out predictions of one seed of two became empty. Pass False where the pixels
            themselves are the parameters: there a square with blocks grown onto it became the square again with False
            (complexity 0.65 to 0.06 bits), and a larger, more complex shape with True (0.65 to 0.82).
        threshold: a pixel is inside a shape if its probability is greater; in (0, 1).
        max_flips: regions that are flipped per shape at most, spread over all sizes of regions. Each is one solve; the
            time of a step is about that of `torchlinf.complexity` on (1 + max_flips) B C masks.
        deformations: if True, each shape is also scaled, stretched, sheared, turned and squared, a little backwards and
            forwards, and the gradient is corrected so that its slope along them is right, unless the shape is rough. It
            then knows better what slivers along all sides at once are worth, for 4, 20, 44 or 80 more solves a shape in
            1, 2, 3 or 4 dimensions.
        {measure options}
            Here rho must be None or one number, not a tensor.

    Attributes:
        measure: the `torchlinf.Measure` of the options.

    Shape:
        - input: (B, C, *spatial) with 1 to 4 spatial dimensions, each (b, c) one shape, floating point, any device. The
          flips are computed on the CPU: on another device the input makes one trip to the host, which waits for it
          once. float16 and bfloat16 give a float32 loss.
        - target: like input, optional; nonzero is inside. The loss needs no target. If one is given, shapes that are
          empty in it (classes that are not in the image) are left out: they count neither in the loss nor in the mean.
        - mask: broadcastable to input, bool, optional; where it is False no gradient goes. The shape's geometry is
          still that of the whole prediction. For labels (B, *spatial) with an `ignore_index` pass
          `(labels != ignore_index)[:, None]`.
        - output: a number, or (B, C) for reduction "none", with zeros for shapes left out; in bits (share of the
          field's maximum for "std"), times the weight.

    An empty shape, and with `per="object"` a prediction without an object of `min_pixels`, is not a simple shape: it
    costs `measure.largest`, which the complexity of no shape exceeds: 10 bits,
    the log2 of the bins, by default (0.5 for "std"). No region of more than half of a shape is flipped. No gradient can
    bring an empty shape back; that is the data term's task. A full prediction is a box: value 0. NaN in the input gives
    NaN.

    Differentiable once in the input; second derivatives see a constant gradient. Deterministic, and independent of the
    rest of the batch. A mirror image has the same loss and the mirrored gradient, as far as the errors of the fields
    allow: at the default `tol` to rounding, at a coarse one not. It works under `torch.compile` (the flips are one
    opaque step; with `orientation` or `per="object"` all of the loss is a break in the graph) and under autocast, and
    it pickles unless `activation` does not.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value, or the input a wrong shape or values outside [0, 1].
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020; the gradient is this library's, docs/training.

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
        *,
        weight: Weight = 1.0,
        activation: Activation = None,
        reduction: Literal["mean", "sum", "none"] = "mean",
        include_background: bool = True,
        keep_area: bool = True,
        threshold: float = 0.5,
        max_flips: int = 16,
        deformations: bool = False,
        **options: Unpack[MeanOptions],
    ) -> None:
        super().__init__()
        self.measure = Measure.of(options, MeanOptions)
        self.measure.scalar_rho()
        self.weight = weight
        self.activation = _activation(activation)
        self.reduction = choice(reduction, REDUCTIONS, "reduction")
        self.include_background = flag(include_background, "include_background")
        self.keep_area = flag(keep_area, "keep_area")
        self.threshold = fraction(threshold, "threshold")
        self.max_flips = count(max_flips, "max_flips")
        self.deformations = flag(deformations, "deformations")

    @property
    def weight(self) -> float | tuple[float, ...]:
        """The factor of the loss, a number or one for each channel."""
        return self._weight

    @weight.setter
    def weight(self, weight: Weight) -> None:
        # Plain numbers, not a buffer: `half()` would round it, and some devices have no float64.
        self._weight = _weight(weight)

    def forward(self, input: Tensor, target: Tensor | None = None, mask: Tensor | None = None) -> Tensor:
        """The loss of a batch; the class describes the shapes of `input`, `target` and `mask`."""
        _check_input(input, target, mask)
        if self.activation is _softmax_over_channels and input.shape[1] == 1:
            raise ValueError(
                'activation="softmax" needs 2 channels or more; got 1, of which every probability is 1. Pass "sigmoid".'
            )
        # Before the activation: sigmoid(0.001) is 0.5 in bfloat16, on the wrong side of the threshold.
        logits = input.float() if input.dtype in LOW_PRECISION else input
        probability = logits if self.activation is None else self.activation(logits)
        if probability.dtype in LOW_PRECISION:  # by a callable, or by autocast within it
            probability = probability.float()
        if not self.include_background:
            if input.shape[1] == 1:
                raise ValueError(
                    "include_background=False needs 2 channels or more; got 1, which would leave nothing. "
                    "Pass include_background=True."
                )
            probability = probability[:, 1:]
            target = target if target is None else target[:, 1:]
            mask = mask if mask is None else mask.expand_as(input)[:, 1:]
        if not self.measure.is_plain:
            return self._loss_of_parts(probability, mask, target)
        return self._reduce(self._complexity(probability, mask), target)

    def extra_repr(self) -> str:
        """The options, for print."""
        options = {
            "weight": self.weight,
            "reduction": self.reduction,
            "keep_area": self.keep_area,
            "max_flips": self.max_flips,
            "deformations": self.deformations,
            **self.measure.options(),
        }
        return ", ".join(f"{name}={value!r}" for name, value in options.items())

    def _complexity(self, probability: Tensor, mask: Tensor | None) -> Tensor:
        """(B, C): the hard values, with the gradient under region flips."""
        flat = probability.flatten(0, 1)
        value, gradient = self._flips(flat.detach())
        counted = torch.ones_like(flat) if mask is None else mask.expand_as(probability).flatten(0, 1).to(flat)
        gradient = gradient * counted
        if self.keep_area:
            gradient = without_area(gradient, counted * (flat * (1 - flat)).detach())
        # A zero that has the gradient of sum(gradient * p).
        carrier = gradient * (flat - flat.detach())
        return (value + carrier.flatten(1).sum(dim=1)).reshape(probability.shape[:2])

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def _loss_of_parts(self, probability: Tensor, mask: Tensor | None, target: Tensor | None) -> Tensor:
        return self._reduce(self._complexity_of_parts(probability, mask), target)

    def _complexity_of_parts(self, probability: Tensor, mask: Tensor | None) -> Tensor:
        """(B, C): the same, each the mean over its objects, in their frames."""
        flat = probability.flatten(0, 1)
        counted = [] if mask is None else [mask.expand_as(probability).flatten(0, 1)]
        with torch.inference_mode(False), torch.enable_grad():
            on_host, *counted = to_host(flat, *counted)
            leaf = on_host.clone().requires_grad_()
            total = self._mean_over_parts(leaf, torch.ones_like(leaf) if mask is None else counted[0].to(leaf))
            (gradient,) = torch.autograd.grad(total.sum(), leaf)
        value, gradient = to_device(flat.device, total.detach(), gradient)
        carrier = gradient * (flat - flat.detach())
        return (value + carrier.flatten(1).sum(dim=1)).reshape(probability.shape[:2])

    def _mean_over_parts(self, flat: Tensor, counted: Tensor) -> Tensor:
        """(N,): the same of shapes (N, *spatial) on the CPU, of which `counted` is 0 where no gradient goes."""
        require_probabilities(flat.detach())
        inside = (flat.detach() > self.threshold).numpy()
        through = torch.where(counted > 0, flat, flat.detach())
        parts = parts_of(inside, self.measure)
        cuts = [cut_out(through[part.owner], part, others_of(part, inside[part.owner])) for part in parts]
        # NaN stays NaN, and what has no part a loss with a gradient of zeros.
        total = (0.0 * (flat - flat.detach())).flatten(1).sum(dim=1)
        owners = torch.tensor([part.owner for part in parts], dtype=torch.int64, device="cpu")
        missing = torch.bincount(owners, minlength=len(flat)) == 0
        total = total + self.measure.largest * missing.to(total)
        for numbers in like_sizes(parts):
            cut = [consistent(cuts[i], parts[i], self.threshold) for i in numbers]
            values, gradients = self._flips(torch.stack([padded_to(one, cut) for one in cut]))
            for i, value, whole in zip(numbers, values, gradients, strict=True):
                gradient = whole[tuple(slice(side) for side in cuts[i].shape)]
                weight = cut_out(counted[parts[i].owner], parts[i])
                gradient = gradient * weight
                if self.keep_area:
                    doubt = weight * (cuts[i] * (1 - cuts[i])).detach()
                    gradient = without_area(gradient[None], doubt[None])[0]
                carrier = (gradient * (cuts[i] - cuts[i].detach())).sum()
                share = parts[i].weight * (value + carrier)
                total = total.index_add(0, owners[i : i + 1], share[None])
        return total

    def _flips(self, probability: Tensor) -> tuple[Tensor, Tensor]:
        """The complexity (N,) of shapes (N, *spatial) as they stand, and their gradient under region flips."""
        measure = self.measure
        value, gradient = region_flip_gradient(
            probability,
            self.threshold,
            self.max_flips,
            self.deformations,
            measure.low,
            measure.high,
            measure.bins,
            measure.estimator,
            measure.levels,
            measure.scalar_rho(),
            measure.tol,
            measure.tol_bits,
        )
        return value, gradient

    def _reduce(self, value: Tensor, target: Tensor | None) -> Tensor:
        if isinstance(self.weight, tuple):
            if len(self.weight) != value.shape[1]:
                raise ValueError(
                    f"weight must be a number or hold one for each of the {value.shape[1]} channels; got "
                    f"{len(self.weight)}. With include_background=False leave out that of the background."
                )
            # Number by number: a tensor of them would have to be copied to the device, which waits for it.
            value = torch.stack([value[:, i] * weight for i, weight in enumerate(self.weight)], dim=1)
        else:
            value = value * self.weight
        number: int | Tensor = value.numel()
        if target is not None:
            present = (target != 0).flatten(2).any(dim=2)
            value = torch.where(present, value, 0.0)
            number = present.sum().clamp(min=1)
        if self.reduction == "none":
            return value
        return value.sum() / number if self.reduction == "mean" else value.sum()


def _activation(activation: Activation) -> Callable[[Tensor], Tensor] | None:
    if activation is None or callable(activation):
        return activation
    if not isinstance(activation, str):
        raise TypeError(
            f"activation must be None, a name or a callable; got {activation!r}. Pass for example torch.sigmoid."
        )
    if activation not in ACTIVATIONS:
        listed = ", ".join(repr(name) for name in ACTIVATIONS)
        raise ValueError(
            f"activation must be None, one of {listed}, or a callable; got {activation!r}. Pass None for probabilities."
        )
    return ACTIVATIONS[activation]


def _weight(weight: Weight) -> float | tuple[float, ...]:
    plain = weight.tolist() if hasattr(weight, "tolist") else weight
    if isinstance(plain, Sequence) and not isinstance(plain, str):
        return tuple(not_negative(number, "weight") for number in plain)
    return not_negative(plain, "weight")  # type: ignore[arg-type]


def _check_input(input: Tensor, target: Tensor | None, mask: Tensor | None) -> None:
    for name, tensor in (("input", input), ("target", target), ("mask", mask)):
        if not isinstance(tensor, Tensor) and (tensor is not None or name == "input"):
            raise TypeError(f"{name} must be a torch.Tensor; got {type(tensor).__name__}. Pass torch.as_tensor(...).")
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
    if mask is not None:
        if mask.dtype != torch.bool:
            raise TypeError(f"mask must be bool; got {mask.dtype}. Pass mask != 0.")
        if not _broadcasts(mask, input):
            raise ValueError(
                f"mask must broadcast to the shape of input, {tuple(input.shape)}; got {tuple(mask.shape)}. "
                "Pass (B, 1, *spatial) for all channels."
            )


def _broadcasts(mask: Tensor, input: Tensor) -> bool:
    sizes = zip(reversed(mask.shape), reversed(input.shape), strict=False)
    return mask.ndim <= input.ndim and all(side in (1, size) for side, size in sizes)
