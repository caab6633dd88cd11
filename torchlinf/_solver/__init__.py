"""How a field is solved: one file per method, one loop that knows no method, and the table METHODS."""

from collections.abc import Callable
from functools import partial

from torchlinf._solver.accelerated import Accelerated
from torchlinf._solver.iterate import iterate
from torchlinf._solver.monotone import Monotone
from torchlinf._solver.problem import Problem, Solved

Solver = Callable[[Problem, float, int | None], Solved]

METHODS: dict[str, Solver] = {
    "monotone": partial(iterate, Monotone),
    "accelerated": partial(iterate, Accelerated),
}


def automatic(problem: Problem) -> str:
    """The method that ``method="auto"`` stands for: the one place of that choice."""
    return "accelerated"
