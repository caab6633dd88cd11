"""How a field is solved: one file per method, one loop that knows no method, and the table METHODS."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchlinf.field.accelerated_value_iteration import AcceleratedValueIteration
from torchlinf.field.batched_policy_iteration import solve_batched
from torchlinf.field.iterate import iterate
from torchlinf.field.problem import Problem
from torchlinf.field.solution import FieldSolution
from torchlinf.field.value_iteration import ValueIteration
from torchlinf.kernels import has_compiler, usable

if TYPE_CHECKING:
    from torchlinf.field.local_solve import LocalSolve
    from torchlinf.field.policy_iteration import PolicyIteration

Solver = Callable[[Problem, float, int | None], FieldSolution]


def _compiled(problem: Problem, tol: float, max_sweeps: int | None) -> FieldSolution:
    """The compiled method, imported when first used: numba takes longer to import than this whole library."""
    if problem.mask.device.type != "cpu":
        raise ValueError(
            f'method="compiled" needs a mask on the CPU; got one on {problem.mask.device}. '
            'Pass mask.cpu(), or method="auto".'
        )
    if problem.compile:
        raise ValueError(
            'compile=True fuses the sweeps of the methods in torch operations; got method="compiled", which is so '
            'already. Pass method="accelerated", or leave compile out.'
        )
    if not has_compiler():
        raise ImportError('method="compiled" needs numba; it is not installed. Run: pip install numba')
    from torchlinf.field.policy_iteration import solve_compiled

    return solve_compiled(problem, tol, max_sweeps)


METHODS: dict[str, Solver] = {
    "monotone": partial(iterate, ValueIteration),
    "accelerated": partial(iterate, AcceleratedValueIteration),
    "batched": solve_batched,
    "compiled": _compiled,
}


def automatic(problem: Problem) -> str:
    """The method that ``method="auto"`` stands for: the one place of that choice."""
    return "compiled" if usable(problem.mask) and not problem.compile else "accelerated"


def uses_kernels(mask: Tensor, method: str) -> bool:
    """Whether shapes of this mask are solved one by one by the compiled kernels."""
    return method in ("auto", "compiled") and usable(mask)


def solve_shape(mask: NDArray[np.bool_], rho: float | None, tol: float, check: Callable[[], None]) -> "PolicyIteration":
    """`torchlinf.field.policy_iteration.solve_shape`, which is imported when first used."""
    from torchlinf.field.policy_iteration import solve_shape

    return solve_shape(mask, rho, tol, check)


def solve_locally(solved: "PolicyIteration", rho: float | None, tol: float) -> "LocalSolve":
    """A solved shape in which pixels can be flipped, solved anew only where that reaches; it takes over the arrays."""
    from torchlinf.field.local_solve import LocalSolve

    return LocalSolve(solved, rho, tol)
