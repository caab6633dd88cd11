"""Objects and orientations: a mask is measured by its parts. What each must give is known from the plain measure."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from torch import Tensor

import torchlinf
from torchlinf import ComplexityProfile, Measure, complexity, complexity_profile, labels, metrics, order, plot, shapes
from torchlinf.measure import components
from torchlinf.transforms import ShapeComplexityScore

DISC, WIDE, ELL = shapes.disc(9), shapes.box(5, 17), torch.ones(17, 13, dtype=torch.bool)
ELL[:8, 4:] = False
TILTED_BOX = {  # a 30 x 40 rectangle along (3, 4) and (-4, 3), and one along (4, 3): all corners are grid points
    "3-4-5": ((24, 32), (-24, 18)),
    "4-3-5": ((32, 24), (-24, 32)),
    "5-12-13": ((15, 36), (-48, 20)),
    "8-15-17": ((24, 45), (-30, 16)),
}


def drawn(first: tuple[int, int], second: tuple[int, int]) -> NDArray[np.bool_]:
    """The pixels whose centres are in the parallelogram of two vectors (row, column), H != W, not at the middle."""
    corners = np.array([(0, 0), first, second, np.add(first, second)])
    low = corners.min(axis=0) - (3, 5)
    size = corners.max(axis=0) - low + (4, 2)
    rows, columns = np.indices(size).astype(float) + 0.5 + low[:, None, None]
    (a, b), (c, d) = first, second
    u, v = (rows * d - columns * c) / (a * d - b * c), (columns * a - rows * b) / (a * d - b * c)
    inside: NDArray[np.bool_] = (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
    return inside


def placed(*objects: Tensor, gap: int = 3) -> Tensor:
    """Objects side by side, each a little lower than the one before."""
    height = max(one.shape[0] + 2 * i for i, one in enumerate(objects)) + 2
    mask = torch.zeros(height, sum(one.shape[1] + gap for one in objects) + 4, dtype=torch.bool)
    left = 2
    for i, one in enumerate(objects):
        mask[1 + 2 * i : 1 + 2 * i + one.shape[0], left : left + one.shape[1]] = one
        left += one.shape[1] + gap
    return mask


SEVERAL = placed(DISC, WIDE, ELL)


def of(mask: Tensor, **options: Any) -> float:
    return complexity(mask, spatial_ndim=mask.ndim, **options).item()


def alone(mask: Tensor, low: float = 0.0, high: float = 1.0, **options: Any) -> float:
    return complexity_profile(mask, spatial_ndim=mask.ndim, **options).mean(low, high).item()


# Objects


@pytest.mark.parametrize("options", [{}, {"estimator": "std"}, {"levels": "rim", "bins": 64}, {"rho": 3.0}])
def test_the_mean_of_the_objects_is_that_of_each_alone(options: dict[str, Any]) -> None:
    each = [alone(one, **options) for one in (DISC, WIDE, ELL)]
    pixels = [int(one.sum()) for one in (DISC, WIDE, ELL)]
    assert len(set(each)) == 3
    assert of(SEVERAL, per="object", **options) == pytest.approx(np.mean(each), rel=1e-12)
    weighted = np.average(each, weights=pixels)
    assert of(SEVERAL, per="object", pool="area", **options) == pytest.approx(weighted, rel=1e-12)
    assert weighted != pytest.approx(np.mean(each), rel=1e-3)
    fine = [alone(one, 0.0, 0.3, **options) for one in (DISC, WIDE, ELL)]
    assert of(SEVERAL, per="object", high=0.3, **options) == pytest.approx(np.mean(fine), rel=1e-12)


def test_the_profile_of_objects_is_the_mean_of_their_profiles() -> None:
    profile = complexity_profile(SEVERAL, per="object", spatial_ndim=2)
    each = [complexity_profile(one, spatial_ndim=2) for one in (DISC, WIDE, ELL)]
    torch.testing.assert_close(
        profile.values, torch.stack([one.values for one in each]).mean(dim=0), rtol=1e-12, atol=0
    )
    assert profile.objects == 3
    assert profile.radius == max(int(one.radius) for one in each)
    assert profile.parts is not None
    assert profile.parts.profile.radius.tolist() == [int(one.radius) for one in each]
    assert profile.parts.pixels is not None
    assert profile.parts.pixels.tolist() == [int(one.sum()) for one in (DISC, WIDE, ELL)]
    assert profile.parts.number().tolist() == [1, 2, 3]
    with pytest.raises(
        ValueError, match=r"levels must be those of one shape in one frame; got a mean of several\. Pass"
    ):
        profile.levels()
    assert profile.field_error_bound == max(float(one.field_error_bound) for one in each)
    assert profile.error_bound() == 0


def test_boxes_of_objects_cut_them_out_of_the_mask() -> None:
    profile = complexity_profile(SEVERAL, per="object", spatial_ndim=2)
    assert profile.parts is not None
    assert profile.parts.box is not None
    cut = [SEVERAL[rows[0] : rows[1], columns[0] : columns[1]] for rows, columns in profile.parts.box.tolist()]
    for found, expected in zip(cut, (DISC, WIDE, ELL), strict=True):
        assert torch.equal(found, expected)


def steps_by_hand(each: list[ComplexityProfile]) -> Callable[[float], float]:
    """The mean of the objects' level values at a scale."""
    levels = [one.level_values.tolist() for one in each]
    return lambda t: float(np.mean([of_one[math.ceil(t * len(of_one)) - 1] for of_one in levels]))


