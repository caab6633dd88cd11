from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy import ndimage

from torchlinf.shapes import add_noise, disc, noise

Pixel = tuple[int, int]


def naive_noise(
    shape: torch.Tensor,
    factor: int,
    count: int,
    seed: int,
    close: Callable[[set[Pixel], int], set[Pixel]] | None = None,
) -> set[Pixel]:
    """The definition over sets of pixels, with the same random numbers: widths, then lengths, then places."""
    random = torch.Generator().manual_seed(seed)
    widths = [max(0, round(factor + factor / 3 * x)) for x in normal(count, random)]
    lengths = iter([round(factor + factor / 3 * x) for x in normal(2 * sum(widths), random)])
    places = torch.rand(count, generator=random, dtype=torch.float64).tolist()
    inside = {(row, column) for row, column in shape.nonzero().tolist()}
    for width, place in zip(widths, places, strict=True):
        boundary = sorted(pixel for pixel in inside if any(other not in inside for other in around(pixel)))
        row, column = boundary[int(place * len(boundary))]
        ways = ways_from((shape.shape[1] - 1) / 2, column), ways_from((shape.shape[0] - 1) / 2, row)
        first = -((width - 1) // 2)
        for i in range(first, first + width):
            length = next(lengths)
            inside |= {(row + i, column + way * j) for way in ways[0] for j in range(length + 1)}
        for i in range(first, first + width):
            length = next(lengths)
            inside |= {(row + way * j, column + i) for way in ways[1] for j in range(length + 1)}
        inside = (close or closing)(inside, factor)
    return inside


def ways_from(middle: float, place: int) -> list[int]:
    return [way for way in (-1, 1) if way * (place - middle) >= 0]


def normal(size: int, random: torch.Generator) -> list[float]:
    return torch.randn(size, generator=random, dtype=torch.float64).tolist()


def around(pixel: Pixel) -> list[Pixel]:
    return [(pixel[0] + i, pixel[1] + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]


def closing(inside: set[Pixel], side: int) -> set[Pixel]:
    """What no square of that side, all outside, covers."""
    square = [(i, j) for i in range(side) for j in range(side)]
    rows, columns = zip(*inside, strict=True)
    frame = [
        (i, j)
        for i in range(min(rows) - side, max(rows) + side + 1)
        for j in range(min(columns) - side, max(columns) + side + 1)
    ]
    free = [(i, j) for i, j in frame if all((i + a, j + b) not in inside for a, b in square)]
    opened = {(i + a, j + b) for i, j in free for a, b in square}
    return {pixel for pixel in frame if pixel not in opened}


def closing_of_arrays(inside: set[Pixel], side: int) -> set[Pixel]:
    """The same by SciPy, for large squares."""
    places = np.array(sorted(inside))
    origin = places.min(axis=0) - side
    canvas = np.zeros(places.max(axis=0) - origin + side + 1, dtype=bool)
    canvas[tuple((places - origin).T)] = True
    filled = ndimage.binary_closing(canvas, np.ones((side, side)))
    return {(int(row), int(column)) for row, column in np.argwhere(filled) + origin}


def boxed(inside: set[Pixel]) -> torch.Tensor:
    places = torch.tensor(sorted(inside))
    places -= places.amin(dim=0)
    mask = torch.zeros((places.amax(dim=0) + 1).tolist(), dtype=torch.bool)
    mask[tuple(places.T)] = True
    return mask


ONE_PIXEL = torch.ones(1, 1)
RING = torch.ones(9, 14)
RING[3:6, 4:9] = 0
PARTS = torch.zeros(12, 10)
PARTS[1:4, 1:9] = PARTS[8:11, 5:9] = 1


@pytest.mark.parametrize("shape", [torch.ones(11, 17), ONE_PIXEL, RING, PARTS, disc(6)])
@pytest.mark.parametrize("factor", [1, 2, 3, 6])
def test_noise_against_the_definition_over_sets(shape: torch.Tensor, factor: int) -> None:
    found = add_noise(shape, factor, 12, seed=factor)
    assert found.dtype == torch.bool
    assert torch.equal(found, boxed(naive_noise(shape, factor, 12, factor)))


def test_noise_far_beyond_the_first_canvas() -> None:
    # A single pixel that grows by patches of 30 pixels leaves any room that was made for it at first.
    found = add_noise(ONE_PIXEL, 30, 8, seed=0)
    assert min(found.shape) > 100
    assert torch.equal(found, boxed(naive_noise(ONE_PIXEL, 30, 8, 0, closing_of_arrays)))


@pytest.mark.parametrize("factor", [2, 4, 5])
def test_what_comes_out_is_closed(factor: int) -> None:
    padded = np.pad(add_noise(torch.ones(30, 20), factor, 30, seed=1).numpy(), 2 * factor)
    again = ndimage.binary_closing(padded, np.ones((factor, factor)))
    assert np.array_equal(again, padded)


def test_the_same_seed_gives_the_same_noise_and_nothing_else_changes() -> None:
    shape = torch.ones(20, 30, dtype=torch.uint8)
    state = torch.random.get_rng_state()
    first, second = (add_noise(shape, 3, 20, seed=5) for _ in range(2))
    assert torch.equal(first, second)
    assert not torch.equal(first, add_noise(shape, 3, 20, seed=6))
    assert torch.equal(add_noise(shape, 3, 20), add_noise(shape, 3, 20, seed=0))
    assert shape.all()
    assert shape.shape == (20, 30)
    assert torch.equal(torch.random.get_rng_state(), state)


@pytest.mark.parametrize("side", [1, 2, 3, 6, 7])
def test_closing_and_boundary_are_those_of_binary_morphology(side: int) -> None:
    mask = np.random.default_rng(side).random((23, 31)) < 0.3
    far = np.pad(mask, side)
    expected = ndimage.binary_closing(far, np.ones((side, side)))[side:-side, side:-side]
    assert np.array_equal(noise.closed(mask, side), expected)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(mask, 1), (3, 3)).all(axis=(2, 3))
    assert np.array_equal(noise.boundary_of(mask), mask & ~around)


def test_more_additions_and_larger_factors_add_more() -> None:
    shape = torch.ones(60, 60)
    by_count = [int(add_noise(shape, 4, count, seed=0).sum()) for count in (5, 20, 80)]
    by_factor = [int(add_noise(shape, factor, 20, seed=0).sum()) for factor in (1, 3, 6)]
    assert 3600 < by_count[0] < by_count[1] < by_count[2]
    assert 3600 < by_factor[0] < by_factor[1] < by_factor[2]


def test_messages() -> None:
    with pytest.raises(ValueError, match=r"shape must be one shape \(H, W\) with pixels inside; got \(3, 4\) with 0"):
        add_noise(torch.zeros(3, 4), 1, 1)
    with pytest.raises(ValueError, match=r"got \(2, 3, 4\) with 24. Add noise to one shape at a time."):
        add_noise(torch.ones(2, 3, 4), 1, 1)
    with pytest.raises(ValueError, match="shape must hold only 0 and 1; got 2"):
        add_noise(torch.full((3, 4), 2), 1, 1)
    with pytest.raises(ValueError, match="factor must be an integer of 1 or more; got 0"):
        add_noise(torch.ones(3, 4), 0, 1)
    with pytest.raises(TypeError, match=r"count must be an integer of 1 or more; got 1\.5"):
        add_noise(torch.ones(3, 4), 1, 1.5)
    with pytest.raises(ValueError, match="seed must be an integer of 0 or more; got -1"):
        add_noise(torch.ones(3, 4), 1, 1, seed=-1)
    with pytest.raises(TypeError, match="seed must be an integer of 0 or more; got <torch"):
        add_noise(torch.ones(3, 4), 1, 1, seed=torch.Generator())  # type: ignore[arg-type]
