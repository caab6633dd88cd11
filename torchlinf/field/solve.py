"""The screened L-infinity field of a shape, solved to a certified relative error."""

import numpy as np
import torch
from torch import Tensor

from torchlinf._helpers.boxes import maxima
from torchlinf._helpers.checks import as_mask, choice, count, flag, plain, positive, real_dtype
from torchlinf.field.adjoint import attach_gradient
from torchlinf.field.methods import METHODS, automatic
from torchlinf.field.problem import Problem, pose
from torchlinf.field.solution import FieldSolution, raise_failures


def solve_field(
    mask: Tensor,
    *,
    rho: float | Tensor | None = None,
    tol: float = 1e-9,
    method: str = "auto",
    max_sweeps: int | None = None,
    throw: bool = True,
    compile: bool = False,
    spatial_ndim: int | None = None,
    dtype: torch.dtype | None = None,
) -> FieldSolution:
    """Solve max_B f + min_B f - (2 + 1/rho^2) f + 1 = 0 on every shape, with f = 0 outside, and bound the error.

    B is the 3^n block around a pixel, itself included. The solution f exists and is unique. On a box it depends on the
    chessboard distance alone. Whatever method finds the values, their error is bounded from the residual of the
    equation: the bound is proven, up to rounding, and holds at every pixel.

    Args:
        mask: (B, C, *spatial) with 1 to 4 spatial dimensions, values 0 or 1 of any real dtype, nonzero is inside,
            beyond the array is outside. Each (b, c) is one shape, however many components it has.
        rho: screening length in pixels, a number or a tensor that broadcasts to the batch shape; None means each
            shape's own radius D, the largest chessboard distance in it.
        tol: relative error to reach. Residuals are known to a few ulps of the largest value, so no less than
            8 eps max f is asked for: that matters beyond D = 1200 in float64, and everywhere in float32.
        method: "compiled" is policy iteration in compiled kernels on the CPU, for which a mask on another device makes
            a trip to the host's memory (numba only); "batched" is policy iteration in torch operations on all shapes
            at once, and "accelerated" accelerated value iteration in torch operations (any device); "monotone" is value
            iteration, the slow reference, whose values decrease to the field (any device). "auto" is "compiled" for
            masks on the CPU, without numba "batched", and "accelerated" for masks on other devices.
        max_sweeps: sweeps allowed to each shape, an integer of 1 or more; None means far more than the method needs:
            20000 + 200 D for "compiled" and "batched", 400 D + 2000 for "accelerated", 40 D^2 + 1000 for "monotone".
        throw: raise when a shape is not certified to `tol`; with False look at `status` and `error_bound` instead.
        compile: fuse the sweeps of all methods but "compiled" by `torch.compile`, and let "auto" mean "accelerated".
            Meant for GPUs; on a CPU it costs some seconds at first and did not make them faster.
        spatial_ndim: if given, that many last dimensions are spatial, and all others, any number, are batch.
        dtype: of `value`; float16 ends at 65504, which f exceeds from D = 430 on. f is always computed, and by default
            returned, in float64, whatever the dtype of the mask; in float32 on devices without float64.

    Returns:
        A `FieldSolution`, on the device of the mask. An empty shape has value 0, error bound 0 and status EMPTY, and
        does not raise; a full mask is a box. Not differentiable. A shape's result does not depend on what else is in
        the batch.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong rank or value, or `method` does not go with `compile`.
        ImportError: `method` is "compiled", and numba is not installed.
        RuntimeError: with `throw`, if a shape is not certified to `tol`; the message names the shapes.

    Source: Arslan and Tari, "Complexity of Shapes Embedded in Z^n with a Bias Towards Squares", IEEE TIP 2020; the
    certificate and the methods: docs/method.

    Example:
        >>> import torch, torchlinf
        >>> solution = torchlinf.solve_field(torch.ones(1, 1, 3, 4))
        >>> solution.value[0, 0, 1]
        tensor([1.2414, 1.7931, 1.7931, 1.2414], dtype=torch.float64)
        >>> bool(solution.error_bound <= 1e-9), torchlinf.Status(int(solution.status)).name
        (True, 'CONVERGED')
    """
    plain(rho, "rho")
    shapes, batch_shape = as_mask(mask, spatial_ndim)
    if max_sweeps is not None:
        max_sweeps = count(max_sweeps, "max_sweeps")
    real_dtype(dtype)
    problem = pose(shapes, rho, batch_shape, flag(compile, "compile"))
    solved = solve(problem, batch_shape, tol=tol, method=method, max_sweeps=max_sweeps, throw=flag(throw, "throw"))
    return FieldSolution(
        value=solved.value.to(dtype or solved.value.dtype).reshape(*batch_shape, *shapes.shape[1:]),
        error_bound=solved.error_bound.reshape(batch_shape),
        num_sweeps=solved.num_sweeps.reshape(batch_shape),
        num_solves=solved.num_solves.reshape(batch_shape),
        status=solved.status.reshape(batch_shape),
    )


