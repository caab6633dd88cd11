"""A program that uses every entry point, with types, as the code of a user does.

`make types` checks it with pyright and mypy --strict. `make dist-check` runs it from the installed wheel, with the
extras cli, plot and metrics alone.
"""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("MPLBACKEND", "Agg")

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

import torchlinf
from torchlinf import (
    ComplexityProfile,
    FieldSolution,
    Measure,
    decompose,
    labels,
    order,
    plot,
    regions,
    scoring,
    shapes,
)
from torchlinf.losses import ShapeComplexityLoss
from torchlinf.metrics import ShapeComplexity
from torchlinf.samplers import ComplexitySampler
from torchlinf.transforms import ShapeComplexityScore, ShapeComplexityScored


def measure(masks: Tensor) -> dict[str, float]:
    """The functions of the core."""
    distance: Tensor = torchlinf.chessboard_distance(masks)
    solution: FieldSolution = torchlinf.solve_field(masks)
    field: Tensor = torchlinf.linf_field(masks, tol=1e-6)
    profile: ComplexityProfile = torchlinf.complexity_profile(masks, bins=512)
    settings: Measure = profile.measure
    peak, scale = profile.peak()
    numbers: dict[str, Tensor] = {
        "distance": distance,
        "field": field,
        "bound": solution.error_bound,
        "mean": profile.mean(0.0, 0.5),
        "peak": peak,
        "scale": scale,
        "complexity": torchlinf.complexity(masks, low=0.0, high=0.25, estimator="entropy"),
        "map": torchlinf.complexity_map(masks),
    }
    assert settings.bins == 512
    return {name: float(number.double().mean()) for name, number in numbers.items()}


def train(masks: Tensor) -> float:
    """The loss, the soft functions and the metric in one step of training."""
    network = nn.Conv2d(2, 2, 3, padding=1)
    regulariser: nn.Module = ShapeComplexityLoss(weight=0.06, activation="sigmoid", keep_area=True)
    logits: Tensor = network(masks.float())
    loss: Tensor = nn.functional.binary_cross_entropy_with_logits(logits, masks.float()) + regulariser(logits)
    soft = torchlinf.soft_complexity(logits.sigmoid()).nanmean()
    (loss + soft).backward()  # type: ignore[no-untyped-call, unused-ignore]
    metric = ShapeComplexity(2, threshold=0.0, average="macro")
    metric.update(logits.detach())
    value = metric.compute()
    assert isinstance(value, Tensor)  # a dictionary with several windows
    return float(loss.detach()) + float(value)


def load(mask: NDArray[np.bool_]) -> list[int]:
    """The transforms and the sampler."""
    score = ShapeComplexityScore(high=0.5)
    scored = ShapeComplexityScored("mask")
    sample = scored({"mask": mask})
    number = score(mask)
    assert isinstance(number, Tensor)  # a dictionary with several windows
    sampler = ComplexitySampler([float(number), float(sample["mask_complexity"])], num_samples=2, seed=3)
    return list(sampler)


def inspect(masks: dict[str, Tensor], label_map: Tensor) -> list[tuple[str, ...]]:
    """Tables, orders, parts, regions and figures."""
    table: dict[str, NDArray[np.generic]] = labels.complexity_table(label_map)
    assert len(table["label"]) == 2
    profiles = {name: torchlinf.complexity_profile(mask, spatial_ndim=2) for name, mask in masks.items()}
    graph = order.hasse_diagram(order.dominance(profiles))
    longest: list[tuple[str, ...]] = order.longest_chain(graph)
    found: decompose.Decomposition = decompose.parts(masks["disc"], spatial_ndim=2)
    assert int(found.num_parts) >= 1
    classifier: Callable[[Tensor], Tensor] = lambda points: points[:, 0] ** 2 + points[:, 1] ** 2  # noqa: E731
    decided = regions.decision_region_complexity(classifier, [(-1.0, 1.0), (-1.0, 1.0)], resolution=32, threshold=0.5)
    value: Tensor = decided.profile.mean()
    assert value.ndim >= 0
    summary = regions.decision_region_summary(classifier, [(-1.0, 1.0), (-1.0, 1.0)], resolution=16, threshold=0.5)
    rows: dict[str, NDArray[np.generic]] = summary.table()
    assert len(rows["share"]) == len(summary.classes)
    plot.profile(masks["disc"], label="disc")
    plot.shapes(masks).savefig(os.devnull, format="png")
    return longest


def score(folder: Path) -> list[float | None]:
    """Files into rows."""
    np.save(folder / "disc.npy", shapes.disc(12).numpy())
    sources = scoring.find_masks([folder])
    return [row["complexity"] for row in scoring.score_masks(sources, workers=1)]


def main() -> None:
    masks = torch.stack([shapes.square(25), shapes.disc(12)])[None]
    label_map = torch.stack([1 * masks[0, 0], 2 * masks[0, 1]], dim=1).flatten(1)
    print(measure(masks), train(masks), load(shapes.disc(12).numpy()))
    print(inspect({"square": masks[0, 0], "disc": masks[0, 1]}, label_map))
    with tempfile.TemporaryDirectory() as folder:
        print(score(Path(folder)))


if __name__ == "__main__":
    main()
