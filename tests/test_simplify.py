"""The proximal step: what it lowers, what it costs, what it keeps."""

import itertools
import math
import sys
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

import torchlinf
from torchlinf import shapes
from torchlinf.kernels import has_compiler
from torchlinf.losses.descent import Topology
from torchlinf.losses.simplify import simplify

pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs numba")


WHOLE: dict[str, Any] = {"per": "mask", "keep_topology": False}


def blobs(count: int, *sides: int, seed: int = 0, smooth: float = 1.2) -> Tensor:
    """Grey random blobs, (count, *sides) in [0, 1], with holes and several parts as they come."""
    noise = np.random.default_rng(seed).standard_normal((count, *sides))
    noise = ndimage.gaussian_filter(noise, (0, *[smooth] * len(sides)))
    return torch.from_numpy(1 / (1 + np.exp(-4 * noise / noise.std())))


def log_odds(probability: Tensor) -> Tensor:
    return torch.logit(probability, eps=1e-12).abs().clamp(max=16)


def topology(mask: NDArray[np.bool_]) -> str:
    """The tree of the components of a 2-D mask and its outside, as a word that says how they lie in each other."""
    padded = np.pad(mask, 1)
    inside, count = ndimage.label(padded, np.ones((3, 3)))
    outside, _ = ndimage.label(~padded)
    label = np.where(padded, inside, outside + count)  # the outer one is count + 1
    beside: dict[int, set[int]] = {}
    for a, b in ((label[1:], label[:-1]), (label[:, 1:], label[:, :-1])):
        for i, j in zip(a.ravel().tolist(), b.ravel().tolist(), strict=True):
            if i != j:
                beside.setdefault(i, set()).add(j)
                beside.setdefault(j, set()).add(i)

    def word(node: int, parent: int) -> str:
        return "(" + "".join(sorted(word(child, node) for child in beside.get(node, ()) if child != parent)) + ")"

    return word(count + 1, 0)


@pytest.mark.parametrize(
    "options", [{}, {"low": 0.1, "high": 0.6, "bins": 64}, {"estimator": "std"}, {"levels": "rim"}]
)
def test_the_objective_falls_and_the_numbers_are_those_of_the_masks(options: dict[str, Any]) -> None:
    weight = 0.002 if "estimator" in options else 0.2
    probability = blobs(3, 25, 32)[:, None]
    found = simplify(probability, weight=weight, **WHOLE, **options)
    inside = probability > 0.5
    before, after = (torchlinf.complexity(mask, **options) for mask in (inside, found.mask))
    torch.testing.assert_close(found.before, before, rtol=0, atol=4e-9)
    torch.testing.assert_close(found.after, after, rtol=0, atol=4e-9)
    cost = (log_odds(probability) * (found.mask != inside)).flatten(2).sum(dim=2)
    torch.testing.assert_close(found.cost, cost, rtol=1e-4, atol=1e-4)
    gain = before - after - weight * cost / inside.flatten(2).sum(dim=2)
    assert bool((gain > 0).all())
    assert found.mask.dtype == torch.bool
    assert found.mask.shape == found.flip_number.shape == probability.shape
    assert torch.equal(found.flip_number.flatten(2).amax(dim=2), found.num_flips)
    assert not (found.mask != inside)[found.flip_number == 0].any()


def test_an_appendage_goes_if_it_is_cheap_and_stays_if_it_is_dear() -> None:
    shape = shapes.with_appendages((12, 15), [shapes.Appendage("right", 4, 3)], margin=3)
    body = shapes.with_appendages((12, 15), [], margin=3)
    worth = float(torchlinf.complexity(shape, spatial_ndim=2))
    area = int(shape.sum())
    breaking_even = worth * area / 12  # 12 pixels, of which each costs 1
    # Half of it: a little below breaking even, a part of the appendage that is worth more for its price goes alone.
    cheap = simplify(shape, weight=0.5 * breaking_even, spatial_ndim=2)
    assert float(cheap.after) == 0
    assert float(cheap.cost) == 12
    assert int(cheap.mask.sum()) == area - 12
    assert body.sum() == area - 12
    dear = simplify(shape, weight=100 * breaking_even, spatial_ndim=2)
    assert torch.equal(dear.mask, shape)
    assert int(dear.num_flips) == 0


