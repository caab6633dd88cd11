"""The linearised system A x = b and A^T x = b: products, and BiCGStab preconditioned by elimination."""

import numpy as np

from torchlinf.kernels._compile import kernel
from torchlinf.kernels.elimination import substitute
from torchlinf.kernels.krylov import _dot

_ITERATIONS = 200
_STARTS = 5


@kernel
def product(x, out, transposed, begin, column, weight, a):  # type: ignore[no-untyped-def]
    """out = A x, or A^T x. Neighbours with a negative number are outside the shape, where x is 0."""
    for i in range(x.size):
        out[i] = a[i] * x[i]
    for i in range(x.size):
        for k in range(begin[i], begin[i + 1]):
            j = column[k]
            if j >= 0:
                if transposed:
                    out[j] -= weight[k] * x[i]
                else:
                    out[i] -= weight[k] * x[j]


@kernel
def _norm(x):  # type: ignore[no-untyped-def]
    return np.sqrt(_dot(x, x))


@kernel
def solve_tied(b, x, transposed, tol, begin, column, weight, a, factors):  # type: ignore[no-untyped-def]
    """Improve x in place until |b - A x| <= tol |b| (or with A^T). Returns the ratio reached.

    BiCGStab, preconditioned from the right; begun anew from the true residual where it breaks down or drifts from it.
    With exact factors the start is the solution, and only its residual is taken.
    """
    size = _norm(b)
    r = np.empty(b.size)
    reached = 0.0
    for start in range(_STARTS):
        product(x, r, transposed, begin, column, weight, a)
        for i in range(b.size):
            r[i] = b[i] - r[i]
        reached = _norm(r) / size if size > 0.0 else 0.0
        if reached <= tol or start == _STARTS - 1:
            break
        _bicgstab(r, x, transposed, 0.1 * tol * size, begin, column, weight, a, factors)
    return reached


@kernel
def _bicgstab(r, x, transposed, target, begin, column, weight, a, factors):  # type: ignore[no-untyped-def]
    """Add to x what reduces the residual r to norm `target`, as far as BiCGStab gets."""
    size = r.size
    shadow, p, y = r.copy(), r.copy(), np.empty(size)
    v, t = np.empty(size), np.empty(size)
    rho = _dot(shadow, r)
    for _ in range(_ITERATIONS):
        y[:] = p
        substitute(y, transposed, factors)
        product(y, v, transposed, begin, column, weight, a)
        projection = _dot(shadow, v)
        if projection == 0.0 or rho == 0.0:
            return
        alpha = rho / projection
        for i in range(size):
            x[i] += alpha * y[i]
            r[i] -= alpha * v[i]
        if _norm(r) <= target:
            return
        y[:] = r
        substitute(y, transposed, factors)
        product(y, t, transposed, begin, column, weight, a)
        square = _dot(t, t)
        omega = _dot(t, r) / square if square > 0.0 else 0.0
        for i in range(size):
            x[i] += omega * y[i]
            r[i] -= omega * t[i]
        if _norm(r) <= target or omega == 0.0:
            return
        following = _dot(shadow, r)
        beta = following / rho * alpha / omega
        rho = following
        for i in range(size):
            p[i] = r[i] + beta * (p[i] - omega * v[i])


@kernel
def spread(x, out, order, begin, target, weight):  # type: ignore[no-untyped-def]
    """Add x, share by share, to the flat pixels that each row points to, outside the shape as well."""
    for i in range(order.size):
        for k in range(begin[i], begin[i + 1]):
            out[target[k]] += weight[k] * x[i]
