"""Complexity of predicted shapes as a torchmetrics metric. Needs the extra `metrics` (torchmetrics).

`InputFormat` turns predictions and targets into masks, `ShapeComplexity` measures the masks.
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any, Literal, Unpack, cast

import torch
from torch import Tensor

from torchlinf._helpers.axes import image_shape
from torchlinf._helpers.checks import MAX_SPATIAL_NDIM, as_mask, choice, count, flag, number_of_axes, number_or_none
from torchlinf._helpers.extras import require
from torchlinf.measure import Measure, MeasureOptions, ProfileOptions, complexity_profile, takes

require("torchmetrics", "torchlinf.metrics", "metrics")
from torchmetrics import Metric  # noqa: E402

__all__ = ["ShapeComplexity"]

AVERAGES = ("macro", "micro", "none")
FORMATS = ("one-hot", "index")
EMPTY = ("worst", "skip")
# Sums are kept in whole units of 2^-32 bit: exact, so the same however the shapes are spread over batches and
# processes, and at home on devices without float64. They overflow after 2^63 / (20 * 2^32) shapes, a hundred million.
UNIT = 2.0**32


class MetricOptions(MeasureOptions, total=False):
    """The options of the measure, and those of every torchmetrics metric."""

    compute_on_cpu: bool
    compute_with_cache: bool
    dist_sync_fn: Callable[..., Any] | None
    dist_sync_on_step: bool
    distributed_available_fn: Callable[..., bool] | None
    process_group: Any
    sync_on_compute: bool


@takes(MeasureOptions)
class ShapeComplexity(Metric):
    """Mean hard complexity of the shapes that a segmentation model predicts, per class or averaged.

    Each class of each sample is one shape. What is summed is `torchlinf.complexity` of its mask. With `per="object"`
    each object of each class of each sample is one shape, unless `pool` makes one number of the objects of a class.

    An empty prediction has no complexity, and must not improve the score: it counts `measure.largest`, the most that a
    shape could have, 10 bits by default (0.5 for "std"), unless `empty="skip"`. Pass `target` too, and classes that are
    not in the image are left out, whatever is predicted for them; without it an absent class cannot be told from a
    missed one. With `per="object"` a class without an object counts as one empty prediction.

    Args:
        num_classes: number of classes, the background included.
        threshold: how one-hot predictions become masks. With a number every channel is its own mask, inside where the
            value is greater: 0.0 for logits, 0.5 for probabilities (sigmoid, several labels a pixel, one class alone).
            None takes, of several floating-point channels, the class of the largest value at each pixel (logits or
            probabilities, softmax); all other predictions must then hold 0 and 1. Labels are never thresholded.
        input_format: what `preds` is, in the words of `torchmetrics.segmentation`: "one-hot" for (B, C, *spatial)
            masks, logits or probabilities, "index" for (B, *spatial) integer labels.
        average: "macro", the mean over classes that have shapes; "micro", the mean over all shapes; "none" or None, one
            value for each class.
        include_background: if False, class 0 is dropped, from the result as well.
        ignore_index: a label in `preds` or `target` that stands for no class, such as 255.
        empty: "worst" or "skip", what an empty prediction counts as.
        spatial_ndim: dimensions of an image; 3 for volumes. None takes all dimensions behind the channels of one-hot
            predictions, and of labels (B, H, W); more axes raise, since they may be channels.
        {measure options}
            Here rho must be None or one number, not a tensor.
        kwargs: options of every torchmetrics metric, such as `sync_on_compute`.

    Attributes:
        measure: the `torchlinf.Measure` of the options.
        num_shapes: (C,) int64, shapes that were measured, by class: objects, with `per="object"` and without `pool`.
        num_empty: (C,) int64, empty predictions, by class. These and `num_shapes` are of this process; within
            `with metric.sync_context():` of all.

    Shape:
        - preds: (B, C, *spatial) or (B, *spatial), as `input_format` says, with 1 to 4 spatial dimensions, on any
          device. Labels may have axes of length 1 before or behind the image, (B, 1, H, W) or (B, H, W, 1), which are
          dropped; with `spatial_ndim=3` (B, 1, H, W) is a volume that is one voxel thick.
        - target: optional, (B, C, *spatial), nonzero is inside, or integer labels (B, *spatial), or with an axis of
          length 1; the rank tells. Beside one-hot predictions of one class the labels are 0, outside, and 1.
        - output of `forward` and `compute`: a float32 number, or (C,) for average "none", in bits (share of the field's
          maximum for "std"), in [0, `measure.largest`], lower is simpler; NaN where there is no shape. With `windows` a
          dictionary of them by name. Full masks give 0.0.

    Not differentiable. States are sums and counts, so memory does not grow, and several processes get the number that
    one would, to the last bit. It pickles, plots, and works in a `MetricCollection`, where only metrics of the same
    measure and the same input format share their states.

    Raises:
        ImportError: torchmetrics is not installed (when `torchlinf.metrics` is imported).
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value, or `preds` or `target` a wrong shape, labels that are no class, or
            NaN; or torchmetrics does not know a keyword.
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020.

    Example:
        >>> from torchlinf import shapes
        >>> labels = torch.stack([1 * shapes.disc(8), 2 * shapes.square(17)])  # (B, H, W)
        >>> metric = ShapeComplexity(3, input_format="index", include_background=False, average="none", empty="skip")
        >>> metric(labels), metric.num_empty
        (tensor([0.6233, 0.0000]), tensor([1, 1]))
        >>> ShapeComplexity(3, input_format="index", include_background=False)(labels, target=labels)
        tensor(0.3116)
    """

    is_differentiable = False
    higher_is_better = False
    full_state_update = False
    plot_lower_bound = 0.0

    total: Tensor
    total_error: Tensor
    num_shapes: Tensor
    num_empty: Tensor

    def __init__(
        self,
        num_classes: int,
        *,
        threshold: float | None = None,
        input_format: Literal["one-hot", "index"] = "one-hot",
        average: Literal["macro", "micro", "none"] | None = "macro",
        include_background: bool = True,
        ignore_index: int | None = None,
        empty: Literal["worst", "skip"] = "worst",
        spatial_ndim: int | None = None,
        **kwargs: Unpack[MetricOptions],
    ) -> None:
        ours = MeasureOptions.__optional_keys__
        super().__init__(**{name: value for name, value in kwargs.items() if name not in ours})
        self.measure = Measure.of({name: value for name, value in kwargs.items() if name in ours}, MeasureOptions)
        self.measure.scalar_rho()
        self.input_format = InputFormat(num_classes, threshold, input_format, ignore_index, spatial_ndim)
        self.average = choice("none" if average is None else average, AVERAGES, "average")
        self.include_background = flag(include_background, "include_background")
        self.empty = choice(empty, EMPTY, "empty")
        self._add_states()

    def _add_states(self) -> None:
        classes = self.input_format.num_classes - (not self.include_background)
        if classes < 1:
            raise ValueError(
                "include_background=False needs num_classes of 2 or more; got 1, which would leave nothing. "
                "Pass include_background=True."
            )
        zeros = torch.zeros(classes, dtype=torch.int64)
        self.add_state("total", zeros.repeat(len(self.measure.named_windows()), 1), dist_reduce_fx="sum")  # (W, C)
        self.add_state("total_error", zeros.repeat(len(self.measure.named_windows()), 1), dist_reduce_fx="sum")
        self.add_state("num_shapes", zeros.clone(), dist_reduce_fx="sum")
        self.add_state("num_empty", zeros.clone(), dist_reduce_fx="sum")
        # A MetricCollection takes metrics whose states agree after the first batch for one metric, which two windows do
        # on a batch of boxes, and two tolerances on nearly every batch. States of different names never agree.
        settings = f"{self.input_format} {self.include_background} {self.measure.settings()}"
        name = f"settings_{zlib.crc32(settings.encode()):08x}"
        self.add_state(name, torch.zeros((), dtype=torch.int64), dist_reduce_fx="sum")

    def update(self, preds: Tensor, target: Tensor | None = None) -> None:
        """Add the shapes of a batch; the class describes the shapes and formats of `preds` and `target`."""
        masks = self.input_format.masks(preds)  # (B, C, *spatial)
        counted = masks.new_ones(masks.shape[:2]) if target is None else self.input_format.present(target, masks)
        if not self.include_background:
            masks, counted = masks[:, 1:], counted[:, 1:]
        classes = counted.nonzero()[:, 1]  # (N,)
        options = self.measure.options(ProfileOptions)
        profile = complexity_profile(masks[counted], spatial_ndim=masks.ndim - 2, **options)
        _count(self.num_empty, classes[profile.radius == 0])
        if self.measure.per == "object" and self.measure.pool is None and profile.parts is not None:
            classes, profile = classes[profile.parts.owner], profile.parts.profile  # every object is a shape
        blank = profile.radius == 0
        _count(self.num_shapes, classes[~blank])
        values = torch.stack([profile.mean(*ends) for ends in self.measure.named_windows().values()])  # (W, N)
        whole = (values.masked_fill(blank, 0.0) * UNIT).round().long()
        self.total.index_add_(1, classes.to(self.total.device), whole.to(self.total.device))
        bounds = torch.stack([profile.error_bound(*ends) for ends in self.measure.named_windows().values()])
        most = (bounds.masked_fill(blank, 0.0) * UNIT).ceil().long()
        self.total_error.index_add_(1, classes.to(self.total_error.device), most.to(self.total_error.device))

    def set_dtype(self, dst_type: str | torch.dtype) -> "ShapeComplexity":
        """Nothing to do: the states are whole numbers, exact in any precision, and stay so."""
        return self

    def compute(self) -> Tensor | dict[str, Tensor]:
        """The result over all shapes so far, as the class describes it."""
        charged = self.num_empty if self.empty == "worst" else torch.zeros_like(self.num_empty)
        return self._averaged(self.total.float() / UNIT + self.measure.largest * charged.float(), charged)

    def error_bound(self) -> Tensor | dict[str, Tensor]:
        """How far the result can be from that of the exact fields, proven: like `compute`, in the same unit.

        It is 0 where every digit is proven, as at the default `tol` and `tol_bits`. The rounding of the result to
        float32 is not in it. It is of this process; within `with metric.sync_context():` of all.
        """
        charged = self.num_empty if self.empty == "worst" else torch.zeros_like(self.num_empty)
        return self._averaged(self.total_error.float() / UNIT, charged)

    def _averaged(self, total: Tensor, charged: Tensor) -> Tensor | dict[str, Tensor]:
        """The mean of totals (W, C) over the shapes, as `average` says; `charged` (C,) empty shapes count too."""
        number = (self.num_shapes + charged).expand_as(total)
        if self.average == "micro":
            total, number = total.sum(dim=1), number.sum(dim=1)
        mean = total / number  # NaN where there is no shape
        if self.average == "macro":
            mean = mean.nanmean(dim=1)
        return mean[0] if self.measure.windows is None else dict(zip(self.measure.windows, mean, strict=True))

    def plot(self, val: Any = None, ax: Any = None) -> Any:
        """Draw one result or a sequence of them, as every torchmetrics metric does.

        Args:
            val: what `forward` or `compute` gave, or a list of such results; None draws `compute()`.
            ax: matplotlib axes to draw on; None makes new ones.

        Returns:
            Figure and axes, the complexity in bits (share of the field's maximum for "std") on the vertical axis.

        Raises:
            ModuleNotFoundError: matplotlib is not installed.
        """
        figure, axes = self._plot(val, ax)
        for one in [axes] if hasattr(axes, "set_ylabel") else cast("Sequence[Any]", axes):
            one.set_ylabel(f"complexity ({self.measure.unit})")
        return figure, axes


def _count(state: Tensor, classes: Tensor) -> None:
    """Count shapes, by class."""
    state.index_add_(0, classes.to(state.device), torch.ones_like(classes).to(state))


@dataclass(frozen=True)
class InputFormat:
    """How predictions and targets of a segmentation model become one mask for each class.

    The fields are the arguments of `ShapeComplexity` of the same names.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value.

    Example:
        >>> labels = torch.tensor([[[0, 1, 1]]])
        >>> InputFormat(2, None, "index", None).masks(labels).int()
        tensor([[[[1, 0, 0]],
        <BLANKLINE>
                 [[0, 1, 1]]]], dtype=torch.int32)
    """

    num_classes: int
    threshold: float | None
    input_format: str
    ignore_index: int | None
    spatial_ndim: int | None = None

    def __post_init__(self) -> None:
        count(self.num_classes, "num_classes")
        if self.spatial_ndim is not None:
            number_of_axes(self.spatial_ndim)
        choice(self.input_format, FORMATS, "input_format")
        remedy = "Pass 0.0 for logits, 0.5 for probabilities."
        object.__setattr__(self, "threshold", number_or_none(self.threshold, "threshold", remedy))
        if self.threshold is not None and self.input_format == "index":
            raise ValueError(
                f'threshold must be None beside input_format="index", since labels are not thresholded; got '
                f'{self.threshold}. Pass input_format="one-hot" for logits or probabilities.'
            )
        if self.ignore_index is None:
            return
        if isinstance(self.ignore_index, bool) or not isinstance(self.ignore_index, Integral):
            raise TypeError(f"ignore_index must be an int or None; got {self.ignore_index!r}. Pass for example 255.")
        if 0 <= self.ignore_index < self.num_classes:
            raise ValueError(
                f"ignore_index must be the number of no class, below 0 or from {self.num_classes} on; got "
                f"{self.ignore_index}. Pass include_background=False to leave out class 0."
            )

    def masks(self, preds: Tensor) -> Tensor:
        """Predictions as bool (B, C, *spatial)."""
        _check_tensor(preds, "preds")
        if self.input_format == "index":
            _check_rank(preds, 1, 'Pass (B, *spatial) labels, or input_format="one-hot" for (B, C, *spatial).', "preds")
            return self._one_hot(_labels(preds, self.spatial_ndim, "preds"), "preds")
        _check_rank(preds, 2, 'Pass (B, C, *spatial), or input_format="index" for (B, *spatial) labels.', "preds")
        if self.spatial_ndim not in (None, preds.ndim - 2):
            raise ValueError(
                f"preds must be (B, C, *spatial) with spatial_ndim={self.spatial_ndim} last dimensions; got "
                f"{tuple(preds.shape)}. Pass spatial_ndim={preds.ndim - 2}, or None."
            )
        self._check_channels(preds, "preds")
        if preds.is_floating_point() and bool(preds.isnan().any()):
            raise ValueError("preds must hold no NaN; got some. Find out where the model's output became NaN.")
        if self.threshold is not None:
            return preds.detach() > self.threshold
        if preds.is_floating_point() and self.num_classes > 1:
            return self._one_hot(preds.argmax(dim=1), "preds")
        if preds.is_floating_point() and not bool(((preds == 0) | (preds == 1)).all()):
            raise ValueError(
                "threshold must be a number for grey predictions of one class; got None. "
                "Pass threshold=0.0 for logits, threshold=0.5 for probabilities."
            )
        return as_mask(preds, preds.ndim - 2, "preds")[0].reshape(preds.shape)

    def present(self, target: Tensor, masks: Tensor) -> Tensor:
        """Which classes are in which samples of the target, bool (B, C)."""
        _check_tensor(target, "target")
        if target.ndim == masks.ndim and (1 not in (target.shape[1], target.shape[-1]) or target.shape == masks.shape):
            self._check_channels(target, "target")
            inside = target != 0
            if self.ignore_index is not None:
                inside &= target != self.ignore_index
        else:
            _check_rank(target, 1, "Pass (B, *spatial) labels or (B, C, *spatial) masks.", "target")
            labels = _labels(target, masks.ndim - 2, "target")
            # Labels of one class beside an unnamed background: 0 is the background, not the class.
            is_binary = self.num_classes == 1 and self.input_format == "one-hot"
            inside = self._binary(labels)[:, None] if is_binary else self._one_hot(labels, "target")
        if inside.shape != masks.shape:
            raise ValueError(
                f"target must have the batch and spatial sizes of preds; got {tuple(target.shape)} beside masks "
                f"{tuple(masks.shape)}. Resize one of them."
            )
        return inside.flatten(2).any(dim=2)

    def _binary(self, target: Tensor) -> Tensor:
        """Where a target (B, *spatial) of 0 and 1 is 1; what is to be ignored is outside."""
        inside = target == 1
        wrong = ~(inside | (target == 0))
        if self.ignore_index is not None:
            wrong &= target != self.ignore_index
        if bool(wrong.any()):
            raise ValueError(
                f"target must hold 0 and 1 beside num_classes=1; got {target[wrong][0].item()}. Pass it as "
                "ignore_index if it stands for no class."
            )
        return inside

    def _one_hot(self, labels: Tensor, name: str) -> Tensor:
        """One mask for each class of integer labels (B, *spatial)."""
        if labels.is_floating_point() or labels.is_complex() or labels.dtype == torch.bool:
            raise TypeError(f"{name} must hold integer labels; got {labels.dtype}. Pass {name}.long().")
        labels = labels.long()  # torch cannot compare unsigned integers of more than 8 bits
        wrong = (labels < 0) | (labels >= self.num_classes)
        if self.ignore_index is not None:
            wrong &= labels != self.ignore_index
        if bool(wrong.any()):
            raise ValueError(
                f"{name} must hold labels from 0 to {self.num_classes - 1}; got {labels[wrong][0].item()}. Pass it as "
                "ignore_index if it stands for no class."
            )
        classes = torch.arange(self.num_classes, device=labels.device)
        return labels[:, None] == classes.view(-1, *[1] * (labels.ndim - 1))

    def _check_channels(self, x: Tensor, name: str) -> None:
        if x.shape[1] != self.num_classes:
            # Integers without a dimension for channels, or with one of length 1, are labels, to all appearance.
            labels = name == "preds" and not x.is_floating_point() and (x.ndim == 3 or 1 in (x.shape[1], x.shape[-1]))
            remedy = 'input_format="index" for (B, *spatial) labels, or ' if labels else ""
            raise ValueError(
                f"{name} must have num_classes={self.num_classes} channels; got {tuple(x.shape)}. "
                f"Pass {remedy}num_classes={x.shape[1]}."
            )


def _check_tensor(x: object, name: str) -> None:
    if not isinstance(x, Tensor):
        raise TypeError(f"{name} must be a torch.Tensor; got {type(x).__name__}. Pass torch.as_tensor({name}).")


def _labels(x: Tensor, spatial_ndim: int | None, name: str) -> Tensor:
    """Labels (B, *spatial), without the axes of length 1 that they came with."""
    return x.reshape(image_shape(tuple(x.shape), spatial_ndim, name, batch=1))


def _check_rank(x: Tensor, leading: int, remedy: str, name: str) -> None:
    if not leading < x.ndim <= leading + MAX_SPATIAL_NDIM:
        raise ValueError(
            f"{name} must have {leading + 1} to {leading + MAX_SPATIAL_NDIM} dimensions; got {tuple(x.shape)}. {remedy}"
        )
