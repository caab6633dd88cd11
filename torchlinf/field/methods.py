"""How a field is solved: one file per method, one loop that knows no method, and the table METHODS."""

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.transfer import to_device, to_host
from torchlinf.field.accelerated_value_iteration import AcceleratedValueIteration
from torchlinf.field.batched_policy_iteration import solve_batched
from torchlinf.field.iterate import iterate
from torchlinf.field.problem import Problem
from torchlinf.field.solution import FieldSolution
from torchlinf.field.value_iteration import ValueIteration
from torchlinf.kernels import has_compiler

if TYPE_CHECKING:
    from torchlinf.field.local_solve import LocalSolve
    from torchlinf.field.policy_iteration import PolicyIteration

Solver = Callable[[Problem, float, int | None], FieldSolution]


def _compiled(problem: Problem, tol: float, max_sweeps: int | None) -> FieldSolution:
    """The compiled method, imported when first used: numba takes longer to import than this whole library.

    Shapes on another device make a trip to the host.
    """
    if problem.compile:
        raise ValueError(
            'compile=True fuses the sweeps of the methods in torch operations; got method="compiled", which is so '
            'already. Pass method="accelerated", or leave compile out.'
        )
    if not has_compiler():
        raise ImportError('method="compiled" needs numba; it is not installed. Run: pip install numba')
    from torchlinf.field.policy_iteration import solve_compiled

    device, real = problem.mask.device, problem.screening.dtype
    mask, distance, radius, screening = to_host(problem.mask, problem.distance, problem.radius, problem.screening)
    solved = solve_compiled(Problem(mask, distance, radius, screening), tol, max_sweeps)
    if device.type == "cpu":
        return solved
    # In float32 a value is rounded once more, by half an ulp.
    bound = solved.error_bound + (torch.finfo(real).eps if real != torch.float64 else 0.0)
    found = solved.value.to(real), bound.to(real), solved.num_sweeps, solved.num_solves, solved.status
    return FieldSolution(*to_device(device, *found))


METHODS: dict[str, Solver] = {
    "monotone": partial(iterate, ValueIteration),
    "accelerated": partial(iterate, AcceleratedValueIteration),
    "batched": solve_batched,
    "compiled": _compiled,
}


# Where method="auto" solves masks that are on a device. A row has pairs (pixels, shapes), ascending in pixels: masks of
# at most so many pixels stay on the device in batches of at least so many shapes; the host solves all others.
# `make test-gpu` measures such a row and prints it. No GPU was at hand so far: all masks stay where they are.
STAYS: dict[str, tuple[tuple[float, float], ...]] = {"cuda": ((math.inf, 1),)}


def automatic(problem: Problem) -> str:
    """The method that ``method="auto"`` stands for: the one place of that choice."""
    if problem.compile or (problem.mask.device.type != "cpu" and not uses_kernels(problem.mask, "auto")):
        return "accelerated"
    return "compiled" if has_compiler() else "batched"


def uses_kernels(mask: Tensor, method: str) -> bool:
    """Whether shapes of this mask (N, *spatial) are solved one by one by the compiled kernels, on the host."""
    if method not in ("auto", "compiled") or not has_compiler():
        return False
    return method == "compiled" or mask.device.type == "cpu" or not _stays(mask)


def _stays(mask: Tensor) -> bool:
    """Whether "auto" solves a mask on the device that it is on."""
    pixels = mask[0].numel() if len(mask) else 0
    return next((len(mask) >= shapes for most, shapes in STAYS.get(mask.device.type, ()) if pixels <= most), True)


def solve_shape(mask: NDArray[np.bool_], rho: float | None, tol: float, check: Callable[[], None]) -> "PolicyIteration":
    """`torchlinf.field.policy_iteration.solve_shape`, which is imported when first used."""
    from torchlinf.field.policy_iteration import solve_shape

    return solve_shape(mask, rho, tol, check)


def solve_locally(solved: "PolicyIteration", rho: float | None, tol: float) -> "LocalSolve":
    """A solved shape in which pixels can be flipped, solved anew only where that reaches; it takes over the arrays."""
    from torchlinf.field.local_solve import LocalSolve

    return LocalSolve(solved, rho, tol)
