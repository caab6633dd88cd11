"""The start: the exact solution on squares, a supersolution everywhere else."""

import torch
from torch import Tensor

from torchlinf.field.problem import Problem


def square_profile(radius: Tensor, screening: Tensor, length: int) -> Tensor:
    """g_D(k): the field of a square of radius D at chessboard distance k from its outside.

    g solves g(k+1) + g(k-1) - (2+s) g(k) + 1 = 0, g(0) = 0, g(D+1) = g(D). With 2 sinh(theta / 2) = sqrt(s) the
    solution is (1 - cosh(theta (D + 1/2 - k)) / cosh(theta (D + 1/2))) / s. It is evaluated as a product,
    2 sinh(a) sinh(b) / (s cosh(a + b)) with b = theta k / 2 and a + b = theta (D + 1/2), which neither cancels nor
    overflows once the growing exponentials are divided out.

    Args:
        radius: D, `(N,)` integers.
        screening: s, `(N,)` of the wanted dtype.
        length: number of distances.

    Returns:
        `(N, length)`, g_D(k) for k = 0 .. length - 1; beyond k = D the value g_D(D).

    >>> square_profile(torch.tensor([2]), torch.tensor([0.25], dtype=torch.float64), 3).round(decimals=6).tolist()
    [[0.0, 1.241379, 1.793103]]
    """
    s = screening[:, None]
    theta = 2 * torch.asinh(s.sqrt() / 2)
    D = radius[:, None].to(s.dtype)
    k = torch.arange(length, device=s.device, dtype=s.dtype).minimum(D)
    rise, rest = -torch.expm1(-theta * k), -torch.expm1(-theta * (2 * D + 1 - k))
    return rise * rest / (s * (1 + torch.exp(-theta * (2 * D + 1))))


def start(problem: Problem) -> Tensor:
    """v_0(x) = g_D(d(x)): never below the field f, and equal to it on every shape of complexity zero.

    g_D rises up to D. The block of x holds a pixel of distance d(x) - 1 and none above min(d(x) + 1, D), so
    R(v_0) <= g(d+1) + g(d-1) + 1 - (2+s) g(d) = 0: for any rho v_0 is a supersolution, from which T decreases.
    """
    distance = problem.distance.flatten(1)
    length = int(problem.radius.max()) + 1 if len(problem.radius) else 1
    profile = square_profile(problem.radius, problem.screening, length)
    return profile.gather(1, distance.long()).view(problem.mask.shape)
