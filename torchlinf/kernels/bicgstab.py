"""BiCGStab on arrays, with any operator. What elimination leaves over is rare, so this is not compiled."""

from collections.abc import Callable

import numpy as np

Operator = Callable[[np.ndarray], np.ndarray]

_DIVERGED = 1e8  # growth of the residual at which the iteration is given up, long before anything overflows


def bicgstab(operator: Operator, r: np.ndarray, target: float, iterations: int, precondition: Operator) -> np.ndarray:
    """What is to be added to x so that the residual r = b - A x shrinks to the 2-norm `target`.

    The iteration may stop short of that (breakdown, divergence, iterations used up): whoever calls looks at the true
    residual.

    Args:
        operator: the product A x, a new array.
        r: residual, left as it is.
        target: 2-norm of the residual at which to stop.
        iterations: how many at most.
        precondition: an approximate inverse of A, applied from the right; a new array, or what it was given.

    >>> matrix = np.array([[2.0, -1.0], [-0.5, 2.0]])
    >>> bicgstab(lambda x: matrix @ x, np.array([1.0, 2.0]), 1e-14, 10, lambda x: x).round(6).tolist()
    [1.142857, 1.285714]
    """
    x, shadow, p = np.zeros_like(r), r, r
    rho = _dot(shadow, r)
    limit = _DIVERGED * np.sqrt(rho)
    for _ in range(iterations):
        y = precondition(p)
        v = operator(y)
        projection = _dot(shadow, v)
        if projection == 0.0 or rho == 0.0:
            break
        alpha = rho / projection
        x += alpha * y
        r = r - alpha * v
        if np.sqrt(_dot(r, r)) <= target:
            break
        y = precondition(r)
        t = operator(y)
        square = _dot(t, t)
        omega = _dot(t, r) / square if square > 0.0 else 0.0
        x += omega * y
        r = r - omega * t
        if not target < np.sqrt(_dot(r, r)) <= limit or omega == 0.0:
            break
        following = _dot(shadow, r)
        p = r + following / rho * alpha / omega * (p - omega * v)
        rho = following
    return x


def _dot(a: np.ndarray, b: np.ndarray) -> float:
    """The inner product in numpy's own order; that of a BLAS library may depend on its threads."""
    return float((a * b).sum())
