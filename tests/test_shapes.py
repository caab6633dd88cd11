import itertools
import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from torchlinf.shapes import (
    Appendage,
    appendage_dictionary,
    band,
    box,
    cube_with_appendages,
    disc,
    rooms,
    square,
    superellipse,
    with_appendages,
)


def picture(shape: Tensor) -> list[str]:
    return ["".join("#" if inside else "." for inside in row) for row in shape.tolist()]


@pytest.mark.parametrize("side", [1, 2, 5, 8])
@pytest.mark.parametrize("margin", [0, 1, 3])
def test_a_square_fills_all_but_its_margin(side: int, margin: int) -> None:
    found = square(side, margin=margin)
    assert found.shape == (side + 2 * margin, side + 2 * margin)
    assert found.dtype == torch.bool
    assert found[margin : margin + side, margin : margin + side].all()
    assert found.sum() == side**2


@pytest.mark.parametrize("sides", [(7,), (2, 5), (3, 1, 4), (2, 3, 4, 5)])
def test_a_box_has_its_sides_in_order(sides: tuple[int, ...]) -> None:
    assert box(*sides).shape == sides
    assert box(*sides).all()
    inner = box(*sides, margin=2)
    assert inner.shape == tuple(side + 4 for side in sides)
    assert inner.sum() == math.prod(sides)


@pytest.mark.parametrize("radius", [0.5, 1, 2, 2.5, 5, 13, 32])
def test_a_disc_holds_the_lattice_points_within_its_radius(radius: float) -> None:
    found = disc(radius)
    reach = (found.shape[0] - 1) // 2
    assert reach == math.floor(radius)
    for y in range(-reach, reach + 1):
        for x in range(-reach, reach + 1):
            assert found[y + reach, x + reach].item() == (x * x + y * y <= radius * radius)


@pytest.mark.parametrize("radius", [5, 13, 25, 65, 7.3])
def test_a_superellipse_of_exponent_two_is_the_disc(radius: float) -> None:
    # The integer radii have lattice points exactly on the circle, which rounding must not lose.
    assert torch.equal(superellipse(radius, 2), disc(radius))


def test_a_superellipse_of_exponent_one_is_a_diamond() -> None:
    assert superellipse(9, 1).sum() == 9**2 + 10**2


def test_superellipses_grow_with_their_exponent_towards_the_square() -> None:
    family = [superellipse(20, exponent) for exponent in (0.5, 1, 1.5, 2, 4, 20)]
    for smaller, larger in itertools.pairwise(family):
        assert (smaller & ~larger).sum() == 0
        assert smaller.sum() < larger.sum()


@pytest.mark.parametrize("exponent", [1, 3, 4, 6])
def test_a_superellipse_of_integer_exponent_equals_integer_arithmetic(exponent: int) -> None:
    offsets = range(-20, 21)
    expected = [[abs(x) ** exponent + abs(y) ** exponent <= 20**exponent for x in offsets] for y in offsets]
    assert superellipse(20, exponent).tolist() == expected


@pytest.mark.parametrize("make", [lambda: disc(9, margin=2), lambda: superellipse(9, 3, margin=2)])
def test_round_shapes_are_symmetric_and_keep_their_margin(make: Callable[[], Tensor]) -> None:
    found = make()
    assert found.shape == (23, 23)
    assert torch.equal(found, found.T)
    assert torch.equal(found, found.flip(0))
    assert not found[:2].any()
    assert found[2].any()


def test_appendages_lie_where_they_are_asked_for() -> None:
    found = with_appendages(
        (4, 5), [Appendage("right", 2, 3), Appendage("left", 1, 1, offset=3), Appendage("top", 3, 1, offset=2)]
    )
    assert picture(found) == [
        "...###...",
        ".#####...",
        ".########",
        ".########",
        "######...",
    ]


def test_appendages_on_the_bottom_and_with_a_margin() -> None:
    assert picture(with_appendages((2, 4), [Appendage("bottom", 1, 2, offset=0)], margin=1)) == [
        "......",
        ".####.",
        ".####.",
        ".#....",
        ".#....",
        "......",
    ]


def test_an_appendage_may_be_wider_than_the_body_is_deep() -> None:
    assert picture(with_appendages((5, 1), [Appendage("right", 3, 1)])) == ["#.", "##", "##", "##", "#."]


def test_an_odd_rest_centres_rounded_down() -> None:
    assert picture(with_appendages((4, 1), [Appendage("right", 1, 1)])) == ["#.", "##", "#.", "#."]


def test_several_appendages_share_a_face() -> None:
    found = with_appendages((5, 2), [Appendage("right", 1, 1, offset=0), Appendage("right", 2, 2, offset=3)])
    assert picture(found) == ["###.", "##..", "##..", "####", "####"]


def test_no_appendage_gives_the_body() -> None:
    assert torch.equal(with_appendages((3, 4), []), box(3, 4))


