"""The loop that knows no method: chunks of sweeps, a certificate after each, finished shapes leave the batch."""

from typing import Protocol

import torch
from torch import Tensor

from torchlinf._solver.layout import Layout, System
from torchlinf._solver.problem import Problem, Solved, certify
from torchlinf._solver.start import start
from torchlinf._solver.status import Status

FIRST_CHUNK = 8
CHUNK_SHARE = 8


class Method(Protocol):
    """One way to sweep, for all shapes of a system at once; every shape goes its own way."""

    line: Tensor
    system: System

    def __init__(self, system: System, line: Tensor) -> None:
        """Begin at the values on ``line``."""

    @staticmethod
    def limit(radius: Tensor) -> Tensor:
        """Sweeps allowed by default to shapes of these radii."""

    def sweep(self) -> None:
        """One application of the stencil."""

    def select(self, keep: Tensor) -> None:
        """Go on with the shapes of these indices only."""

    def fall_back(self, stalled: Tensor, best: Tensor) -> None:
        """Go on in a way that surely ends, from the values ``best``, on the shapes marked in ``stalled``."""


def iterate(kind: type[Method], problem: Problem, tol: float, max_sweeps: int | None) -> Solved:
    """Sweep until the relative error bound of every shape is at most ``tol``, or its sweeps are used up.

    The best certified iterate of each shape is kept and returned. A shape whose best bound has not halved while its
    sweeps doubled (and 8 D + 100 more were made) falls back. All shapes have the same sweeps behind them, so the
    chunks, which grow with them, are the same for a shape in any batch.
    """
    layout = Layout(problem.mask)
    radius = problem.radius.long()
    inside = layout.rows(layout.pack(problem.mask.to(problem.screening.dtype)))
    method = kind(System(layout, inside, problem.screening, radius), layout.pack(start(problem)))
    limit = kind.limit(radius) if max_sweeps is None else torch.full_like(radius, max_sweeps)
    value = torch.zeros_like(inside)
    bound = torch.full_like(problem.screening, torch.inf)
    status = torch.where(radius > 0, int(Status.MAX_SWEEPS), int(Status.EMPTY))
    sweeps = torch.zeros_like(radius)

    active = torch.arange(len(radius), device=radius.device)
    best, best_bound = layout.rows(method.line).clone(), bound.clone()
    mark, marked = bound.clone(), sweeps.clone()
    done = 0
    while len(active):
        new_bound = certify(method.system.residual(method.line))
        done += 1
        better = new_bound < best_bound
        best_bound = torch.where(better, new_bound, best_bound)
        torch.where(better[:, None], layout.rows(method.line), best, out=best)
        floor = 4 * torch.finfo(best.dtype).eps * best.amax(dim=1)
        # (not >) also holds for NaN
        solved = best_bound <= floor.clamp(min=tol)
        broken = new_bound.isnan()
        over = done >= limit[active]
        leave = solved | broken | over
        if leave.any():
            gone = active[leave]
            value[gone], bound[gone], sweeps[gone] = best[leave], best_bound[leave], done
            outcome = torch.where(
                solved, int(Status.CONVERGED), torch.where(broken, int(Status.NONFINITE), int(Status.MAX_SWEEPS))
            )
            status[gone] = torch.where(radius[gone] > 0, outcome[leave], int(Status.EMPTY))
            keep = (~leave).nonzero()[:, 0]
            active, best, best_bound, mark, marked = (
                active[keep],
                best[keep],
                best_bound[keep],
                mark[keep],
                marked[keep],
            )
            if not len(active):
                break
            method.select(keep)
        progress = best_bound <= mark / 2
        mark = torch.where(progress, best_bound, mark)
        marked = torch.where(progress, done, marked)
        stalled = done > 2 * marked + 8 * method.system.radius + 100
        method.fall_back(stalled, best)
        marked = torch.where(stalled, 2**60, marked)
        chunk = max(FIRST_CHUNK, done // CHUNK_SHARE)
        if max_sweeps is not None:
            chunk = min(chunk, max_sweeps - done - 1)
        for _ in range(chunk):
            method.sweep()
        done += chunk
    return Solved(layout.unpack(value), bound, sweeps, torch.zeros_like(sweeps), status)