def test_the_steps_and_the_peak_of_a_mean() -> None:
    profile = complexity_profile(SEVERAL, per="object", spatial_ndim=2)
    at = steps_by_hand([complexity_profile(one, spatial_ndim=2) for one in (DISC, WIDE, ELL)])
    ends, values, bounds = profile.steps()
    radii = [math.ceil(complexity_profile(one, spatial_ndim=2).radius.item()) for one in (DISC, WIDE, ELL)]
    assert ends.tolist() == sorted({k / radius for radius in radii for k in range(1, radius + 1)})
    before = 0.0
    for end, value in zip(ends.tolist(), values.tolist(), strict=True):
        assert value == pytest.approx(at((before + end) / 2), rel=1e-12)
        before = end
    assert not bounds.any()
    lengths = torch.diff(ends, prepend=torch.zeros(1, dtype=torch.float64))
    assert (values * lengths).sum().item() == pytest.approx(profile.mean().item(), rel=1e-12)
    peak, scale = profile.peak()
    assert peak == values.max()
    assert scale == ends[values.argmax()]
    plain = complexity_profile(DISC, spatial_ndim=2)
    assert torch.equal(plain.steps()[1], plain.level_values)
    with pytest.raises(ValueError, match=r"steps must be those of one shape; got 2\. Pass"):
        complexity_profile(torch.ones(2, 1, 4, 4)).steps()


def test_a_batch_is_its_parts() -> None:
    masks = [SEVERAL, torch.zeros_like(SEVERAL), SEVERAL.flip(1), placed(ELL, DISC.T, WIDE)[: len(SEVERAL)], SEVERAL]
    batch = torch.stack([torch.nn.functional.pad(mask, (0, 3)) for mask in masks])
    options: tuple[dict[str, Any], ...] = (
        {"per": "object"},
        {"per": "object", "pool": "area", "orientation": "own"},
        {"per": "object", "orientation": "mean", "rotations": 3},
        {"orientation": "mean", "rotations": 2},
        {"orientation": "least", "rotations": 4},
        {"orientation": 25},
        {"orientation": "own"},
    )
    for chosen in options:
        together = complexity_profile(batch[None], **chosen)
        assert together.radius.shape == (1, 5)
        for i, mask in enumerate(batch):
            one = complexity_profile(mask, spatial_ndim=2, **chosen)
            part = together[0, i]
            for found in (part, one):
                assert found.radius.shape == ()
            for name in ("values", "radius", "field_error_bound", "objects"):
                assert torch.equal(getattr(part, name).nan_to_num(-1), getattr(one, name).nan_to_num(-1)), (
                    chosen,
                    name,
                )
            for low, high in ((0.0, 1.0), (0.2, 0.7)):
                assert torch.equal(part.mean(low, high).nan_to_num(-1), one.mean(low, high).nan_to_num(-1))
                assert torch.equal(together.mean(low, high)[0, i].nan_to_num(-1), one.mean(low, high).nan_to_num(-1))
            assert torch.equal(part.peak()[0].nan_to_num(-1), one.peak()[0].nan_to_num(-1))
            assert torch.equal(together.peak()[1][0, i].nan_to_num(-1), one.peak()[1].nan_to_num(-1))
        assert together.mean()[0, 0] == together.mean()[0, 4]
        assert together.mean()[0, 1].isnan()
        some = together[0, torch.tensor([4, 1, 0])]
        assert torch.equal(some.mean().nan_to_num(-1), together.mean()[0, [4, 1, 0]].nan_to_num(-1))
        assert torch.equal(some.objects, together.objects[0, [4, 1, 0]])


