"""Sweeps with momentum: the smoother between two linear solves of method="batched"."""

import math

import torch
from torch import Tensor

from torchlinf.field.stencil import System


def smooth(system: System, line: Tensor, sweeps: int, *, momentum: bool) -> Tensor:
    """Sweep so many times; the line that holds the values, this one or another.

    With `momentum` the values go on, after each pair of sweeps but the last, by a share of what the pair has changed,
    as in `AcceleratedValueIteration`.
    """
    rows = system.layout.rows
    r = (system.least_screening + (math.pi / (2 * system.radius[:, None].to(line))) ** 2).sqrt().clamp(max=1)
    most = (1 - r) / (1 + r)
    present, other = ((one, system.sweeps(one)) for one in (line, torch.zeros_like(line)))
    for pair in range(1, sweeps // 2 + 1):
        values, sweep = present
        sweep()
        sweep()
        if momentum and 2 * pair + 1 < sweeps:
            before, after = rows(other[0]), rows(values)
            share = most.clamp(max=(pair - 1) / (pair + 2))
            torch.sub(after, before, out=before).mul_(share).add_(after)
            present, other = other, present
    values, sweep = present
    if sweeps % 2:
        sweep()
    return values
