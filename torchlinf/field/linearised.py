"""The linearised equation with ties split, in torch operations: gathers only, hence the same in every run."""

from collections.abc import Callable
from itertools import product

import torch
from torch import Tensor

ITERATIONS = 20_000
STARTS = 4


class TiedRows:
    """Rows y(x) - w(x) (mean of y over up(x) + mean of y over down(x)) for N shapes on padded lines `(N, P)`.

    up(x) are, of the neighbours within `tie` of the block's maximum, those that differ from x along the fewest axes;
    down(x) likewise. `torchlinf.kernels.ties` says why. Kept are 2 * 3^n bools a pixel.
    """

    def __init__(self, value: Tensor, weight: Tensor, tie: Tensor) -> None:
        """Linearise at `value` f with weights w, (N, *spatial); `tie` is absolute, (N,)."""
        self.spatial = tuple(value.shape[1:])
        v = self.pack(value)
        self.inside = v > 0
        self.weight = self.pack(weight) * self.inside
        self.offsets = _nearest_first(self.spatial)
        around = [v.roll(-offset, 1) for _, offset in self.offsets]
        high, low = around[0], around[0]
        for other in around[1:]:
            high, low = torch.maximum(high, other), torch.minimum(low, other)
        self.sides = [
            self._nearest([other >= high - tie[:, None] for other in around]),
            self._nearest([other <= low + tie[:, None] for other in around]),
        ]

    def _nearest(self, hits: list[Tensor]) -> tuple[list[Tensor], Tensor]:
        """Of the neighbours that hit, which are the nearest, and the share of each."""
        kept: list[Tensor] = []
        open_rows, count = self.inside, torch.zeros_like(self.inside, dtype=torch.int8)
        for axes in range(self.offsets[-1][0] + 1):
            ring = [hit & open_rows for (steps, _), hit in zip(self.offsets, hits, strict=True) if steps == axes]
            for hit in ring:
                count += hit
            kept += ring
            open_rows = self.inside & (count == 0)
        return kept, 1 / count.clamp(min=1).to(self.weight)

    def pack(self, x: Tensor) -> Tensor:
        """`(N, *spatial)` with a ring of zeros, as lines."""
        return torch.nn.functional.pad(x, [1] * (2 * len(self.spatial))).flatten(1)

    def unpack(self, lines: Tensor) -> Tensor:
        """Lines back to `(N, *spatial)`; what lies on the ring is beyond the array."""
        padded = lines.view(-1, *(size + 2 for size in self.spatial))
        return padded[:, *(slice(1, -1) for _ in self.spatial)]

    def spread(self, y: Tensor) -> Tensor:
        """At every pixel its shares of the w y of those that have it as a neighbour; outside the shapes as well."""
        total = torch.zeros_like(y)
        for kept, share in self.sides:
            part = self.weight * y * share
            for (_, offset), hit in zip(self.offsets, kept, strict=True):
                total += (part * hit).roll(offset, 1)
        return total

    def transposed_product(self, y: Tensor) -> Tensor:
        """A^T y for y that is 0 outside the shapes; 0 there."""
        return y - self.spread(y) * self.inside


def _nearest_first(spatial: tuple[int, ...]) -> list[tuple[int, int]]:
    """The block's neighbours as (axes along which they step, offset on a padded line), nearest first."""
    stride, strides = 1, []
    for size in reversed(spatial):
        strides.append(stride)
        stride *= size + 2
    steps = product((-1, 0, 1), repeat=len(spatial))
    return sorted(
        (sum(map(abs, step)), sum(k * stride for k, stride in zip(step, reversed(strides), strict=True)))
        for step in steps
    )


def bicgstab(operator: Callable[[Tensor], Tensor], right: Tensor, tol: float) -> tuple[Tensor, Tensor]:
    """Solve operator(y) = right, row by row `(N, P)`, until each residual is below `tol` in the 2-norm.

    Returns:
        y and the relative residual reached, `(N,)`: the true one, and not finite where `right` is not.
    """
    size = _dot(right, right).sqrt()
    y = torch.zeros_like(right)
    for _ in range(STARTS):
        r = right - operator(y)
        reached = _dot(r, r).sqrt() / torch.where(size == 0, 1, size)
        if (reached <= tol).all() or not reached.isfinite().all():
            break
        y = y + _bicgstab(operator, r, 0.1 * tol * size)
    return y, reached[:, 0]


def _bicgstab(operator: Callable[[Tensor], Tensor], r: Tensor, target: Tensor) -> Tensor:
    """What is to be added to reduce the residuals to the targets `(N, 1)`, as far as BiCGStab gets.

    A row that is done, or breaks down, has its steps set to 0 and stays as it is.
    """
    y, shadow, p = torch.zeros_like(r), r, r
    rho = _dot(shadow, r)
    going = _dot(r, r).sqrt() > target
    for _ in range(ITERATIONS):
        v = operator(p)
        alpha = _ratio(rho, _dot(shadow, v), going)
        half = r - alpha * v
        t = operator(half)
        omega = _ratio(_dot(t, half), _dot(t, t), going)
        y = y + alpha * p + omega * half
        r = torch.where(going, half - omega * t, r)
        following = _dot(shadow, r)
        beta = _ratio(following, rho, going) * _ratio(alpha, omega, going)
        going = going & (_dot(r, r).sqrt() > target) & (beta != 0)
        if not going.any():
            break
        p = r + beta * (p - omega * v)
        rho = following
    return y


def _ratio(a: Tensor, b: Tensor, where: Tensor) -> Tensor:
    return torch.where(where & (b != 0), a / torch.where(b == 0, 1, b), 0)


def _dot(a: Tensor, b: Tensor) -> Tensor:
    return (a * b).sum(dim=1, keepdim=True)
