"""Bands, pairs of squares, and the families: their pixels, and the values known for them."""

import functools
import itertools
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from torchlinf import ComplexityProfile, complexity_profile, shapes
from torchlinf.shapes import Appendage, band, diagonal_pair, with_appendages

NARROW, WIDE = (1.31666, 2.08479, 3.01552), (1.60550, 2.40499, 3.16434)  # over (0, 1/4], for 1, 2 and 4 appendages


def profile_of(shape: Tensor) -> ComplexityProfile:
    return complexity_profile(shape, spatial_ndim=shape.ndim)


def assert_exactly_zero(shape: Tensor) -> None:
    assert profile_of(shape).level_values.tolist() == [0.0] * int(profile_of(shape).radius)


def picture(shape: Tensor) -> list[str]:
    return ["".join("#" if inside else "." for inside in row) for row in shape.tolist()]


def test_a_rectangle_has_rows_and_columns() -> None:
    assert picture(shapes.rectangle(2, 3, margin=1)) == [".....", ".###.", ".###.", "....."]


def test_a_band_with_corners() -> None:
    assert picture(band([(0, 0), (0, 4), (3, 4), (3, 2)], width=1, margin=1)) == [
        ".......",
        ".#####.",
        ".....#.",
        ".....#.",
        "...###.",
        ".......",
    ]


@pytest.mark.parametrize("width", [1, 2, 5])
@pytest.mark.parametrize(
    "points",
    [[(3, 3)], [(0, 0), (4, 4), (4, 9)], [(0, 6), (6, 0), (0, 0)], [(2, -3, 1), (2, 4, 1), (5, 4, -2)], [(7,), (2,)]],
)
def test_a_band_is_what_the_square_covers(points: list[tuple[int, ...]], width: int) -> None:
    steps = [points[0]]
    for stop in points[1:]:
        while steps[-1] != stop:
            steps.append(tuple(x + (y > x) - (y < x) for x, y in zip(steps[-1], stop, strict=True)))
    low = [min(axis) for axis in zip(*steps, strict=True)]
    found = band(points, width)
    assert list(found.shape) == [
        max(axis) + width - zero for axis, zero in zip(zip(*steps, strict=True), low, strict=True)
    ]
    for index in itertools.product(*map(range, found.shape)):
        at = [i + zero for i, zero in zip(index, low, strict=True)]
        covered = any(all(x <= y < x + width for x, y in zip(step, at, strict=True)) for step in steps)
        assert found[index].item() == covered


@pytest.mark.parametrize("width", [1, 2, 7, 12])
def test_bands_of_constant_width_are_exactly_zero(width: int) -> None:
    for line in (
        [(0, 0), (4 * width, 0), (4 * width, 3 * width)],
        [(0, 0), (3 * width, 3 * width), (3 * width, 6 * width)],
        [(0, 0, 0), (3 * width, 0, 0), (3 * width, 2 * width, 0), (3 * width, 2 * width, 2 * width)],
    ):
        assert_exactly_zero(band(line, width))


def test_a_band_that_turns_between_diagonals_or_meets_itself_is_not_zero() -> None:
    assert profile_of(band([(0, 0), (30, 30), (0, 60)], 11)).mean() > 1
    assert profile_of(band([(0, 0), (0, 40), (5, 40), (5, 0), (40, 0)], 11)).mean() > 1


@pytest.mark.parametrize(("side", "shift"), [(1, 1), (4, 0), (5, 2), (8, 4), (9, 9)])
def test_a_diagonal_pair_is_two_squares(side: int, shift: int) -> None:
    found = diagonal_pair(side, shift, margin=1)
    assert found.shape == (side + shift + 2, side + shift + 2)
    assert found.sum() == 2 * side**2 - (side - shift) ** 2
    assert found[1 : side + 1, 1 : side + 1].all()
    assert torch.equal(found, found.flip(0, 1))
    assert_exactly_zero(found)


@pytest.mark.parametrize("side", [1, 6, 9, 32])
def test_the_zeros_are_exactly_zero(side: int) -> None:
    found = shapes.zero_complexity(side)
    assert len(found) == 8
    for shape in found.values():
        assert_exactly_zero(shape)


def test_the_nested_appendages_are_those_of_the_known_values() -> None:
    ladder = [Appendage("right", 96, 48), Appendage("top", 64, 48), Appendage("left", 32, 48)]
    for number, shape in enumerate(shapes.nested_appendages().values()):
        assert torch.equal(shape, with_appendages((128, 128), ladder[:number]))


