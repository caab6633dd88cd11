"""The gradient of the loss: exact differences of the complexity under region flips, spread over the pixels.

`region_flip_gradient` is the operator that `ShapeComplexityLoss` calls, `finite_difference_gradient` what it computes.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchlinf._helpers.transfer import to_device, to_host
from torchlinf.losses.region_flips import candidates, complexities, differences, select
from torchlinf.measure import Measure


@torch.library.custom_op("torchlinf::region_flip_gradient", mutates_args=())
def region_flip_gradient(
    probability: Tensor,
    threshold: float,
    max_flips: int,
    deformations: bool,
    low: float,
    high: float,
    bins: int,
    estimator: str,
    levels: str,
    rho: float | None,
    tol: float,
    tol_bits: float,
) -> tuple[Tensor, Tensor]:
    """Complexity (N,) of thresholded shapes (N, *spatial) and its finite-difference gradient, like them.

    It is an operator of its own, so that torch.compile sees one opaque step and no graph breaks; therefore the options
    are plain numbers and words. Shapes on a device make one trip to the host. The value of an empty shape is the
    largest that any shape can have. Not differentiable; `ShapeComplexityLoss` makes its gradient of the second result.

    Raises:
        ValueError: a probability is not in [0, 1].

    Example:
        >>> options = 0.0, 1.0, 1024, "entropy", "distance", None, 1e-9, 0.0  # those of a `Measure`
        >>> region_flip_gradient(torch.ones(1, 4, 6), 0.5, 16, False, *options)[0]
        tensor([0.])
    """
    (on_host,) = to_host(probability)
    require_probabilities(on_host)
    measure = Measure(
        low=low,
        high=high,
        bins=bins,
        estimator=estimator,  # type: ignore[arg-type]
        levels=levels,  # type: ignore[arg-type]
        rho=rho,
        tol=tol,
        tol_bits=tol_bits,
    )
    value, gradient = finite_difference_gradient(
        on_host, threshold=threshold, max_flips=max_flips, deformations=deformations, measure=measure
    )
    value, gradient = value.nan_to_num(nan=measure.largest), gradient.contiguous()
    value, gradient = to_device(probability.device, value.to(probability.dtype), gradient.to(probability.dtype))
    return value, gradient


@region_flip_gradient.register_fake
def _(probability: Tensor, *options: object) -> tuple[Tensor, Tensor]:
    # Of the strides that the operator gives, which are not those of a permuted input.
    return probability.new_empty(len(probability)), probability.new_empty(probability.shape)


def require_probabilities(values: Tensor) -> None:
    """Raise unless all values are in [0, 1]; NaN passes."""
    # A sum of probabilities may be rounded to a little above 1.
    if bool(((values < 0) | (values > 1 + 4 * torch.finfo(values.dtype).eps)).any()):
        raise ValueError(
            f"input must hold probabilities in [0, 1]; got values from {values.min():.4g} to {values.max():.4g}. "
            'Pass activation="sigmoid" or "softmax" for logits.'
        )


def finite_difference_gradient(
    probability: Tensor, *, threshold: float, max_flips: int, deformations: bool, measure: Measure
) -> tuple[Tensor, Tensor]:
    """Hard complexity of each thresholded shape, and its finite-difference gradient under region flips.

    Args:
        probability: (N, *spatial) in [0, 1], on the CPU.
        threshold: the shape is where the probability is greater; in (0, 1).
        max_flips: regions flipped per shape, at most.
        deformations: whether the gradient is corrected by `torchlinf.losses.deformations`.
        measure: how complexity is measured.

    Returns:
        The complexity, (N,) float64, NaN for an empty shape, and the gradient G like `probability`, float64: the sum
        over the regions R of +-dC(R) / |R| on the pixels of R, + where R is outside and - where it is inside, dC(R)
        being the change of the complexity when R is flipped. The sum of G over a change of the shape says how much that
        change is worth.

    Example:
        >>> from torchlinf import shapes
        >>> shape = shapes.with_appendages((9, 9), [shapes.Appendage("right", 3, 2)], margin=2)
        >>> value, gradient = finite_difference_gradient(
        ...     shape[None].float(), threshold=0.5, max_flips=16, deformations=False, measure=Measure()
        ... )
        >>> value, gradient[0, 6, 11:13] > 0  # descent removes the appendage
        (tensor([0.2369], dtype=torch.float64), tensor([True, True]))
    """
    probability = probability.contiguous()
    inside = probability > threshold
    regions = select(inside, candidates(probability, threshold, max_flips), max_flips)
    value, difference = differences(inside, regions, measure)
    gradient = np.zeros((len(inside), inside[0].numel()))
    for n, (shape, tried) in enumerate(zip(inside.flatten(1).numpy(), regions, strict=True)):
        for region, change in zip(tried, difference[n], strict=True):
            gradient[n, region] += (-change if shape[region[0]] else change) / len(region)
    if deformations:
        _correct_by_deformations(gradient, value, inside, measure)
    return value, torch.from_numpy(gradient).reshape(inside.shape)


def _correct_by_deformations(gradient: NDArray[np.float64], value: Tensor, inside: Tensor, measure: Measure) -> None:
    """Correct the gradient (N, P) of each shape in place."""
    from torchlinf.losses.deformations import correct, deformed  # not needed without them, and loads SciPy

    lines = [deformed(shape) for shape in inside.numpy()]
    masks = (torch.from_numpy(mask) for line in lines for mask in line.reshape(-1, *inside.shape[1:]))
    along = complexities(masks, inside, measure).split([line.shape[0] * line.shape[1] for line in lines])
    for n, (line, values) in enumerate(zip(lines, along, strict=True)):
        gradient[n] = correct(gradient[n], value[n].item(), line, values.numpy().reshape(line.shape[:2]))


def without_area(gradient: Tensor, doubt: Tensor) -> Tensor:
    """Make the gradient neutral to a common shift of all logits of a shape, (N, *spatial).

    Such a shift changes the probability p by p (1 - p). So what it is worth is the product of the gradient with
    p (1 - p), and the multiple of p (1 - p) that makes the product zero is subtracted.

    Example:
        >>> without_area(torch.tensor([[2.0, 0.0, 5.0]]), torch.tensor([[0.25, 0.25, 0.0]]))
        tensor([[ 1., -1.,  5.]])
    """
    flat, doubt = gradient.flatten(1), doubt.flatten(1)
    excess = (flat * doubt).sum(dim=1) / doubt.square().sum(dim=1).clamp(min=torch.finfo(doubt.dtype).tiny)
    return (flat - excess[:, None] * doubt).reshape(gradient.shape)
