"""The field after a flip, solved where the flip reaches: distance, certificate and undoing, against the whole."""

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy import ndimage

import torchlinf
from torchlinf.field import solve_locally, solve_shape
from torchlinf.kernels import has_compiler

pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs numba")


def checked() -> None:
    """Nothing ends the work early."""


@pytest.mark.parametrize("sides", [(60,), (24, 33), (10, 9, 12), (6, 7, 5, 6)])
@pytest.mark.parametrize("rho", [None, 4.0])
def test_distance_field_and_certificate_hold_everywhere(sides: tuple[int, ...], rho: float | None) -> None:
    rng = np.random.default_rng(len(sides))
    mask: NDArray[np.bool_] = ndimage.gaussian_filter(rng.standard_normal(sides), 1.2) > -0.01
    solved = solve_shape(mask, rho, 1e-9, checked)
    field = solve_locally(solved, rho, 1e-9)
    shape, within = solved.shape.grid.shape, (slice(1, -1),) * mask.ndim
    inner = np.zeros(shape, bool)
    inner[within] = True
    places = np.flatnonzero(inner).astype(np.int32)
    v, distance = field.v.copy(), field.distance.copy()
    solved_flips = 0
    for number in range(30):
        some = np.zeros_like(mask)
        some[tuple(slice(a, a + int(rng.integers(1, 4))) for a in (int(rng.integers(0, size)) for size in sides))] = (
            True
        )
        if number % 3 < 2:
            some &= mask if number % 3 else ~mask
        after = mask ^ some
        if not some.any() or not after.any():
            continue
        change = field.apply(places[np.flatnonzero(some)], checked)
        # Chessboard distance by its definition: the block of radius d - 1 is the largest that lies inside.
        padded = np.pad(after, 1)
        exact = ndimage.distance_transform_cdt(padded, "chessboard")
        assert np.array_equal(field.distance.reshape(shape), exact)
        assert change.radius == exact.max()
        if change.solved:
            solved_flips += 1
            found = field.v.reshape(shape)
            length = rho or float(change.radius)
            above = ndimage.maximum_filter(found, 3, mode="constant")
            below = ndimage.minimum_filter(found, 3, mode="constant")
            residual = (above + below - (2 + length**-2) * found + 1)[padded]
            # The residual of the whole, which is a bound of the relative error, up to the rounding of its terms.
            assert np.abs(residual).max() <= change.bound + 16 * 2.0**-52 * (1 + 2 * found.max())
            whole = torchlinf.solve_field(torch.from_numpy(after), rho=rho, spatial_ndim=mask.ndim).value.numpy()
            np.testing.assert_allclose(found[within][after], whole[after], rtol=2e-9)
            assert not found[~padded].any()
        field.undo()
        assert np.array_equal(field.v, v)
        assert np.array_equal(field.distance, distance)
    assert solved_flips > 3


def test_what_is_kept_is_where_the_next_flip_begins() -> None:
    mask = np.zeros((30, 41), bool)
    mask[4:26, 5:36] = True
    mask[2:4, 12:17] = True
    solved = solve_shape(mask, None, 1e-9, checked)
    field = solve_locally(solved, None, 1e-9)
    index = np.arange(32 * 43).reshape(32, 43)[1:-1, 1:-1].astype(np.int32)
    for box in ((slice(2, 4), slice(12, 17)), (slice(26, 28), slice(20, 23)), (slice(10, 12), slice(36, 38))):
        mask[box] ^= True
        assert field.apply(index[box].ravel(), checked).solved
        field.keep()
        expected = torchlinf.solve_field(torch.from_numpy(mask), spatial_ndim=2).value.numpy()
        found = field.v.reshape(32, 43)[1:-1, 1:-1].copy()
        np.testing.assert_allclose(found[mask], expected[mask], rtol=2e-9)
        field.undo()  # of nothing
        assert np.array_equal(field.v.reshape(32, 43)[1:-1, 1:-1], found)


def test_a_cycle_that_cannot_be_eliminated_leaves_the_flip_to_a_solve_of_the_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from torchlinf.kernels import local_field, local_flips

    def left_over(v: Any, starts: Any, ends: Any, *rest: Any) -> None:
        """What `solve_runs` leaves where elimination has no room: no flip was found that it has none for."""
        owner, search = rest[4], rest[-1]
        v[starts] *= -1
        owner[starts] = 1
        search[:] = 1

    advance: Any = local_field.advance
    mask = np.zeros((30, 41), bool)
    mask[4:26, 5:36] = True
    mask[2:4, 12:17] = True
    field = solve_locally(solve_shape(mask, None, 1e-9, checked), None, 1e-9)
    index = np.arange(32 * 43).reshape(32, 43)[1:-1, 1:-1].astype(np.int32)
    box = (slice(2, 4), slice(12, 17))
    v, distance = field.v.copy(), field.distance.copy()
    after = mask.copy()
    after[box] ^= True
    expected = torchlinf.solve_field(torch.from_numpy(after), spatial_ndim=2).value.numpy()
    with monkeypatch.context() as patched:
        patched.setattr(local_field, "solve_runs", left_over)
        patched.setattr(local_flips, "solve", lambda d, f: advance.py_func(f.v, d.distance, d.block, *f[1:]))
        assert not field.apply(index[box].ravel(), checked).solved
    assert not field.field.owner.any()
    assert not field.field.search.any()
    whole = field.whole(1e-9, checked)
    np.testing.assert_allclose(whole.v.reshape(32, 43)[1:-1, 1:-1], expected, rtol=2e-9)
    field.undo()
    assert np.array_equal(field.v, v)
    assert np.array_equal(field.distance, distance)
    assert field.apply(index[box].ravel(), checked).solved
    np.testing.assert_allclose(field.v.reshape(32, 43)[1:-1, 1:-1], expected, rtol=2e-9)
