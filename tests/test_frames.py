"""The smallest rectangle, the own angle, and masks turned: against brute force, drawn shapes and exact geometry."""

import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

import torchlinf
from torchlinf._helpers.boxes import bounding_box
from torchlinf.kernels.outlines import draw, hull, polygons, sides, straight, trace
from torchlinf.measure import own_angle, smallest_rectangle, turned
from torchlinf.measure.frames import centred_grid, in_own_frame

Mask = NDArray[np.bool_]


def rotation(degrees: float) -> NDArray[np.float64]:
    """Turns (row, column) counter-clockwise as an image is seen."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[cos, -sin], [sin, cos]])


def rectangle(height: float, width: float, degrees: float, place: tuple[float, float] = (0.0, 0.0)) -> Mask:
    """The pixels whose middles a rectangle holds that was turned about its middle."""
    reach = math.ceil(math.hypot(height, width) / 2) + 2
    points = np.stack(np.mgrid[-reach : reach + 1, -reach : reach + 1], -1) - np.array(place)
    back = np.abs(points @ rotation(degrees))  # rows times the rotation: turned the other way
    mask = (back[..., 0] < height / 2) & (back[..., 1] < width / 2)
    return np.asarray(mask[bounding_box(mask)])


def random_masks(number: int, seed: int) -> list[Mask]:
    """Cropped masks of blobs and of noise, none with a symmetry, with holes and several parts."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    masks: list[Mask] = []
    while len(masks) < number:
        noise = rng.random(rng.integers(3, 40, 2))
        mask = gaussian_filter(noise, rng.choice([0.0, 1.0, 2.0])) > rng.choice([0.4, 0.5, 0.6])
        mask = np.ascontiguousarray(mask[bounding_box(mask)])
        images = [np.rot90(m, k) for m in (mask, mask[::-1]) for k in range(4)]
        if mask.size and sum(np.array_equal(image, mask) for image in images) == 1:
            masks.append(mask)
    return masks


def window(mask: Mask, low: float) -> float:
    return float(torchlinf.complexity(torch.from_numpy(mask), low=low, spatial_ndim=2))


def area_at(points: NDArray[np.float64], degrees: float) -> float:
    return float(np.prod(np.ptp(points @ rotation(degrees).T, axis=0)))


@pytest.mark.parametrize("seed", range(6))
def test_no_angle_gives_a_smaller_rectangle(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(30, 2)) * (7, 3)
    found = smallest_rectangle(points)
    scanned = [area_at(points, angle) for angle in np.arange(-45, 45, 0.01)]
    assert found.area <= min(scanned) * (1 + 1e-12)
    assert min(scanned) <= found.area * 1.001  # the scan comes close to it
    assert area_at(points, found.angle) == pytest.approx(found.area, rel=1e-12)
    assert found.sides == pytest.approx(np.ptp(points @ rotation(found.angle).T, axis=0), rel=1e-12)
    assert found.box_area == pytest.approx(area_at(points, 0.0), rel=1e-12)
    # A side of it lies on an edge of the hull: two of the points, at least, are on it.
    at = points @ rotation(found.angle).T
    touching = [int((np.abs(at[:, k] - end) < 1e-9).sum()) for k in (0, 1) for end in (at[:, k].min(), at[:, k].max())]
    assert max(touching) == 2


def test_smallest_rectangle_of_a_turned_rectangle() -> None:
    corners = np.array([(0, 0), (0, 8), (3, 8), (3, 0)]) @ rotation(20.0).T + (100, -7)
    found = smallest_rectangle(corners)
    assert (found.angle, found.area) == pytest.approx((-20.0, 24.0))
    assert found.sides == pytest.approx((3.0, 8.0))
    steep = smallest_rectangle(corners @ rotation(50.0).T)
    assert (steep.angle, steep.sides) == (pytest.approx(20.0), pytest.approx((8.0, 3.0)))


def test_ties_have_one_answer() -> None:
    square = np.array([(0, 0), (0, 2), (2, 2), (2, 0)])
    assert smallest_rectangle(square @ rotation(45.0).T).angle == pytest.approx(45.0)
    octagon = [(math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)) for k in range(8)]
    assert smallest_rectangle(octagon).angle == pytest.approx(22.5)  # not -22.5
    hexagon = [(math.cos(k * math.pi / 3), math.sin(k * math.pi / 3)) for k in range(6)]
    assert smallest_rectangle(hexagon).angle == pytest.approx(0.0, abs=1e-9)  # 30 and -30 degrees are as good


