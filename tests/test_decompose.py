"""Parts: they partition the shape, their objective is never higher, boxes joined to boxes fall apart into boxes."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
import torch
from problems import random_batch
from scipy import ndimage
from torch import Tensor

from torchlinf import ComplexityProfile, complexity, shapes
from torchlinf.decompose import cut_tree, parts
from torchlinf.decompose.cut_candidates import CANDIDATES
from torchlinf.labels import complexity_table
from torchlinf.measure import Measure, complexities_after_flips, ragged_profile
from torchlinf.shapes import Appendage

LADDER = [Appendage("right", 24, 12), Appendage("top", 16, 12), Appendage("left", 8, 12)]
JOINED = {
    "three widths": shapes.with_appendages((32, 32), LADDER, margin=1),
    "almost as wide": shapes.with_appendages((32, 32), [Appendage("right", 29, 9)]),
    "on every side": shapes.with_appendages((21, 21), [Appendage(f, 7, 5) for f in ("left", "right", "top", "bottom")]),
    "meeting at a corner": shapes.with_appendages((12, 12), [Appendage("right", 4, 3, 0), Appendage("top", 4, 3, 8)]),
    "rooms": shapes.rooms(2, 3, side=16, wall=2, aperture=5),
    "in 3-D": shapes.cube_with_appendages(10, 4, ["left", "front", "top"]),
}


def pieces(label_map: Tensor) -> list[np.ndarray]:
    """The parts of one shape, each cropped to its box."""
    found = label_map.numpy()
    return [found[box] == i for i, box in enumerate(ndimage.find_objects(found), start=1)]


def same_partition(one: Tensor, other: Tensor) -> bool:
    """Whether two label maps tell the same pixels apart, whatever the numbers."""
    pairs = len(torch.unique(torch.stack([one.flatten(), other.flatten()]), dim=1)[0])
    return pairs == len(one.unique()) == len(other.unique())


@pytest.mark.parametrize("name", JOINED)
def test_boxes_joined_to_boxes_fall_apart_into_boxes(name: str) -> None:
    shape = JOINED[name]
    found = parts(shape, spatial_ndim=shape.ndim)
    assert found.before > 0.1
    assert found.after == 0.0
    assert all(piece.all() for piece in pieces(found.label_map))
    assert torch.equal(found.label_map > 0, shape)


def test_the_cuts_are_where_the_appendages_were_joined() -> None:
    shape = shapes.with_appendages((32, 32), LADDER)
    found = parts(shape, spatial_ndim=2)
    sizes = [int((found.label_map == i).sum()) for i in range(1, int(found.num_parts) + 1)]
    assert sizes == [32 * 32, 24 * 12, 16 * 12, 8 * 12]
    assert (found.label_map[12:, 12:44] == 1).all()


@pytest.mark.parametrize("candidates", ["openings", "watershed"])
@pytest.mark.parametrize("objective", ["sum", "mean"])
@pytest.mark.parametrize("size", [(50,), (21, 34), (7, 9, 8), (4, 5, 4, 5)])
def test_parts_partition_the_shape_and_lower_the_objective(
    size: tuple[int, ...], objective: str, candidates: str
) -> None:
    masks = random_batch(len(size), 4, size).reshape(2, 2, *size)
    found = parts(masks, objective=objective, penalty_per_part=0.05, candidates=candidates)
    assert torch.equal(found.label_map > 0, masks)
    for mask in masks.flatten(0, 1).numpy():
        for cut in CANDIDATES[candidates](mask, Measure()) if mask.any() else ():
            assert np.array_equal(cut > 0, mask)
            assert all(ndimage.label(cut == i)[1] == 1 for i in range(1, cut.max() + 1))
    torch.testing.assert_close(found.before, complexity(masks), rtol=0, atol=1e-12, equal_nan=True)
    for b in range(2):
        for c in range(2):
            if not masks[b, c].any():
                continue
            count = int(found.num_parts[b, c])
            assert found.label_map[b, c].unique().tolist()[-count:] == list(range(1, count + 1))
            # Measured again by other code, from the label map alone.
            table = complexity_table(found.label_map[b, c], spatial_ndim=found.label_map.ndim - 2)
            areas = np.bincount(found.label_map[b, c].numpy().ravel())[1:]
            assert (np.diff(areas) <= 0).all()
            weight = np.ones(count) if objective == "sum" else areas / areas.sum()
            assert found.after[b, c].item() == pytest.approx(table["complexity"] @ weight, abs=1e-12)
            assert found.after[b, c] + 0.05 * (count - 1) <= found.before[b, c]
            if count > 1:
                assert found.after[b, c] + 0.05 * (count - 1) < found.before[b, c]
                assert all(ndimage.label(piece)[1] == 1 for piece in pieces(found.label_map[b, c]))


@pytest.mark.parametrize("candidates", ["openings", "watershed"])
@pytest.mark.parametrize("options", [{"estimator": "std", "low": 0.1}, {"bins": 32, "rho": 3.0}, {"tol": 1e-4}])
def test_the_options_of_the_measure_reach_the_parts(options: dict[str, Any], candidates: str) -> None:
    masks = random_batch(12, 4, (21, 34))[:, None]
    found = parts(masks, objective="mean", candidates=candidates, **options)
    assert found.measure == Measure(**options)
    torch.testing.assert_close(found.before, complexity(masks, **options), rtol=0, atol=1e-12, equal_nan=True)
    assert (found.num_parts > 1).any()
    for i in range(4):
        table = complexity_table(found.label_map[i, 0], properties=["area"], **options)
        expected = table["complexity"] @ (table["area"] / table["area"].sum())
        assert found.after[i, 0].item() == pytest.approx(expected, abs=1e-12)
        assert found.after[i, 0] <= found.before[i, 0]


@pytest.mark.parametrize("default", [torch.float16, torch.float64])
def test_the_default_dtype_does_not_matter(default: torch.dtype) -> None:
    shape = JOINED["meeting at a corner"]
    expected = parts(shape, spatial_ndim=2)
    before = torch.get_default_dtype()
    torch.set_default_dtype(default)
    try:
        found = parts(shape, spatial_ndim=2)
    finally:
        torch.set_default_dtype(before)
    assert torch.equal(found.label_map, expected.label_map)
    assert found.before.dtype == torch.float64
    assert found.before == expected.before


def test_random_shapes_do_get_simpler_without_a_penalty() -> None:
    masks = random_batch(9, 6, (24, 31))
    found = parts(masks[:, None])
    complex_ones = found.before > 0.1
    assert complex_ones.sum() >= 4
    assert (found.after[complex_ones] < 0.5 * found.before[complex_ones]).all()


def test_shapes_of_complexity_zero_stay_whole_even_if_they_are_several() -> None:
    masks = torch.zeros(4, 1, 20, 24)
    masks[0] = 1
    masks[1, 0, 3:9, 4:20] = 1
    masks[2, 0, :8, :8] = masks[2, 0, 8:16, 8:16] = 1  # two squares that touch at a corner
    masks[3, 0, 7, 9] = 1
    found = parts(masks)
    assert found.num_parts.tolist() == [[1]] * 4
    assert found.num_solves.tolist() == [[1]] * 4
    assert torch.equal(found.label_map, masks.long())
    assert found.after.abs().max() == 0.0


def test_components_of_unlike_size_are_parts() -> None:
    mask = torch.zeros(14, 20)
    mask[1:11, 1:11] = 1
    mask[5:9, 13:17] = 1
    found = parts(mask, spatial_ndim=2)
    assert (found.num_parts, found.after) == (2, 0.0)


@pytest.mark.parametrize("size", [(15, 22), (7, 8, 6)])
def test_flips_and_axis_swaps_move_the_parts(size: tuple[int, ...]) -> None:
    masks = torch.stack([*random_batch(70 + len(size), 3, size)])[:, None]
    for options in ({}, {"penalty_per_part": 0.03, "objective": "mean"}):
        found = parts(masks, **options).label_map
        for axis in range(2, masks.ndim):
            for move in (lambda x, a=axis: x.flip(a), lambda x, a=axis: x.transpose(2, a).flip(2)):
                moved = parts(move(masks), **options).label_map
                for one, other in zip(moved, move(found), strict=True):
                    assert same_partition(one, other)


def test_equal_appendages_are_cut_off_together() -> None:
    shape = JOINED["on every side"]
    found = parts(shape, spatial_ndim=2)
    assert found.num_parts == 5
    assert same_partition(found.label_map.mT, parts(shape.mT, spatial_ndim=2).label_map)


def test_it_is_deterministic_and_the_batch_does_not_matter() -> None:
    masks = random_batch(80, 4, (19, 26)).reshape(2, 2, 19, 26)
    masks[0, 1] = False
    found = parts(masks, low=0.1, high=0.8)
    assert torch.equal(found.label_map, parts(masks, low=0.1, high=0.8).label_map)
    for b in range(2):
        for c in range(2):
            alone = parts(masks[b, c].float(), low=0.1, high=0.8, spatial_ndim=2)
            for name in ("label_map", "before", "after", "num_parts", "num_solves"):
                one, of_batch = getattr(alone, name), getattr(found, name)[b, c]
                torch.testing.assert_close(one, of_batch, rtol=0, atol=0, equal_nan=True)


def test_no_mask_is_solved_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Candidates share most of their pieces."""
    solved: list[tuple[tuple[int, ...], bytes]] = []

    def profile(mask_at: Callable[[int], np.ndarray], count: int, measure: Measure) -> ComplexityProfile:
        solved.extend((mask_at(i).shape, mask_at(i).tobytes()) for i in range(count))
        return ragged_profile(mask_at, count, measure)

    monkeypatch.setattr(cut_tree, "ragged_profile", profile)
    monkeypatch.setattr(cut_tree, "FEW", 10**9)  # all of them solved as a whole
    found = parts(random_batch(81, 1, (24, 31))[0], spatial_ndim=2)
    assert len(set(solved)) == len(solved) > 20
    assert found.num_parts > 1
    assert found.num_solves > len(solved)  # those of the parts that were cut are more


