"""Region flips: the candidates, the choice, their exact differences, and the gradient that is made of them."""

import itertools
from typing import Any

import numpy as np
import pytest
import torch
from scipy import ndimage
from torch import Tensor

import torchlinf
from torchlinf import shapes
from torchlinf.losses import region_flips
from torchlinf.losses.gradient import finite_difference_gradient
from torchlinf.measure import Measure

OPTIONS: dict[str, Any] = {"threshold": 0.5, "max_flips": 9, "deformations": False, "measure": Measure()}


def random_shapes(*size: int, seed: int = 0) -> Tensor:
    """Smooth random blobs, (3, *size) in [0, 1]."""
    generator = torch.Generator().manual_seed(seed)
    noise = torch.rand(3, *size, generator=generator)
    for dim in range(1, noise.ndim):
        noise = (noise + noise.roll(1, dim) + noise.roll(-1, dim)) / 3
    return ((noise - 0.5) * 4 + 0.55).clamp(0, 1)


def flipped_by(shape: Tensor, region: np.ndarray) -> Tensor:
    after = shape.clone()
    after.view(-1)[torch.from_numpy(region)] ^= True
    return after


@pytest.mark.parametrize("size", [(17,), (12, 19), (7, 6, 9)])
@pytest.mark.parametrize("side", [2, 3, 6])
def test_opening_and_closing_agree_with_scipy(size: tuple[int, ...], side: int) -> None:
    inside = random_shapes(*size) > 0.5
    for sides in {(side,) * len(size), (side, *[1] * (len(size) - 1))}:
        box = np.ones(sides)
        for shape, opened, closed in zip(
            inside, region_flips.opened(inside, sides), region_flips.closed(inside, sides), strict=True
        ):
            around = np.pad(shape.numpy(), 2 * side)
            middle = (slice(2 * side, -2 * side),) * len(size)
            assert np.array_equal(opened, ndimage.binary_opening(around, box)[middle])
            assert np.array_equal(closed, ndimage.binary_closing(around, box)[middle])


def test_a_box_larger_than_the_array_opens_to_nothing() -> None:
    assert not region_flips.opened(torch.ones(1, 3, 9, dtype=torch.bool), (4, 4)).any()


@pytest.mark.parametrize("size", [(17,), (12, 19), (6, 5, 7)])
def test_a_region_lies_on_one_side_only(size: tuple[int, ...]) -> None:
    inside = (random_shapes(*size) > 0.5).double()
    found = region_flips.candidates(inside, 0.5, 9)
    for n, shape in enumerate(inside):
        regions = found.of(n)
        assert len(regions) > 3
        for region in regions:
            assert len(set(shape.view(-1)[torch.from_numpy(region)].tolist())) == 1
            assert len(np.unique(region)) == len(region)


def test_the_regions_of_an_appendage() -> None:
    # 8 x 11 body at rows 2-9, columns 2-12, with a 3 x 2 appendage below, at columns 6-8.
    shape = shapes.with_appendages((8, 11), [shapes.Appendage("bottom", 3, 2)], margin=2)
    regions = {tuple(np.sort(region)) for region in region_flips.candidates(shape[None].double(), 0.5, 16).of(0)}
    at = torch.arange(shape.numel()).reshape(shape.shape)
    assert tuple(at[10:12, 6:9].flatten().tolist()) in regions  # what a 4-square cannot reach
    assert tuple(at[2, 2:13].tolist()) in regions  # the whole top row
    assert tuple(at[1, 2:13].tolist()) in regions  # the row above it
    assert tuple(at[10, 2:6].tolist()) in regions  # the free piece of the lower side
    assert (0,) not in regions


def test_a_grey_region_is_a_region_of_its_own() -> None:
    probability = torch.zeros(1, 20, 24)
    probability[:, 4:16, 4:16] = 1.0
    probability[:, 4:16, 16:20] = 0.6  # inside, in doubt
    probability[:, 6:14, 1:4] = 0.4  # outside, in doubt
    regions = {tuple(np.sort(region)) for region in region_flips.candidates(probability, 0.5, 16).of(0)}
    at = torch.arange(20 * 24).reshape(20, 24)
    assert tuple(at[4:16, 16:20].flatten().tolist()) in regions
    assert tuple(at[6:14, 1:4].flatten().tolist()) in regions


