"""How a solve ended."""

from enum import IntEnum


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