def linf_field(
    mask: Tensor,
    *,
    rho: float | Tensor | None = None,
    tol: float = 1e-9,
    spatial_ndim: int | None = None,
    dtype: torch.dtype | None = None,
) -> Tensor:
    """The screened L-infinity field of every shape, divided by its largest value.

    The field f solves max_B f + min_B f - (2 + 1/rho^2) f + 1 = 0 on the shape and is 0 outside; B is the 3^n block
    around a pixel, itself included. `solve_field` gives f itself, its error bound and the choice of the method.

    Args:
        mask: (B, C, *spatial) with 1 to 4 spatial dimensions, values 0 or 1 of any real dtype, nonzero is inside,
            beyond the array is outside. Each (b, c) is one shape, however many components it has.
        rho: screening length in pixels, a number or a tensor that broadcasts to the batch shape; None means each
            shape's own radius D, the largest chessboard distance in it.
        tol: relative error of the field before it is divided by its largest value, which about doubles the error at
            most. No less than 8 eps max f is asked for, the limit of rounding.
        spatial_ndim: if given, that many last dimensions are spatial, and all others, any number, are batch.
        dtype: of the result; None means float64, float32 on devices without it.

    Returns:
        Tensor like `mask`, in [0, 1]: 0 outside, positive inside, largest value 1 on each shape. All 0 for an empty
        shape; a full mask is a box. Differentiable once with respect to `rho`, by the implicit function theorem: one
        linear solve, in memory that does not depend on the number of sweeps. Neighbours that tie share the derivative.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong rank or value.
        RuntimeError: a shape could not be certified to `tol`; the message names it. In the backward pass: the linear
            solve failed.

    Source: Arslan and Tari, "Complexity of Shapes Embedded in Z^n with a Bias Towards Squares", IEEE TIP 2020.

    Example:
        >>> import torch, torchlinf
        >>> torchlinf.linf_field(torch.ones(1, 1, 3, 4))[0, 0, 1]
        tensor([0.6923, 1.0000, 1.0000, 0.6923], dtype=torch.float64)
    """
    plain(rho, "rho")
    shapes, batch_shape = as_mask(mask, spatial_ndim)
    real_dtype(dtype)
    problem = pose(shapes, rho, batch_shape)
    solved = solve(problem, batch_shape, tol=tol, method="auto")
    value = solved.value
    if isinstance(rho, Tensor) and rho.requires_grad:
        length = rho.to(value).broadcast_to(batch_shape).reshape(-1, *[1] * (value.ndim - 1))
        value = attach_gradient(value, shapes / (2 + length**-2), solved.error_bound, everywhere=False)
    return normalised(value).reshape(mask.shape).to(dtype or value.dtype)


def normalised(value: Tensor) -> Tensor:
    """Each field (N, *spatial) divided by its maximum, 0 where that is 0."""
    if value.device.type == "cpu" and not value.requires_grad:
        tops = maxima(value).numpy().reshape(-1, *[1] * (value.ndim - 1))
        return torch.from_numpy(value.numpy() / np.where(tops > 0, tops, 1))  # without OpenMP, see `for_each`
    top = largest(value).view(-1, *[1] * (value.ndim - 1))
    return value / torch.where(top > 0, top, 1)


def largest(x: Tensor) -> Tensor:
    """Maximum over each shape of (N, *spatial), whose derivative the pixels equal to it up to rounding share."""
    flat = x.flatten(1)
    top = flat.detach().amax(dim=1)
    if not x.requires_grad:
        return top
    peak = flat.detach() >= (1 - 1e-11) * top[:, None]
    mean = torch.where(peak, flat, 0).sum(dim=1) / peak.sum(dim=1)
    return top + (mean - mean.detach())


def solve(
    problem: Problem,
    batch_shape: tuple[int, ...],
    *,
    tol: float,
    method: str,
    max_sweeps: int | None = None,
    throw: bool = True,
) -> FieldSolution:
    """Solve a posed problem by the method of that name; `batch_shape` is for the message that names failed shapes."""
    tol = positive(tol, "tol")
    choice(method, ("auto", *METHODS), "method")
    solved = METHODS[automatic(problem) if method == "auto" else method](problem, tol, max_sweeps)
    if throw:
        raise_failures(solved.status, solved.error_bound, solved.num_sweeps, tol, batch_shape)
    return solved