@pytest.mark.parametrize("candidates", ["openings", "watershed"])
@pytest.mark.parametrize("options", [{}, {"estimator": "std", "low": 0.1}, {"bins": 32, "rho": 3.0}, {"levels": "rim"}])
def test_pieces_solved_from_their_part_have_the_complexity_of_a_whole_solve(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], candidates: str
) -> None:
    local: list[float] = []

    def after_flips(masks: list[np.ndarray], flips: list[list[np.ndarray]], measure: Measure) -> Any:
        [(before, after)] = complexities_after_flips(masks, flips, measure)
        for pixels, value in zip(flips[0], after, strict=True):
            left = masks[0].copy()
            left.reshape(-1)[pixels] ^= True
            assert value == pytest.approx(
                complexity(torch.from_numpy(left), spatial_ndim=2, **options).item(), abs=1e-9
            )
            local.append(value)
        return [(before, after)]

    monkeypatch.setattr(cut_tree, "complexities_after_flips", after_flips)
    shape = shapes.rooms(2, 3, side=18, wall=2, aperture=9)
    shape[::7, 4] = shape[3, ::5] = False
    found = parts(shape, candidates=candidates, objective="mean", spatial_ndim=2, **options)
    assert len(local) >= 3
    monkeypatch.setattr(cut_tree, "FEW", 10**9)
    whole = parts(shape, candidates=candidates, objective="mean", spatial_ndim=2, **options)
    assert torch.equal(found.label_map, whole.label_map)
    torch.testing.assert_close(found.after, whole.after, rtol=0, atol=1e-9)


