"""Deformations of whole shapes, and what they correct."""

import itertools

import numpy as np
import pytest
import torch
from torch import Tensor

import torchlinf
from torchlinf import shapes
from torchlinf.losses import ShapeComplexityLoss
from torchlinf.losses.deformations import correct, deformed
from torchlinf.losses.gradient import finite_difference_gradient
from torchlinf.measure import Measure

SCALE, STRETCH, SHEAR, ROTATION, FOURTH = range(5)
BACK, FORTH = 0, 3


def rectangle(height: int = 15, width: int = 25) -> np.ndarray:
    """In the middle of 41 x 45."""
    shape = np.zeros((41, 45), bool)
    shape[20 - height // 2 : 21 + height // 2, 22 - width // 2 : 23 + width // 2] = True
    return shape


def sides(mask: np.ndarray) -> tuple[int, int]:
    return int(mask.any(axis=1).sum()), int(mask.any(axis=0).sum())


def test_scale_and_stretch_of_a_rectangle() -> None:
    lines = deformed(rectangle())
    assert lines.shape == (5, 4, 41, 45)
    grown, shrunk = np.exp(3 / 12.5), np.exp(-3 / 12.5)  # the ends of the longest side move by about 3 pixels
    for mode, step, factors in (
        (SCALE, FORTH, (grown, grown)),
        (SCALE, BACK, (shrunk, shrunk)),
        (STRETCH, FORTH, (grown, shrunk)),
        (STRETCH, BACK, (shrunk, grown)),
    ):
        found = sides(lines[mode, step])
        assert found == pytest.approx((15 * factors[0], 25 * factors[1]), abs=1.5)
        assert lines[mode, step].sum() == found[0] * found[1]  # still a box


def test_rotation_and_shear_of_a_rectangle() -> None:
    lines = deformed(rectangle())
    rows, columns = np.indices((41, 45)) - np.array([20, 22]).reshape(2, 1, 1)
    angle = 3 / 12.5
    across, down = np.cos(angle) * columns - np.sin(angle) * rows, np.sin(angle) * columns + np.cos(angle) * rows
    turned = (abs(across) <= 12.5) & (abs(down) <= 7.5)
    missed = [int((lines[ROTATION, step] ^ turned).sum()) for step in (BACK, FORTH)]
    assert min(missed) <= 12
    assert max(missed) > 100  # it turns one way or the other
    for mode in (ROTATION, SHEAR):
        assert np.array_equal(lines[mode, FORTH], lines[mode, BACK][::-1])  # the mirror image
        assert lines[mode, FORTH].sum() == pytest.approx(375, abs=12)


def test_the_fourth_order_leads_from_a_diamond_towards_a_square() -> None:
    rows, columns = np.indices((41, 45)) - np.array([20, 22]).reshape(2, 1, 1)
    disc = rows**2 + columns**2 <= 14**2
    lines = deformed(disc)
    axis = [int(mask[20, 22:].sum()) for mask in lines[FOURTH]]
    diagonal = [int(mask[np.arange(20, 41), np.arange(22, 43)].sum()) for mask in lines[FOURTH]]
    assert axis == sorted(axis, reverse=True)
    assert diagonal == sorted(diagonal)
    assert axis[BACK] - axis[FORTH] in (5, 6, 7)  # 3 pixels each way
    assert diagonal[FORTH] - diagonal[BACK] in (4, 5)  # the same on a diagonal, whose pixels are sqrt 2 apart


@pytest.mark.parametrize(("size", "number"), [((30,), 1), ((20, 23), 5), ((12, 13, 14), 11), ((6, 7, 6, 7), 20)])
def test_how_many(size: tuple[int, ...], number: int) -> None:
    shape = np.zeros(size, bool)
    shape[tuple(slice(2, -2) for _ in size)] = True
    assert len(deformed(shape)) <= number
    assert deformed(np.zeros(size, bool)).shape == (0, 4, *size)
    one = np.zeros(size, bool)
    one[tuple(side // 2 for side in size)] = True
    for mask in deformed(one).reshape(-1, *size):
        assert mask.any()
    full = deformed(np.ones(size, bool))
    assert full.reshape(len(full), 4, -1).sum(axis=2).min() >= np.ones(size).sum() / 2


def test_the_slope_along_a_steady_deformation_is_its_difference() -> None:
    generator = np.random.default_rng(0)
    lines = generator.random((3, 4, 6, 7)) < 0.5
    values = np.array([[1.0, 1.2, 2.0, 2.5], [3.0, 2.5, 1.0, 1.1], [4.0, 3.0, 3.0, 4.5]])  # the last goes down and up
    gradient = generator.normal(size=(6, 7))
    corrected = correct(gradient, 1.5, lines, values)
    maps = lines[:, 2:].sum(axis=1).astype(float) - lines[:, :2].sum(axis=1)
    slopes = (maps * corrected).sum(axis=(1, 2))
    assert slopes[:2] == pytest.approx([2.0 + 2.5 - 1.0 - 1.2, 1.0 + 1.1 - 3.0 - 2.5])
    assert abs(slopes[2] - 0.5) > 1e-3
    change = (corrected - gradient).ravel()  # the least that does it: a combination of the two maps
    assert np.linalg.matrix_rank(np.stack([*maps[:2].reshape(2, -1), change]), tol=1e-9) == 2


def test_no_correction_without_a_steady_deformation() -> None:
    gradient = np.arange(12.0).reshape(3, 4)
    assert np.array_equal(correct(gradient, 1.0, np.empty((0, 4, 3, 4), bool), np.empty((0, 4))), gradient)
    lines = np.ones((1, 4, 3, 4), bool)
    lines[0, :2, 0] = False
    assert np.array_equal(correct(gradient, 0.0, lines, np.array([[2.0, 1.0, 1.0, 2.0]])), gradient)
    assert not np.array_equal(correct(gradient, 1.0, lines, np.array([[0.0, 1.0, 1.0, 2.0]])), gradient)


def blobs(*size: int) -> Tensor:
    """Two ellipsoids of different axes in [0, 1], off the middle."""
    at = torch.meshgrid(*[torch.arange(side) - 0.45 * side for side in size], indexing="ij")
    radii = [[0.3 + 0.05 * ((i + k) % 3) for i in range(len(size))] for k in range(2)]
    r = torch.stack([sum((x / (a * s)) ** 2 for x, a, s in zip(at, row, size, strict=True)) for row in radii])
    return (1.5 - r).clamp(0, 1).double()


@pytest.mark.parametrize("size", [(25,), (25, 28), (13, 14, 16)])
def test_the_corrected_gradient_commutes_with_flips_and_axis_swaps(size: tuple[int, ...]) -> None:
    probability = blobs(*size)
    options = {"threshold": 0.5, "max_flips": 4, "deformations": True, "measure": Measure()}
    _, gradient = finite_difference_gradient(probability, **options)
    if len(size) > 1:
        plain = finite_difference_gradient(probability, **{**options, "deformations": False})[1]
        assert not torch.allclose(gradient, plain)
    dims = range(1, len(size) + 1)
    for flips in itertools.chain.from_iterable(itertools.combinations(dims, r) for r in dims):
        mirrored = finite_difference_gradient(probability.flip(flips), **options)[1]
        torch.testing.assert_close(mirrored.flip(flips), gradient)
    swapped = finite_difference_gradient(probability.transpose(1, -1), **options)[1]
    torch.testing.assert_close(swapped.transpose(1, -1), gradient)


def test_with_deformations_rounding_the_corners_of_a_superellipse_costs() -> None:
    def placed(exponent: float) -> Tensor:
        return torch.nn.functional.pad(shapes.superellipse(20, exponent), (4, 4, 4, 4))

    rounder, middle, squarer = placed(1.5), placed(2.0), placed(3.5)
    difference = torchlinf.complexity(torch.stack([rounder, squarer]), spatial_ndim=2).diff().item()
    assert difference < -0.1
    slopes = []
    for deformations in (False, True):
        leaf = middle.double()[None, None].requires_grad_()
        ShapeComplexityLoss(deformations=deformations)(leaf).backward()
        assert leaf.grad is not None
        slopes.append((leaf.grad[0, 0] * (squarer.double() - rounder.double())).sum().item())
    assert slopes[1] < min(0.0, slopes[0])


def test_empty_full_and_single_pixels() -> None:
    probability = torch.zeros(1, 3, 9, 12)
    probability[0, 1] = 1
    probability[0, 2, 4, 5] = 1
    leaf = probability.requires_grad_()
    value = ShapeComplexityLoss(deformations=True, reduction="none")(leaf)
    value.sum().backward()
    assert leaf.grad is not None
    assert bool(leaf.grad.isfinite().all())
    assert not leaf.grad[0, 0].any()
    torch.testing.assert_close(value, ShapeComplexityLoss(reduction="none")(probability))
