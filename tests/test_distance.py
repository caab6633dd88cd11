"""Tests of the exact chessboard distance."""

import numpy as np
import problems
import pytest
import torch
from scipy.ndimage import distance_transform_cdt

from torchlinf import chessboard_distance
from torchlinf.field.distance import eroded_distance


def scipy_distance(mask: np.ndarray) -> np.ndarray:
    """SciPy's distance, padded since beyond the array is outside, and SciPy wants some outside."""
    inner = tuple(slice(1, -1) for _ in mask.shape)
    return distance_transform_cdt(np.pad(mask, 1), metric="chessboard")[inner]


@pytest.mark.parametrize(("ndim", "largest", "rounds"), [(1, 70, 60), (2, 40, 60), (3, 14, 40), (4, 8, 30)])
def test_equals_scipy_on_thousands_of_random_masks(ndim: int, largest: int, rounds: int) -> None:
    generator = np.random.default_rng(ndim)
    radii = set()
    for number in range(rounds):
        sizes = (
            tuple(int(size) for size in generator.integers(1, largest + 1, size=ndim)) if number else (largest,) * ndim
        )
        holes = generator.choice([0.5, 0.1, 0.02, 0.003, 0.0], size=(20, *[1] * ndim))
        masks = generator.random((20, *sizes)) >= holes
        found = chessboard_distance(torch.from_numpy(masks)[:, None])
        assert found.dtype == torch.int32
        assert torch.equal(eroded_distance(torch.from_numpy(masks)), found[:, 0])
        for mask, distance in zip(masks, found[:, 0].numpy(), strict=True):
            np.testing.assert_array_equal(distance, scipy_distance(mask))
            radii.add(int(distance.max()))
    assert max(radii) >= largest // 2 - 2


@pytest.mark.parametrize("name", problems.catalogue())
def test_equals_the_definition(name: str) -> None:
    mask = problems.catalogue()[name]
    for found in (
        chessboard_distance(torch.from_numpy(mask), spatial_ndim=2),
        eroded_distance(torch.from_numpy(mask[None]))[0],
    ):
        np.testing.assert_array_equal(found.numpy(), problems.naive_distance(mask))


@pytest.mark.parametrize("side", [1, 2, 3, 255, 256, 509, 510, 511, 512, 513, 70_000])
def test_large_distances_do_not_overflow(side: int) -> None:
    """A full mask attains half its side; intermediate results are kept in the smallest sufficient integer type."""
    axis = torch.arange(side)
    expected = (torch.minimum(axis, side - 1 - axis) + 1).int()
    assert torch.equal(eroded_distance(torch.ones(1, side, dtype=torch.bool))[0], expected)
    assert torch.equal(chessboard_distance(torch.ones(side), spatial_ndim=1), expected)
    if side < 1000:
        mask = torch.ones(1, 2 * side, side, dtype=torch.bool)
        found = eroded_distance(mask)
        assert torch.equal(found[0, side], expected)
        assert found.max() == (side + 1) // 2
        assert torch.equal(chessboard_distance(mask[None])[0], found)


def test_flips_and_axis_swaps() -> None:
    mask = problems.random_batch(3, 2, (13, 18))[:, None]
    distance = chessboard_distance(mask)
    assert torch.equal(chessboard_distance(mask.flip(-1)), distance.flip(-1))
    assert torch.equal(chessboard_distance(mask.mT), distance.mT)


@pytest.mark.parametrize(
    "dtype", [torch.uint8, torch.int64, torch.float16, torch.bfloat16, torch.float32, torch.float64]
)
def test_dtypes(dtype: torch.dtype) -> None:
    mask = problems.random_batch(4, 6, (9, 14)).view(2, 3, 9, 14)
    assert torch.equal(chessboard_distance(mask.to(dtype)), chessboard_distance(mask))


def test_strides() -> None:
    mask = problems.random_batch(5, 3, (14, 9))
    contiguous = chessboard_distance(mask.mT.contiguous()[:, None])
    assert torch.equal(chessboard_distance(mask.mT[:, None]), contiguous)
    assert torch.equal(
        chessboard_distance(mask[:, ::2, ::3], spatial_ndim=2)[1],
        chessboard_distance(mask[1, ::2, ::3], spatial_ndim=2),
    )
    expanded = chessboard_distance(mask[:, None].expand(3, 4, 14, 9))
    assert torch.equal(expanded[:, 3], chessboard_distance(mask, spatial_ndim=2))


def test_the_mask_is_left_alone() -> None:
    mask = problems.random_batch(6, 2, (9, 9))[:, None]
    copy = mask.clone()
    chessboard_distance(mask)
    assert torch.equal(mask, copy)


@pytest.mark.parametrize("lead", [(), (4,), (2, 1, 3), (0, 2)])
def test_leading_dimensions(lead: tuple[int, ...]) -> None:
    found = chessboard_distance(torch.ones(*lead, 5, 7), spatial_ndim=2)
    assert found.shape == (*lead, 5, 7)
    assert (found == chessboard_distance(torch.ones(5, 7), spatial_ndim=2)).all()


def test_bad_masks_are_refused() -> None:
    with pytest.raises(ValueError, match=r"mask must be \(B, C, \*spatial\).*got \(64, 64\)\. Pass spatial_ndim=2"):
        chessboard_distance(torch.ones(64, 64))
    with pytest.raises(TypeError, match=r"torch\.from_numpy"):
        chessboard_distance(np.ones((1, 1, 4, 4)))  # type: ignore[arg-type]
