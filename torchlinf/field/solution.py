"""What a solve gives: the field with its certified bound, how the solve ended, and the error where it failed."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from torch import Tensor

MAX_NAMED = 8  # shapes that the message of a failure names


class Status(IntEnum):
    """How the solve of one shape ended; `advice` says in a sentence what to do about it.

    Attributes:
        CONVERGED: certified to the tolerance.
        MAX_SWEEPS: the allowed sweeps were used up; values and bound are the best reached.
        EMPTY: no inside pixel; the field is 0.
        NONFINITE: a value is not a finite number.

    Example:
        >>> import torchlinf
        >>> torchlinf.Status.MAX_SWEEPS.advice
        'The sweeps were used up before the error bound reached tol: raise max_sweeps or tol.'
    """

    CONVERGED = 0
    MAX_SWEEPS = 1
    EMPTY = 2
    NONFINITE = 3

    @property
    def advice(self) -> str:
        """What to do, in one sentence."""
        return _ADVICE[self]


_ADVICE = {
    Status.CONVERGED: "The error bound is within the tolerance; nothing is to be done.",
    Status.MAX_SWEEPS: "The sweeps were used up before the error bound reached tol: raise max_sweeps or tol.",
    Status.EMPTY: "The shape has no inside pixel, so its field is 0 and its complexity undefined; drop it or count it.",
    Status.NONFINITE: "The field left the range of its dtype; choose rho nearer to the radius of the shape.",
}


@dataclass(frozen=True, eq=False)
class FieldSolution:
    """The field of each shape of a batch and how far it can be trusted; made by `solve_field`.

    (B, C) stands for the batch dimensions of the mask, which with `spatial_ndim` may be any number of dimensions.

    Attributes:
        value: f, like the mask, not normalised: positive inside, 0 outside.
        error_bound: (B, C), a proven bound of the relative error |value - f| / f at every pixel of the shape. 0 for an
            empty shape, inf where nothing is proven.
        num_sweeps: (B, C) int64, how often the stencil was applied to the shape, certificates included.
        num_solves: (B, C) int64, linear solves.
        status: (B, C) int64, values of `Status`.
    """

    value: Tensor
    error_bound: Tensor
    num_sweeps: Tensor
    num_solves: Tensor
    status: Tensor


def raise_failures(
    status: Tensor, error_bound: Tensor, num_sweeps: Tensor, tol: float, batch_shape: tuple[int, ...]
) -> None:
    """Raise RuntimeError naming the shapes that are neither certified nor empty, if there are any."""
    failed = ((status != Status.CONVERGED) & (status != Status.EMPTY)).nonzero()[:, 0].tolist()
    if not failed:
        return
    named = []
    for i in failed[:MAX_NAMED]:
        place = tuple(int(index) for index in np.unravel_index(i, batch_shape)) if batch_shape else ()
        bound, sweeps = error_bound[i].item(), num_sweeps[i].item()
        named.append(f"{place}: {Status(int(status[i])).name}, error bound {bound:.2g} after {sweeps} sweeps")
    if len(failed) > MAX_NAMED:
        named.append(f"and {len(failed) - MAX_NAMED} more")
    reasons = sorted({int(status[i]) for i in failed})
    advice = " ".join(Status(reason).advice for reason in reasons)
    raise RuntimeError(
        f"every shape must be certified to tol={tol:g}; {len(failed)} of {len(status)} are not. "
        f"{'; '.join(named)}. {advice} Or pass throw=False to get the values with their bounds."
    )
