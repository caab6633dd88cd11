"""Argument checks. Every message reads: argument, requirement, what came, remedy."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

# The command checks its options before it loads torch, and answers --help without it.
if TYPE_CHECKING:
    import torch
    from torch import Tensor

MAX_SPATIAL_NDIM = 4


def as_mask(mask: Tensor, spatial_ndim: int | None = None, name: str = "mask") -> tuple[Tensor, tuple[int, ...]]:
    """Check a binary mask and lay its shapes in a row.

    Args:
        mask: `(B, C, *spatial)` with 1 to 4 spatial dimensions; with `spatial_ndim` a batch shape of any length. Bool,
            integer or real dtype, every value 0 or 1, any strides.
        spatial_ndim: how many of the last dimensions are spatial; None means all after the first two.
        name: what the messages call the argument.

    Returns:
        The mask as bool `(N, *spatial)` and the batch shape, whose product is N (1 for an empty batch shape).

    Raises:
        TypeError: no tensor, or a complex one.
        ValueError: wrong rank, a spatial dimension of size 0, or values other than 0 and 1.

    >>> import torch
    >>> shapes, batch_shape = as_mask(torch.ones(2, 3, 4, 5))
    >>> tuple(shapes.shape), shapes.dtype, batch_shape
    ((6, 4, 5), torch.bool, (2, 3))
    """
    import torch

    if not isinstance(mask, torch.Tensor):
        remedy = "Pass torch.from_numpy(array)." if type(mask).__module__ == "numpy" else "Pass torch.as_tensor(...)."
        raise TypeError(f"{name} must be a torch.Tensor; got {type(mask).__name__}. {remedy}")
    if mask.layout != torch.strided or mask.is_meta:
        got = "a meta tensor" if mask.is_meta else f"layout {mask.layout}"
        raise TypeError(f"{name} must be a dense tensor with data; got {got}. Pass {name}.to_dense() of a sparse one.")
    plain(mask, name)
    if mask.is_complex():
        raise TypeError(f"{name} must be bool, integer or real; got {mask.dtype}. Pass {name} != 0.")
    ndim = _spatial_ndim(mask, spatial_ndim, name)
    batch_shape, spatial = tuple(mask.shape[: mask.ndim - ndim]), tuple(mask.shape[mask.ndim - ndim :])
    if 0 in spatial:
        raise ValueError(
            f"{name} must have spatial dimensions of size 1 or more; got spatial shape {spatial}. "
            "Drop the shapes without pixels first."
        )
    rows = (math.prod(batch_shape), *spatial)
    if mask.device.type == "cpu" and mask.dtype != torch.bfloat16:
        # NumPy starts no threads of OpenMP, which a forked child would wait for without end; see `for_each`.
        values = mask.numpy(force=True)
        return torch.from_numpy(
            (values if mask.dtype == torch.bool else _binary(values, name)).reshape(rows)
        ), batch_shape
    inside = mask.detach() if mask.dtype == torch.bool else _binary(mask.detach(), name)
    return inside.reshape(rows), batch_shape


def plain(x: Any, name: str) -> None:
    """Raise for a tensor without data, as inside the transforms of torch.func, which solves cannot see through."""
    import torch

    if not isinstance(x, torch.Tensor):
        return
    try:
        x.data_ptr()
    except RuntimeError:
        raise NotImplementedError(
            f"{name} must be a tensor with data; got one without, as inside torch.func.vmap or torch.func.grad. "
            "Stack shapes along a batch dimension instead, and call torch.autograd.grad for a derivative."
        ) from None


def _spatial_ndim(mask: Tensor, spatial_ndim: int | None, name: str) -> int:
    if spatial_ndim is None:
        ndim = mask.ndim - 2
        if 1 <= ndim <= MAX_SPATIAL_NDIM:
            return ndim
        remedy = "Pass spatial_ndim, the number of spatial dimensions."
        if 1 <= mask.ndim <= 2:
            remedy = f"Pass spatial_ndim={mask.ndim} or {name}[None, None]."
        raise ValueError(
            f"{name} must be (B, C, *spatial) with 1 to {MAX_SPATIAL_NDIM} spatial dimensions; "
            f"got {tuple(mask.shape)}. {remedy}"
        )
    ndim = number_of_axes(spatial_ndim)
    if mask.ndim < ndim:
        raise ValueError(
            f"{name} must have at least spatial_ndim={ndim} dimensions; got {tuple(mask.shape)}. "
            f"Pass spatial_ndim={max(mask.ndim, 1)} or add dimensions to {name}."
        )
    return ndim


def number_of_axes(spatial_ndim: int) -> int:
    """Return `spatial_ndim` as an int if it is an integer from 1 to 4, else raise.

    >>> number_of_axes(2)
    2
    """
    if isinstance(spatial_ndim, bool) or not isinstance(spatial_ndim, Integral):
        raise TypeError(
            f"spatial_ndim must be an integer from 1 to {MAX_SPATIAL_NDIM}; got {spatial_ndim!r}. "
            "Pass 2 for images, 3 for volumes."
        )
    if not 1 <= spatial_ndim <= MAX_SPATIAL_NDIM:
        raise ValueError(
            f"spatial_ndim must be from 1 to {MAX_SPATIAL_NDIM}; got {spatial_ndim}. Pass 2 for images, 3 for volumes."
        )
    return int(spatial_ndim)


def _binary(mask: Any, name: str) -> Any:
    """Where a tensor or an array of 0 and 1 is 1."""
    inside = mask == 1
    wrong = ~(inside | (mask == 0))
    if wrong.any():
        value = mask[wrong].reshape(-1)[0].item()
        if (mask != mask).any():
            raise ValueError(f"{name} must hold only 0 and 1; got NaN. Pass {name} > threshold after removing the NaN.")
        remedy = f"Pass {name} > threshold" if isinstance(value, float) else f"Pass {name} != 0 for nonzero inside"
        raise ValueError(f"{name} must hold only 0 and 1; got {value}. {remedy}.")
    return inside


def number(value: float, name: str, wanted: str = "a number", remedy: str = "Pass a float.") -> float:
    """Return `value` as a float if it is a real number, else raise; `wanted` is what the message asks for.

    >>> number(1, "tol")
    1.0
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name} must be {wanted}; got {value!r}. {remedy}")
    return float(value)


