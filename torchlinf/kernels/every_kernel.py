"""Calls that use every kernel with every type that the library passes.

This module plays a user: it calls the library's public functions on small shapes. So what the functions pass to kernels
is written in one place, and a test can ask whether anything is left to compile.
"""

import numpy as np
import torch

from torchlinf.kernels.grid import make_grid, pad
from torchlinf.kernels.policy_system import PolicySystem

SIDES = ((41,), (70, 90), (9, 11, 10), (5, 6, 5, 7))  # in 2-D large enough for coarse grids
LARGE = 340  # side of a square whose cut-out takes the path of large shapes


def call_everything() -> None:
    """Solve small shapes in 1 to 4 dimensions, with all that is compiled."""
    import torchlinf
    from torchlinf.losses import ShapeComplexityLoss

    generator = torch.Generator().manual_seed(0)
    for sides in SIDES:
        ndim = len(sides)
        mask = torch.rand(sides, generator=generator) < 0.97
        for estimator in ("entropy", "std"):
            torchlinf.complexity(mask, estimator=estimator, spatial_ndim=ndim)
        torchlinf.chessboard_distance(mask, spatial_ndim=ndim)
        rho = torch.tensor(5.0, requires_grad=True)
        torchlinf.linf_field(mask, rho=rho, spatial_ndim=ndim).sum().backward()
        small = tuple(slice(12) for _ in sides)
        grey = torch.rand(sides, generator=generator)[small].requires_grad_()
        torchlinf.soft_complexity(grey, spatial_ndim=ndim).backward()
        if ndim == 2:
            grey = torch.rand((1, 1, 12, 14), generator=generator).requires_grad_()
            ShapeComplexityLoss()(grey, torch.ones(1, 1, 12, 14)).backward()
    y, x = np.mgrid[:LARGE, :LARGE]
    torchlinf.complexity(torch.from_numpy((x - 100) ** 2 + (y - 90) ** 2 > 900), spatial_ndim=2)
    _solve_large_component()


def _solve_large_component() -> None:
    """A component of the policy graph with many feedback vertices, as random policies make them."""
    padded = pad(np.ones((160, 163), np.bool_))
    grid, inside = make_grid(padded), np.flatnonzero(padded)
    system, rng = PolicySystem(grid, 0.01), np.random.default_rng(160)
    system.up[inside] = inside + rng.choice(grid.block[grid.block > 0], inside.size)
    system.down[inside] = inside + rng.choice(grid.block[grid.block != 0], inside.size)
    system.solve(padded.reshape(-1).astype(float), 1e-6)
