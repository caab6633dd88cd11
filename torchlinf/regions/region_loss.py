"""A loss that asks a network for simple decision regions while it trains."""

from typing import Any, Unpack

import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn

from torchlinf.losses import ShapeComplexityLoss
from torchlinf.measure import Measure, WindowOptions, takes
from torchlinf.regions.grids import Bounds, Grid, Plane


@takes(WindowOptions)
class DecisionRegionLoss(nn.Module):
    """Hard complexity of the decision regions of a network, with a gradient that moves their boundaries.

    The value is that of `decision_region_complexity(model, bounds, resolution=resolution).overall(low, high)`, times
    `weight`, with the boundary condition "background". The gradient is that of `torchlinf.losses.ShapeComplexityLoss`:
    some regions of each mask are flipped, one at a time, and the change of the complexity is measured exactly. That
    change goes to the probability that a class has against the strongest of the other classes, which is above 1/2 in
    the region of that class. Add the loss to a data term; it does not know the data.

    Args:
        bounds: (low, high) for each of 1 to 3 features; None if every call passes three points, for a plane.
        resolution: points along every axis, 2 or more. A step costs one evaluation of the model on the grid and about
            1 + `max_flips` solves a class.
        weight: factor of the loss, 0 or more.
        keep_area: if True, the loss neither gains nor loses when all logits of a class rise or fall together, as
            `ShapeComplexityLoss` explains; recommended for networks.
        max_flips: regions flipped per class and step at most, 1 or more.
        relative_margin: by how much the grid of a plane extends the longest side of its triangle at either end, as a
            share of that side, 0 or more. Only used with points.
        {measure options}

    Shape:
        - model: from (P, features), or (P, *features) for planes, to logits or log-probabilities (P, C), or to logits
          of class 1, (P,) or (P, 1). It is called as it is, in whatever mode; its first parameter says the dtype and
          device of the points.
        - points: (3, *features), of each call, such as three samples of the batch, instead of `bounds`.
        - output: a number, differentiable once in the parameters of the model. A class that is nowhere on the grid has
          no weight in it and gets no gradient; a class that is everywhere has 0.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: an argument has a wrong value, there are both bounds and points or neither, or the model answers in
            another shape, or not finite.
        RuntimeError: a field could not be solved to `tol`.

    Source: docs/regions and docs/training.

    Example:
        >>> _ = torch.manual_seed(0)
        >>> model = nn.Sequential(nn.Linear(2, 8), nn.Tanh(), nn.Linear(8, 3))
        >>> loss = DecisionRegionLoss([(-3, 3), (-3, 3)], resolution=24)(model)
        >>> loss.backward()
        >>> loss.item() > 0, bool(model[0].weight.grad.any())
        (True, True)
    """

    def __init__(
        self,
        bounds: Bounds | None = None,
        *,
        resolution: int = 64,
        weight: float = 1.0,
        keep_area: bool = True,
        max_flips: int = 16,
        relative_margin: float = 0.25,
        **options: Unpack[WindowOptions],
    ) -> None:
        super().__init__()
        self.measure = Measure.of(options, WindowOptions)
        self.measure.scalar_rho()
        self.grid = None if bounds is None else Grid.within(bounds, resolution)
        self.resolution, self.relative_margin = resolution, relative_margin
        self.complexity = ShapeComplexityLoss(
            weight=weight, reduction="none", keep_area=keep_area, max_flips=max_flips, **options
        )
        if self.grid is not None and len(self.grid.axes) > 3:
            raise ValueError(f"bounds must be of 1 to 3 features; got {len(self.grid.axes)}. Pass points, for planes.")

    def forward(self, model: Any, points: Tensor | ArrayLike | None = None) -> Tensor:
        """The loss of a model; see the class."""
        if (points is None) == (self.grid is None):
            raise ValueError(
                "either bounds or points must be given; got both or neither. Pass loss(model) with bounds, or "
                "DecisionRegionLoss()(model, X[:3])."
            )
        grid = self.grid
        if grid is None:
            grid = Grid.around(Plane.through(points), self.resolution, self.relative_margin)  # type: ignore[arg-type]
        number = torch.Size(grid.shape).numel()
        known = next((p for p in model.parameters() if p.is_floating_point()), torch.empty(0, device="cpu"))
        probability = against_others(_logits(model(grid.points(0, number).to(known)), number))  # (P, C)
        masks = probability.detach().T.reshape(-1, *grid.shape) > self.complexity.threshold
        value = self.complexity(probability.T.reshape(1, -1, *grid.shape))[0]  # (C,)
        area = masks.flatten(1).sum(dim=1)
        return (value * area).sum() / area.sum().clamp(min=1)


def against_others(logits: Tensor) -> Tensor:
    """Probability of each class against the strongest of the others alone, (P, C): above 1/2 where it is the largest.

    Example:
        >>> against_others(torch.tensor([[1.0, 1.0, 3.0]])).round(decimals=3)
        tensor([[0.1190, 0.1190, 0.8810]])
    """
    top = logits.topk(2, dim=1)
    first = torch.arange(logits.shape[1], device=logits.device) == top.indices[:, :1]
    return torch.sigmoid(logits - torch.where(first, top.values[:, 1:], top.values[:, :1]))


def _logits(answer: Tensor, number: int) -> Tensor:
    """(P, C) with 2 classes or more."""
    logits = answer[:, None] if answer.ndim == 1 else answer
    if logits.ndim != 2 or len(logits) != number:
        raise ValueError(
            f"model must answer ({number},) or ({number}, classes) for {number} points; got {tuple(answer.shape)}. "
            "Wrap it in one that reshapes its output."
        )
    if not bool(logits.detach().isfinite().all()):
        raise ValueError("model must answer finite numbers; got NaN or infinity. Lower the learning rate.")
    return torch.cat([torch.zeros_like(logits), logits], dim=1) if logits.shape[1] == 1 else logits
