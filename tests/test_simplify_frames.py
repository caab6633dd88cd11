"""Shapes that are simplified in frames of their own, and drawn back onto their pixels."""

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import torchlinf
from tests.test_simplify import blobs, topology
from torchlinf.kernels import has_compiler

pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs numba")


def slanted(degrees: float, kind: str, height: float = 30, width: float = 50) -> tuple[Tensor, Tensor, Tensor]:
    """A rectangle with a notch or an appendage of 6 x 8 pixels, where that is, and the rectangle alone."""
    rows, columns = np.indices((84, 92))
    y, x = rows - 41.63, columns - 45.79
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    along, across = cos * x + sin * y, cos * y - sin * x
    clean = (abs(along) < width / 2) & (abs(across) < height / 2)
    beside = (along > 5) & (along < 13)
    if kind == "notch":
        different = clean & beside & (across > height / 2 - 6)
    else:
        different = ~clean & beside & (across > 0) & (across < height / 2 + 6)
    return torch.from_numpy(clean ^ different), torch.from_numpy(different), torch.from_numpy(clean)


@pytest.mark.parametrize("degrees", [20, 33])
@pytest.mark.parametrize("kind", ["notch", "appendage"])
def test_a_slanted_rectangle_becomes_clean_and_nothing_else_changes(kind: str, degrees: float) -> None:
    shape, different, clean = slanted(degrees, kind)
    found = torchlinf.simplify(shape, weight=1.0, tries=8, orientation="own", keep_topology=False, spatial_ndim=2)
    assert float(found.before) > 0.15
    assert float(found.after) == 0
    assert torch.equal(found.mask, clean)
    assert torch.equal(found.flip_number > 0, different)
    assert float(found.cost) == int(different.sum())
    assert int(found.num_flips) >= 1


def test_a_known_angle_and_a_grid_that_is_not_turned() -> None:
    shape, different, clean = slanted(20, "notch")
    # With the topology kept the search ends elsewhere: at a box without the part beside the notch.
    found = torchlinf.simplify(shape, weight=1.0, tries=8, orientation=20.0, keep_topology=False, spatial_ndim=2)
    assert int((found.mask ^ clean).sum()) <= 0.1 * int(different.sum())
    assert float(found.after) < 0.1 * float(found.before)
    probability = blobs(2, 21, 26, seed=4)
    plain = torchlinf.simplify(probability, weight=1.0, tries=8, spatial_ndim=2)
    same = torchlinf.simplify(probability, weight=1.0, tries=8, orientation=0.0, spatial_ndim=2)
    assert int(plain.num_flips.max()) > 0
    for name in ("mask", "flip_number", "num_flips", "before", "after", "cost"):
        assert torch.equal(getattr(same, name), getattr(plain, name))


@pytest.mark.parametrize(
    "options", [{"orientation": "own"}, {"orientation": "least", "rotations": 2}, {"orientation": 30.0}]
)
@pytest.mark.parametrize("per", ["mask", "object"])
def test_the_objective_falls_in_the_measure_of_the_masks(per: Any, options: dict[str, Any]) -> None:
    probability = blobs(3, 22, 27, seed=6, smooth=1.5)
    inside = probability > 0.5
    keep = per == "object"  # so that objects stay objects
    found = torchlinf.simplify(probability, weight=0.2, tries=8, per=per, keep_topology=keep, spatial_ndim=2, **options)
    before, after = (torchlinf.complexity(m, per=per, spatial_ndim=2, **options) for m in (inside, found.mask))
    torch.testing.assert_close(found.before, before, rtol=0, atol=1e-8)
    torch.testing.assert_close(found.after, after, rtol=0, atol=1e-8)
    assert int(found.num_flips.sum()) > 0
    changed = found.mask != inside
    assert torch.equal(changed, changed & (found.flip_number > 0))
    odds = torch.logit(probability, eps=1e-12).abs().clamp(max=16)
    torch.testing.assert_close(found.cost, (odds * changed).flatten(1).sum(dim=1), rtol=1e-4, atol=1e-4)
    gain = before - after
    if per == "mask":
        gain = gain - 0.2 * found.cost / inside.flatten(1).sum(dim=1)
    assert bool((gain[found.num_flips > 0] > 0).all())
    assert torch.equal(found.mask[found.num_flips == 0], inside[found.num_flips == 0])


def check_topology(count: int, per: Any) -> None:
    probability = blobs(count, 20, 25, seed=8, smooth=1.2)
    found = torchlinf.simplify(
        probability, weight=0.1, tries=8, keep_topology=True, per=per, orientation="own", spatial_ndim=2
    )
    inside = (probability > 0.5).numpy()
    assert int((found.num_flips > 0).sum()) > 0.5 * count
    for before, after in zip(inside, found.mask.numpy(), strict=True):
        assert topology(after) == topology(before)


def test_topology_is_kept_on_the_grid() -> None:
    check_topology(6, "object")


@pytest.mark.slow
@pytest.mark.parametrize("per", ["mask", "object"])
def test_topology_is_kept_on_the_grid_of_300_shapes(per: Any) -> None:
    check_topology(300, per)


def test_volumes_are_turned_by_a_matrix() -> None:
    cos, sin = np.cos(np.radians(25)), np.sin(np.radians(25))
    rotation = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    place = np.indices((22, 30, 32)).reshape(3, -1) - np.array([[10.5], [14.6], [15.3]])
    z, y, x = rotation @ place
    clean = (abs(z) < 6) & (abs(y) < 8) & (abs(x) < 10)
    dented = clean & ~((x > 7) & (abs(y) < 3) & (abs(z) < 3))
    masks = [torch.from_numpy(m.reshape(22, 30, 32)) for m in (dented, clean)]
    found = torchlinf.simplify(masks[0], weight=1.0, tries=8, orientation=rotation, keep_topology=False, spatial_ndim=3)
    assert int((found.mask ^ masks[1]).sum()) < 0.5 * int((masks[0] ^ masks[1]).sum())
    assert float(found.after) < float(found.before)


def test_one_frame_a_shape_is_needed() -> None:
    with pytest.raises(ValueError, match="orientation must name one frame"):
        torchlinf.simplify(torch.ones(5, 6, dtype=torch.bool), orientation="mean", spatial_ndim=2)
    with pytest.raises(ValueError, match="matrix"):
        torchlinf.simplify(
            torch.ones(4, 5, 6, dtype=torch.bool), orientation="own", keep_topology=False, spatial_ndim=3
        )