def test_an_empty_shape_has_no_parts() -> None:
    found = parts(torch.zeros(2, 1, 5, 6))
    assert found.num_parts.tolist() == found.num_solves.tolist() == [[0], [0]]
    assert found.before.isnan().all()
    assert found.after.isnan().all()
    assert found.label_map.abs().sum() == 0
    assert parts(torch.zeros(0, 3, 5, 6)).after.shape == (0, 3)


def test_a_penalty_leaves_whole_what_saves_less() -> None:
    shape = JOINED["three widths"]
    whole = float(complexity(shape, spatial_ndim=2))
    for penalty, count in ((0.1, 4), (whole * 1.01, 1)):
        assert parts(shape, penalty_per_part=penalty, spatial_ndim=2).num_parts == count
    # Three cuts would save the penalty each, but one of them does better still.
    found = parts(shape, penalty_per_part=whole / 3 * 0.99, spatial_ndim=2)
    assert found.num_parts == 2
    assert float(found.after) + whole / 3 * 0.99 < 3 * whole / 3 * 0.99


def test_the_window_decides_which_cuts_count() -> None:
    """An appendage of width w on a body of width W acts up to scale w/W: the two narrow ones not above 1/2."""
    shape = JOINED["three widths"]
    found = parts(shape, low=0.5, spatial_ndim=2)
    assert found.after == 0.0
    assert found.num_parts == 2
    assert parts(shape, low=0.75, spatial_ndim=2).num_parts == 1