def test_what_is_in_doubt_is_flipped_and_what_is_certain_is_not() -> None:
    shape = shapes.with_appendages((12, 15), [shapes.Appendage(side, 4, 3) for side in ("right", "left")], margin=4)
    columns = torch.arange(shape.shape[1]).expand_as(shape)
    right = shape & (columns >= 4 + 3 + 15)
    left = shape & (columns < 4 + 3)
    if int(left.sum()) != 12:  # no margin beyond the appendage
        left, right = shape & (columns < 4 + 0), shape & (columns >= 4 + 15)
    assert int(left.sum()) == int(right.sum()) == 12
    probability = torch.where(shape, 0.999, 0.001)
    probability[right] = 0.55
    found = simplify(probability, weight=10.0, spatial_ndim=2)
    assert not found.mask[right].any()
    assert bool(found.mask[left].all())


@pytest.mark.parametrize("sides", [(40,), (17, 22), (7, 8, 9)])
def test_mirror_images_become_mirror_images(sides: tuple[int, ...]) -> None:
    probability = blobs(2, *sides, seed=3)
    symmetric = (probability + probability.flip(1)) / 2
    for p in (probability, symmetric, (symmetric > 0.5)):
        how: dict[str, Any] = WHOLE | {"keep_topology": len(sides) < 3 and not p.is_floating_point()}
        found = simplify(p, weight=1.0, **how, spatial_ndim=len(sides))
        for dims in itertools.chain.from_iterable(
            itertools.combinations(range(1, p.ndim), r) for r in range(1, p.ndim)
        ):
            mirrored = simplify(p.flip(dims), weight=1.0, **how, spatial_ndim=len(sides))
            assert torch.equal(mirrored.mask.flip(dims), found.mask)
            assert torch.equal(mirrored.flip_number.flip(dims), found.flip_number)
            assert torch.equal(mirrored.after, found.after)


def test_what_else_is_in_the_batch_does_not_matter() -> None:
    probability = blobs(4, 21, 26, seed=5)
    probability[2] = 0.0
    together = simplify(probability, weight=2.0, **WHOLE, spatial_ndim=2)
    for n in range(4):
        alone = simplify(probability[n], weight=2.0, **WHOLE, spatial_ndim=2)
        assert torch.equal(alone.mask, together.mask[n])
        assert torch.equal(alone.cost, together.cost[n])
    assert together.before.isnan().tolist() == together.after.isnan().tolist() == [False, False, True, False]
    assert not together.mask[2].any()
    assert together.num_flips.shape == (4,)


def test_a_box_and_limits_are_left_alone() -> None:
    box = torch.zeros(20, 24, dtype=torch.bool)
    box[3:15, 4:20] = True
    assert torch.equal(simplify(box, spatial_ndim=2).mask, box)
    probability = blobs(1, 30, 34, seed=7)[0]
    area = int((probability > 0.5).sum())
    free = simplify(probability, weight=0.5, **WHOLE, spatial_ndim=2)
    changed = int((free.mask != (probability > 0.5)).sum())
    assert int(free.num_flips) > 2
    assert changed > 0.1 * area
    few = simplify(probability, weight=0.5, max_flips=2, **WHOLE, spatial_ndim=2)
    assert int(few.num_flips) == 2
    little = simplify(probability, weight=0.5, max_change=0.05, **WHOLE, spatial_ndim=2)
    assert 0 < int((little.mask != (probability > 0.5)).sum()) <= 0.05 * area