def test_a_segment_with_an_appendage_is_a_longer_segment() -> None:
    assert torch.equal(with_appendages((5,), [Appendage("left", 1, 2)]), box(7))


@pytest.mark.parametrize("side", [6, 7])
def test_every_face_of_a_cube_takes_its_appendage(side: int) -> None:
    axes = {"left": (2, 0), "right": (2, -1), "top": (1, 0), "bottom": (1, -1), "front": (0, 0), "back": (0, -1)}
    start = (side - 2) // 2
    for face, (axis, end) in axes.items():
        found = cube_with_appendages(side, 2, [face])
        expected = [side] * 3
        expected[axis] += 2
        assert list(found.shape) == expected
        outermost = found.select(axis, end)
        assert outermost.sum() == 4
        assert outermost[start : start + 2, start : start + 2].all()
        assert found.sum() == side**3 + 8


def test_a_cube_with_all_six_appendages_is_symmetric() -> None:
    found = cube_with_appendages(6, 2, ["left", "right", "top", "bottom", "front", "back"], margin=1)
    assert found.shape == (12, 12, 12)
    assert found.sum() == 6**3 + 6 * 2**3
    for axis in range(3):
        assert torch.equal(found, found.flip(axis))
        assert torch.equal(found, found.transpose(axis, axis - 1))


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: square(0), ValueError, r"side must be an integer of 1 or more; got 0\. Pass"),
        (lambda: square(2.0), TypeError, r"side must be an integer of 1 or more; got 2\.0\. Pass"),  # type: ignore[arg-type]
        (lambda: square(2, margin=-1), ValueError, r"margin must be an integer of 0 or more; got -1\. Pass"),
        (lambda: square(2, margin=1.5), TypeError, r"margin must be an integer of 0 or more; got 1\.5\. Pass"),  # type: ignore[arg-type]
        (lambda: box(), ValueError, r"sides must be 1 to 4 numbers; got 0\. Pass"),
        (lambda: box(1, 2, 3, 4, 5), ValueError, r"sides must be 1 to 4 numbers; got 5\. Pass"),
        (lambda: disc(0), ValueError, r"radius must be finite and above 0; got 0\. Pass"),
        (lambda: disc(math.inf), ValueError, r"radius must be finite and above 0; got inf\. Pass"),
        (lambda: superellipse(5, -1), ValueError, r"exponent must be finite and above 0; got -1\. Pass"),
        (lambda: superellipse(5, math.nan), ValueError, r"exponent must be finite and above 0; got nan\. Pass"),
        (lambda: with_appendages((), []), ValueError, r"sides must be 1 to 3 numbers; got 0\. Pass"),
        (
            lambda: with_appendages((4, 4), [Appendage("front", 1, 1)]),
            ValueError,
            r"face must be one of 'left', 'right', 'top', 'bottom'; got 'front'\. Pass",
        ),
        (
            lambda: with_appendages((4, 4), [Appendage("top", 5, 1)]),
            ValueError,
            r"width and offset must keep .* side 4; got width=5, offset=None\. Pass",
        ),
        (
            lambda: with_appendages((4, 4), [Appendage("top", 3, 1, offset=2)]),
            ValueError,
            r"width and offset must keep .* side 4; got width=3, offset=2\. Pass",
        ),
        (
            lambda: with_appendages((4, 4), [Appendage("top", 3, 1, offset=-1)]),
            ValueError,
            r"offset must be an integer of 0 or more; got -1\. Pass",
        ),
        (
            lambda: with_appendages((4, 4), [Appendage("top", 3, 0)]),
            ValueError,
            r"depth must be an integer of 1 or more; got 0\. Pass",
        ),
        (lambda: with_appendages(4, []), TypeError, r"sides must be 1 to 3 numbers; got 4\. Pass"),  # type: ignore[arg-type]
        (
            lambda: with_appendages((4, 4), ["top"]),
            TypeError,
            r"appendages must hold Appendage objects; got 'top'\. Pass",
        ),  # type: ignore[list-item]
        (lambda: cube_with_appendages(4, 2, "top"), TypeError, r"faces must be a sequence of names; got 'top'\. Pass"),
        (lambda: band(3, 1), TypeError, r"points must be a sequence of corners; got 3\. Pass"),  # type: ignore[arg-type]
        (lambda: appendage_dictionary(widths=3), TypeError, r"widths must be a sequence of integers; got 3\. Pass"),  # type: ignore[arg-type]
        (lambda: rooms(1, 1, obstacle=3), TypeError, r"obstacle must be a pair \(height, width\); got 3\. Pass"),  # type: ignore[arg-type]
        (
            lambda: cube_with_appendages(4, 2, ["top", "left", "top"]),
            ValueError,
            r"faces must differ from each other; got \['top', 'left', 'top'\]\. Name",
        ),
    ],
)
def test_bad_arguments_are_named(make: Callable[[], Tensor], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        make()
