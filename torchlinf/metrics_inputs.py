"""Predictions of a segmentation model in the formats of torchmetrics, as one mask for each class."""

from dataclasses import dataclass
from numbers import Real

import torch
from torch import Tensor

from torchlinf._checks import MAX_SPATIAL_NDIM, as_mask, choice


@dataclass(frozen=True)
class Predictions:
    """How predictions become masks; the fields are the arguments of `torchlinf.metrics.ShapeComplexity`.

    Example:
        >>> labels = torch.tensor([[[0, 1, 1]]])
        >>> Predictions(2, None, "index", None).masks(labels).int()
        tensor([[[[1, 0, 0]],
        <BLANKLINE>
                 [[0, 1, 1]]]], dtype=torch.int32)
    """

    num_classes: int
    threshold: float | None
    input_format: str
    ignore_index: int | None

    def __post_init__(self) -> None:
        choice(self.input_format, ("one-hot", "index"), "input_format")
        if self.threshold is not None and (isinstance(self.threshold, bool) or not isinstance(self.threshold, Real)):
            raise TypeError(
                f"threshold must be a number or None; got {self.threshold!r}. "
                "Pass 0.0 for logits, 0.5 for probabilities."
            )

    def masks(self, preds: Tensor) -> Tensor:
        """Predictions as bool (B, C, *spatial)."""
        _check_tensor(preds, "preds")
        if self.input_format == "index":
            _check_rank(preds, 1, 'Pass (B, *spatial) labels, or input_format="one-hot" for (B, C, *spatial).', "preds")
            return self._split(preds, "preds")
        _check_rank(preds, 2, 'Pass (B, C, *spatial), or input_format="index" for (B, *spatial) labels.', "preds")
        self._check_channels(preds, "preds")
        if not preds.is_floating_point():
            return as_mask(preds, preds.ndim - 2, "preds")[0].reshape(preds.shape)
        if bool(preds.isnan().any()):
            raise ValueError("preds must hold no NaN; got some. Find out where the model's output became NaN.")
        if self.threshold is not None:
            return preds.detach() > self.threshold
        if self.num_classes == 1:
            raise ValueError(
                "threshold must be a number where there is one class only; got None, which compares classes. "
                "Pass threshold=0.0 for logits, threshold=0.5 for probabilities."
            )
        return self._split(preds.argmax(dim=1), "preds")

    def there(self, target: Tensor, masks: Tensor) -> Tensor:
        """Which classes are in which samples, (B, C)."""
        _check_tensor(target, "target")
        if target.ndim == masks.ndim:
            self._check_channels(target, "target")
            inside = target != 0
        else:
            _check_rank(target, 1, "Pass (B, *spatial) labels or (B, C, *spatial) masks.", "target")
            inside = self._split(target, "target")
        if inside.shape != masks.shape:
            raise ValueError(
                f"target must have the batch and spatial sizes of preds; got {tuple(target.shape)} beside masks "
                f"{tuple(masks.shape)}. Resize one of them."
            )
        return inside.flatten(2).any(dim=2)

    def _split(self, labels: Tensor, name: str) -> Tensor:
        """One mask for each class of integer labels (B, *spatial)."""
        if labels.is_floating_point() or labels.is_complex() or labels.dtype == torch.bool:
            raise TypeError(f"{name} must hold integer labels; got {labels.dtype}. Pass {name}.long().")
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
            # Integers without a dimension for channels are labels, to all appearance.
            labels = name == "preds" and x.ndim == 3 and not x.is_floating_point()
            remedy = 'input_format="index" for (B, *spatial) labels, or ' if labels else ""
            raise ValueError(
                f"{name} must have num_classes={self.num_classes} channels; got {tuple(x.shape)}. "
                f"Pass {remedy}num_classes={x.shape[1]}."
            )


def _check_tensor(x: object, name: str) -> None:
    if not isinstance(x, Tensor):
        raise TypeError(f"{name} must be a torch.Tensor; got {type(x).__name__}. Pass torch.as_tensor({name}).")


def _check_rank(x: Tensor, leading: int, remedy: str, name: str) -> None:
    if not leading < x.ndim <= leading + MAX_SPATIAL_NDIM:
        raise ValueError(
            f"{name} must have {leading + 1} to {leading + MAX_SPATIAL_NDIM} dimensions; got {tuple(x.shape)}. {remedy}"
        )