def test_objects_in_several_batches_of_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    batch = torch.stack([SEVERAL, SEVERAL.flip(0), torch.zeros_like(SEVERAL), SEVERAL.flip(1)])
    rho = torch.tensor([2.0, 3.0, 4.0, 5.0])
    whole = complexity(batch, per="object", rho=rho, spatial_ndim=2)
    monkeypatch.setattr("torchlinf.measure.objects.AT_A_TIME", 1)
    pieces = complexity(batch, per="object", rho=rho, spatial_ndim=2)
    assert torch.equal(whole.nan_to_num(-1), pieces.nan_to_num(-1))
    assert [of(mask, per="object", rho=value) for mask, value in zip(batch[:2], (2.0, 3.0), strict=True)] == [
        *whole[:2].tolist()
    ]


def test_each_object_has_the_screening_length_of_its_mask() -> None:
    batch, rho = torch.stack([SEVERAL, SEVERAL.flip(0)]), torch.tensor([2.0, 5.0])
    for options in ({}, {"orientation": "own"}, {"orientation": "mean", "rotations": 2}, {"orientation": "least"}):
        profile = complexity_profile(batch, per="object", rho=rho, spatial_ndim=2, **options)
        assert torch.equal(profile.measure.rho, rho)
        assert profile.parts is not None
        alone = profile.parts.profile
        assert alone.measure.rho.tolist() == [2.0] * 3 + [5.0] * 3
        assert alone[4].measure.rho == 5.0
        assert (profile.seconds > 0).all()
        expected = [of(mask, per="object", rho=value, **options) for mask, value in zip(batch, (2.0, 5.0), strict=True)]
        assert profile.mean().tolist() == expected


def test_small_objects_are_left_out_by_their_pixels() -> None:
    each, pixels = [alone(one) for one in (DISC, WIDE, ELL)], [int(one.sum()) for one in (DISC, WIDE, ELL)]
    assert pixels[1] < pixels[2] < pixels[0]
    for least, kept in ((pixels[1], each), (pixels[1] + 1, [each[0], each[2]]), (pixels[2] + 1, each[:1])):
        assert of(SEVERAL, per="object", min_pixels=least) == pytest.approx(np.mean(kept), rel=1e-12)
    nothing = complexity_profile(SEVERAL, per="object", min_pixels=10**6, spatial_ndim=2)
    assert nothing.mean().isnan()
    assert nothing.peak()[0].isnan()
    assert nothing.values.isnan().all()
    assert (nothing.objects, nothing.radius) == (0, 0)


def test_connectivity_says_what_one_object_is() -> None:
    touching = torch.zeros(20, 25, dtype=torch.bool)
    touching[:9, :9] = True  # two squares that touch at a corner, as one shape and as two
    touching[9:20, 9:20] = True
    assert complexity_profile(touching, per="object", spatial_ndim=2).objects == 1
    assert complexity_profile(touching, per="object", connectivity=2, spatial_ndim=2).objects == 1
    assert complexity_profile(touching, per="object", connectivity=1, spatial_ndim=2).objects == 2
    cubes = torch.zeros(6, 5, 8, dtype=torch.bool)
    cubes[:2, :2, :2] = cubes[2:4, 2:4, :2] = cubes[4:, 4:, 2:] = True  # one touches along an edge, one at a corner
    assert [
        int(complexity_profile(cubes, per="object", connectivity=n, spatial_ndim=3).objects) for n in (1, 2, 3, None)
    ] == [3, 2, 1, 1]
    with pytest.raises(
        ValueError, match=r"connectivity must be at most the number of spatial dimensions, 2; got 3\. Pass"
    ):
        of(touching, per="object", connectivity=3)