def test_four_appendages_are_equal_wherever_they_are() -> None:
    found = shapes.appendage_places()
    profiles = {name: profile_of(shape) for name, shape in found.items()}
    for name, shape in found.items():
        assert shape.sum() == 128**2 + 4 * 32**2
        assert profiles[name].mean(0.0, 0.25).item() == pytest.approx(NARROW[2], abs=5e-6)
        assert profiles[name].mean(0.25, 1.0).item() == 0.0
        assert torch.equal(profiles[name].level_values, profiles["centred"].level_values)


@pytest.mark.parametrize("width", [32, 80])
def test_the_dictionary_orders_by_width_and_then_by_number(width: int) -> None:
    found = {name: profile_of(shape) for name, shape in shapes.appendage_dictionary().items()}
    assert len(found) == 12
    for position in ("centred", "flush"):
        fine = [found[f"{n} x {width} {position}"].mean(0.0, 0.25).item() for n in (1, 2, 4)]
        assert fine == pytest.approx({32: NARROW, 80: WIDE}[width], abs=5e-6)
        coarse = [found[f"{n} x {width} {position}"].mean(0.25, 0.625).item() for n in (1, 2, 4)]
        assert coarse == pytest.approx({32: (0, 0, 0), 80: (1.89459, 2.81061, 3.72760)}[width], abs=5e-6)


def moved(cube: Tensor) -> set[bytes]:
    """The shape under all 48 symmetries of the cube."""
    frames = set()
    for axes in itertools.permutations(range(3)):
        for ends in itertools.product((False, True), repeat=3):
            turned = cube.permute(axes).flip([axis for axis in range(3) if ends[axis]])
            frames.add(bytes(list(turned.shape)) + turned.contiguous().numpy().tobytes())
    return frames


def test_the_ten_cubes_are_all_choices_of_faces_up_to_symmetry() -> None:
    ten = [moved(cube) for cube in shapes.cube_family(4, 2).values()]
    for one, other in itertools.combinations(ten, 2):
        assert not one & other
    for number in range(7):
        for faces in itertools.combinations(shapes.FACES, number):
            assert moved(shapes.cube_with_appendages(4, 2, faces)) in ten


@functools.cache
def cubes() -> dict[str, ComplexityProfile]:
    return {name: profile_of(cube) for name, cube in shapes.cube_family().items()}


def test_cubes_are_zero_above_a_quarter_and_count_their_appendages() -> None:
    fine = {name: profile.mean(0.0, 0.25).item() for name, profile in cubes().items()}
    assert all(profile.mean(0.25, 1.0).item() == 0.0 for profile in cubes().values())
    assert fine["0"] == 0.0
    assert fine["1"] == pytest.approx(0.28311, abs=5e-6)
    assert fine["2 opposite"] == fine["2 adjacent"] == pytest.approx(0.49757, abs=5e-6)
    numbers = {name: int(name[0]) for name in fine}
    for one, other in itertools.combinations(fine, 2):
        if numbers[one] < numbers[other]:
            assert fine[one] < fine[other] - 0.05


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: band([], 3), ValueError, r"points must be 1 or more, of the same 1 to 4 coordinates; got \[\]\. Pass"),
        (lambda: band([(0, 0), (0, 1, 2)], 3), ValueError, r"points must be 1 or more, of the same .* Pass"),
        (lambda: band([(0, 0), (2, 5)], 3), ValueError, r"axis or a diagonal; got \[0, 0\] to \[2, 5\]\. Put"),
        (lambda: band([(0, 0), (4, 2)], 3), ValueError, r"axis or a diagonal; got \[0, 0\] to \[4, 2\]\. Put"),
        (lambda: band([(0, 0.5)], 3), TypeError, r"points must be integers; got 0\.5\. Round"),  # type: ignore[list-item]
        (lambda: band([(0, 0)], 0), ValueError, r"width must be an integer of 1 or more; got 0\. Pass"),
        (lambda: diagonal_pair(4, 5), ValueError, r"shift must be from 0 to side=4; got 5\. Pass"),
        (lambda: diagonal_pair(4, -1), ValueError, r"shift must be an integer of 0 or more; got -1\. Pass"),
        (lambda: shapes.nested_appendages(30), ValueError, r"side must be a multiple of 4; got 30\. Pass"),
        (lambda: shapes.appendage_places(2), ValueError, r"side must be a multiple of 4; got 2\. Pass"),
        (lambda: shapes.appendage_dictionary(numbers=(1, 5)), ValueError, r"from 0 to 4; got \[1, 5\]\. Pass"),
        (lambda: shapes.appendage_dictionary(numbers=(2.0,)), TypeError, r"numbers must be an integer of 0 or more"),  # type: ignore[arg-type]
        (lambda: shapes.appendage_dictionary(64), ValueError, r"width and offset must keep"),
        (lambda: shapes.rectangle(0, 4), ValueError, r"height must be an integer of 1 or more; got 0\. Pass"),
    ],
)
def test_bad_arguments_are_named(make: Callable[[], object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        make()
