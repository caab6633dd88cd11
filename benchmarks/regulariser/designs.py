"""Ways to give the complexity of a thresholded probability a gradient, each by one function of one (H, W) tensor.

Each returns the value it stands for and the gradient with respect to the probability; the first argument is float64 in
[0, 1]. They are kept as short as they can be: what is compared is the idea.
"""

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

import torchlinf
from torchlinf.losses import ShapeComplexityLoss, region_flips

Design = Callable[[Tensor], tuple[float, Tensor]]
GENERATOR = torch.Generator()


def region_flip_gradient(probability: Tensor, max_flips: int = 64, deformations: bool = False) -> tuple[float, Tensor]:
    """The design of the library: differences of the hard complexity under flips of whole regions."""
    leaf = probability.clone().requires_grad_()
    value = ShapeComplexityLoss(max_flips=max_flips, deformations=deformations, keep_area=False)(leaf[None, None])
    value.backward()
    return value.item(), leaf.grad


def few_flips(probability: Tensor) -> tuple[float, Tensor]:
    """The same with at most 16 flips a step, as in training."""
    return region_flip_gradient(probability, max_flips=16)


def single_pixels(probability: Tensor) -> tuple[float, Tensor]:
    """Exact differences under flips of single pixels beside the boundary."""
    inside = (probability > 0.5)[None]
    edge = (torchlinf.chessboard_distance(inside, spatial_ndim=2) == 1) | (
        torchlinf.chessboard_distance(~inside, spatial_ndim=2) == 1
    )
    pixels = [edge.flatten().nonzero().numpy()]
    value, [difference] = region_flips.differences(inside, [list(pixels[0])], torchlinf.Measure())
    gradient = torch.zeros(probability.numel(), dtype=torch.float64)
    where = torch.from_numpy(pixels[0][:, 0])
    gradient[where] = torch.from_numpy(difference).nan_to_num() * torch.where(inside.flatten()[where], -1.0, 1.0)
    return value.item(), gradient.reshape(probability.shape)


def thresholds(probability: Tensor, count: int = 12) -> tuple[float, Tensor]:
    """Mean hard complexity over the thresholds of the smoothed probability.

    The pixels between two neighbouring levels are one region, and share the difference of the complexities there.
    """
    smooth = _smoothed(probability[None], 1.5)[0]
    levels = torch.linspace(0.1, 0.9, count, dtype=torch.float64)
    values = torchlinf.complexity(smooth[None] > levels[:, None, None], spatial_ndim=2)
    gradient = torch.zeros_like(probability)
    for lower, upper, below, above in zip(levels[:-1], levels[1:], values[:-1], values[1:], strict=True):
        between = (smooth > lower) & (smooth <= upper)
        if bool(between.any()) and bool(torch.isfinite(below - above)):
            gradient[between] = (below - above) / between.sum()  # raising them moves the upper shape to the lower
    return values.nanmean().item(), _smoothed(gradient[None], 1.5)[0]


def perturbations(probability: Tensor, count: int = 64, strength: float = 0.6) -> tuple[float, Tensor]:
    """Score function: smooth random perturbations, each credited with the complexity it leads to."""
    noise = torch.randn(count // 2, *probability.shape, generator=GENERATOR.manual_seed(0), dtype=torch.float64)
    noise = _smoothed(noise, 2.0)
    noise = strength * torch.cat([noise, -noise]) / noise.std()
    values = torchlinf.complexity(_smoothed(probability[None], 1.0) + noise > 0.5, spatial_ndim=2)
    credit = (values - values.nanmean()).nan_to_num()
    return values.nanmean().item(), (credit[:, None, None] * noise).mean(dim=0) / strength**2


def soft(probability: Tensor, slices: int = 1, estimator: str = "entropy") -> tuple[float, Tensor]:
    """Pointwise relaxation, `torchlinf.soft_complexity`: occupancy in the field, and its implicit adjoint."""
    leaf = probability.clone().requires_grad_()
    value = torchlinf.soft_complexity(leaf, slices=slices, estimator=estimator, spatial_ndim=2)
    value.backward()
    return value.item(), leaf.grad


def _smoothed(stack: Tensor, sigma: float) -> Tensor:
    """Gaussian smoothing of (N, H, W), zero beyond the array."""
    reach = int(3 * sigma)
    weight = torch.exp(-torch.arange(-reach, reach + 1, dtype=torch.float64).square() / (2 * sigma**2))
    weight = weight / weight.sum()
    stack = torch.nn.functional.conv2d(stack[:, None], weight.reshape(1, 1, -1, 1), padding=(reach, 0))
    return torch.nn.functional.conv2d(stack, weight.reshape(1, 1, 1, -1), padding=(0, reach))[:, 0]


DESIGNS: dict[str, Design] = {
    "region flips, at most 64": region_flip_gradient,
    "region flips, at most 16": few_flips,
    "region flips, at most 16, and deformations": partial(region_flip_gradient, max_flips=16, deformations=True),
    "single pixels": single_pixels,
    "thresholds": thresholds,
    "random perturbations": perturbations,
    "soft complexity": soft,
    "soft complexity, std": partial(soft, estimator="std"),
    "soft complexity, 4 slices": partial(soft, slices=4),
}
