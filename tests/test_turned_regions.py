"""Decision regions on turned grids: which points are asked, and how the rotations become one number."""

import cmath
import inspect
import math
import statistics
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import torchlinf
from torchlinf import Measure, plot, regions
from torchlinf.measure import turned
from torchlinf.regions import (
    RegionSummary,
    decision_plane,
    decision_plane_complexity,
    decision_region_complexity,
    decision_region_summary,
)

BOUNDS = [(-2.0, 2.5), (-1.0, 1.5)]
SQUARE = [(-1.0, 1.0)] * 2


def half_plane(degrees: float, offset: float = 0.137) -> Callable[[Tensor], Tensor]:
    """The first axis turned towards the second by an angle is across the boundary."""
    normal = torch.tensor([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    return lambda points: points @ normal.to(points.dtype) > offset


def petals(points: Tensor) -> Tensor:
    """Three classes without any symmetry."""
    radius, angle = points.norm(dim=1), torch.atan2(points[:, 1], points[:, 0])
    return (radius > 0.6 + 0.2 * torch.cos(3 * angle + 0.4)).long() + (points[:, 0] > 0.83).long()


class Spy:
    """Keeps the points that it is asked for."""

    def __init__(self, answer: Callable[[Tensor], Any]) -> None:
        self.answer = answer
        self.asked: list[Tensor] = []

    def __call__(self, points: Tensor) -> Any:
        self.asked.append(points.double())
        return self.answer(points)

    @property
    def points(self) -> np.ndarray:
        return torch.cat(self.asked).numpy()


class Shown:
    """Answers with one mask after the other, whatever the points are; one grid is asked for at a time."""

    def __init__(self, masks: list[Tensor], labels: Sequence[Any] = (0, 1)) -> None:
        self.masks, self.labels = iter(masks), np.array(labels)

    def __call__(self, points: Tensor) -> np.ndarray:
        return self.labels[next(self.masks).flatten().long()]


# --- which points are asked ------------------------------------------------------------------------------------------


def turned_points(bounds: list[tuple[float, float]], sizes: tuple[int, int], degrees: float) -> np.ndarray:
    """Point by point, in complex numbers: the regions turn counter-clockwise if the points turn clockwise."""
    back = cmath.exp(-1j * math.radians(degrees))
    found = []
    for i in range(sizes[0]):
        for j in range(sizes[1]):
            step = complex(i - (sizes[0] - 1) / 2, j - (sizes[1] - 1) / 2) * back
            found.append(
                [
                    (low + high) / 2 + part * (high - low) / (size - 1)
                    for (low, high), part, size in zip(bounds, (step.real, step.imag), sizes, strict=True)
                ]
            )
    return np.array(found)


@pytest.mark.parametrize("chunk_size", [None, 7])
@pytest.mark.parametrize("degrees", [20.0, -33.5, 90.0, 135.0, 200.0, 3610.0])
def test_the_classifier_is_asked_at_the_points_of_the_turned_grid(degrees: float, chunk_size: int | None) -> None:
    spy = Spy(half_plane(70))
    found = decision_region_complexity(
        spy, BOUNDS, resolution=(9, 6), orientation=degrees, chunk_size=chunk_size, classes=[False, True]
    )
    points = turned_points(BOUNDS, (9, 6), degrees)
    np.testing.assert_allclose(spy.points, points, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(found.masks[1].flatten(), half_plane(70)(torch.from_numpy(points)))
    assert found.orientation == degrees
    np.testing.assert_allclose(found.axes[1], np.linspace(-1, 1.5, 6))


@pytest.mark.parametrize(("sizes", "period"), [((8, 8), 90), ((9, 6), 180)])
def test_the_rotations_are_asked_for_one_after_the_other(sizes: tuple[int, int], period: int) -> None:
    spy = Spy(half_plane(70))
    summary = decision_region_summary(spy, BOUNDS, resolution=sizes, rotations=4, chunk_size=11)
    angles = [i * period / 4 for i in range(4)]
    assert [found.orientation for found in summary.regions] == angles
    points = np.concatenate([turned_points(BOUNDS, sizes, angle) for angle in angles])
    np.testing.assert_allclose(spy.points, points, rtol=0, atol=1e-6)


def test_a_plane_is_turned_in_itself() -> None:
    corners = torch.tensor([[0.0, 0.0, 1.0], [4.0, 0.0, 1.0], [1.0, 2.0, 1.0]])
    spy = Spy(lambda points: points[:, :2])
    found = decision_plane(spy, corners, resolution=8, orientation=30)
    (first, last), (low, high) = ((float(axis[0]), float(axis[-1])) for axis in found.axes)
    expected = turned_points([(first, last), (low, high)], (8, 8), 30)
    np.testing.assert_allclose(spy.points, np.c_[expected, np.ones(64)], rtol=0, atol=1e-6)
    assert found.orientation == 30.0


@pytest.mark.parametrize("degrees", [0, 0.0, 360, -720])
def test_a_full_turn_is_no_turn(degrees: float) -> None:
    plain, turned = (
        decision_region_complexity(petals, BOUNDS, resolution=(31, 22), orientation=one) for one in (None, degrees)
    )
    assert torch.equal(plain.masks, turned.masks)
    assert torch.equal(plain.profile.level_values, turned.profile.level_values)
    assert plain.orientation is None


@pytest.mark.parametrize(("degrees", "quarters"), [(90, 1), (180, 2), (-90, 3)])
def test_quarter_turns_are_those_of_an_image(degrees: float, quarters: int) -> None:
    plain, turned = (
        decision_region_complexity(petals, SQUARE, resolution=32, orientation=one) for one in (None, degrees)
    )
    np.testing.assert_array_equal(turned.masks, np.rot90(plain.masks, quarters, axes=(1, 2)))
    torch.testing.assert_close(turned.mean(), plain.mean(), rtol=0, atol=1e-9)


# --- closed forms ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("boundary", ["background", "open"])
@pytest.mark.parametrize("angle", [10.0, 33.3, 71.0])
def test_a_slanted_boundary_is_simple_on_the_grid_that_is_turned_with_it(angle: float, boundary: str) -> None:
    for orientation in (-angle, 90 - angle):
        found = decision_region_complexity(
            half_plane(angle), SQUARE, resolution=24, orientation=orientation, boundary=boundary
        )
        assert found.mean().tolist() == [0.0, 0.0]
    for orientation in (None, angle):
        found = decision_region_complexity(
            half_plane(angle), SQUARE, resolution=24, orientation=orientation, boundary=boundary
        )
        assert found.mean().min() > 0.3


def test_a_turn_acts_on_steps_of_the_grid() -> None:
    """Of features in other units the same grid shows the same picture."""
    scale, shift = torch.tensor([1000.0, 0.01]).double(), torch.tensor([5.0, -2.0]).double()
    bounds = [(low * float(a) + float(b), high * float(a) + float(b)) for (low, high), a, b in
              zip(SQUARE, scale, shift, strict=True)]  # fmt: skip
    plain = decision_region_complexity(petals, SQUARE, resolution=25, orientation=40)
    scaled = decision_region_complexity(
        lambda points: petals((points.double() - shift) / scale), bounds, resolution=25, orientation=40
    )
    assert torch.equal(plain.masks, scaled.masks)


def test_a_volume_is_turned_by_a_matrix() -> None:
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_euler("zyx", [20, 35, -50], degrees=True)
    normal = torch.from_numpy(turn.as_matrix().T[:, 0].copy())  # what the turn brings onto the first axis
    bounds = [(-1.0, 1.0)] * 3

    def half_space(points: Tensor) -> Tensor:
        return points.double() @ normal > 0.137

    for given in (turn, turn.as_matrix(), torch.from_numpy(turn.as_matrix())):
        found = decision_region_complexity(half_space, bounds, resolution=10, orientation=given)
        assert found.mean().tolist() == [0.0, 0.0]
        assert found.orientation == pytest.approx(turn.as_matrix())
    assert decision_region_complexity(half_space, bounds, resolution=10).mean().min() > 0.3
    assert decision_region_complexity(half_space, bounds, resolution=10, orientation=turn.inv()).mean().min() > 0.3
    summary = decision_region_summary(half_space, bounds, resolution=10, orientation=turn)
    assert summary.overall() == 0.0
    assert summary.overall_standard_error().isnan()


def test_a_disc_is_nearly_the_same_at_every_angle() -> None:
    """Around the centre the grids cannot tell; elsewhere up to the noise of drawing it. A straight boundary is not."""

    def spread(classifier: Callable[[Tensor], Tensor]) -> float:
        summary = decision_region_summary(classifier, SQUARE, resolution=96, rotations=6)
        values = [float(found.mean()[1]) for found in summary.regions]
        return max(values) - min(values)

    assert spread(lambda p: p.norm(dim=1) < 0.5) == 0
    assert spread(lambda p: (p - p.new_tensor([0.1, -0.05])).norm(dim=1) < 0.5) < 0.6
    assert spread(half_plane(0)) > 2


def test_the_mean_does_not_change_when_the_regions_turn_by_one_rotation() -> None:
    """Every window is the same square, turned: turned regions see the same ones, in another order."""
    angle = math.radians(15)
    turn = torch.tensor([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]).double()
    plain = decision_region_summary(petals, SQUARE, resolution=40)
    other = decision_region_summary(lambda p: petals(p.double() @ turn), SQUARE, resolution=40)
    assert plain.overall_standard_error() > 0.01
    torch.testing.assert_close(other.overall(), plain.overall(), rtol=0, atol=1e-9)
    torch.testing.assert_close(other.mean(), plain.mean(), rtol=0, atol=1e-9)
    torch.testing.assert_close(other.standard_error(), plain.standard_error(), rtol=0, atol=1e-9)


# --- one number of several rotations --------------------------------------------------------------------------------


def drawn(*names: str) -> list[Tensor]:
    """Masks of one size."""
    y, x = torch.meshgrid(torch.arange(14), torch.arange(14), indexing="ij")
    known = {"half": x < 6, "slant": x + 2 * y < 17, "disc": (x - 6) ** 2 + (y - 7) ** 2 < 30, "nothing": x < 0}
    return [known[name] for name in names]


def test_means_and_standard_errors_by_hand() -> None:
    masks = drawn("half", "slant", "disc")
    summary = decision_region_summary(
        Shown(masks, ["out", "in"]), SQUARE, resolution=14, rotations=3, chunk_size=14 * 14, classes=["out", "in"]
    )
    for low, high in ((0.0, 1.0), (0.1, 0.6)):
        inside, outside = (
            [float(torchlinf.complexity(mask, spatial_ndim=2, low=low, high=high)) for mask in these]
            for these in (masks, [~mask for mask in masks])
        )
        area = [float(mask.double().mean()) for mask in masks]
        overall = [a * i + (1 - a) * o for a, i, o in zip(area, inside, outside, strict=True)]
        table = summary.table(low, high)
        assert table["class"].tolist() == ["out", "in"]
        for row, values in enumerate((outside, inside)):
            assert table["complexity"][row] == pytest.approx(statistics.mean(values), abs=1e-12)
            assert table["standard_error"][row] == pytest.approx(statistics.stdev(values) / 3**0.5, abs=1e-12)
        np.testing.assert_allclose(table["share"], [1 - statistics.mean(area), statistics.mean(area)], atol=1e-12)
        assert float(summary.overall(low, high)) == pytest.approx(statistics.mean(overall), abs=1e-12)
        error = statistics.stdev(overall) / 3**0.5
        assert float(summary.overall_standard_error(low, high)) == pytest.approx(error, abs=1e-12)


def test_rotations_that_agree_have_no_error() -> None:
    same = decision_region_summary(
        Shown(drawn("slant") * 4), SQUARE, resolution=14, rotations=4, chunk_size=14 * 14, classes=[0, 1]
    )
    assert same.standard_error().tolist() == [0.0, 0.0]
    assert same.overall_standard_error() == 0.0
    constant = decision_region_summary(lambda p: torch.ones(len(p)), SQUARE, resolution=9, threshold=0.5)
    assert (constant.overall(), constant.overall_standard_error()) == (0.0, 0.0)
    assert constant.mean().isnan().tolist() == [True, False]
    assert constant.share.tolist() == [0.0, 1.0]


def test_a_class_that_some_rotations_do_not_have() -> None:
    masks = drawn("disc", "nothing", "slant", "nothing")
    summary = decision_region_summary(Shown(masks), SQUARE, resolution=14, rotations=4, chunk_size=14 * 14)
    assert summary.classes == (0, 1)  # labels that are met on any grid
    values = [float(torchlinf.complexity(mask, spatial_ndim=2)) for mask in (masks[0], masks[2])]
    assert float(summary.mean()[1]) == pytest.approx(statistics.mean(values), abs=1e-12)
    assert float(summary.standard_error()[1]) == pytest.approx(statistics.stdev(values) / 2**0.5, abs=1e-12)
    once = decision_region_summary(Shown(masks[:2]), SQUARE, resolution=14, rotations=2, chunk_size=14 * 14)
    assert once.mean()[1] == pytest.approx(values[0], abs=1e-12)
    assert once.standard_error()[1].isnan()
    nowhere = decision_region_summary(lambda p: p, SQUARE, resolution=9, threshold=9.0, rotations=2)
    assert nowhere.overall().isnan()
    assert nowhere.overall_standard_error().isnan()


@pytest.mark.parametrize("boundary", ["background", "open"])
def test_mean_and_least_are_those_of_the_single_rotations(boundary: str) -> None:
    options: dict[str, Any] = {"resolution": 20, "boundary": boundary, "classes": [0, 1, 2]}
    single = [decision_region_complexity(petals, SQUARE, orientation=a, **options) for a in (0, 30, 60)]
    values = [float(found.overall()) for found in single]
    assert len(set(values)) == 3
    mean = decision_region_summary(petals, SQUARE, rotations=3, **options)
    assert float(mean.overall()) == pytest.approx(statistics.mean(values), abs=1e-12)
    least = decision_region_complexity(petals, SQUARE, orientation="least", rotations=3, **options)
    assert float(least.overall()) == min(values)
    assert least.orientation == (0.0, 30.0, 60.0)[values.index(min(values))]
    alone = decision_region_summary(petals, SQUARE, orientation="least", rotations=3, **options)
    assert len(alone.regions) == 1
    assert alone.overall() == least.overall()
    assert alone.overall_standard_error().isnan()


def test_the_least_rotation_has_a_region() -> None:
    """A grid that no class has a point of has no complexity, so it is not the least."""

    def beyond(points: Tensor) -> Tensor:
        return points[:, [0, 0]]

    options: dict[str, Any] = {"resolution": 14, "threshold": 1.2}
    values = [decision_region_complexity(beyond, SQUARE, orientation=a, **options).overall() for a in (0, 45)]
    assert values[0].isnan()
    least = decision_region_complexity(beyond, SQUARE, orientation="least", rotations=2, **options)
    assert (least.orientation, least.overall()) == (45.0, values[1])


def test_options_reach_every_rotation() -> None:
    options: dict[str, Any] = {"bins": 16, "levels": "rim", "tol": 1e-7}
    rho = torch.tensor([2.0, 3.0, 4.0])
    summary = decision_region_summary(petals, SQUARE, resolution=16, rotations=2, rho=rho, **options)
    for found in summary.regions:
        same = torchlinf.complexity_profile(found.masks, spatial_ndim=2, rho=rho, **options)
        assert torch.equal(found.profile.level_values, same.level_values)
        assert found.profile.measure.orientation is None
    defaults = inspect.signature(decision_region_summary).parameters
    assert (defaults["orientation"].default, defaults["rotations"].default) == ("mean", 6)
    assert inspect.signature(decision_region_complexity).parameters["orientation"].default is None


# --- planes ----------------------------------------------------------------------------------------------------------

CLOUD = torch.randn(30, 5, generator=torch.Generator().manual_seed(1))


def largest(points: Tensor) -> Tensor:
    return points[:, :3] + points[:, 2:] ** 2


def test_planes_have_the_mean_over_their_rotations() -> None:
    options: dict[str, Any] = {"resolution": 16, "classes": ["a", "b", "c"]}
    planes = decision_plane_complexity(
        largest, CLOUD, num_planes=3, orientation="mean", rotations=2, low=0.1, high=0.8, **options
    )
    least = decision_plane_complexity(largest, CLOUD, num_planes=3, orientation="least", rotations=2, **options)
    for triple, value, of_classes, share, smallest in zip(
        planes.triples, planes.values, planes.class_values, planes.share, least.values, strict=True
    ):
        both = [decision_plane(largest, CLOUD[triple], orientation=angle, **options) for angle in (0, 45)]
        expected = statistics.mean(float(found.overall(0.1, 0.8)) for found in both)
        assert float(value) == pytest.approx(expected, abs=1e-12)
        values = torch.stack([found.mean(0.1, 0.8) for found in both]).nanmean(dim=0)
        torch.testing.assert_close(of_classes, values, rtol=0, atol=1e-12, equal_nan=True)
        torch.testing.assert_close(share, (both[0].area + both[1].area) / 2, rtol=0, atol=1e-12)
        assert float(smallest) == min(float(found.overall()) for found in both)


def test_planes_have_a_row_a_class() -> None:
    planes = decision_plane_complexity(largest, CLOUD, num_planes=6, resolution=12, classes=["a", "b", "c"])
    assert (
        planes.values.tolist() == decision_plane_complexity(largest, CLOUD, num_planes=6, resolution=12).values.tolist()
    )
    table = planes.table()
    assert table["class"].tolist() == ["a", "b", "c"]
    found = [decision_plane(largest, CLOUD[triple], resolution=12) for triple in planes.triples]
    for number in range(3):
        values = [float(one.mean()[number]) for one in found if one.area[number] > 0]
        assert table["complexity"][number] == pytest.approx(statistics.mean(values), abs=1e-12)
        assert table["standard_error"][number] == pytest.approx(
            statistics.stdev(values) / len(values) ** 0.5, abs=1e-12
        )
        assert table["share"][number] == pytest.approx(statistics.mean(float(one.area[number]) for one in found))


def test_labels_that_some_planes_alone_have() -> None:
    def cells(points: Tensor) -> Tensor:
        return (points[:, 0] * 3).round().long()

    planes = decision_plane_complexity(cells, CLOUD, num_planes=4, resolution=12)
    found = [decision_plane(cells, CLOUD[triple], resolution=12) for triple in planes.triples]
    everywhere = set.intersection(*(set(one.classes) for one in found))
    assert list(planes.classes) == sorted(set().union(*(one.classes for one in found)))
    assert everywhere < set(planes.classes)
    for row, one in enumerate(found):
        for column, name in enumerate(planes.classes):
            expected = one.area[one.classes.index(name)] if name in one.classes else 0.0
            assert planes.share[row, column] == expected
            assert planes.class_values[row, column].isnan() == (expected == 0)


# --- what is refused, and the figure ---------------------------------------------------------------------------------


def test_what_cannot_be_turned_is_refused() -> None:
    matrix = np.eye(3)
    for call in (decision_region_complexity, decision_region_summary):
        with pytest.raises(ValueError, match=r'for regions, which the edge of the grid cuts; got "own"\. Pass "least"'):
            call(petals, SQUARE, resolution=8, orientation="own")
        with pytest.raises(ValueError, match=r"a 3 x 3 matrix on grids of three axes alone; got one on 2\. Pass"):
            call(petals, SQUARE, resolution=8, orientation=matrix)
        with pytest.raises(ValueError, match=r"orientation must be None on a grid of 1 axes; got 20\.0\. Pass"):
            call(lambda p: p, [(-1, 1)], resolution=8, threshold=0.0, orientation=20)
        with pytest.raises(ValueError, match=r"None or a 3 x 3 matrix on a grid of 3 axes; got 'least'\. Pass"):
            call(lambda p: p, [(-1, 1)] * 3, resolution=8, orientation="least")
        with pytest.raises(ValueError, match=r'rotations must stand beside orientation="mean" or "least"'):
            call(petals, SQUARE, resolution=8, orientation=20, rotations=3)
    with pytest.raises(ValueError, match="orientation must be None on a grid of 4 axes; got 'mean'"):
        decision_region_summary(lambda p: p, [(-1, 1)] * 4, resolution=3)
    for call in (
        lambda: decision_region_complexity(petals, SQUARE, resolution=8, orientation="mean"),
        lambda: decision_plane(largest, CLOUD[:3], resolution=8, orientation="mean"),
    ):
        with pytest.raises(ValueError, match=r'on one grid; got "mean"\. Pass it to decision_region_summary or'):
            call()
    with pytest.raises(ValueError, match='got "own"'):
        decision_plane_complexity(largest, CLOUD, num_planes=2, orientation="own")


def test_a_turned_grid_is_drawn_where_it_lies() -> None:
    """The colour of the figure at a point is that of the class there."""
    import matplotlib.pyplot as plt
    from matplotlib.colors import to_rgb

    bounds = [(-20.0, 25.0), (-1.0, 1.5)]
    centre, reach = np.array([2.5, 0.25]), np.array([22.5, 1.25])

    def classifier(points: Tensor) -> Tensor:
        return (points[:, 0] / 20 + points[:, 1] > 0.45).long()

    for orientation in (None, 25, -40):
        found = decision_region_complexity(classifier, bounds, resolution=60, orientation=orientation)
        fig, ax = plt.subplots(figsize=(5, 4), dpi=100)
        plot.decision_regions(found, ax=ax)
        ax.set_aspect("auto")
        ax.get_legend().remove()
        fig.canvas.draw()
        image = np.asarray(fig.canvas.buffer_rgba())[:, :, :3] / 255
        seen = 0
        for angle in np.radians(np.arange(5, 360, 40)):
            point = centre + 0.8 * reach * [np.cos(angle), np.sin(angle)]
            x, y = ax.transData.transform(point)
            number = int(classifier(torch.from_numpy(point)[None])[0])
            colour = 1 - 0.4 * (1 - np.array(to_rgb(plot.COLOURS[number])))
            np.testing.assert_allclose(image[len(image) - 1 - round(y), round(x)], colour, atol=0.02)
            seen += number
        assert 0 < seen < 9
        # All of the turned grid is within the axes.
        corners = turned_points(bounds, (60, 60), orientation or 0)
        assert ax.get_xlim()[0] <= corners[:, 0].min() < corners[:, 0].max() <= ax.get_xlim()[1]
        assert ax.get_ylim()[0] <= corners[:, 1].min() < corners[:, 1].max() <= ax.get_ylim()[1]
        plt.close(fig)


def test_the_summary_is_a_record_of_public_parts() -> None:
    summary = decision_region_summary(petals, SQUARE, resolution=12, rotations=2)
    assert isinstance(summary, RegionSummary)
    assert all(isinstance(found, regions.DecisionRegions) for found in summary.regions)
    assert summary.regions[0].profile.measure == Measure()
    pandas = pytest.importorskip("pandas")
    assert list(pandas.DataFrame(summary.table()).columns) == ["class", "complexity", "standard_error", "share"]


def overlap(first: np.ndarray, second: np.ndarray) -> float:
    """Intersection over union of two shapes with the centroids within a pixel of each other: of all shifts the best."""
    canvases = np.zeros((2, 99, 99), dtype=bool)
    for canvas, mask in zip(canvases, (first, second), strict=True):
        place = np.argwhere(mask)
        canvas[tuple((place - place.mean(axis=0)).round().astype(int).T + 49)] = True
    shifted = [np.roll(canvases[1], shift, axis=(0, 1)) for shift in np.ndindex(3, 3)]
    moved = np.roll(canvases[0], 1, axis=(0, 1))
    return max(float((moved & other).sum() / (moved | other).sum()) for other in shifted)


def test_regions_turn_as_masks_do() -> None:
    """One meaning of degrees: a region with the shape of a mask is turned to where `orientation` turns the mask."""
    mask = torch.zeros(40, 40, dtype=torch.bool)
    mask[10:30, 12:18], mask[24:30, 12:33] = True, True

    def shape(points: Tensor) -> Tensor:
        row, column = points.round().long().T
        within = (row >= 0) & (row < 40) & (column >= 0) & (column < 40)
        return within & mask[row.clamp(0, 39), column.clamp(0, 39)]

    found = decision_region_complexity(
        shape, [(0.0, 39.0)] * 2, resolution=40, orientation=25, classes=[False, True]
    ).masks[1]
    assert overlap(found.numpy(), turned(mask.numpy(), 25)) > 0.9
    assert overlap(found.numpy(), turned(mask.numpy(), -25)) < 0.6
