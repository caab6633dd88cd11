"""Shapes for the tests, and what is known about them by other means than the library's own code.

The oracles are plain Python loops or dense linear algebra, taken from the definitions. They are slow on purpose: use
them on shapes of some hundred pixels.
"""

from collections.abc import Iterator
from itertools import permutations, product

import networkx as nx
import numpy as np
import torch

Pixel = tuple[int, ...]


def pixels(mask: np.ndarray) -> list[Pixel]:
    """The inside pixels."""
    return [tuple(int(i) for i in index) for index in np.argwhere(mask)]


def block(pixel: Pixel) -> Iterator[Pixel]:
    """The 3^n pixels around one, itself included."""
    for offset in product((-1, 0, 1), repeat=len(pixel)):
        yield tuple(i + j for i, j in zip(pixel, offset, strict=True))


def naive_distance(mask: np.ndarray) -> np.ndarray:
    """Chessboard distance as defined, the least over the outside; of that beyond the array one ring is enough."""
    padded = np.pad(mask.astype(bool), 1)
    outside = np.argwhere(~padded)
    distance = np.zeros(mask.shape, dtype=np.int32)
    for pixel in pixels(mask):
        distance[pixel] = np.abs(outside - 1 - np.array(pixel)).max(axis=1).min()
    return distance


def naive_field(mask: np.ndarray, rho: float | None = None, change: float = 1e-15) -> np.ndarray:
    """The field f by Gauss-Seidel sweeps from zero, until no pixel changes by more than `change` of the largest."""
    inside = pixels(mask)
    if not inside:
        return np.zeros(mask.shape)
    screening = 1 / (naive_distance(mask).max() if rho is None else rho) ** 2
    around = {pixel: list(block(pixel)) for pixel in inside}
    field = dict.fromkeys((other for blocks in around.values() for other in blocks), 0.0)
    largest_change = np.inf
    while largest_change > change * max(field.values()):
        largest_change = 0.0
        for pixel in inside:
            values = [field[other] for other in around[pixel]]
            new = (max(values) + min(values) + 1) / (2 + screening)
            largest_change = max(largest_change, abs(new - field[pixel]))
            field[pixel] = new
    result = np.zeros(mask.shape)
    for pixel in inside:
        result[pixel] = field[pixel]
    return result


def naive_residual(field: np.ndarray, mask: np.ndarray, rho: float) -> np.ndarray:
    """max + min + 1 - (2 + 1/rho^2) f over the block of every inside pixel, 0 outside."""
    padded = np.pad(field, 1)
    residual = np.zeros(mask.shape)
    for pixel in pixels(mask):
        values = [padded[tuple(i + 1 for i in other)] for other in block(pixel)]
        residual[pixel] = max(values) + min(values) + 1 - (2 + rho**-2) * field[pixel]
    return residual


def square_values(radius: int, rho: float) -> np.ndarray:
    """The field of a box of this radius at the distances 0 .. radius: a dense tridiagonal system, solved."""
    matrix = np.zeros((radius, radius))
    for k in range(radius):
        matrix[k, k] = 2 + rho**-2
        if k > 0:
            matrix[k, k - 1] = -1
        # the innermost pixel is its own maximum
        matrix[k, min(k + 1, radius - 1)] -= 1
    return np.concatenate([[0.0], np.linalg.solve(matrix, np.ones(radius))])


def box_field(sizes: tuple[int, ...], rho: float | None = None) -> np.ndarray:
    """The field of a full array: the distance to its border, put through `square_values`."""
    distance = np.min(
        [np.minimum(index + 1, size - index) for index, size in zip(np.indices(sizes), sizes, strict=True)], axis=0
    )
    radius = int(distance.max())
    return square_values(radius, float(radius) if rho is None else rho)[distance]


def catalogue() -> dict[str, np.ndarray]:
    """Small 2-D shapes, each awkward in its own way."""
    shapes = {
        "empty": np.zeros((5, 7), bool),
        "full": np.ones((6, 9), bool),
        "one pixel": np.zeros((4, 6), bool),
        "corner pixel": np.zeros((3, 5), bool),
        "one by one": np.ones((1, 1), bool),
        "line": np.zeros((5, 9), bool),
        "diagonal": np.eye(7, 9, dtype=bool),
        "one row": np.array([[1, 1, 0, 1, 1, 1, 1, 0]], bool),
        "hole": np.ones((9, 11), bool),
        "touching corners": np.zeros((9, 10), bool),
        "components": np.zeros((12, 10), bool),
        "touching the border": np.zeros((8, 11), bool),
        "dumb-bell": np.zeros((7, 17), bool),
    }
    shapes["one pixel"][2, 3] = True
    shapes["corner pixel"][0, 4] = True
    shapes["line"][2, 1:8] = True
    shapes["hole"][3, 4] = False
    shapes["touching corners"][1:4, 1:4] = shapes["touching corners"][4:8, 4:9] = True
    shapes["components"][1:7, 1:8] = shapes["components"][9, 2] = shapes["components"][8:11, 5:9] = True
    shapes["touching the border"][:5, :6] = shapes["touching the border"][3:, 4:] = True
    shapes["dumb-bell"][1:6, 1:6] = shapes["dumb-bell"][3, 5:12] = shapes["dumb-bell"][:, 11:16] = True
    return shapes


def random_mask(generator: np.random.Generator, sizes: tuple[int, ...]) -> np.ndarray:
    """Single pixels, or blocks of them, set at random: bays, holes, thin parts and several components."""
    side = int(generator.integers(1, 4))
    coarse = generator.random([-(-size // side) for size in sizes]) < generator.choice([0.4, 0.7, 0.9, 0.97])
    for axis in range(len(sizes)):
        coarse = coarse.repeat(side, axis=axis)
    return coarse[tuple(slice(size) for size in sizes)] & (generator.random(sizes) < generator.choice([0.95, 1.0]))


def random_batch(seed: int, count: int, sizes: tuple[int, ...]) -> torch.Tensor:
    """`count` random shapes of one size, bool (count, *sizes)."""
    generator = np.random.default_rng(seed)
    return torch.from_numpy(np.stack([random_mask(generator, sizes) for _ in range(count)]))


def disc(radius: int) -> torch.Tensor:
    """The digital disc x^2 + y^2 <= radius^2 in an array that it touches, bool."""
    axis = torch.arange(-radius, radius + 1)
    return axis[:, None] ** 2 + axis**2 <= radius**2


def random_order(seed: int, size: int = 7) -> nx.DiGraph:
    """The order of random points in the plane, which has chains and antichains of all lengths."""
    points = np.random.default_rng(seed).random((size, 2))
    graph = nx.DiGraph()
    graph.add_nodes_from(range(size))
    graph.add_edges_from((a, b) for a, b in permutations(range(size), 2) if (points[a] < points[b]).all())
    return graph