def number_or_none(
    value: float | None, name: str, remedy: str = "Pass for example {name}=0.5, or None."
) -> float | None:
    """Return `value` as a float if it is a real number other than NaN, or None; else raise.

    >>> number_or_none(127, "threshold"), number_or_none(None, "threshold")
    (127.0, None)
    """
    if value is None:
        return None
    remedy = remedy.replace("{name}", name)
    found = number(value, name, "a number or None", remedy)
    if math.isnan(found):
        raise ValueError(f"{name} must be a number or None; got NaN. {remedy}")
    return found


def positive(value: float, name: str) -> float:
    """Return `value` as a float if it is a finite number above 0, else raise.

    >>> positive(1, "tol")
    1.0
    """
    found = number(value, name, "a number above 0")
    if not (math.isfinite(found) and found > 0):
        raise ValueError(f"{name} must be finite and above 0; got {value!r}. Pass a positive number.")
    return found


def not_negative(value: float, name: str) -> float:
    """Return `value` as a float if it is a finite number of 0 or more, else raise.

    >>> not_negative(0, "margin")
    0.0
    """
    found = number(value, name, "a number of 0 or more")
    if not (math.isfinite(found) and found >= 0):
        raise ValueError(f"{name} must be finite and 0 or more; got {value!r}. Pass 0.0 or a positive number.")
    return found


