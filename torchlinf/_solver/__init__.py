"""How a field is solved: one file per method, one loop that knows no method, and the table METHODS."""

from collections.abc import Callable
from functools import partial

from torchlinf._kernels import has_compiler, usable
from torchlinf._solver.accelerated import Accelerated
from torchlinf._solver.iterate import iterate
from torchlinf._solver.monotone import Monotone
from torchlinf._solver.problem import Problem, Solved

Solver = Callable[[Problem, float, int | None], Solved]


def _compiled(problem: Problem, tol: float, max_sweeps: int | None) -> Solved:
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
    from torchlinf._solver.compiled import compiled

    return compiled(problem, tol, max_sweeps)


METHODS: dict[str, Solver] = {
    "monotone": partial(iterate, Monotone),
    "accelerated": partial(iterate, Accelerated),
    "compiled": _compiled,
}


def automatic(problem: Problem) -> str:
    """The method that ``method="auto"`` stands for: the one place of that choice."""
    return "compiled" if usable(problem.mask) and not problem.compile else "accelerated"
