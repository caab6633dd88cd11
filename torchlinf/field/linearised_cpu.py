"""The field's equation linearised at a field, on the CPU: solved forwards, or transposed for a gradient."""

import math

import numpy as np

from torchlinf.kernels import elimination, tied, ties
from torchlinf.kernels.grid import Grid

DROP = 1e-5  # entries of the factors below this, beside a diagonal of 2, are left out and made up for by iteration


class TiedSystem:
    """a(x) y(x) - mean of y over up(x) - mean of y over down(x) = b(x) on one shape, some 200 bytes a pixel.

    up(x) and down(x) are the neighbours that hold the extrema of v's block, see `torchlinf.kernels.ties`.
    """

    def __init__(self, grid: Grid, v: np.ndarray, a: np.ndarray, tie: float, drop: float = DROP) -> None:
        """Linearise at v, flat on the padded grid; `a` = 2 + s(x), flat; `tie` is absolute."""
        number = np.full(math.prod(grid.shape), -1, np.int32)
        inside = np.flatnonzero(v > 0)
        self.order = inside[np.argsort(v[inside], kind="stable")].astype(np.int32)
        number[self.order] = np.arange(grid.pixels, dtype=np.int32)
        self.begin, self.target, weight = ties.find_ties(v, self.order, *ties.nearest_first(grid), tie)
        self.matrix = (self.begin, number[self.target], weight, a[self.order])
        self.factors = elimination.factorise(*self.matrix, drop)

    def solve(self, b: np.ndarray, tol: float, transposed: bool = False) -> tuple[np.ndarray, float]:
        """The solution for a flat right-hand side, by unknown (pixel `order[i]`), and its relative residual."""
        rhs = b[self.order]
        y = rhs.copy()
        elimination.substitute(y, transposed, self.factors)
        return y, tied.solve_tied(rhs, y, transposed, tol, *self.matrix, self.factors)

    def spread(self, y: np.ndarray, out: np.ndarray) -> None:
        """Add to `out`, flat, at every pixel its shares of the y of those that have it as a neighbour.

        That is a y - A^T y, but outside the shape as well, on pixels that hold the minimum of a boundary pixel.
        """
        tied.spread(y, out, self.order, self.begin, self.target, self.matrix[2])