def from_zero(value: float, name: str) -> float:
    """Return `value` as a float if it is a number of 0 or more, infinity allowed, else raise.

    >>> from_zero(0, "tol_bits")
    0.0
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name} must be a number of 0 or more; got {value!r}. Pass a float.")
    if not value >= 0:
        raise ValueError(f"{name} must be 0 or more; got {value!r}. Pass for example 0.0.")
    return float(value)


def positive_tensor(value: Tensor, shape: tuple[int, ...], name: str) -> Tensor:
    """Return `value` broadcast to `shape` if all of it is real, finite and above 0, else raise.

    >>> import torch
    >>> positive_tensor(torch.tensor([2.0]), (2,), "rho")
    tensor([2., 2.])
    """
    plain(value, name)
    import torch

    if value.is_complex() or value.dtype == torch.bool:
        raise TypeError(f"{name} must be a real tensor; got {value.dtype}. Pass lengths in pixels as float64.")
    value = value.detach()
    wrong = ~(value.isfinite() & (value > 0))
    if wrong.any():
        raise ValueError(
            f"{name} must be finite and above 0; got {value[wrong].flatten()[0].item()}. Pass positive numbers."
        )
    try:
        return value.broadcast_to(shape)
    except RuntimeError:
        raise ValueError(
            f"{name} must broadcast to the batch shape {shape}; got {tuple(value.shape)}. "
            "Pass a number, or one value a shape."
        ) from None


def integer(value: int, name: str, least: int) -> int:
    """Return `value` as an int if it is an integer of `least` or more, else raise.

    >>> integer(0, "seed", 0)
    0
    """
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise TypeError(f"{name} must be an integer of {least} or more; got {value!r}. Pass an int.")
    if value < least:
        remedy = "Pass a positive int." if least == 1 else f"Pass {least} or a larger int."
        raise ValueError(f"{name} must be an integer of {least} or more; got {value!r}. {remedy}")
    return int(value)


def whole(value: int, name: str) -> int:
    """Return `value` as an int if it is an integer of either sign, else raise.

    >>> whole(-3, "points")
    -3
    """
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise TypeError(f"{name} must be integers; got {value!r}. Round them to whole pixels.")
    return int(value)


def count(value: int, name: str) -> int:
    """Return `value` as an int if it is an integer of 1 or more, else raise.

    >>> count(3, "bins")
    3
    """
    return integer(value, name, 1)


def flag(value: bool, name: str) -> bool:
    """Return `value` if it is True or False, else raise: the truth of "no" or of an array is not what is meant.

    >>> flag(True, "keep_area")
    True
    """
    if not isinstance(value, bool):
        raise TypeError(f"{name} must be True or False; got {value!r}. Pass a bool.")
    return value


def fraction(value: float, name: str) -> float:
    """Return `value` as a float if it lies strictly between 0 and 1, else raise.

    >>> fraction(0.5, "threshold")
    0.5
    """
    found = number(value, name, "a number in (0, 1)")
    if not 0 < found < 1:
        raise ValueError(f"{name} must lie strictly between 0 and 1; got {value!r}. Pass for example 0.5.")
    return found


def window(low: float, high: float) -> tuple[float, float]:
    """Return the window of scales (low, high] as floats if 0 <= low < high <= 1, else raise.

    >>> window(0, 0.25)
    (0.0, 0.25)
    """
    for name, value in (("low", low), ("high", high)):
        number(value, name, "a number in [0, 1]")
    if not 0 <= low < high <= 1:
        raise ValueError(
            f"low and high must obey 0 <= low < high <= 1; got low={low!r}, high={high!r}. "
            "Scales are fractions of the radius: pass for example low=0.0, high=0.25."
        )
    return float(low), float(high)


def choice(value: str, options: tuple[str, ...], name: str) -> str:
    """Return `value` if it is one of `options`, else raise.

    >>> choice("std", ("entropy", "std"), "estimator")
    'std'
    """
    listed = ", ".join(repr(option) for option in options)
    if not isinstance(value, str):
        raise TypeError(f"{name} must be one of {listed}; got {value!r}. Pass {name}={options[0]!r}.")
    if value not in options:
        raise ValueError(f"{name} must be one of {listed}; got {value!r}. Pass {name}={options[0]!r}.")
    return value


def real_dtype(dtype: torch.dtype | None, name: str = "dtype") -> torch.dtype | None:
    """Return `dtype` if it is None or a real floating-point dtype, else raise.

    >>> import torch
    >>> real_dtype(torch.float32)
    torch.float32
    """
    if dtype is None:
        return None
    import torch

    if not isinstance(dtype, torch.dtype):
        raise TypeError(f"{name} must be a torch dtype; got {dtype!r}. Pass for example torch.float32.")
    if not dtype.is_floating_point:
        raise TypeError(f"{name} must be a floating-point dtype; got {dtype}. Pass for example torch.float32.")
    return dtype