def test_points_without_an_area() -> None:
    assert smallest_rectangle([(2, 3)]).sides == (0.0, 0.0)
    assert smallest_rectangle([(2, 3), (2, 3)]).area == 0.0
    line = smallest_rectangle([(0, 0), (1, 1), (3, 3)])
    assert (line.angle, line.area) == (45.0, 0.0)
    assert sorted(line.sides) == pytest.approx([0.0, 3 * math.sqrt(2)])


@pytest.mark.parametrize("points", [[], [1.0, 2.0], [(1, 2, 3)], [(1, math.nan)]])
def test_points_must_be_pairs_of_numbers(points: object) -> None:
    with pytest.raises(ValueError, match=r"points must be \(N, 2\) finite numbers"):
        smallest_rectangle(points)  # type: ignore[arg-type]


def test_hull_is_scipys() -> None:
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(1).integers(0, 12, (60, 2)).astype(float)
    found = hull(points[np.lexsort((points[:, 1], points[:, 0]))])
    want = points[ConvexHull(points).vertices]
    assert sorted(map(tuple, found)) == sorted(map(tuple, want))


@pytest.mark.parametrize("degrees", [3.0, 14.5, 20.0, 33.0, 45.0, 61.0, -10.0])
def test_own_angle_of_a_rectangle(degrees: float) -> None:
    mask = rectangle(64.0, 96.0, degrees, (0.3, 0.2))
    off = (own_angle(mask) + degrees + 45) % 90 - 45
    assert abs(off) < 0.1


def test_shapes_along_the_axes_are_not_turned() -> None:
    mask = np.ones((40, 60), dtype=np.bool_)
    assert own_angle(mask) == 0.0
    mask[:15, 40:] = False
    assert own_angle(mask) == 0.0  # an L
    mask[0, :20] = False
    assert own_angle(mask) == 0.0  # with a step
    assert own_angle(np.zeros((4, 5), dtype=np.bool_)) == 0.0
    assert own_angle(np.ones((1, 1), dtype=np.bool_)) == 0.0


def test_quarter_turns_and_mirrors_change_nothing_else() -> None:
    for mask in random_masks(40, 0):
        angle, found = own_angle(mask), turned(mask, 17.0)
        for quarters in (1, 2, 3):
            assert own_angle(np.rot90(mask, quarters)) == angle
            assert np.array_equal(turned(np.rot90(mask, quarters), 17.0), np.rot90(found, quarters))
        assert own_angle(mask[::-1]) == (-angle if angle != 45.0 else 45.0)
        assert np.array_equal(turned(mask[::-1], -17.0), found[::-1])


@pytest.mark.parametrize("quarters", [-3, -2, -1, 0, 1, 2, 3, 4])
def test_multiples_of_90_degrees_move_pixels(quarters: int) -> None:
    for mask in random_masks(5, 1):
        wide = np.pad(mask, ((2, 1), (0, 3)))
        assert np.array_equal(turned(wide, 90 * quarters), np.rot90(mask, quarters))
        assert np.array_equal(turned(mask, 20 + 90 * quarters), np.rot90(turned(mask, 20), quarters))


@pytest.mark.parametrize("degrees", [1.3, 5.0, 12.0, 20.0, 29.0, 33.0, 41.0, 44.4, 45.0, 67.0])
@pytest.mark.parametrize(("height", "width"), [(64.0, 96.0), (40.0, 55.4), (47.3, 120.8)])
def test_a_rectangle_at_any_angle_is_a_box_in_its_own_frame(height: float, width: float, degrees: float) -> None:
    mask = rectangle(height, width, degrees, (0.21, 0.43))
    found = turned(mask, own_angle(mask))
    assert window(mask, 0.1) > 0.5
    assert window(found, 0.1) <= 0.1
    assert sorted(found.shape) == pytest.approx([height, width], abs=1.0)


