"""BiCGStab for x = a + B x with at most two entries a row."""

import numpy as np

from torchlinf._kernels._compile import kernel

# Rarely needed, but a component left inexact ties its pixels into still larger ones in the next round.
_ITERATIONS = 1000


@kernel
def _apply(weight, index, x, out):  # type: ignore[no-untyped-def]
    """out = (I - B) x."""
    for j in range(x.size):
        out[j] = x[j] - weight[j, 0] * x[index[j, 0]] - weight[j, 1] * x[index[j, 1]]


@kernel
def _dot(a, b):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(a.size):
        total += a[j] * b[j]
    return total


@kernel
def bicgstab(constant, weight, index, x, tol):  # type: ignore[no-untyped-def]
    """Improve x in place until no row of (I - B) x = a is off by more than `tol`.

    It may stop short of that (breakdown, iterations): the field's own certificate is what decides in the end.
    """
    size = x.size
    r, p, v, t = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    _apply(weight, index, x, v)
    for j in range(size):
        r[j] = constant[j] - v[j]
    shadow = r.copy()
    p[:] = r
    rho = _dot(shadow, r)
    for _ in range(_ITERATIONS):
        _apply(weight, index, p, v)
        projection = _dot(shadow, v)
        if projection == 0.0 or rho == 0.0:
            return
        alpha = rho / projection
        for j in range(size):
            r[j] -= alpha * v[j]
        _apply(weight, index, r, t)
        square = _dot(t, t)
        omega = _dot(t, r) / square if square > 0.0 else 0.0
        worst = 0.0
        for j in range(size):
            x[j] += alpha * p[j] + omega * r[j]
            r[j] -= omega * t[j]
            worst = max(worst, abs(r[j]))
        if worst <= tol or omega == 0.0:
            return
        following = _dot(shadow, r)
        beta = following / rho * alpha / omega
        rho = following
        for j in range(size):
            p[j] = r[j] + beta * (p[j] - omega * v[j])
