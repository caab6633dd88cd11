"""Values known for the exact solution, and the shapes whose complexity is exactly zero."""

import functools
import itertools

import pytest
import torch
from torch import Tensor

from torchlinf import ComplexityProfile, complexity_profile
from torchlinf.field.methods import METHODS
from torchlinf.shapes import (
    Appendage,
    appendage_dictionary,
    appendage_places,
    box,
    cube_with_appendages,
    disc,
    nested_appendages,
    square,
    with_appendages,
)

LADDER = [Appendage("right", 96, 48), Appendage("top", 64, 48), Appendage("left", 32, 48)]
BOXES = [
    *[(1,), (6,), (7,), (100,)],
    *[(1, 9), (8, 8), (9, 9), (8, 21), (9, 20), (64, 64), (65, 65), (37, 120)],
    *[(5, 5, 5), (6, 6, 6), (24, 24, 24), (25, 25, 25), (7, 12, 20)],
    *[(3, 4, 5, 6), (6, 6, 6, 6)],
]
SIDES = ["right", "left", "top", "bottom"]


def profile_of(shape: Tensor) -> ComplexityProfile:
    return complexity_profile(shape, spatial_ndim=shape.ndim)


@functools.cache
def ladder_levels(number: int) -> Tensor:
    """Levels of the 128-square with the first `number` appendages of the ladder."""
    profile = profile_of(with_appendages((128, 128), LADDER[:number]))
    assert profile.radius == 64
    levels: Tensor = profile.levels()
    return levels


@functools.cache
def appended_profile(width: int, number: int, offset: int | None) -> ComplexityProfile:
    """A 128-square with appendages of depth 32 on the first `number` sides."""
    return profile_of(with_appendages((128, 128), [Appendage(face, width, 32, offset) for face in SIDES[:number]]))


@pytest.mark.parametrize(
    ("euclidean", "radius", "largest", "mean", "above_3_bits"),
    [
        (32, 23, 3.114, 2.378, 0.087),
        (64, 46, 4.029, 3.310, 0.739),
        (96, 68, 4.442, 3.666, 0.838),
        (128, 91, 4.783, 3.943, 0.857),
    ],
)
def test_discs(euclidean: int, radius: int, largest: float, mean: float, above_3_bits: float) -> None:
    profile = profile_of(disc(euclidean))
    assert profile.radius == radius
    assert profile.peak()[0].item() == pytest.approx(largest, abs=5e-4)
    assert profile.mean().item() == pytest.approx(mean, abs=5e-4)
    assert (profile.levels() > 3).double().mean().item() == pytest.approx(above_3_bits, abs=5e-4)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_knows_a_disc_and_a_zero(method: str) -> None:
    profile = complexity_profile(disc(32), method=method, spatial_ndim=2)
    assert profile.peak()[0].item() == pytest.approx(3.114, abs=5e-4)
    assert profile.mean().item() == pytest.approx(2.378, abs=5e-4)
    for shape in (box(12, 12), box(13, 9), box(6, 7, 8), on_a_diagonal(12, 5, (1, -1)), on_a_diagonal(9, 9, (1, 1))):
        for estimator in ("entropy", "std"):
            found = complexity_profile(shape, method=method, estimator=estimator, spatial_ndim=shape.ndim)
            assert found.level_values.tolist() == [0.0] * int(found.radius)


@pytest.mark.parametrize(
    ("number", "values"),
    [(1, [1.34, 2.16, 2.32, 2.74, 3.33]), (2, [2.35, 3.54, 3.71, 2.74, 3.33]), (3, [3.08, 4.40, 3.71, 2.74, 3.33])],
)
def test_squares_with_one_two_and_three_appendages(number: int, values: list[float]) -> None:
    levels = ladder_levels(number)
    assert [levels[k - 1].item() for k in (1, 11, 17, 33, 48)] == pytest.approx(values, abs=5e-3)
    assert levels[48:].tolist() == [0.0] * 16


def test_an_appendage_shows_at_no_scale_above_its_contact_width() -> None:
    assert torch.equal(ladder_levels(2)[32:], ladder_levels(1)[32:])
    assert torch.equal(ladder_levels(3)[16:], ladder_levels(2)[16:])
    assert (ladder_levels(2)[:32] != ladder_levels(1)[:32]).all()
    assert (ladder_levels(3)[:16] != ladder_levels(2)[:16]).all()


