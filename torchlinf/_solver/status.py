"""How a solve ended."""

from enum import IntEnum


class Status(IntEnum):
    """How the solve of one shape ended; ``advice`` says in a sentence what to do about it."""

    CONVERGED = 0
    MAX_SWEEPS = 1
    EMPTY = 2
    NONFINITE = 3

    @property
    def advice(self) -> str:
        return _ADVICE[self]


_ADVICE = {
    Status.CONVERGED: "The error bound is within the tolerance; nothing is to be done.",
    Status.MAX_SWEEPS: "The sweeps were used up before the error bound reached tol; raise max_sweeps or tol.",
    Status.EMPTY: "The shape has no inside pixel, so its field is 0 and its complexity undefined; drop it or count it.",
    Status.NONFINITE: "The field left the range of its dtype; choose rho nearer to the radius of the shape.",
}
