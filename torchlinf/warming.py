"""`warm_up`: calls that use every kernel with every type that the library passes.

This module plays a user: it calls the library's public functions on small shapes. So what the functions pass to kernels
is written in one place, and a test can ask whether anything is left to compile.
"""

import time
from importlib.util import find_spec

import numpy as np
import torch

from torchlinf.field import chessboard_distance, linf_field
from torchlinf.kernels import has_compiler
from torchlinf.losses import ShapeComplexityLoss, simplify
from torchlinf.measure import complexity, own_angle, soft_complexity, turned

SIDES = ((41,), (70, 90), (9, 11, 10), (5, 6, 5, 7))  # in 2-D large enough for coarse grids
LARGE = 340  # side of a square whose cut-out takes the path of large shapes


def warm_up() -> float:
    """Compile all kernels, so that no later call of this library on this machine has to.

    Meant for images of containers, whose processes would otherwise each compile anew: run it once when the image is
    built, as the user and with the NUMBA_CACHE_DIR that the processes will have.

    Returns:
        The seconds that it took: some 20 if nothing was compiled before, else about 1.

    Raises:
        ImportError: numba is not installed.

    Example:
        >>> import torchlinf
        >>> seconds = torchlinf.warm_up()
    """
    if not has_compiler():
        raise ImportError("warm_up compiles kernels with numba, which is not installed. Run: pip install numba")
    start = time.perf_counter()
    _call_everything()
    return time.perf_counter() - start


def _call_everything() -> None:
    """Solve small shapes in 1 to 4 dimensions, with all that is compiled."""
    generator = torch.Generator("cpu").manual_seed(0)
    for sides in SIDES:
        ndim = len(sides)
        mask = torch.rand(sides, generator=generator, device="cpu") < 0.97
        complexity(mask, spatial_ndim=ndim)
        complexity(mask, estimator="std", spatial_ndim=ndim)
        chessboard_distance(mask, spatial_ndim=ndim)
        rho = torch.tensor(5.0, device="cpu", requires_grad=True)
        linf_field(mask, rho=rho, spatial_ndim=ndim).sum().backward()
        small = tuple(slice(12) for _ in sides)
        grey = torch.rand(sides, generator=generator, device="cpu")[small].requires_grad_()
        soft_complexity(grey, spatial_ndim=ndim).backward()
        if ndim == 2:
            grey = torch.rand((1, 1, 12, 14), generator=generator, device="cpu").requires_grad_()
            ShapeComplexityLoss()(grey, torch.ones_like(grey)).backward()
            simplify(mask[:40, :40], weight=0.1, max_flips=2, keep_topology=True, spatial_ndim=2)
    small_mask = np.tri(12, 9, dtype=np.bool_)
    turned(small_mask, own_angle(small_mask))
    y, x = np.mgrid[:LARGE, :LARGE]
    complexity(torch.from_numpy((x - 100) ** 2 + (y - 90) ** 2 > 900), spatial_ndim=2)
    _solve_large_component()
    if find_spec("shapely") is not None:
        from torchlinf.polygons import simplify as simplify_outlines

        triangle = {"type": "Polygon", "coordinates": [[(0, 0), (9, 0), (0, 7), (0, 0)]]}
        simplify_outlines([triangle], resolution=1.0, straighten=0.5)


def _solve_large_component() -> None:
    """A component of the policy graph that elimination has no room for, as policies make it that reach any pixel."""
    from torchlinf.kernels.grid import make_grid, pad
    from torchlinf.kernels.policy_system import PolicySystem

    padded = pad(np.ones((40, 43), np.bool_))
    grid, inside = make_grid(padded), np.flatnonzero(padded)
    system, rng = PolicySystem(grid, 0.01), np.random.default_rng(40)
    places = np.arange(1, inside.size)
    system.up[inside[:-1]] = inside[rng.integers(places, inside.size)]
    system.down[inside[1:]] = inside[rng.integers(0, places)]
    system.up[inside[-1]] = inside[-1]
    system.solve(padded.reshape(-1).astype(float), 1e-6, lambda: None)
