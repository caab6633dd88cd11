"""The compiled CPU method against the torch path, on shapes that exercise chains, components and coarse grids."""

import numpy as np
import pytest
import torch
from scipy import ndimage

from torchlinf import Status, chessboard_distance, complexity_profile, shapes, solve_field
from torchlinf.field import policy_iteration
from torchlinf.kernels import chains, grid, policy_system, strong_components
from torchlinf.kernels.bicgstab import bicgstab
from torchlinf.kernels.distance import chessboard_of

SIDES = {1: (37,), 2: (17, 26), 3: (7, 10, 8), 4: (4, 6, 5, 5)}


def random_masks(ndim: int, count: int, seed: int) -> torch.Tensor:
    """Blobs with holes, several components and pixels on the border, ``(count, *spatial)``."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(count, *SIDES[ndim]))
    smooth = [ndimage.gaussian_filter(one, rng.uniform(0.3, 2.0)) for one in noise]
    return torch.from_numpy(np.stack([one > rng.normal() * one.std() for one in smooth]))


@pytest.mark.parametrize("ndim", [1, 2, 3, 4])
@pytest.mark.parametrize("rho", [None, 0.5, 7.0, 1e4])
@pytest.mark.parametrize("large", [policy_iteration.LARGE, 1])
def test_agrees_with_the_torch_path(ndim: int, rho: float | None, large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """By sweeps of the whole shape, and of active tiles alone."""
    monkeypatch.setattr(policy_iteration, "LARGE", large)
    masks = random_masks(ndim, 12, seed=ndim)
    found = solve_field(masks, rho=rho, method="compiled", spatial_ndim=ndim)
    reference = solve_field(masks, rho=rho, tol=1e-11, method="accelerated", spatial_ndim=ndim)
    torch.testing.assert_close(found.value, reference.value, rtol=2e-9, atol=0)
    assert (found.error_bound <= 1e-9).all()


def test_certificate_is_true_and_not_empty() -> None:
    mask = shapes.disc(40)
    rough = solve_field(mask, max_sweeps=8, throw=False, method="compiled", spatial_ndim=2)
    exact = solve_field(mask, tol=1e-11, method="compiled", spatial_ndim=2)
    error = ((rough.value - exact.value).abs() / exact.value)[mask].max()
    assert 1e-11 < error <= rough.error_bound + 1e-11


def test_boxes_need_no_sweep_but_the_certificate() -> None:
    solution = solve_field(shapes.box(31, 64), method="compiled", spatial_ndim=2)
    assert (solution.num_sweeps, solution.num_solves) == (1, 0)


def test_batch_equals_one_by_one_to_the_bit() -> None:
    masks = random_masks(2, 9, seed=5)
    batch = solve_field(masks, method="compiled", spatial_ndim=2)
    for i, mask in enumerate(masks):
        alone = solve_field(mask, method="compiled", spatial_ndim=2)
        assert torch.equal(alone.value, batch.value[i])
        assert alone.num_sweeps == batch.num_sweeps[i]


def test_position_in_a_larger_frame_does_not_matter() -> None:
    mask = random_masks(2, 1, seed=3)[0]
    framed = torch.nn.functional.pad(mask, (5, 11, 2, 40))
    alone = solve_field(mask, method="compiled", spatial_ndim=2).value
    assert torch.equal(solve_field(framed, method="compiled", spatial_ndim=2).value[2:19, 5:31], alone)


def test_threads_do_not_change_the_result() -> None:
    masks = random_masks(2, 8, seed=8)
    threads = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        one = solve_field(masks, method="compiled", spatial_ndim=2).value
        torch.set_num_threads(4)
        assert torch.equal(solve_field(masks, method="compiled", spatial_ndim=2).value, one)
    finally:
        torch.set_num_threads(threads)


def test_max_sweeps_is_obeyed_and_reported() -> None:
    solution = solve_field(shapes.disc(40), method="compiled", max_sweeps=8, throw=False, spatial_ndim=2)
    assert solution.status == Status.MAX_SWEEPS
    assert solution.num_sweeps <= 8
    assert solution.error_bound > 1e-9


def test_work_stays_below_two_sweeps_per_pixel_of_radius() -> None:
    solution = solve_field(shapes.disc(256), method="compiled", spatial_ndim=2)
    radius = int(chessboard_distance(shapes.disc(256), spatial_ndim=2).max())
    assert solution.num_sweeps <= 2 * radius  # plain iteration from zero takes some 17 radius^2
    assert solution.num_solves <= 8


def test_what_counts_as_equal_does_not_stall_the_solve(monkeypatch: pytest.MonkeyPatch) -> None:
    """On large shapes what counts as equal is above the tolerance; here a small shape gets such a limit."""
    noise = np.random.default_rng(4).normal(size=(150, 190))
    mask = torch.from_numpy(ndimage.gaussian_filter(noise, 6) > -0.01)
    exact = solve_field(mask, method="compiled", spatial_ndim=2)
    monkeypatch.setattr(policy_iteration, "TIE", 1e-3)
    found = solve_field(mask, method="compiled", spatial_ndim=2)
    assert found.num_sweeps <= 2 * exact.num_sweeps
    assert found.error_bound <= 1e-9
    torch.testing.assert_close(found.value, exact.value, rtol=2e-9, atol=0)


def test_policies_chosen_in_parts_are_those_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    mask = grid.pad(random_masks(2, 1, seed=9)[0].numpy())
    geometry = grid.make_grid(mask)
    v = np.where(mask, np.random.default_rng(9).integers(1, 9, mask.shape), 0.0).reshape(-1)
    chosen, looks = [], []
    for part in (policy_system._PART, 50):
        monkeypatch.setattr(policy_system, "_PART", part)
        system = policy_system.PolicySystem(geometry, 0.01)
        looks.append(0)

        def look() -> None:
            looks[-1] += 1

        system.choose(v, 0.5, np.empty((4, mask.shape[1])), look)
        chosen.append((system.up, system.down))
    assert looks[0] == 1
    assert looks[1] > 2
    for one, other in zip(*chosen, strict=True):
        assert np.array_equal(one, other)
    block = np.array([dy * mask.shape[1] + dx for dy in (-1, 0, 1) for dx in (-1, 0, 1)])
    for x in np.flatnonzero(mask):  # the rule by its words: the pixel itself, or else the smallest index
        values = v[x + block]
        most, least = x + block[values >= values.max() - 0.5], x + block[values <= values.min() + 0.5]
        assert chosen[0][0][x] == (x if x in most else most.min())
        assert chosen[0][1][x] == (x if x in least else least.min())


@pytest.mark.parametrize("ndim", [1, 2, 3, 4])
def test_distance_kernel_equals_scipy(ndim: int) -> None:
    for mask in random_masks(ndim, 60, seed=20 + ndim).numpy():
        padded = np.pad(mask, 1)
        expected = ndimage.distance_transform_cdt(padded, metric="chessboard")
        assert np.array_equal(chessboard_of(grid.make_grid(padded)).reshape(padded.shape), expected)


@pytest.mark.parametrize(("side", "far", "unknowns"), [(5, False, 10), (160, False, 10_000), (40, True, 1_000)])
def test_components_that_are_no_chain_are_solved(
    side: int, far: bool, unknowns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Random policies tie pixels into large cycles; the solution must satisfy every single equation.

    Where neighbours are pixels beside each other, elimination alone solves them; where they are any pixels, BiCGStab.

    Up only ever increases (here the index, in a solve the value), or a chain would close on itself.
    """
    rng = np.random.default_rng(side)
    padded = np.pad(np.ones((side, side + 3), bool), 1)
    geometry = grid.make_grid(padded)
    inside = np.flatnonzero(padded)
    v = padded.reshape(-1).astype(float)
    system = policy_system.PolicySystem(geometry, 0.01)
    system.up[inside] = inside + rng.choice(geometry.block[geometry.block > 0], inside.size)
    system.down[inside] = inside + rng.choice(geometry.block[geometry.block != 0], inside.size)
    if far:
        system.up[inside[:-1]] = inside[rng.integers(np.arange(1, inside.size), inside.size)]
        system.down[inside[1:]] = inside[rng.integers(0, np.arange(1, inside.size))]
    iterated = []
    monkeypatch.setattr(strong_components, "bicgstab", lambda *given: iterated.append(1) or bicgstab(*given))
    assert system.solve(v, 1e-13, lambda: None) >= unknowns
    assert bool(iterated) == far
    assert not system._owner.any()
    left = 2.01 * v - v[system.up] - v[system.down]
    assert np.abs(left[inside] - 1).max() < 1e-9