def test_a_turned_rectangle_is_the_rectangle_drawn_there() -> None:
    """Turned into a third frame it may differ from what is drawn there only along the border, by rounding."""
    for degrees, turn in ((0.0, 30.0), (20.0, 13.0), (33.0, -50.0), (10.0, 140.0)):
        found, want = turned(rectangle(50.5, 81.5, degrees), turn), rectangle(50.5, 81.5, degrees + turn)
        assert np.abs(np.subtract(found.shape, want.shape)).max() <= 2
        assert found.sum() == pytest.approx(want.sum(), rel=0.02)
        size = np.maximum(found.shape, want.shape) + 4
        best = max(overlap(found, want, size, di, dj) for di in (-1, 0, 1) for dj in (-1, 0, 1))
        assert best > 0.97


def overlap(a: Mask, b: Mask, size: NDArray[np.int64], di: int, dj: int) -> float:
    """Intersection over union of two masks whose middles are (di, dj) apart."""
    placed = []
    for mask, move in ((a, (0, 0)), (b, (di, dj))):
        out = np.zeros(size, dtype=np.bool_)
        i, j = ((n - m) // 2 + d for n, m, d in zip(size, mask.shape, move, strict=True))
        out[i : i + mask.shape[0], j : j + mask.shape[1]] = mask
        placed.append(out)
    return float((placed[0] & placed[1]).sum() / (placed[0] | placed[1]).sum())


def test_an_l_at_an_angle_has_the_bits_of_one_that_is_drawn_along_the_axes() -> None:
    plain = np.ones((60, 90), dtype=np.bool_)
    plain[:25, 50:] = False
    for degrees in (7.0, 22.0, 38.0):
        reach = 60
        points = np.stack(np.mgrid[-reach:reach, -reach:reach], -1) @ rotation(degrees) + (30.0, 45.0)
        inside = ((points > 0) & (points < (60, 90))).all(-1) & ~((points[..., 0] < 25) & (points[..., 1] > 50))
        mask = np.ascontiguousarray(inside[bounding_box(inside)])
        found = turned(mask, own_angle(mask))
        assert window(mask, 0.1) - window(plain, 0.1) > 0.5
        assert window(found, 0.1) == pytest.approx(window(plain, 0.1), abs=0.1)


def test_holes_and_parts_are_kept() -> None:
    from scipy.ndimage import label

    mask = np.zeros((50, 80), dtype=np.bool_)
    mask[5:45, 5:40] = mask[10:30, 50:75] = True
    mask[15:30, 12:25] = False
    mask[20:25, 16:20] = True  # an island in the hole
    found = turned(mask, 23.0)
    assert label(found)[1] == 3
    assert label(~np.pad(found, 1), np.ones((3, 3)))[1] == 2
    assert found.sum() == pytest.approx(mask.sum(), rel=0.02)


def test_no_mask_is_lost() -> None:
    for mask in [*random_masks(30, 2), np.eye(7, dtype=np.bool_), np.ones((1, 9), dtype=np.bool_)]:
        found = turned(mask, 31.0)
        assert found.flags["C_CONTIGUOUS"]
        assert found.dtype == np.bool_
        assert found.any(axis=0)[[0, -1]].all()  # cropped, and not empty
        assert found.any(axis=1)[[0, -1]].all()
    assert turned(np.zeros((3, 4), dtype=np.bool_), 31.0).size == 0
    assert turned(np.ones((1, 1), dtype=np.bool_), 31.0).tolist() == [[True]]


def test_cracks_go_around_every_part_once() -> None:
    for mask in random_masks(20, 3):
        padded = np.pad(mask, 1)
        code, begin = trace(padded)
        assert len(code) == sum((np.diff(padded.astype(int), axis=axis) != 0).sum() for axis in (0, 1))
        steps = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])[code]
        area = 0
        for first, last, i, j in zip(begin[:-1, 0], begin[1:, 0], begin[:-1, 1], begin[:-1, 2], strict=True):
            at = np.cumsum(steps[first:last], axis=0) + np.array([i, j])
            assert (at[-1] == (i, j)).all()  # closed
            area += int((at[:, 1] * steps[first:last, 0]).sum())  # Green's theorem; holes go the other way
        assert area == mask.sum()


