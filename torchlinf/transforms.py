"""Scores in datasets and loaders: transforms that add the complexity of a mask, and a sampler that draws by it."""

from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from PIL.Image import Image
from torch import Tensor

from torchlinf._checks import MAX_SPATIAL_NDIM, count, window
from torchlinf.measure import Measure, ragged_profile
from torchlinf.samplers import ComplexitySampler

__all__ = ["ComplexitySampler", "ShapeComplexityScore", "ShapeComplexityScored"]


class ShapeComplexityScore:
    """Transform from a mask to its complexity, the same number as `torchlinf.complexity`.

    Pass it as the `transform` or `target_transform` of a dataset, or call it in `__getitem__`. It is made for the
    workers of a `DataLoader`, forked or spawned: it pickles, and runs on one thread there. Flips and axis swaps do not
    change the score of a shape; rotations and rescaling do, a little.

    Args:
        low: lower end of the window of scales, excluded.
        high: upper end, included; 0 <= low < high <= 1.
        threshold: what is inside. None takes what is not zero (0 and 255, labels, a palette), and of floating-point
            masks only 0 and 1; with a number it is what is larger.
        spatial_ndim: that many last dimensions are spatial, all others are batch; 2 for images, 3 for volumes.
        bins: as in `torchlinf.complexity`.
        estimator: "entropy" or "std", as there.
        tol: relative error that the field is certified to.

    Shape:
        - mask: a tensor or NumPy array, (*lead, *spatial), bool, integer or real; or a PIL image of one band (modes 1,
          L, I, F, P). Colour and multi-band images raise.
        - output: float64 tensor of the leading shape, a number without dimensions for a single mask, so that loaders
          collate a batch of them to (B,). In bits, in [0, log2(bins)] (share of the field's maximum for "std"). NaN
          for an empty mask, exactly 0.0 for a full one.

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
    """

    def __init__(
        self,
        low: float = 0.0,
        high: float = 1.0,
        *,
        threshold: float | None = None,
        spatial_ndim: int = 2,
        bins: int = 1024,
        estimator: str = "entropy",
        tol: float = 1e-9,
    ) -> None:
        self.low, self.high = window(low, high)
        if threshold is not None and (isinstance(threshold, bool) or not isinstance(threshold, Real)):
            raise TypeError(f"threshold must be a number or None; got {threshold!r}. Pass for example threshold=0.5.")
        self.threshold = threshold
        self.spatial_ndim = count(spatial_ndim, "spatial_ndim")
        if self.spatial_ndim > MAX_SPATIAL_NDIM:
            raise ValueError(
                f"spatial_ndim must be from 1 to {MAX_SPATIAL_NDIM}; got {spatial_ndim}. Pass 2 for images."
            )
        self.measure = Measure(low=low, high=high, bins=bins, estimator=estimator, tol=tol)

    def __call__(self, mask: Tensor | ArrayLike | Image) -> Tensor:
        """Score a mask; see the class."""
        inside = self._inside(_array(mask))
        lead = inside.shape[: inside.ndim - self.spatial_ndim]
        shapes = inside.reshape(-1, *inside.shape[len(lead) :])
        profile = ragged_profile(lambda i: shapes[i], len(shapes), self.measure)
        return profile.mean(self.low, self.high).reshape(lead)

    def __repr__(self) -> str:
        """As a call, with what a user may want to see in the print of a pipeline."""
        return f"{type(self).__name__}(low={self.low}, high={self.high}, threshold={self.threshold})"

    def _inside(self, mask: NDArray[Any]) -> NDArray[np.bool_]:
        if mask.dtype.kind not in "buif":
            raise TypeError(f"mask must be bool, integer or real; got {mask.dtype}. Pass mask != 0.")
        if mask.ndim < self.spatial_ndim or 0 in mask.shape[mask.ndim - self.spatial_ndim :]:
            raise ValueError(
                f"mask must have at least spatial_ndim={self.spatial_ndim} dimensions, the last {self.spatial_ndim} of "
                f"size 1 or more; got {mask.shape}. Pass spatial_ndim=... or another mask."
            )
        inside: NDArray[np.bool_] = mask != 0 if self.threshold is None else mask > self.threshold
        if mask.dtype.kind != "f":
            return inside
        nan = bool(np.isnan(mask).any())
        if nan or (self.threshold is None and not bool((mask[inside] == 1).all())):
            got = "NaN. Replace it" if nan else f"{mask[inside & (mask != 1)][0]}. Pass threshold=0.5"
            raise ValueError(
                f"mask of floating point must hold only 0 and 1, or numbers without NaN beside a threshold; got {got}."
            )
        return inside


class ShapeComplexityScored:
    """The same for samples that are dictionaries, as in MONAI: `sample["mask"]` gives `sample["mask_complexity"]`.

    Args:
        keys: key of a mask, or several keys.
        postfix: the score of `key` is stored as `key_postfix`.
        allow_missing_keys: if True, keys that a sample does not have are passed over.
        kwargs: the arguments of `ShapeComplexityScore`.

    Returns a new dictionary with the old entries and the scores; the sample itself is left as it was.

    Raises:
        TypeError: as for `ShapeComplexityScore`, or the sample is no mapping.
        ValueError: as there.
        KeyError: a key is not in the sample.

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
        **kwargs: Any,
    ) -> None:
        self.keys = (keys,) if isinstance(keys, str) else tuple(keys)
        self.postfix = postfix
        self.allow_missing_keys = bool(allow_missing_keys)
        self.score = ShapeComplexityScore(**kwargs)

    def __call__(self, sample: Mapping[str, Any]) -> dict[str, Any]:
        """Add the scores; see the class."""
        if not isinstance(sample, Mapping):
            raise TypeError(f"sample must be a dictionary; got {type(sample).__name__}. Call ShapeComplexityScore.")
        missing = [key for key in self.keys if key not in sample]
        if missing and not self.allow_missing_keys:
            raise KeyError(
                f"keys must be in the sample; got {missing}, which has {list(sample)}. Pass allow_missing_keys=True."
            )
        found = {f"{key}_{self.postfix}": self.score(sample[key]) for key in self.keys if key in sample}
        return {**sample, **found}

    def __repr__(self) -> str:
        """As a call."""
        return f"{type(self).__name__}(keys={self.keys!r}, score={self.score!r})"


def _array(mask: Tensor | ArrayLike | Image) -> NDArray[Any]:
    if isinstance(mask, Image) and len(mask.getbands()) > 1:
        raise TypeError(
            f"mask must be an image of one band; got mode {mask.mode}. "
            "Pass mask.convert('L'), or mask.getchannel(...) for the band that holds it."
        )
    if isinstance(mask, Tensor):
        return (mask.float() if mask.dtype == torch.bfloat16 else mask).numpy(force=True)  # NumPy has no bfloat16
    return np.asarray(mask)
