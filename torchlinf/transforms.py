"""Scores in datasets: transforms that add the complexity of a mask. The sampler that draws by it is in `samplers`."""

from collections.abc import Mapping, Sequence
from typing import Any, Unpack

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from PIL.Image import Image
from torch import Tensor

from torchlinf._helpers.axes import refuse_colours
from torchlinf._helpers.checks import flag, number_of_axes, number_or_none, real_dtype
from torchlinf._helpers.inside import UnclearMaskError, find_inside, text
from torchlinf.measure import Measure, MeasureOptions, ragged_profile, takes
from torchlinf.samplers import ComplexitySampler

__all__ = ["ComplexitySampler", "ShapeComplexityScore", "ShapeComplexityScored"]


@takes(MeasureOptions)
class ShapeComplexityScore:
    """Transform from a mask to its complexity, the same number as `torchlinf.complexity`.

    Pass it as the `transform` or `target_transform` of a dataset, or call it in `__getitem__`. It is made for the
    workers of a `DataLoader`, forked or spawned: it pickles, and runs on one thread there. Flips and axis swaps change
    the score of a shape by no more than the errors of the fields explain, at the default `tol` by nothing on all shapes
    that were tried; rescaling changes it a little, and so do rotations, unless `orientation="own"` takes most of that
    away.

    Args:
        threshold: what is inside. A number: inside is what is greater. None decides by the rule of `torchlinf score`,
            over the whole batch: of 0 and one other value that value; of a negative and a positive value the positive
            one; of grey uint8 and uint16 what lies above half of the type's range; of numbers from 0 to 1 what lies
            above 0.5. A label map raises; pass `labels == k` for one object, or `labels != 0` for all as one shape.
        spatial_ndim: that many last dimensions are spatial, all others are batch; 3 for volumes. None means 2, for
            images; then a last axis of length 1 is dropped, as in (H, W, 1), and one of length 3 or 4 raises, since it
            may be one of colours.
        dtype: of the result; None means float64, in which it is always computed.
        {measure options}
            Here rho must be None or one number, not a tensor.

    Attributes:
        measure: the `torchlinf.Measure` of the options.

    Shape:
        - mask: a tensor or NumPy array, (*batch, *spatial), bool, integer or real; or a PIL image of one band (modes 1,
          L, I, F, P). Colour and multi-band images raise. (N, H, W) are N masks, never a volume by itself.
        - output: tensor of the batch shape, a number without dimensions for a single mask, so that loaders collate a
          batch of them to (B,); (1,) for a mask (1, H, W). With `windows` a dictionary of them by name, from one solve.
          In bits (share of the field's maximum for "std"), in [0, `measure.largest`]. NaN for an empty mask, and with
          `per="object"` for one without an object of `min_pixels`; exactly 0.0 for a full one.

    Not differentiable; computed on the CPU.

    Raises:
        TypeError: an argument or the mask is of the wrong type.
        ValueError: an argument has a wrong value, or the mask a wrong shape or values.
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020.

    Example:
        >>> from torchlinf import shapes
        >>> score = ShapeComplexityScore(high=0.5)
        >>> score(shapes.disc(8)), score(255 * np.ones((9, 14), np.uint8))
        (tensor(1.0493, dtype=torch.float64), tensor(0., dtype=torch.float64))
        >>> ShapeComplexityScore(windows={"fine": (0.0, 0.5), "coarse": (0.5, 1.0)})(shapes.disc(8))
        {'fine': tensor(1.0493, dtype=torch.float64), 'coarse': tensor(0.1972, dtype=torch.float64)}
    """

    def __init__(
        self,
        *,
        threshold: float | None = None,
        spatial_ndim: int | None = None,
        dtype: torch.dtype | None = None,
        **options: Unpack[MeasureOptions],
    ) -> None:
        self.threshold = number_or_none(threshold, "threshold")
        self.spatial_ndim = None if spatial_ndim is None else number_of_axes(spatial_ndim)
        self.dtype = real_dtype(dtype)
        self.measure = Measure.of(options, MeasureOptions)
        self.measure.scalar_rho()

    def __call__(self, mask: Tensor | ArrayLike | Image) -> Tensor | dict[str, Tensor]:
        """Score a mask; the class describes the forms that it may come in."""
        scores = self.by_window(mask)
        return scores["complexity"] if self.measure.windows is None else scores

    def by_window(self, mask: Tensor | ArrayLike | Image) -> dict[str, Tensor]:
        """The scores by the name of their window, "complexity" if it is only one.

        Example:
            >>> ShapeComplexityScore().by_window(np.eye(3, dtype=bool))
            {'complexity': tensor(0., dtype=torch.float64)}
        """
        inside = self._inside(_array(mask))
        batch_shape = inside.shape[: inside.ndim - (self.spatial_ndim or 2)]
        shapes = inside.reshape(-1, *inside.shape[len(batch_shape) :])
        profile = ragged_profile(lambda i: shapes[i], len(shapes), self.measure)
        return {
            name: profile.mean(*ends).reshape(batch_shape).to(self.dtype or torch.float64)
            for name, ends in self.measure.named_windows().items()
        }

    def __repr__(self) -> str:
        """As a call, with what a user may want to see in the print of a pipeline."""
        options = {"threshold": self.threshold, "spatial_ndim": self.spatial_ndim, **self.measure.options()}
        if self.dtype is not None:
            options["dtype"] = self.dtype
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in options.items())})"

    def _inside(self, mask: NDArray[Any]) -> NDArray[np.bool_]:
        if mask.dtype.kind not in "buif":
            raise TypeError(f"mask must be bool, integer or real; got {mask.dtype}. Pass mask != 0.")
        if self.spatial_ndim is None:
            while mask.ndim > 2 and mask.shape[-1] == 1:
                mask = mask[..., 0]
            refuse_colours(mask.shape, "mask")
        ndim = self.spatial_ndim or 2
        if mask.ndim < ndim or 0 in mask.shape[mask.ndim - ndim :]:
            raise ValueError(
                f"mask must have at least spatial_ndim={ndim} dimensions, the last {ndim} of size 1 or more; got "
                f"{mask.shape}. Pass spatial_ndim=... or another mask."
            )
        if mask.dtype.kind == "f" and bool(np.isnan(mask).any()):
            raise ValueError("mask must hold no NaN; got some. Replace it, for example by np.nan_to_num.")
        if self.threshold is not None:
            return mask > self.threshold
        try:
            return find_inside(mask)[0]
        except UnclearMaskError as error:
            raise ValueError(
                f"mask must be of 0 and one other value, grey, or from 0 to 1, without a threshold; got {error}. Pass "
                f"mask == {text(error.example)} for one label, mask != 0 for all, threshold=... for other numbers."
            ) from error