def test_watersheds_part_rooms_and_few_parts_lower_the_mean_but_not_the_sum() -> None:
    plan = shapes.rooms(1, 2, side=33, wall=1, aperture=7)
    by_mean = parts(plan, objective="mean", candidates="watershed", spatial_ndim=2)
    assert by_mean.num_parts == 2
    assert by_mean.after < by_mean.before
    assert (by_mean.label_map[:, :33] == by_mean.label_map[0, 0]).logical_or(~plan[:, :33]).all()


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"penalty_per_part": -0.1}, ValueError, r"penalty_per_part must be finite and 0 or more; got -0\.1\. Pass"),
        ({"penalty_per_part": "a"}, TypeError, r"penalty_per_part must be a number of 0 or more; got 'a'\. Pass"),
        ({"objective": "max"}, ValueError, r"objective must be one of 'sum', 'mean'; got 'max'\. Pass"),
        ({"objective": 1}, TypeError, r"objective must be one of 'sum', 'mean'; got 1\. Pass"),
        ({"bins": 0}, ValueError, r"bins must be an integer of 1 or more; got 0\. Pass"),
        ({"estimator": "mean"}, ValueError, r"estimator must be one of 'entropy', 'std'; got 'mean'\. Pass"),
        ({"rho": torch.ones(1)}, TypeError, r"rho must be None or one number here; got a tensor"),
        ({"windows": {"a": (0.0, 0.5)}}, TypeError, r"windows is not an option here"),
        ({"spatial_ndim": 0}, ValueError, r"spatial_ndim must be from 1 to 4; got 0\. Pass"),
        ({"candidates": "x"}, ValueError, r"candidates must be one of 'openings', 'watershed'; got 'x'\. Pass"),
        ({"low": 1.0}, ValueError, r"low and high must obey 0 <= low < high <= 1; got low=1\.0"),
        ({"tol": 0.0}, ValueError, r"tol must be finite and above 0; got 0\.0\. Pass"),
    ],
)
def test_bad_options_are_named(options: Mapping[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        parts(torch.ones(1, 1, 4, 5), **options)
    with pytest.raises(ValueError, match=r"mask must be \(B, C, \*spatial\).*got \(4, 5\)"):
        parts(torch.ones(4, 5))


def test_numba_is_not_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = JOINED["meeting at a corner"]
    expected = parts(shape, spatial_ndim=2)
    for name in ("torchlinf.kernels", "torchlinf.measure.levels"):
        monkeypatch.setattr(f"{name}.has_compiler", lambda: False)
    found = parts(shape, spatial_ndim=2)
    assert torch.equal(found.label_map, expected.label_map)
    assert found.after == 0.0
