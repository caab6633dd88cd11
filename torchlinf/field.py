"""The screened L-infinity field of a shape, solved to a certified accuracy."""

from dataclasses import dataclass

import torch
from torch import Tensor

from torchlinf._checks import as_mask, choice, count, positive, real_dtype
from torchlinf._solver import METHODS, automatic
from torchlinf._solver.problem import Problem, Solved
from torchlinf._solver.status import Status
from torchlinf.distance import distance_of

__all__ = ["FieldSolution", "Status", "linf_field", "solve_field"]


@dataclass(frozen=True)
class FieldSolution:
    """The field of each shape, and how far it can be trusted.

    Attributes:
        value: f like the mask, not normalised, 0 outside.
        error_bound: certified bound of max \\|value - f\\| / f per shape, leading shape of the mask.
        num_sweeps: applications of the stencil, certificates included, int64.
        num_solves: linear solves, int64.
        status: :class:`Status` values, int64.
    """

    value: Tensor
    error_bound: Tensor
    num_sweeps: Tensor
    num_solves: Tensor
    status: Tensor


def solve_field(
    mask: Tensor,
    *,
    rho: float | Tensor | None = None,
    tol: float = 1e-9,
    method: str = "auto",
    max_sweeps: int | None = None,
    throw: bool = True,
    spatial_ndim: int | None = None,
    dtype: torch.dtype | None = None,
) -> FieldSolution:
    """Solve max_B f + min_B f - (2 + 1/rho^2) f + 1 = 0 on every shape, with f = 0 outside, and certify the result.

    B is the 3^n block around a pixel. Solved in float64 whatever the dtype of the mask.

    >>> solution = solve_field(torch.ones(1, 1, 3, 3))
    >>> solution.status.tolist(), solution.error_bound.item() <= 1e-9
    ([[0]], True)
    """
    shapes, lead = as_mask(mask, spatial_ndim)
    tol = positive(tol, "tol")
    if max_sweeps is not None:
        max_sweeps = count(max_sweeps, "max_sweeps")
    choice(method, ("auto", *METHODS), "method")
    real_dtype(dtype)
    problem = _problem(shapes, rho, lead)
    solved = METHODS[automatic(problem) if method == "auto" else method](problem, tol, max_sweeps)
    if throw:
        _raise_failures(solved, lead)
    return FieldSolution(
        solved.value.to(dtype or solved.value.dtype).reshape(*lead, *shapes.shape[1:]),
        solved.error_bound.reshape(lead),
        solved.num_sweeps.reshape(lead),
        solved.num_solves.reshape(lead),
        solved.status.reshape(lead),
    )


def linf_field(
    mask: Tensor,
    *,
    rho: float | Tensor | None = None,
    tol: float = 1e-9,
    spatial_ndim: int | None = None,
    dtype: torch.dtype | None = None,
) -> Tensor:
    """The field of every shape, normalised to a maximum of 1.

    >>> linf_field(torch.ones(1, 1, 3, 3))[0, 0, 1].tolist()[1]
    1.0
    """
    solution = solve_field(mask, rho=rho, tol=tol, spatial_ndim=spatial_ndim)
    ndim = mask.ndim - solution.status.ndim
    spatial = tuple(range(mask.ndim - ndim, mask.ndim))
    top = solution.value.amax(dim=spatial, keepdim=True)
    field = solution.value / torch.where(top > 0, top, 1)
    return field if dtype is None else field.to(dtype)


def _problem(mask: Tensor, rho: float | Tensor | None, lead: tuple[int, ...]) -> Problem:
    distance = distance_of(mask)
    radius = distance.flatten(1).amax(dim=1)
    dtype = torch.float32 if mask.device.type == "mps" else torch.float64
    length = radius.clamp(min=1).to(dtype)
    if isinstance(rho, Tensor):
        length = rho.to(length).broadcast_to(lead).reshape(-1)
        if not (length.isfinite() & (length > 0)).all():
            raise ValueError("rho must be finite and above 0; got another value. Pass positive lengths in pixels.")
    elif rho is not None:
        length = torch.full_like(length, positive(rho, "rho"))
    return Problem(mask, distance, radius, length**-2)


def _raise_failures(solved: Solved, lead: tuple[int, ...]) -> None:
    failed = (solved.status == Status.MAX_SWEEPS) | (solved.status == Status.NONFINITE)
    if failed.any():
        raise RuntimeError("failed")