@pytest.mark.parametrize("peak", [True, False])
@pytest.mark.parametrize(("length", "screening"), [(1, 0.1), (9, 1 / 144), (70, 4.0)])
def test_chains_are_the_tridiagonal_system(length: int, screening: float, peak: bool) -> None:
    """Also beyond the end of the table, which for the last is shorter than the chain."""
    factors = chains.chain_factors(1000, screening)
    assert (factors.shape[1] < length) == (length == 70)
    below, above = 1.7, 2.9
    matrix = (2 + screening) * np.eye(length) - np.eye(length, k=1) - np.eye(length, k=-1)
    matrix[-1, -1] -= peak
    sides = np.zeros((length, 3))
    sides[:, 0], sides[0, 1], sides[-1, 2] = 1, 1, not peak
    constant, by_below, by_above = np.linalg.solve(matrix, sides).T
    v = np.r_[below, np.zeros(length), above]
    places = np.arange(length + 2, dtype=np.int32)
    up, down = places + 1, places - 1
    up[length] -= peak
    chains.solve_chain(v, 1, length, length, up, down, factors, screening)
    np.testing.assert_allclose(v[1:-1], constant + below * by_below + above * by_above, rtol=1e-12)
    responses = np.empty((3, length))
    chains.solve_chain_affine(length, peak, factors, *responses)
    np.testing.assert_allclose(responses, [constant, by_below, by_above], rtol=1e-9, atol=1e-15)


