"""Complexity of predicted shapes as a torchmetrics metric. Needs the extra `metrics` (torchmetrics)."""

import math
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, Literal, cast

import torch
from torch import Tensor

from torchlinf._checks import choice, count, positive, window
from torchlinf.measure import Measure, complexity_profile
from torchlinf.metrics_inputs import Predictions

try:
    from torchmetrics import Metric
except ImportError as error:
    raise ImportError(
        "torchlinf.metrics needs torchmetrics, which is not installed. Run: pip install 'torchlinf[metrics]'"
    ) from error

__all__ = ["ShapeComplexity"]

AVERAGES = ("macro", "micro", "none")
# Sums are kept in whole units of 2^-32 bit: exact, so the same however the shapes are spread over batches and
# processes, and at home on devices without float64. They overflow after 2^63 / (20 * 2^32) shapes, a hundred million.
UNIT = 2.0**32


class ShapeComplexity(Metric):
    """Mean hard complexity of the shapes that a segmentation model predicts, per class or averaged.

    Each class of each sample is one shape. What is summed is `torchlinf.complexity` of its mask.

    An empty prediction has no complexity, and must not improve the score: it counts as much as the most complex shape
    could, log2(bins) = 10 bits (0.5 for "std"), unless `empty="skip"`. Pass `target` too, and classes that are not in
    the image are left out, whatever is predicted for them; without it an absent class cannot be told from a missed one.

    Args:
        num_classes: number of classes, the background included.
        low: lower end of the window of scales, excluded.
        high: upper end, included; 0 <= low < high <= 1. Small scales are near the boundary.
        windows: several windows (low, high] by name, all from one solve, instead of `low` and `high`; the result is a
            dictionary then.
        threshold: how floating-point predictions become masks. None takes the class of the largest value at each
            pixel (logits or probabilities, softmax); with a number every channel is its own mask, inside where the
            value is larger: 0.0 for logits, 0.5 for probabilities (sigmoid, several labels a pixel, one class alone).
        input_format: what `preds` is, in the words of `torchmetrics.segmentation`: "one-hot" for (B, C, *spatial)
            masks, logits or probabilities, "index" for (B, *spatial) integer labels.
        average: "macro", the mean over classes that have shapes; "micro", the mean over all shapes; "none" or None, one
            value for each class.
        include_background: if False, class 0 is dropped, from the result as well.
        ignore_index: a label in `preds` or `target` that stands for no class, such as 255.
        empty: "worst" or "skip", what an empty prediction counts as.
        bins: as in `torchlinf.complexity`.
        estimator: "entropy" or "std", as there.
        tol: relative error that the fields are certified to.
        kwargs: options of every torchmetrics metric, such as `sync_on_compute`.

    Attributes:
        num_shapes: (C,) int64, shapes that were measured, by class.
        num_empty: (C,) int64, empty predictions, by class. These and `num_shapes` are of this process; within
            `with metric.sync_context():` of all.

    Shape:
        - preds: (B, C, *spatial) or (B, *spatial), see `input_format`, with 1 to 4 spatial dimensions, on any device.
        - target: optional, (B, C, *spatial), nonzero is inside, or (B, *spatial) integer labels; the rank tells.
        - output of `forward` and `compute`: a float32 number, or (C,) for average "none", in bits (share of the field's
          maximum for "std"), in [0, log2(bins)], lower is simpler; NaN where there is no shape. Full masks give 0.0.

    Not differentiable. States are sums and counts, so memory does not grow, and several processes get the number that
    one would, to the last bit. It pickles, plots, and works in a `MetricCollection`.

    Raises:
        ImportError: torchmetrics is not installed (when `torchlinf.metrics` is imported).
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value, or `preds` or `target` a wrong shape, labels that are no class, or
            NaN.

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
    num_shapes: Tensor
    num_empty: Tensor

    def __init__(
        self,
        num_classes: int,
        *,
        low: float = 0.0,
        high: float = 1.0,
        windows: Mapping[str, tuple[float, float]] | None = None,
        threshold: float | None = None,
        input_format: Literal["one-hot", "index"] = "one-hot",
        average: Literal["macro", "micro", "none"] | None = "macro",
        include_background: bool = True,
        ignore_index: int | None = None,
        empty: Literal["worst", "skip"] = "worst",
        bins: int = 1024,
        estimator: str = "entropy",
        tol: float = 1e-9,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.predictions = Predictions(count(num_classes, "num_classes"), threshold, input_format, ignore_index)
        self.windows = _windows(low, high, windows)
        self.named = windows is not None
        self.average = choice(average or "none", AVERAGES, "average")
        self.include_background = bool(include_background)
        self.empty = choice(empty, ("worst", "skip"), "empty")
        self.measure = Measure(bins=bins, estimator=estimator, tol=tol)
        self.bins, self.estimator, self.tol = bins, estimator, positive(tol, "tol")
        self._add_states()

    def _add_states(self) -> None:
        classes = self.predictions.num_classes - (not self.include_background)
        if classes < 1:
            raise ValueError(
                "include_background=False needs num_classes of 2 or more; got 1, which would leave nothing. "
                "Pass include_background=True."
            )
        whole = torch.zeros(classes, dtype=torch.int64)
        self.add_state("total", whole.repeat(len(self.windows), 1), dist_reduce_fx="sum")  # (W, C)
        self.add_state("num_shapes", whole.clone(), dist_reduce_fx="sum")
        self.add_state("num_empty", whole.clone(), dist_reduce_fx="sum")
        # A MetricCollection takes metrics whose states agree after the first batch for one metric, which two windows do
        # on a batch of boxes. States of different names never agree.
        settings = (self.predictions, self.windows, self.bins, self.estimator)
        name = f"settings_{zlib.crc32(repr(settings).encode()):08x}"
        self.add_state(name, torch.zeros((), dtype=torch.int64), dist_reduce_fx="sum")

    def update(self, preds: Tensor, target: Tensor | None = None) -> None:
        """Add the shapes of a batch; see the class for shapes and formats."""
        masks = self.predictions.masks(preds)  # (B, C, *spatial)
        there = masks.new_ones(masks.shape[:2]) if target is None else self.predictions.there(target, masks)
        if not self.include_background:
            masks, there = masks[:, 1:], there[:, 1:]
        classes = there.nonzero()[:, 1]  # (N,)
        profile = complexity_profile(
            masks[there], spatial_ndim=masks.ndim - 2, bins=self.bins, estimator=self.estimator, tol=self.tol
        )
        values = torch.stack([profile.mean(low, high) for low, high in self.windows.values()])  # (W, N)
        blank = profile.radius == 0
        whole = (values.masked_fill(blank, 0.0) * UNIT).round().long()
        self.total.index_add_(1, classes, whole.to(self.total.device))
        self.num_shapes.index_add_(0, classes, (~blank).long().to(self.num_shapes.device))
        self.num_empty.index_add_(0, classes, blank.long().to(self.num_empty.device))

    def compute(self) -> Tensor | dict[str, Tensor]:
        """The result over all shapes so far; see the class."""
        worst = math.log2(self.bins) if self.estimator == "entropy" else 0.5
        charged = self.num_empty if self.empty == "worst" else torch.zeros_like(self.num_empty)
        total = self.total.float() / UNIT + worst * charged  # (W, C)
        number = (self.num_shapes + charged).expand_as(total)
        if self.average == "micro":
            total, number = total.sum(dim=1), number.sum(dim=1)
        mean = total / number  # NaN where there is no shape
        if self.average == "macro":
            mean = mean.nanmean(dim=1)
        return dict(zip(self.windows, mean, strict=True)) if self.named else mean[0]

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
            one.set_ylabel("complexity (bits)" if self.estimator == "entropy" else "complexity (share of max f)")
        return figure, axes


def _windows(
    low: float, high: float, windows: Mapping[str, tuple[float, float]] | None
) -> dict[str, tuple[float, float]]:
    if windows is None:
        return {"": window(low, high)}
    if (low, high) != (0.0, 1.0) or not windows:
        raise ValueError(
            f"windows must name one window or more, and stand instead of low and high; got {dict(windows)!r} beside "
            f"low={low!r}, high={high!r}. Pass for example windows={{'fine': (0.0, 0.25), 'coarse': (0.25, 1.0)}}."
        )
    return {name: window(*ends) for name, ends in windows.items()}