@takes(MeasureOptions)
class ShapeComplexityScored:
    """Transform of a sample that is a dictionary, as in MONAI: `sample["mask"]` gives `sample["mask_complexity"]`.

    A call returns a new dictionary with the old entries and the scores; the sample itself is left as it was. The scores
    are those of `ShapeComplexityScore`: float64, NaN for an empty mask, exactly 0.0 for a full one, not differentiable.

    Args:
        keys: key of a mask, or several keys, at least one.
        postfix: the score of the mask `key` is stored as `{key}_{postfix}`. With `windows` there is one score a window,
            stored as `{key}_{name of the window}`, and the postfix is not used.
        allow_missing_keys: if True, keys that a sample does not have are passed over.
        threshold: what is inside. A number: inside is what is greater. None decides by the rule of `torchlinf score`;
            see `ShapeComplexityScore`.
        spatial_ndim: that many last dimensions are spatial, all others are batch; 3 for volumes. None means images, in
            any of the forms that `ShapeComplexityScore` takes.
        dtype: of the scores; None means float64.
        {measure options}
            Here rho must be None or one number, not a tensor.

    Attributes:
        score: the `ShapeComplexityScore` that every mask goes through.

    Raises:
        TypeError: an argument or a mask is of the wrong type, or the sample is no mapping.
        ValueError: an argument has a wrong value, or a mask a wrong shape or values.
        KeyError: a key is not in the sample.
        RuntimeError: a field could not be solved to `tol`.

    Source: the measure is that of Arslan and Tari, IEEE TIP 2020.

    Example:
        >>> from torchlinf import shapes
        >>> transform = ShapeComplexityScored(keys="mask", low=0.25)
        >>> transform({"image": torch.rand(3, 9, 12), "mask": shapes.box(9, 12)})["mask_complexity"]
        tensor(0., dtype=torch.float64)
    """

    def __init__(
        self,
        keys: str | Sequence[str],
        *,
        postfix: str = "complexity",
        allow_missing_keys: bool = False,
        threshold: float | None = None,
        spatial_ndim: int | None = None,
        dtype: torch.dtype | None = None,
        **options: Unpack[MeasureOptions],
    ) -> None:
        self.keys = _keys(keys)
        if not isinstance(postfix, str):
            raise TypeError(f"postfix must be a string; got {postfix!r}. Pass for example 'complexity'.")
        self.postfix = postfix
        self.allow_missing_keys = flag(allow_missing_keys, "allow_missing_keys")
        self.score = ShapeComplexityScore(threshold=threshold, spatial_ndim=spatial_ndim, dtype=dtype, **options)

    def __call__(self, sample: Mapping[str, Any]) -> dict[str, Any]:
        """The sample with its scores; the class says under which keys."""
        if not isinstance(sample, Mapping):
            raise TypeError(f"sample must be a dictionary; got {type(sample).__name__}. Call ShapeComplexityScore.")
        missing = [key for key in self.keys if key not in sample]
        if missing and not self.allow_missing_keys:
            raise KeyError(
                f"keys must be in the sample; got {missing}, which has {list(sample)}. Pass allow_missing_keys=True."
            )
        scored = dict(sample)
        for key in self.keys:
            if key in sample:
                for name, score in self.score.by_window(sample[key]).items():
                    scored[f"{key}_{self.postfix if self.score.measure.windows is None else name}"] = score
        return scored

    def __repr__(self) -> str:
        """As a call."""
        return f"{type(self).__name__}(keys={self.keys!r}, score={self.score!r})"


def _keys(keys: str | Sequence[str]) -> tuple[str, ...]:
    names = (keys,) if isinstance(keys, str) else keys
    if not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise TypeError(f"keys must be a string or several of them; got {keys!r}. Pass for example 'mask'.")
    if not names:
        raise ValueError("keys must name one mask or more; got none. Pass for example 'mask'.")
    return tuple(names)


def _array(mask: Tensor | ArrayLike | Image) -> NDArray[Any]:
    if isinstance(mask, Image) and len(mask.getbands()) > 1:
        raise TypeError(
            f"mask must be an image of one band; got mode {mask.mode}. "
            "Pass mask.convert('L'), or mask.getchannel(...) for the band that holds it."
        )
    if isinstance(mask, Tensor):
        return (mask.float() if mask.dtype == torch.bfloat16 else mask).numpy(force=True)  # NumPy has no bfloat16
    return np.asarray(mask)