def flooded(mask: NDArray[np.bool_], steps: list[tuple[int, int]]) -> set[frozenset[tuple[int, int]]]:
    """Components, pixel by pixel."""
    left = set(zip(*(axis.tolist() for axis in mask.nonzero()), strict=True))
    found = set()
    while left:
        queue = [left.pop()]
        seen = set(queue)
        while queue:
            r, c = queue.pop()
            for dr, dc in steps:
                if (r + dr, c + dc) in left:
                    left.remove((r + dr, c + dc))
                    seen.add((r + dr, c + dc))
                    queue.append((r + dr, c + dc))
        found.add(frozenset(seen))
    return found


@pytest.mark.parametrize("connectivity", [1, 2, None])
def test_components_are_those_of_a_flood(connectivity: int | None) -> None:
    mask = np.random.default_rng(4).random((17, 23)) < 0.45
    steps = [(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if (r, c) != (0, 0)]
    steps = [step for step in steps if sum(map(abs, step)) <= (connectivity or 2)]
    found = set()
    for one in components(mask, connectivity=connectivity):
        rows, columns = one.mask().nonzero()
        found.add(
            frozenset(
                (r + one.box[0].start, c + one.box[1].start)
                for r, c in zip(rows.tolist(), columns.tolist(), strict=True)
            )
        )
        assert one.pixels == len(rows)
        assert one.mask().any(axis=0).all() or one.pixels > 1
    assert found == flooded(mask, steps)
    assert components(np.zeros((3, 4), dtype=bool)) == []


@pytest.mark.parametrize("ndim", [1, 3, 4])
def test_objects_in_other_dimensions(ndim: int) -> None:
    first = torch.ones([7, 5, 6, 4][:ndim], dtype=torch.bool)
    if ndim > 1:
        first[:3, 2:] = False
    second = torch.ones([3, 4, 2, 5][:ndim], dtype=torch.bool)
    mask = torch.zeros([14, 10, 9, 8][:ndim], dtype=torch.bool)
    mask[tuple(slice(1, 1 + side) for side in first.shape)] = first
    place = [slice(0, side) for side in second.shape]
    place[0] = slice(10, 10 + len(second))
    mask[tuple(place)] = second
    assert of(mask, per="object") == pytest.approx((alone(first) + alone(second)) / 2, rel=1e-12)
    assert of(mask, per="object") != of(mask) or ndim == 1


# Orientation


@pytest.mark.parametrize("name", TILTED_BOX)
def test_a_tilted_rectangle_is_simple_in_its_own_frame(name: str) -> None:
    mask = torch.from_numpy(drawn(*TILTED_BOX[name]))
    profile = complexity_profile(mask, orientation="own", spatial_ndim=2)
    assert of(mask) > 1.5
    assert profile.mean() <= 0.05
    (a, b), _ = TILTED_BOX[name]
    along = math.degrees(math.atan2(b, a)) % 90  # of the first side, from the row axis towards the column axis
    assert profile.angle is not None
    turned_to = (along + profile.angle.item()) % 90
    assert min(turned_to, 90 - turned_to) < 1.5


@pytest.mark.parametrize("mask", [DISC, WIDE, ELL, ELL.T])
def test_quarter_turns_change_nothing(mask: Tensor) -> None:
    options: tuple[dict[str, Any], ...] = (
        {"orientation": "own"},
        {"orientation": "mean", "rotations": 3},
        {"orientation": "least", "rotations": 5},
        {"orientation": "own", "per": "object"},
        {"orientation": 90},
        {"orientation": -180.0},
    )
    for chosen in options:
        expected = of(mask, **chosen)
        for turns in (1, 2, 3):
            assert of(torch.rot90(mask, turns), **chosen) == expected, (chosen, turns)
    for degrees in (0, 90, 180, 270, -90, 360):
        assert of(mask, orientation=degrees) == of(mask)


def test_the_order_of_the_objects_does_not_matter() -> None:
    for chosen in ({"per": "object"}, {"per": "object", "pool": "area", "orientation": "own"}):
        assert len({of(torch.rot90(SEVERAL, turns), **chosen) for turns in range(4)}) == 1


@pytest.mark.parametrize("mask", [WIDE, ELL, shapes.with_appendages((20, 24), [shapes.Appendage("right", 5, 4)])])
def test_shapes_along_the_axes_keep_every_digit(mask: Tensor) -> None:
    own, plain = (complexity_profile(mask, orientation=way, spatial_ndim=2) for way in ("own", None))
    assert torch.equal(own.level_values, plain.level_values)
    assert own.angle == 0
    assert plain.angle is None


def test_a_turn_is_one_of_the_mask() -> None:
    from torchlinf.measure import turned

    mask = torch.nn.functional.pad(ELL, (2, 7, 1, 0))
    turned_mask = torch.from_numpy(turned(mask.numpy(), 25.0))
    assert of(mask, orientation=25) == of(turned_mask)
    rotations = [torch.from_numpy(turned(mask.numpy(), 90 * i / 4)) for i in range(4)]
    each = np.array([of(one, low=0.1, high=0.6) for one in rotations])
    profile = complexity_profile(mask, orientation="mean", rotations=4, spatial_ndim=2)
    assert profile.mean(0.1, 0.6).item() == pytest.approx(each.mean(), rel=1e-12)
    assert profile.standard_error(0.1, 0.6).item() == pytest.approx(each.std(ddof=1) / 2, rel=1e-9)
    assert profile.parts is not None
    assert profile.parts.profile.angle is not None
    assert profile.parts.profile.angle.tolist() == [0.0, 22.5, 45.0, 67.5]
    least = complexity_profile(mask, orientation="least", rotations=4, spatial_ndim=2)
    whole = [of(one) for one in rotations]
    assert least.mean().item() == min(whole)
    assert least.angle is not None
    assert least.angle.item() == 22.5 * int(np.argmin(whole))
    assert of(mask, orientation="least", rotations=4, low=0.1, high=0.6) == each.min()


def test_the_standard_error_of_objects_is_that_of_their_mean() -> None:
    each = [np.array([of(one, orientation=degrees) for degrees in (0, 30, 60)]) for one in (DISC, WIDE, ELL)]
    profile = complexity_profile(SEVERAL, per="object", orientation="mean", rotations=3, spatial_ndim=2)
    by_rotation = np.mean(each, axis=0)
    assert profile.mean().item() == pytest.approx(by_rotation.mean(), rel=1e-12)
    assert profile.standard_error().item() == pytest.approx(by_rotation.std(ddof=1) / math.sqrt(3), rel=1e-9)
    with pytest.raises(ValueError, match=r'a standard error must be one over rotations; got .* orientation="mean"'):
        complexity_profile(SEVERAL, per="object", spatial_ndim=2).standard_error()
    assert complexity_profile(DISC, orientation="mean", rotations=1, spatial_ndim=2).standard_error().isnan()


def test_a_disc_has_no_frame() -> None:
    """What a turn does to a large digital disc is little."""
    disc = shapes.disc(32)
    for way in ("own", "mean", "least", 20):
        assert of(disc, orientation=way) == pytest.approx(of(disc), abs=0.5)


def test_volumes_are_turned_by_a_matrix() -> None:
    box = torch.zeros(12, 9, 15, dtype=torch.bool)
    box[1:11, 2:8, 3:12] = True
    quarter = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    assert of(box, orientation=quarter) == 0.0
    assert of(box, orientation=torch.tensor(quarter)) == 0.0
    slanted = Rotation.from_euler("z", 30, degrees=True)
    assert of(box, orientation=slanted) > 0.3
    there = Measure(orientation=slanted).orientation
    assert of(box, orientation=there) == of(box, orientation=slanted)
    profile = complexity_profile(box, orientation=slanted, per="object", spatial_ndim=3)
    assert profile.parts is not None
    assert profile.parts.profile.angle is None
    assert profile.mean() == of(box, orientation=slanted)
    for wrong, words in (
        ({"orientation": 30}, r"orientation must be None for masks of 3 dimensions; got 30\.0\. Pass a 3 x 3"),
        ({"orientation": "own"}, r"orientation must be None for masks of 3 dimensions; got 'own'\. Pass"),
    ):
        with pytest.raises(ValueError, match=words):
            of(box, **wrong)
    with pytest.raises(
        ValueError, match=r"orientation must not be a 3 x 3 matrix for masks of 2 dimensions; got one\. Pass"
    ):
        of(DISC, orientation=quarter)


def test_an_empty_mask_has_no_number() -> None:
    masks = torch.zeros(2, 3, 5, 7)
    for chosen in ({"per": "object"}, {"orientation": "own"}, {"orientation": "mean"}, {"orientation": "least"}):
        profile = complexity_profile(masks, **chosen)
        assert profile.mean().isnan().all()
        assert profile.error_bound().isnan().all()
        assert not profile.objects.any()
        assert profile[0, 0].steps()[0].shape == (0,)
        assert not profile.radius.any()
        assert complexity(masks[:0], **chosen).shape == (0, 3)
    assert complexity_profile(masks, orientation="mean").standard_error().isnan().all()


def test_other_methods_have_no_parts() -> None:
    with pytest.raises(ValueError, match='method must be "auto" or "compiled" beside orientation or per="object"; got'):
        complexity(DISC, method="monotone", orientation="own", spatial_ndim=2)


def test_thin_shapes_do_not_vanish() -> None:
    line = torch.zeros(9, 40, dtype=torch.bool)
    line[4, 3:37] = True
    for degrees in range(0, 90, 7):
        assert complexity_profile(line, orientation=degrees, spatial_ndim=2).radius >= 1
        assert complexity_profile(line[4:5, 5:6], orientation=degrees, spatial_ndim=2).radius == 1


def test_short_dtypes_round_at_the_end() -> None:
    for chosen in ({"per": "object"}, {"orientation": "mean"}):
        full = complexity_profile(SEVERAL, spatial_ndim=2, **chosen)
        short = complexity_profile(SEVERAL, spatial_ndim=2, dtype=torch.float32, **chosen)
        assert short.mean().dtype == short.values.dtype == short.peak()[0].dtype == torch.float32
        assert short.mean() == full.mean().float()
        torch.testing.assert_close(short.values.double(), full.values, rtol=1e-6, atol=1e-6)


# Where it is used


def test_the_metric_counts_objects() -> None:
    other = placed(ELL, WIDE)
    mask = torch.zeros(1, 3, *SEVERAL.shape, dtype=torch.int64)
    mask[0, 0] = SEVERAL
    mask[0, 1, : len(other), : other.shape[1]] = other
    each = [alone(one) for one in (DISC, WIDE, ELL)]
    metric = metrics.ShapeComplexity(3, per="object", average="none", empty="skip")
    found = metric(mask)
    assert metric.num_shapes.tolist() == [3, 2, 0]
    assert metric.num_empty.tolist() == [0, 0, 1]
    expected = [np.mean(each), np.mean(each[1:]), math.nan]
    torch.testing.assert_close(found, torch.tensor(expected, dtype=torch.float32), equal_nan=True)
    micro = metrics.ShapeComplexity(3, per="object", average="micro", empty="skip")(mask)
    assert micro.item() == pytest.approx((sum(each) + each[1] + each[2]) / 5, rel=1e-6)
    worst = metrics.ShapeComplexity(3, per="object", average="micro")(mask)
    assert worst.item() == pytest.approx((sum(each) + each[1] + each[2] + 10) / 6, rel=1e-6)
    for pool in ("mean", "area"):
        metric = metrics.ShapeComplexity(3, per="object", pool=pool, average="none", empty="skip")
        found = metric(mask)
        assert metric.num_shapes.tolist() == [1, 1, 0]
        assert found[0].item() == pytest.approx(of(SEVERAL, per="object", pool=pool), rel=1e-6)


def test_the_metric_of_two_batches_is_that_of_one() -> None:
    masks = torch.stack([SEVERAL, SEVERAL.flip(0)])[:, None].int()
    together = metrics.ShapeComplexity(1, per="object", orientation="own")
    apart = metrics.ShapeComplexity(1, per="object", orientation="own")
    together.update(masks)
    apart.update(masks[:1])
    apart.update(masks[1:])
    assert torch.equal(together.total, apart.total)
    assert torch.equal(together.num_shapes, apart.num_shapes)


LABELS = np.zeros((30, 44), dtype=np.int32)
LABELS[2:21, 1:20][DISC.numpy()] = 7
LABELS[4:9, 24:41] = 3
LABELS[12:29, 28:41][ELL.numpy()] = 7
LABELS[28, 5] = 3


def test_a_table_of_labels_has_a_row_for_each_component() -> None:
    table = labels.complexity_table(LABELS, per="object", properties=["area", "bbox"])
    assert table["label"].tolist() == [3, 3, 7, 7]
    assert table["object"].tolist() == [1, 2, 1, 2]
    assert table["label"].dtype == np.int32
    assert "objects" not in table
    assert "angle" not in table
    assert table["complexity"].tolist() == [alone(WIDE), 0.0, alone(DISC), alone(ELL)]
    assert table["area"].tolist() == [WIDE.sum(), 1, DISC.sum(), ELL.sum()]
    assert table["bbox-0"].tolist() == [4, 28, 2, 12]
    assert table["touches_border"].tolist() == [False, False, False, False]
    large = labels.complexity_table(LABELS, per="object", min_pixels=2, orientation="own")
    assert large["label"].tolist() == [3, 7, 7]
    assert large["angle"].tolist()[0] == 0.0
    assert large["measure"][0] == Measure(per="object", min_pixels=2, orientation="own").settings()
    empty = labels.complexity_table(LABELS * 0, per="object", orientation="mean")
    assert {name: len(column) for name, column in empty.items()} == dict.fromkeys(empty, 0)
    assert "standard_error" in empty


def test_a_table_of_labels_pools_components() -> None:
    table = labels.complexity_table(LABELS, per="object", pool="area", min_pixels=2)
    assert table["label"].tolist() == [3, 7]
    assert table["objects"].tolist() == [1, 2]
    pixels = [int(DISC.sum()), int(ELL.sum())]
    assert table["complexity"][0] == 0.0
    assert table["complexity"][1] == pytest.approx(np.average([alone(DISC), alone(ELL)], weights=pixels), rel=1e-12)
    none = labels.complexity_table(LABELS, per="object", pool="mean", min_pixels=100)
    assert none["objects"].tolist() == [0, 2]
    assert np.isnan(none["complexity"][0])
    mean = labels.complexity_table(LABELS, orientation="mean", rotations=2, windows={"a": (0.0, 0.4), "b": (0.4, 1.0)})
    crop = torch.from_numpy(LABELS == 7)
    profile = complexity_profile(crop, orientation="mean", rotations=2, spatial_ndim=2)
    assert mean["standard_error"][1] == max(profile.standard_error(0, 0.4), profile.standard_error(0.4, 1))


def test_labels_that_cannot_be_turned_are_refused() -> None:
    for wrong in ({"orientation": 30}, {"per": "object", "connectivity": 4}):
        with pytest.raises(ValueError, match="must be"):
            labels.complexity_table(np.zeros((3, 4, 5), dtype=int), **wrong)


def test_transforms_score_batches_of_objects() -> None:
    batch = torch.stack([SEVERAL, torch.zeros_like(SEVERAL), SEVERAL.flip(0)])
    scores = ShapeComplexityScore(per="object", orientation="own")(batch)
    assert [scores[i].item() for i in (0, 2)] == [of(batch[i], per="object", orientation="own") for i in (0, 2)]
    assert scores[1].isnan()


def test_orders_and_figures_take_means() -> None:
    masks = {"several": SEVERAL, "ell": ELL, "box": WIDE}
    options: dict[str, Any] = {"per": "object", "orientation": "mean", "rotations": 2}
    profiles = {name: complexity_profile(mask, spatial_ndim=2, **options) for name, mask in masks.items()}
    for every_scale in (False, True):
        graph = order.dominance(profiles, every_scale=every_scale)
        assert len(graph) == 3
    assert order.kendall_tau(list(profiles.values())).shape == (100,)
    axes = plot.profile(SEVERAL, **options)
    stairs = axes.patches[0].get_data()
    lengths = np.diff(stairs.edges)
    assert (stairs.values * lengths).sum() == pytest.approx(profiles["several"].mean().item(), rel=1e-12)
    plain = complexity_profile(ELL, spatial_ndim=2)
    with pytest.raises(ValueError, match="in the same frames; got"):
        order.dominance({"a": profiles["ell"], "b": plain})


def test_options_can_be_handed_on() -> None:
    fine = Measure(high=0.5, orientation="own", per="object", min_pixels=2)
    assert of(SEVERAL, **fine.options()) == of(SEVERAL, high=0.5, orientation="own", per="object", min_pixels=2)
    assert fine.plain() == Measure(high=0.5)
    assert not fine.is_plain
    assert torchlinf.Measure(**fine.options()) == fine
