"""What does the complexity of decision regions cost, beside asking the classifier on the same grid?"""

from dataclasses import dataclass
from itertools import pairwise

import torch
from sklearn.datasets import make_moons
from torch import Tensor, nn

from benchmarks.timing import Ratio, alternate, ratio
from torchlinf.regions import bounds_around, decision_region_complexity

WIDTHS = (64, 256)


@dataclass(frozen=True)
class Answer:
    """Of one network: milliseconds that it takes on the grid, and how many times as long the whole call takes."""

    width: int
    milliseconds: float
    background: Ratio
    opened: Ratio


def run(resolution: int = 256, rounds: int = 7, widths: tuple[int, ...] = WIDTHS) -> list[Answer]:
    """Networks of three hidden layers, trained on two moons."""
    return [_answer(width, resolution, rounds) for width in widths]


def _answer(width: int, resolution: int, rounds: int) -> Answer:
    points, classes = make_moons(300, noise=0.3, random_state=0)
    model = trained(width, torch.from_numpy(points).float(), torch.from_numpy(classes))
    bounds = bounds_around(points, eps=0.5)
    found = decision_region_complexity(model, bounds, resolution=resolution)
    grid = torch.cartesian_prod(*found.axes).float()
    if not torch.equal(ask(model, grid).reshape(resolution, resolution) == 1, found.masks[1]):
        raise AssertionError("the grid must be the one that is measured")
    times = alternate(
        {
            "classifier": lambda: ask(model, grid),
            "background": lambda: decision_region_complexity(model, bounds, resolution=resolution),
            "open": lambda: decision_region_complexity(model, bounds, resolution=resolution, boundary="open"),
        },
        rounds=rounds,
    )
    alone = times["classifier"]
    return Answer(width, 1e3 * alone.median, ratio(times["background"], alone), ratio(times["open"], alone))


def trained(width: int, points: Tensor, classes: Tensor) -> nn.Sequential:
    """A network after 300 steps."""
    torch.manual_seed(0)
    sizes = (2, width, width, width)
    layers = [part for pair in pairwise(sizes) for part in (nn.Linear(*pair), nn.ReLU())]
    model = nn.Sequential(*layers, nn.Linear(width, 2))
    optimiser = torch.optim.Adam(model.parameters(), lr=3e-3)
    for _ in range(300):
        optimiser.zero_grad()
        nn.functional.cross_entropy(model(points), classes).backward()
        optimiser.step()
    return model


@torch.no_grad()
def ask(model: nn.Module, grid: Tensor) -> Tensor:
    """Classes on the grid, in the chunks of `decision_region_complexity`."""
    return torch.cat([model(chunk).argmax(dim=1) for chunk in grid.split(1 << 14)])