def test_the_last_scale_of_an_appendage_is_its_width_over_the_bodys() -> None:
    # Contact 80 on 128 is t = 0.625: still there at 0.62, gone at 0.63. Rounding t D instead of ceil would show it.
    profile = appended_profile(80, 1, None)
    assert profile.scales[62] == 0.63
    assert (profile.values[:62] > 0).all()
    assert profile.values[62:].tolist() == [0.0] * 38


@pytest.mark.parametrize("offset", ["centred", "low corner", "high corner"])
@pytest.mark.parametrize(
    ("width", "number", "fine", "coarse"),
    [
        (32, 1, 1.31666, 0.0),
        (32, 2, 2.08479, 0.0),
        (32, 4, 3.01552, 0.0),
        (80, 1, 1.60550, 1.89459),
        (80, 2, 2.40499, 2.81061),
        (80, 4, 3.16434, 3.72760),
    ],
)
def test_appendages_count_by_number_and_width_and_not_by_place(
    width: int, number: int, fine: float, coarse: float, offset: str
) -> None:
    place = {"centred": None, "low corner": 0, "high corner": 128 - width}[offset]
    profile = appended_profile(width, number, place)
    assert profile.mean(0.0, 0.25).item() == pytest.approx(fine, abs=5e-6)
    assert profile.mean(0.25, 0.625).item() == (pytest.approx(coarse, abs=5e-6) if coarse else 0.0)
    assert profile.mean(0.625, 1.0).item() == 0.0
    # No difference at all.
    assert torch.equal(profile.level_values, appended_profile(width, number, None).level_values)


@pytest.mark.parametrize(
    ("faces", "fine"), [(["left"], 0.28311), (["left", "right"], 0.49757), (["left", "top"], 0.49757)]
)
def test_cubes_with_cubes_on_their_faces(faces: list[str], fine: float) -> None:
    profile = profile_of(cube_with_appendages(64, 16, faces))
    assert profile.mean(0.0, 0.25).item() == pytest.approx(fine, abs=5e-6)
    assert profile.mean(0.25, 1.0).item() == 0.0


def rims_of(shape: Tensor) -> ComplexityProfile:
    return complexity_profile(shape, levels="rim", spatial_ndim=shape.ndim)


@pytest.mark.parametrize(
    ("name", "fine"),
    [
        ("at the corners", 3.02790),
        ("centred", 3.04038),
        ("shifted", 3.04038),
        ("two on two sides", 3.03101),
        ("three and one", 3.03412),
    ],
)
def test_on_rims_the_place_of_appendages_counts(name: str, fine: float) -> None:
    """The pinwheel has four joints, centred and shifted ones eight; in between it is in between."""
    profile = rims_of(appendage_places()[name])
    assert profile.mean(0.0, 0.25).item() == pytest.approx(fine, abs=5e-6)
    assert profile.levels()[16:].tolist() == [0.0] * 48


def test_on_rims_three_arrangements_with_eight_joints_are_equal() -> None:
    """The paper's second experiment: three shapes with sixteen added corners are equal, the pinwheel is simpler."""
    ways = {
        "centred": [(face, None) for face in SIDES],
        "shifted": [(face, 16) for face in SIDES],
        "two ways": [("right", None), ("left", 16), ("top", 70), ("bottom", None)],
    }
    eight = [
        rims_of(with_appendages((128, 128), [Appendage(face, 32, 32, at) for face, at in there]))
        for there in ways.values()
    ]
    pinwheel = rims_of(appendage_places()["at the corners"])
    for profile in eight:
        assert profile.mean(0.0, 0.25).item() == pytest.approx(3.04038, abs=5e-6)
        assert torch.equal(profile.level_values, eight[0].level_values)
        assert pinwheel.mean(0.0, 0.25) < profile.mean(0.0, 0.25)
        assert profile.error_bound(0.0, 0.25) == 0.0


def test_on_rims_the_nested_appendages() -> None:
    profiles = {name: rims_of(shape) for name, shape in nested_appendages().items()}
    means = [profile.mean(0.0, 0.25).item() for profile in profiles.values()]
    assert means == pytest.approx([0.0, 1.997, 3.308, 4.164], abs=5e-4)
    levels = [profile.level_values for profile in profiles.values()]
    for fewer, more, last in zip(levels[:-1], levels[1:], (48, 32, 16), strict=True):
        assert (fewer < more)[:last].all()
        assert torch.equal(fewer[last:], more[last:])