def test_straight_is_as_long_as_a_line_can_be() -> None:
    """Against linear programming: is there a line between the pixels inside and outside of the cracks?"""
    from scipy.optimize import linprog

    def separable(inner: NDArray[np.float64], outer: NDArray[np.float64]) -> bool:
        rows = np.concatenate([np.c_[inner, -np.ones(len(inner))], np.c_[-outer, np.ones(len(outer))]])
        found = linprog([0, 0, 0], A_ub=rows, b_ub=-np.ones(len(rows)), bounds=[(None, None)] * 3)
        return bool(found.status == 0)

    steps = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])
    for mask in [rectangle(14.2, 23.7, 17.0), rectangle(9.0, 9.0, 40.0), *random_masks(2, 4)]:
        code, begin = trace(np.pad(mask, 1))
        code = code[: begin[1, 0]]
        walk = steps[code]
        at = np.cumsum(np.concatenate([[begin[0, 1:]], walk]), axis=0)[:-1] + walk / 2
        normal = np.stack([walk[:, 1], -walk[:, 0]], 1) / 2  # towards the inside, on the right-hand side
        inner, outer = at + normal, at - normal
        for start in range(0, len(code), 7):
            n = straight(code, start)
            for count in (n, n + 1):
                chosen = (start + np.arange(min(count, len(code)))) % len(code)
                if count <= len(code):
                    assert separable(inner[chosen], outer[chosen]) == (count == n)


def test_sides_leave_the_pixels_where_they_are() -> None:
    """Drawn where they are, the outlines of smooth shapes give the mask back, up to a few pixels at corners."""
    for mask in (rectangle(40.0, 63.0, 21.0), rectangle(33.3, 71.2, 38.0), rectangle(30.0, 30.0, 7.0)):
        points, begin = polygons(*sides(np.pad(mask, 1)), 0.0, 1e-6)
        again = draw(points - 1.0, begin, *mask.shape)
        assert (again != mask).sum() <= 4


def test_draw_takes_the_pixels_whose_middles_are_inside() -> None:
    triangle, rows, columns = np.array([(0.2, 0.1), (9.7, 4.3), (3.1, 11.6)]), 10, 13
    points = np.stack(np.mgrid[:rows, :columns], -1) + 0.5
    edges = np.roll(triangle, -1, axis=0) - triangle
    crossed = [
        edge[0] * (points[..., 1] - p[1]) - edge[1] * (points[..., 0] - p[0])
        for p, edge in zip(triangle, edges, strict=True)
    ]
    inside = (np.array(crossed) > 0).all(axis=0) | (np.array(crossed) < 0).all(axis=0)
    assert np.array_equal(draw(triangle, np.array([0, 3]), rows, columns), inside)
    assert np.array_equal(draw(triangle[::-1].copy(), np.array([0, 3]), rows, columns), inside)


def test_centred_grid() -> None:
    low, high = np.array([0.3, -2.0]), np.array([7.1, 2.0])
    begin, size = centred_grid(low, high)
    assert size == [7, 4]
    assert begin + np.array(size) / 2 == pytest.approx((low + high) / 2)


def turn_about(axis: int, degrees: float) -> NDArray[np.float64]:
    matrix = np.eye(3)
    others = [k for k in range(3) if k != axis]
    matrix[np.ix_(others, others)] = rotation(degrees)
    return matrix


def test_volumes_are_turned_by_a_matrix() -> None:
    volume = np.random.default_rng(5).random((5, 6, 9)) < 0.6
    volume[0, 0, 0] = volume[-1, -1, -1] = True  # the box is the array
    assert np.array_equal(turned(volume, np.eye(3)), volume)
    quarter = turned(volume, turn_about(0, 90.0))
    assert np.array_equal(quarter, np.rot90(volume, 1, axes=(1, 2)))
    box = np.ones((20, 24, 30), dtype=np.bool_)
    there = turned(box, turn_about(2, 25.0))
    assert there.shape[2] == 30
    assert there[:, :, 15].sum() == pytest.approx(20 * 24, rel=0.03)
    back = turned(there, turn_about(2, -25.0))
    assert np.abs(np.subtract(back.shape, box.shape)).max() <= 2
    assert back.sum() == pytest.approx(box.sum(), rel=0.05)


def test_both_at_once_are_one_after_the_other() -> None:
    for mask in [*random_masks(30, 5), rectangle(30, 18, 31.0), np.ones((3, 4), dtype=bool)]:
        found, angle = in_own_frame(mask)
        assert angle == own_angle(mask)
        np.testing.assert_array_equal(found, turned(mask, angle))