def slits(before: NDArray[np.bool_], after: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Rows and pixels of the new slits and spikes: connected runs of new pixels, both of whose ends meet old ones."""
    found = []
    for old, new in ((before, after), (~before, ~after), (before.T, after.T), (~before.T, ~after.T)):
        changed, gone = np.pad(old & ~new, 1), np.pad(~new, 1, constant_values=True)
        runs = np.zeros_like(changed)
        for i, line in enumerate(gone):
            label, count = ndimage.label(line)
            for k in range(1, count + 1):
                runs[i, label == k] = changed[i, label == k].all()
        label, count = ndimage.label(runs, np.ones((3, 3)))
        found += [(int((label == k).any(axis=1).sum()), int((label == k).sum())) for k in range(1, count + 1)]
    return [(rows, pixels) for rows, pixels in found if rows**2 > 2 * pixels]


def check_topology(count: int, seed: int) -> None:
    probability = blobs(count, 23, 28, seed=seed, smooth=1.0)
    found = simplify(probability, weight=0.1, keep_topology=True, spatial_ndim=2)
    inside = (probability > 0.5).numpy()
    assert int((found.num_flips > 0).sum()) > 0.6 * count
    for before, after in zip(inside, found.mask.numpy(), strict=True):
        assert topology(after) == topology(before)
        assert not slits(before, after)
    assert float(found.after.mean()) < float(found.before.mean())


def test_topology_is_kept_without_slits() -> None:
    check_topology(12, 0)


@pytest.mark.slow
def test_topology_is_kept_without_slits_on_a_thousand_shapes() -> None:
    check_topology(1000, 1)


def test_no_slit_is_cut_and_no_spike_drawn() -> None:
    wall = np.zeros((12, 14), bool)
    wall[4:10, 1:11] = True
    cut, notched, spiked, bumpy = wall.copy(), wall.copy(), wall.copy(), wall.copy()
    cut[4:7, 5], notched[4:6, 4:6] = False, False
    spiked[7, 11:14], bumpy[7:9, 11:14] = True, True
    assert slits(wall, cut) == slits(wall, spiked) == [(3, 3)]
    assert slits(wall, notched) == slits(wall, bumpy) == slits(cut, wall) == slits(spiked, wall) == []
    count = 60
    probability = blobs(count, 33, 38, seed=3, smooth=2.0)
    inside = (probability > 0.5).numpy()
    for weight in (0.1, 3.0):
        found = simplify(probability, weight=weight, spatial_ndim=2)
        assert int((found.num_flips > 0).sum()) > 0.6 * count
        assert not any(slits(before, after) for before, after in zip(inside, found.mask.numpy(), strict=True))


def test_the_test_of_topology_agrees_with_the_tree() -> None:
    assert topology(np.ones((3, 3), bool)) == "(())"
    assert topology(np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], bool)) == "((()))"
    rng = np.random.default_rng(0)
    kept = 0
    for seed in range(60):
        mask = (blobs(1, 11, 14, seed=seed)[0] > 0.5).numpy()
        chosen = np.zeros_like(mask)
        a, b = rng.integers(0, 9), rng.integers(0, 12)
        chosen[a : a + rng.integers(1, 4), b : b + rng.integers(1, 4)] = True
        for side in (mask, ~mask):
            pixels = np.flatnonzero(chosen & side)
            after = mask ^ (chosen & side)
            if len(pixels) and Topology(mask).keeps(pixels):
                kept += 1
                assert topology(after) == topology(mask)
            elif len(pixels) == 1:
                # A single pixel that is refused joins, splits, makes or ends something.
                labels = [ndimage.label(m, np.ones((3, 3)))[1] for m in (mask, after)]
                holes = [ndimage.label(np.pad(~m, 1, constant_values=True))[1] for m in (mask, after)]
                assert labels[0] != labels[1] or holes[0] != holes[1]
    assert kept > 30


def test_in_one_dimension_pieces_stay() -> None:
    line = torch.tensor([0, 1, 1, 1, 1, 0, 1, 0, 0, 1, 1, 0, 1, 1, 1, 1, 1, 1, 0, 0]) > 0
    found = simplify(line, weight=0.1, keep_topology=True, spatial_ndim=1)
    assert ndimage.label(found.mask.numpy())[1] == 4
    assert float(found.after) <= float(found.before)


def test_objects_are_simplified_alone_and_never_touch() -> None:
    probability = blobs(1, 40, 52, seed=2, smooth=2.0)[0]
    inside = (probability > 0.5).numpy()
    found = simplify(probability, weight=1.0, keep_topology=True, per="object", spatial_ndim=2)
    labels, count = ndimage.label(inside, np.ones((3, 3)))
    assert count > 3
    after, still = ndimage.label(found.mask.numpy(), np.ones((3, 3)))
    assert still == count
    assert int(found.num_flips) > 0
    values = [float(torchlinf.complexity(torch.from_numpy(labels == i), spatial_ndim=2)) for i in range(1, count + 1)]
    assert float(found.before) == pytest.approx(np.mean(values))
    values = [float(torchlinf.complexity(torch.from_numpy(after == i), spatial_ndim=2)) for i in range(1, count + 1)]
    assert float(found.after) == pytest.approx(np.mean(values))


def test_hundreds_of_objects_stay_apart() -> None:
    probability = blobs(1, 96, 120, seed=9, smooth=1.0)[0]
    labels, count = ndimage.label((probability > 0.9).numpy(), np.ones((3, 3)))
    assert count > 150
    found = simplify(probability, threshold=0.9, weight=1.0, tries=4, per="object", spatial_ndim=2)
    after, _ = ndimage.label(found.mask.numpy(), np.ones((3, 3)))
    assert int(found.num_flips) > 10
    assert float(found.after) < float(found.before)
    for number in range(1, after.max() + 1):  # what is connected is of one object, or of none any more
        assert len(set(labels[after == number]) - {0}) <= 1


@pytest.mark.parametrize("per", ["mask", "object"])
def test_nothing_is_gained_where_it_is_not_allowed(per: Any) -> None:
    generator = torch.Generator().manual_seed(2)
    probability = blobs(3, 22, 27, seed=12, smooth=1.5)[:, None]
    allowed = torch.rand(probability.shape, generator=generator) > 0.2
    how: dict[str, Any] = {"weight": 0.2, "tries": 8, "per": per, "keep_topology": False}
    inside = probability > 0.5
    free, bound = simplify(probability, **how), simplify(probability, allowed=allowed, **how)
    assert bool((free.mask & ~inside & ~allowed).any())
    assert not (bound.mask & ~inside & ~allowed).any()
    assert bool((bound.mask & ~inside).any())
    assert bool((bound.after < bound.before).all())
    same = simplify(probability, allowed=torch.ones_like(allowed), **how)
    assert torch.equal(same.flip_number, free.flip_number)


def test_arguments_are_checked() -> None:
    mask = torch.ones(6, 7, dtype=torch.bool)
    with pytest.raises(ValueError, match="keep_topology"):
        simplify(torch.ones(4, 5, 6, dtype=torch.bool), spatial_ndim=3)
    with pytest.raises(ValueError, match="allowed must have the prediction's shape"):
        simplify(mask, allowed=torch.ones(7, 6, dtype=torch.bool), spatial_ndim=2)
    with pytest.raises(TypeError, match="allowed must be a bool tensor"):
        simplify(mask, allowed=torch.ones(6, 7), spatial_ndim=2)
    with pytest.raises(ValueError, match="probabilities"):
        simplify(mask * 3.0, spatial_ndim=2)
    with pytest.raises(ValueError, match="probabilities"):
        simplify(mask * math.nan, spatial_ndim=2)
    for wrong in (
        {"weight": -1.0},
        {"max_change": 0.0},
        {"max_change": 1.5},
        {"per": "part"},
        {"max_flips": 0},
        {"tries": 0},
    ):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            simplify(mask, spatial_ndim=2, **wrong)
    with pytest.raises(TypeError, match="number"):
        simplify(mask, spatial_ndim=2, rho=torch.ones(1))


def test_it_says_that_it_needs_the_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["torchlinf.losses.simplify"], "has_compiler", lambda: False)
    with pytest.raises(ImportError, match="numba"):
        simplify(torch.ones(6, 7, dtype=torch.bool), spatial_ndim=2)
