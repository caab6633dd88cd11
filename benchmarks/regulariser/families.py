"""Families of shapes with one parameter, in steps that change many pixels, and random shapes."""

import math
from collections.abc import Callable, Iterator

import torch
from torch import Tensor

from torchlinf import shapes

SIZE = 64

Family = tuple[str, list[Tensor]]


def families() -> Iterator[Family]:
    """Name and members, (SIZE, SIZE) bool each, in the order of the parameter."""
    for radius in (14, 20, 26):
        exponents = (1.0, 1.2, 1.5, 2.0, 2.6, 3.5, 5.0, 8.0, 14.0, 30.0)
        yield "superellipse exponent", [_centred(shapes.superellipse(radius, e)) for e in exponents]
    for side in (24, 34):
        for width in (side // 4, side // 2):
            yield "bump height", [_bump(side, width, height) for height in range(1, 15, 2)]
        for height in (4, 10):
            yield "bump width", [_bump(side, width, height) for width in range(3, side + 1, 4)]
        yield "two appendages", [_appended(side, depth) for depth in range(1, 13, 2)]
    for sides in ((24, 36), (30, 30), (16, 44)):
        yield (
            "rotation",
            [_rotated(*sides, angle) for angle in (0.0, 2.0, 4.0, 7.0, 11.0, 16.0, 22.0, 30.0, 38.0, 45.0)],
        )
    yield "radius of a disc", [_centred(shapes.disc(radius)) for radius in range(6, 31, 3)]


def other_families() -> Iterator[Family]:
    """Families that no design was made for."""
    for axis in (12, 17):
        yield "ellipse axis", [_ellipse(24, axis * share) for share in (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2)]
    for axes in ((24, 12), (26, 18)):
        yield "ellipse rotation", [_ellipse(*axes, angle) for angle in (0, 3, 6, 10, 15, 20, 27, 36, 45)]
    for sides in ((20, 32), (38, 22)):
        yield "other rotation", [_rotated(*sides, angle) for angle in (0, 3, 5, 9, 13, 18, 25, 34, 43)]
    down, across = _turned(0)
    angle, radius = torch.atan2(down, across), (down.square() + across.square()).sqrt()
    for points in (3, 5):
        heights = (0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35)
        yield "star", [radius <= 18 * (1 + height * torch.cos(points * angle)) for height in heights]
    slopes = (0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6)
    yield "shear", [((across + slope * down).abs() <= 14) & (down.abs() <= 14) for slope in slopes]
    exponents = (1, 1.2, 1.5, 2, 2.6, 3.5, 5, 8, 14, 30)
    yield "turned superellipse", [_ellipse(20, 20, 20, exponent) for exponent in exponents]
    yield "long superellipse", [_ellipse(26, 15, 0, exponent) for exponent in exponents]
    beyond = [[(x.abs() - 18 + q).clamp(min=0).square() for x in (down, across)] for q in range(0, 19, 2)]
    yield "rounded corners", [a + b <= q * q + 0.1 for (a, b), q in zip(beyond, range(0, 19, 2), strict=True)]
    turned = [_turned(angle) for angle in (0, 2, 4, 7, 11, 16, 22, 30, 38, 45)]
    yield "L rotation", [(x.abs() <= 20) & (y.abs() <= 20) & ~((x > 2) & (y > 2)) for y, x in turned]


def random_shapes(count: int, seed: int = 0) -> Tensor:
    """(count, SIZE, SIZE) bool: blobs of random smoothness, and boxes with random blocks added and removed."""
    generator = torch.Generator().manual_seed(seed)
    blobs = [_blob(generator) for _ in range(count // 2)]
    return torch.stack(blobs + [_ragged_box(generator) for _ in range(count - len(blobs))])


def noisy_square(additions: int, seed: int, side: int = 36, factor: int = 3) -> tuple[Tensor, Tensor]:
    """A square with blocks of side `factor` grown onto it one by one, on a grid of that pitch, and the clean square."""
    generator = torch.Generator().manual_seed(seed)
    cells, first = SIZE // factor + 1, (SIZE - side) // 2
    offset = first % factor
    coarse = torch.zeros(cells, cells, dtype=torch.bool)
    coarse[first // factor : (first + side) // factor, first // factor : (first + side) // factor] = True
    clean = _upsampled(coarse, factor, offset)
    for _ in range(additions):
        grown = torch.nn.functional.max_pool2d(coarse[None].float(), (3, 1), 1, (1, 0))[0]
        grown = grown.maximum(torch.nn.functional.max_pool2d(coarse[None].float(), (1, 3), 1, (0, 1))[0])
        ring = ((grown > 0) & ~coarse)[1:-2, 1:-2].nonzero() + 1
        coarse[tuple(ring[torch.randint(len(ring), (), generator=generator)])] = True
    return _upsampled(coarse, factor, offset), clean


def _upsampled(coarse: Tensor, factor: int, offset: int) -> Tensor:
    fine = coarse.repeat_interleave(factor, 0).repeat_interleave(factor, 1)
    canvas = torch.zeros(SIZE, SIZE, dtype=torch.bool)
    canvas[offset:, offset:] = fine[: SIZE - offset, : SIZE - offset]
    return canvas


def _centred(shape: Tensor) -> Tensor:
    canvas = torch.zeros(SIZE, SIZE, dtype=torch.bool)
    top, left = ((SIZE - size) // 2 for size in shape.shape)
    canvas[top : top + shape.shape[0], left : left + shape.shape[1]] = shape
    return canvas


def _bump(side: int, width: int, height: int) -> Tensor:
    """A square with a rounded bump on top: half an ellipse."""
    rows, columns = torch.meshgrid(torch.arange(SIZE), torch.arange(SIZE), indexing="ij")
    top, left = SIZE - 6 - side, (SIZE - side) // 2
    square = (rows >= top) & (rows < top + side) & (columns >= left) & (columns < left + side)
    centre = left + side / 2 - 0.5
    bump = ((columns - centre) / (width / 2)).square() + ((top - rows) / (height + 0.5)).square() <= 1
    return square | (bump & (rows < top))


def _appended(side: int, depth: int) -> Tensor:
    faces = [shapes.Appendage("right", side // 3, depth), shapes.Appendage("top", side // 2, depth)]
    return _centred(shapes.with_appendages((side, side), faces))


def _rotated(height: int, width: int, degrees: float) -> Tensor:
    down, across = _turned(degrees)
    return (across.abs() <= width / 2) & (down.abs() <= height / 2)


def _ellipse(width: float, height: float, degrees: float = 0, exponent: float = 2) -> Tensor:
    """Half axes, and the exponent of a superellipse."""
    down, across = _turned(degrees)
    return (across.abs() / width) ** exponent + (down.abs() / height) ** exponent <= 1


def _turned(degrees: float) -> tuple[Tensor, Tensor]:
    """Coordinates from the centre, down and across."""
    rows, columns = torch.meshgrid(*[torch.arange(SIZE) - SIZE / 2 + 0.5] * 2, indexing="ij")
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return cos * rows - sin * columns, cos * columns + sin * rows


def _blob(generator: torch.Generator) -> Tensor:
    grain = int(torch.randint(4, 17, (), generator=generator))
    coarse = torch.randn(1, 1, SIZE // grain + 3, SIZE // grain + 3, generator=generator)
    noise = torch.nn.functional.interpolate(coarse, size=(SIZE, SIZE), mode="bicubic", align_corners=False)[0, 0]
    rows, columns = torch.meshgrid(*[torch.linspace(-1, 1, SIZE)] * 2, indexing="ij")
    return 0.6 - rows.square() - columns.square() + 0.3 * noise > 0


def _ragged_box(generator: torch.Generator) -> Tensor:
    draw: Callable[[int, int], int] = lambda low, high: int(torch.randint(low, high, (), generator=generator))  # noqa: E731
    shape = torch.zeros(SIZE, SIZE, dtype=torch.bool)
    shape[16 : 16 + draw(16, 33), 16 : 16 + draw(16, 33)] = True
    for _ in range(draw(0, 40)):
        padded = torch.nn.functional.pad(shape, (1, 1, 1, 1))
        edge = (shape & ~(padded[2:, 1:-1] & padded[:-2, 1:-1] & padded[1:-1, 2:] & padded[1:-1, :-2])).nonzero()
        row, column = edge[draw(0, len(edge))].tolist()
        size = draw(1, 5)
        shape[
            max(row - size // 2, 1) : row + size - size // 2, max(column - size // 2, 1) : column + size - size // 2
        ] = draw(0, 2) == 1
    return shape