def test_chain_with_a_peak_is_the_profile_of_a_square() -> None:
    length, screening = 12, 1 / 144
    geometry = grid.make_grid(np.pad(np.ones(2 * length, bool), 1))
    distance = chessboard_of(geometry)
    field = solve_field(torch.ones(2 * length, dtype=torch.bool), spatial_ndim=1, method="accelerated", tol=1e-11)
    v = np.zeros(2 * length + 2)
    up, down = np.zeros(v.size, np.int32), np.zeros(v.size, np.int32)
    for x in range(1, length + 1):
        up[x], down[x] = min(x + 1, length), x - 1
    factors = chains.chain_factors(length, screening)
    chains.solve_chain(v, 1, length, length, up, down, factors, screening)
    assert distance.max() == length
    np.testing.assert_allclose(v[1 : length + 1], field.value[:length].numpy(), rtol=1e-10)


def random_rows(size: int, reach: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows x = a + b x_i + c x_k that depend on rows at most `reach` away, on themselves, or twice on the same one."""
    rng = np.random.default_rng(seed)
    rows = np.arange(size)[:, None] + rng.integers(-reach, reach + 1, (size, 2))
    rows[(rows < 0) | (rows >= size)] = -1
    rows[rng.random(size) < 0.1, 1] = -1
    twice = rng.random(size) < 0.1
    rows[twice, 0] = rows[twice, 1]
    weight = rng.random((size, 2)) * 0.49
    weight[rows < 0] = 0
    return rng.random(size), weight, rows


@pytest.mark.parametrize(("size", "reach"), [(1, 1), (2, 1), (40, 3), (300, 5), (35, 40)])
def test_elimination_solves_the_rows_of_a_component(size: int, reach: int) -> None:
    for seed in range(20):
        constant, weight, rows = random_rows(size, reach, seed)
        matrix = np.eye(size)
        for j in range(size):
            for i, share in zip(rows[j], weight[j], strict=True):
                matrix[j, i] -= share  # row -1 has a weight of 0
        expected = np.linalg.solve(matrix, constant)
        assert strong_components.eliminate(constant, weight.reshape(-1), rows.reshape(-1))
        np.testing.assert_allclose(constant, expected, rtol=1e-11)


def test_elimination_without_room_changes_nothing_and_bicgstab_takes_over() -> None:
    """What each of a thousand rows depends on is random, so that elimination would fill most of the matrix."""
    size = 1000
    rng = np.random.default_rng(0)
    rows, weight, constant = rng.integers(0, size, (size, 2)), rng.random((size, 2)) * 0.49, rng.random(size)
    given = constant.copy()
    assert not strong_components.eliminate(constant, weight.reshape(-1), rows.reshape(-1))
    assert np.array_equal(constant, given)
    index, feedback = rows.reshape(-1).copy(), np.empty(size, np.int64)
    feedback = feedback[: strong_components.find_feedback(index, feedback)]
    assert set(feedback) == {i for j in range(size) for i in rows[j] if i >= j}
    x = np.empty(feedback.size + size)

    def passed(share: float, z: np.ndarray) -> np.ndarray:
        strong_components.substitute(share, constant, weight.reshape(-1), index, z, x)
        return x[feedback.size + feedback]

    z = bicgstab(lambda y: y - passed(0.0, y), passed(1.0, np.zeros(feedback.size)), 1e-13, 1000, lambda y: y)
    passed(1.0, z)
    found = x[feedback.size :]
    np.testing.assert_allclose(found, constant + (weight * found[rows]).sum(1), rtol=1e-10)


def test_profiles_agree_with_the_torch_path() -> None:
    masks = random_masks(2, 10, seed=31)
    for estimator in ("entropy", "std"):
        found = complexity_profile(masks, estimator=estimator, method="compiled", spatial_ndim=2)
        reference = complexity_profile(masks, estimator=estimator, tol=1e-12, method="accelerated", spatial_ndim=2)
        torch.testing.assert_close(found.values, reference.values, rtol=1e-7, atol=1e-9, equal_nan=True)


def test_distance_of_a_batch_uses_every_shape_alone() -> None:
    masks = random_masks(2, 7, seed=40)
    together = chessboard_distance(masks, spatial_ndim=2)
    assert all(torch.equal(chessboard_distance(m, spatial_ndim=2), d) for m, d in zip(masks, together, strict=True))