@pytest.mark.parametrize(
    "options", [{"low": 0.1, "high": 0.8}, {"estimator": "std", "rho": 2.5}, {"bins": 16, "tol": 1e-6}]
)
def test_differences_are_exact(options: dict[str, Any]) -> None:
    inside = random_shapes(14, 17) > 0.5
    found = region_flips.candidates(inside.double(), 0.5, 9)
    regions = [found.of(n)[:5] for n in range(len(inside))]
    value, difference = region_flips.differences(inside, regions, Measure(**options))
    for n, shape in enumerate(inside):
        before = torchlinf.complexity(shape, spatial_ndim=2, **options)
        assert value[n] == before
        for region, found in zip(regions[n], difference[n], strict=True):
            after = torchlinf.complexity(flipped_by(shape, region), spatial_ndim=2, **options)
            # No bit of an entropy is in doubt at these options; a standard deviation is known to twice the tolerance.
            slack = 4e-9 if "estimator" in options else 0.0
            assert abs(found - float(after - before)) <= slack


def test_the_flip_of_an_appendage_is_worth_all_of_the_complexity() -> None:
    shape = shapes.with_appendages((12, 15), [shapes.Appendage("right", 4, 3)], margin=3)
    appendage = torch.zeros_like(shape)
    appendage[7:11, 18:21] = True
    assert bool(shape[appendage].all())
    region = appendage.flatten().nonzero()[:, 0].numpy()
    [[difference]] = region_flips.differences(shape[None], [[region]], Measure())[1]
    body = torchlinf.complexity(shape, spatial_ndim=2)
    assert float(body) > 0.1
    assert difference == pytest.approx(-float(body))  # what is left is a box


def test_octaves_of_size_take_turns_and_ties_stay_together() -> None:
    inside = torch.ones(1, 4, 6, dtype=torch.bool)
    of_sizes = [np.arange(start, start + n) for start, n in enumerate((1, 3, 2, 3, 13, 2, 7, 12))]
    of_sizes.append(np.array([3, 2, 1]))  # the first of size 3 again

    begin = np.cumsum([0, *map(len, of_sizes)])
    code = np.array([0, 1, 2, 3, 4, 5, 6, 7, 1], np.uint64)
    proposed = region_flips.Candidates(np.concatenate(of_sizes), begin, np.zeros(9, np.int32), code)

    def sizes(max_flips: int) -> list[int]:
        return [len(region) for region in region_flips.select(inside, proposed, max_flips)[0]]

    assert sizes(9) == [12, 7, 3, 3, 1, 2, 2]  # not the one of 13: it leaves less than half
    assert sizes(6) == sizes(5) == [12, 7, 3, 3, 1]
    assert sizes(4) == [12, 7, 3, 3]
    assert sizes(3) == [12, 7, 1]
    assert sizes(1) == [12]


def test_a_large_opening_leads_from_a_disc_to_a_square() -> None:
    disc = shapes.disc(24, margin=4)
    regions = region_flips.select(disc[None], region_flips.candidates(disc[None].double(), 0.5, 16), 16)
    difference = region_flips.differences(disc[None], regions, Measure())[1][0]
    assert difference.min() < -1.0
    assert len(regions[0][difference.argmin()]) > 400


@pytest.mark.parametrize("size", [(13,), (15, 18), (6, 7, 8), (4, 5, 3, 4)])
def test_the_gradient_commutes_with_flips_and_axis_swaps(size: tuple[int, ...]) -> None:
    probability = random_shapes(*size, seed=4).double()
    value, gradient = finite_difference_gradient(probability, **OPTIONS)
    assert gradient.abs().max() > 0
    dims = range(1, len(size) + 1)
    for flips in itertools.chain.from_iterable(itertools.combinations(dims, r) for r in dims):
        mirrored_value, mirrored = finite_difference_gradient(probability.flip(flips), **OPTIONS)
        torch.testing.assert_close(mirrored_value, value)
        torch.testing.assert_close(mirrored.flip(flips), gradient)
    swapped = finite_difference_gradient(probability.transpose(1, -1), **OPTIONS)[1]
    torch.testing.assert_close(swapped.transpose(1, -1), gradient)


def test_an_empty_and_a_full_shape_have_no_gradient_towards_empty() -> None:
    probability = torch.stack([torch.zeros(9, 12), torch.ones(9, 12)])
    value, gradient = finite_difference_gradient(probability, **OPTIONS)
    assert value.isnan().tolist() == [True, False]
    assert value[1] == 0
    assert not gradient[0].any()
    assert bool((gradient[1] <= 0).all())  # removing an edge of a box leaves a box, any other flip costs


@pytest.mark.parametrize("threshold", [0.2, 0.5, 0.8])
def test_the_levels_of_doubt_surround_the_threshold(threshold: float) -> None:
    lower, upper = (region_flips.level_at_odds(threshold, level) for level in region_flips.DOUBT)
    assert 0 < lower < threshold < upper < 1
    if threshold == 0.5:
        assert (lower, upper) == pytest.approx(region_flips.DOUBT)