def test_on_rims_the_dictionary_is_strict() -> None:
    found = {name: rims_of(shape).mean(0.0, 0.25).item() for name, shape in appendage_dictionary().items()}
    words = [f"{n} x {w} {place}" for n in (1, 2, 4) for w in (32, 80) for place in ("flush", "centred")]
    assert [found[word] for word in words] == pytest.approx(
        [1.319, 1.321, 1.608, 1.610, 2.090, 2.096, 2.411, 2.416, 3.031, 3.040, 3.174, 3.180], abs=5e-4
    )
    assert [found[word] for word in words] == sorted(set(found.values()))


@pytest.mark.parametrize(
    ("euclidean", "largest", "mean", "above_3_bits"),
    [(32, 3.026, 2.351, 0.043), (64, 3.947, 3.267, 0.739), (96, 4.409, 3.670, 0.838), (128, 4.761, 3.944, 0.868)],
)
def test_on_rims_discs(euclidean: int, largest: float, mean: float, above_3_bits: float) -> None:
    profile = rims_of(disc(euclidean))
    assert profile.peak()[0].item() == pytest.approx(largest, abs=5e-4)
    assert profile.mean().item() == pytest.approx(mean, abs=5e-4)
    assert (profile.levels() > 3).double().mean().item() == pytest.approx(above_3_bits, abs=5e-4)


@pytest.mark.parametrize("levels", ["distance", "rim"])
def test_what_zero_complexity_is_made_of(levels: str) -> None:
    """A T and a plus of constant width, and squares that overlap: the paper's section 4, and its word on Donderi."""

    def of(shape: Tensor) -> float:
        return complexity_profile(shape, levels=levels, spatial_ndim=2).mean().item()

    tee = torch.zeros(64, 96, dtype=torch.bool)
    tee[:32] = tee[:, 32:64] = True
    plus = torch.zeros(96, 96, dtype=torch.bool)
    plus[32:64] = plus[:, 32:64] = True
    assert of(tee) == of(plus) == of(on_a_diagonal(64, 32, (1, 1))) == of(disc(1)) == 0.0


def assert_exactly_zero(shape: Tensor) -> None:
    for estimator, levels in itertools.product(("entropy", "std"), ("distance", "rim")):
        profile = complexity_profile(shape, estimator=estimator, levels=levels, spatial_ndim=shape.ndim)
        assert profile.level_values.tolist() == [0.0] * int(profile.radius)
        assert not profile.level_values.signbit().any()
        assert profile.mean().item() == 0.0


@pytest.mark.parametrize("sides", BOXES, ids=str)
@pytest.mark.parametrize("margin", [0, 2])
def test_boxes_are_exactly_zero(sides: tuple[int, ...], margin: int) -> None:
    assert_exactly_zero(box(*sides, margin=margin))


def on_a_diagonal(side: int, shift: int, signs: tuple[int, ...]) -> Tensor:
    """Two equal cubes, the second moved by `shift` along the diagonal with these signs."""
    shape = torch.zeros([side + shift] * len(signs), dtype=torch.bool)
    for moved in (0, shift):
        starts = [moved if sign > 0 else shift - moved for sign in signs]
        shape[tuple(slice(start, start + side) for start in starts)] = True
    return shape


@pytest.mark.parametrize("ndim", [1, 2, 3])
@pytest.mark.parametrize("side", [6, 7, 20, 21])
def test_two_equal_cubes_on_a_diagonal_are_exactly_zero(side: int, ndim: int) -> None:
    # From nearly the same over half overlapping to touching in a corner.
    for shift in sorted({1, side // 3, side // 2, side - 1, side}):
        for signs in itertools.product((1, -1), repeat=ndim - 1):
            assert_exactly_zero(on_a_diagonal(side, shift, (1, *signs)))


@pytest.mark.parametrize("side", [64, 65])
def test_two_larger_squares_on_a_diagonal_are_exactly_zero(side: int) -> None:
    for shift in (side // 2, side):
        assert_exactly_zero(on_a_diagonal(side, shift, (1, 1)))


def test_a_rotated_square_and_a_square_with_a_bump_are_not_zero() -> None:
    # The checks above must be able to fail.
    offsets = torch.arange(-12, 13)
    assert profile_of(offsets[:, None].abs() + offsets.abs() <= 12).mean().item() > 0.5
    bumped = square(20, margin=1)
    bumped[0, 9:12] = True
    assert profile_of(bumped).mean(0.0, 0.1).item() > 0.1
