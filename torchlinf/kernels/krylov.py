"""BiCGStab for the feedback of a component, z = P z + q, where P and q are known by one pass over all its rows."""

import numpy as np

from torchlinf.kernels._compile import kernel

# Rarely needed, but a component left inexact ties its pixels into still larger ones in the next round.
_ITERATIONS = 1000
_DIVERGED = 1e8  # growth of the residual at which it is given up, long before anything overflows


@kernel
def substitute(share, constant, weight, index, z, x):  # type: ignore[no-untyped-def]
    """x = z, then all rows in order: share constant_j + weight_j0 x_index_j0 + weight_j1 x_index_j1."""
    count = z.size
    for j in range(count):
        x[j] = z[j]
    for j in range(constant.size):
        x[count + j] = share * constant[j] + weight[j, 0] * x[index[j, 0]] + weight[j, 1] * x[index[j, 1]]


@kernel
def _apply(constant, weight, index, feedback, z, x, out):  # type: ignore[no-untyped-def]
    """out = (I - P) z."""
    substitute(0.0, constant, weight, index, z, x)
    for j in range(z.size):
        out[j] = z[j] - x[z.size + feedback[j]]


@kernel
def _dot(a, b):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(a.size):
        total += a[j] * b[j]
    return total


@kernel
def bicgstab(constant, weight, index, feedback, z, x, tol):  # type: ignore[no-untyped-def]
    """Improve z in place until no row of (I - P) z = q is off by more than `tol`; x is scratch for all rows.

    It may stop short of that (breakdown, iterations): the field's own certificate is what decides in the end.
    """
    size = z.size
    r, p, v, t = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    substitute(1.0, constant, weight, index, z, x)
    for j in range(size):
        r[j] = x[size + feedback[j]] - z[j]
    shadow = r.copy()
    limit = _DIVERGED * np.max(np.abs(r))
    p[:] = r
    rho = _dot(shadow, r)
    for _ in range(_ITERATIONS):
        _apply(constant, weight, index, feedback, p, x, v)
        projection = _dot(shadow, v)
        if projection == 0.0 or rho == 0.0:
            return
        alpha = rho / projection
        for j in range(size):
            r[j] -= alpha * v[j]
        _apply(constant, weight, index, feedback, r, x, t)
        square = _dot(t, t)
        omega = _dot(t, r) / square if square > 0.0 else 0.0
        worst = 0.0
        for j in range(size):
            z[j] += alpha * p[j] + omega * r[j]
            r[j] -= omega * t[j]
            worst = max(worst, abs(r[j]))
        if worst <= tol or worst > limit or omega == 0.0:
            return
        following = _dot(shadow, r)
        beta = following / rho * alpha / omega
        rho = following
        for j in range(size):
            p[j] = r[j] + beta * (p[j] - omega * v[j])
