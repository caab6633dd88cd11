"""How far apart neighbours may be that count as equal when policies are chosen: the rule of all linear solves.

What counts as equal must be rounding, never what is left to correct: such a difference is geometry, and it stays wrong
for as long as it counts as equal. So a share of the residual is the limit, where that is less than rounding on a large
shape may be.
"""

from torch import Tensor

EQUAL = 8.0  # what divides the residual


def equal_within(rounding: float, residual: float, finest: float) -> float:
    """The distance within which neighbours are equal; kernels compile this function too.

    Args:
        rounding: the most that rounding may part equal neighbours by.
        residual: the largest one of the field.
        finest: the least residual that floating point can reach.

    >>> equal_within(1e-6, 1e-9, 1e-12)
    1.25e-10
    """
    return min(rounding, max(residual / EQUAL, finest))


def equal_within_each(rounding: Tensor, residual: Tensor, finest: Tensor) -> Tensor:
    """The same of many shapes."""
    return (residual / EQUAL).maximum(finest).minimum(rounding)
