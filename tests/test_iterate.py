"""Tests of the start, of the loop over the batch, and of the two methods in torch operations."""

from importlib import import_module

import numpy as np
import problems
import pytest
import torch
from torch import Tensor

from torchlinf.field import pose
from torchlinf.field.accelerated_value_iteration import AcceleratedValueIteration
from torchlinf.field.certificate import RESOLUTION, certify
from torchlinf.field.iterate import Method, iterate
from torchlinf.field.problem import Problem
from torchlinf.field.solution import FieldSolution, Status
from torchlinf.field.start import square_profile, start
from torchlinf.field.stencil import Layout, System, block_max, block_min, residual
from torchlinf.field.value_iteration import ValueIteration


def posed(masks: Tensor, rho: float | None = None) -> Problem:
    return pose(masks, rho, (len(masks),))


def same(one: FieldSolution, other: FieldSolution) -> bool:
    return all(torch.equal(getattr(one, name), getattr(other, name)) for name in one.__dataclass_fields__)


@pytest.mark.parametrize("rho_by_radius", [1e-3, 0.1, 1.0, 30.0, 1e8])
@pytest.mark.parametrize("radius", [1, 2, 7, 300])
def test_the_square_profile_solves_its_recurrence(radius: int, rho_by_radius: float) -> None:
    rho = radius * rho_by_radius
    found = square_profile(torch.tensor([radius]), torch.tensor([rho**-2], dtype=torch.float64), radius + 3)[0].numpy()
    np.testing.assert_allclose(found[: radius + 1], problems.square_values(radius, rho), rtol=1e-9)
    assert (found[radius:] == found[radius]).all()


def test_the_square_profile_is_accurate_for_large_radii() -> None:
    """Its residual is a few ulps of the largest value: nothing cancels."""
    radius = 20_000
    s = torch.tensor([radius**-2.0], dtype=torch.float64)
    g = square_profile(torch.tensor([radius]), s, radius + 2)[0]
    value, mask = g[None, : radius + 1], torch.ones(1, radius + 1, dtype=torch.bool)
    mask[0, 0] = mask[0, radius] = False  # the residual there needs a neighbour on the other side
    assert residual(value, mask, s).abs().max() <= 16 * torch.finfo(torch.float64).eps * g.max()


@pytest.mark.parametrize("sizes", [(50,), (17, 22), (8, 9, 7), (4, 5, 4, 5)])
@pytest.mark.parametrize("rho", [None, 0.3, 2.0, 1000.0])
def test_the_start_is_a_supersolution(sizes: tuple[int, ...], rho: float | None) -> None:
    masks = problems.random_batch(20, 12, sizes)
    problem = posed(masks, rho)
    value = start(problem)
    assert ((value > 0) == masks).all()
    above = residual(value, masks, problem.screening).flatten(1).amax(dim=1)
    assert (above <= 16 * torch.finfo(torch.float64).eps * value.flatten(1).amax(dim=1).clamp(min=1)).all()


def test_the_start_is_exact_around_the_centres() -> None:
    masks = problems.random_batch(21, 10, (17, 22))
    problem = posed(masks)
    solution = iterate(AcceleratedValueIteration, problem, 1e-12, None).value
    for mask, distance, first, value in zip(masks, problem.distance, start(problem), solution, strict=True):
        centres = (distance == distance.max()).nonzero()
        away = (mask.nonzero()[:, None] - centres).abs().amax(dim=2).amin(dim=1)
        near = distance[mask] == distance.max() - away
        assert near.any()
        torch.testing.assert_close(value[mask][near], first[mask][near], rtol=1e-11, atol=0)


def test_monotone_decreases_to_the_field() -> None:
    masks = problems.random_batch(22, 3, (9, 12))
    problem = posed(masks)
    layout = Layout(masks)
    inside = layout.rows(layout.pack(masks.double()))
    method = ValueIteration(
        System(layout, inside, problem.screening[:, None], problem.radius.long()), layout.pack(start(problem))
    )
    exact = torch.from_numpy(np.stack([problems.naive_field(mask) for mask in masks.numpy()]))
    for _ in range(30):
        before = layout.unpack(layout.rows(method.line))
        method.step()
        after = layout.unpack(layout.rows(method.line))
        assert (after <= before * (1 + 1e-15)).all()
        assert (after >= exact * (1 - 1e-12)).all()


@pytest.mark.parametrize("sizes", [(30,), (1, 9), (12, 17), (6, 5, 7), (3, 4, 5, 4)])
def test_sweeps_and_residuals_on_lines_equal_the_stencil(sizes: tuple[int, ...]) -> None:
    """On values of both signs, with pixels on every face of the grid; twice, since buffers are used again."""
    generator = torch.Generator().manual_seed(0)
    masks = torch.rand(4, *sizes, generator=generator) < 0.7
    masks[3] = False
    masks[3][tuple(size // 2 for size in sizes)] = True
    layout, ndim, s = Layout(masks), len(sizes), torch.tensor([0.1, 1.0, 4.0, 0.5], dtype=torch.float64)
    inside = layout.rows(layout.pack(masks.double()))
    system = System(layout, inside, s[:, None], torch.ones(4, dtype=torch.int64))
    for _ in range(2):
        value = (torch.rand(4, *sizes, generator=generator, dtype=torch.float64) - 0.3) * masks
        line, out = layout.pack(value), torch.empty_like(inside)
        torch.testing.assert_close(layout.unpack(system.residual(line)), residual(value, masks, s), rtol=0, atol=1e-14)
        system.sweep(line, out=out)
        expected = (block_max(value, ndim) + block_min(value, ndim) + 1) / (2 + s.view(-1, *[1] * ndim)) * masks
        torch.testing.assert_close(layout.unpack(out), expected, rtol=1e-15, atol=1e-15)


def test_the_layout_holds_the_common_box_only() -> None:
    masks = torch.zeros(2, 30, 40, dtype=torch.bool)
    masks[0, 4:9, 7:20] = masks[1, 6:12, 30] = True
    layout = Layout(masks)
    assert layout.pixels == (8 + 1) * (24 + 1)
    values = torch.rand(2, 30, 40, generator=torch.Generator().manual_seed(1)) * masks
    assert torch.equal(layout.unpack(layout.rows(layout.pack(values))), values)


@pytest.mark.parametrize("kind", [ValueIteration, AcceleratedValueIteration])
def test_groups_do_not_matter(kind: type[Method], monkeypatch: pytest.MonkeyPatch) -> None:
    problem = posed(problems.random_batch(23, 9, (14, 19)))
    solved = []
    for pixels in (1, 1000, 1 << 30):
        monkeypatch.setattr(import_module("torchlinf.field.iterate"), "GROUP_PIXELS", pixels)
        solved.append(iterate(kind, problem, 1e-9, None))
    assert same(solved[0], solved[1])
    assert same(solved[0], solved[2])


def test_threads_do_not_matter() -> None:
    masks = torch.stack([torch.nn.functional.pad(problems.disc(24), (k, 200 - k, 30, 200)) for k in (0, 100)]).bool()
    masks[0, 50:60, 90:] = True  # a box large enough for torch to split its work
    problem, threads = posed(masks), torch.get_num_threads()
    solved = []
    try:
        for number in (1, 2):
            torch.set_num_threads(number)
            solved.append(iterate(AcceleratedValueIteration, problem, 1e-2, None))
    finally:
        torch.set_num_threads(threads)
    assert same(*solved)


@pytest.mark.parametrize("kind", [ValueIteration, AcceleratedValueIteration])
def test_the_best_values_are_kept(kind: type[Method]) -> None:
    problem = posed(problems.random_batch(24, 4, (20, 26)))
    bounds = torch.stack([iterate(kind, problem, 1e-12, sweeps).error_bound for sweeps in range(1, 200, 9)])
    assert (bounds.diff(dim=0).nan_to_num(nan=0.0) <= 0).all()
    solved = iterate(kind, problem, 1e-12, 100)
    expected = certify(residual(solved.value, problem.mask, problem.screening).flatten(1))
    assert torch.equal(solved.error_bound, expected)


class Reckless(AcceleratedValueIteration):
    """Twice the momentum that is stable, until the damping has grown to 1, and no restarts: diverges."""

    def step(self) -> None:
        super().step()
        values, ahead = (self.system.layout.rows(line) for line in (self.line, self._ahead))
        ahead.add_((1 - self._damping.clamp(max=1)) * (ahead - values))

    def _test(self, back: Tensor, step: Tensor) -> None:
        pass


def test_what_does_not_converge_falls_back(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = posed(problems.random_batch(25, 4, (36, 41)))
    expected = iterate(ValueIteration, problem, 1e-10, None)
    found = iterate(Reckless, problem, 1e-10, 20_000)
    assert (found.status == Status.CONVERGED).all()
    torch.testing.assert_close(found.value, expected.value, rtol=2.1e-10, atol=0)
    monkeypatch.setattr(Reckless, "fall_back", lambda self, stalled, best: None)
    assert (iterate(Reckless, problem, 1e-10, 20_000).status != Status.CONVERGED).any()


@pytest.mark.parametrize("kind", [ValueIteration, AcceleratedValueIteration])
def test_float32_is_certified_as_far_as_it_goes(kind: type[Method]) -> None:
    """As on devices without float64: tol is out of reach, some ulps of the largest value are not."""
    masks = problems.random_batch(26, 6, (26, 33))
    masks[0, 2:24, 3:30] = True
    problem = posed(masks)
    exact = iterate(AcceleratedValueIteration, problem, 1e-11, None).value
    single = Problem(masks, problem.distance, problem.radius, problem.screening.float())
    found = iterate(kind, single, 1e-9, None)
    assert found.value.dtype == torch.float32
    assert (found.status == Status.CONVERGED).all()
    floor = RESOLUTION * torch.finfo(torch.float32).eps * found.value.flatten(1).amax(dim=1)
    assert (found.error_bound <= floor).all()
    error = torch.where(masks, (found.value.double() - exact).abs() / exact, 0).flatten(1).amax(dim=1)
    assert (error <= found.error_bound + 1e-6).all()


def test_certify() -> None:
    inf, nan = torch.inf, torch.nan
    rows = torch.tensor([[0.0, 0.0], [0.2, -0.5], [0.9, -3.0], [1.0, 0.0], [nan, 0.0], [-2.0, 0.0], [inf, 0.0]])
    assert certify(rows).tolist()[:4] == pytest.approx([0.0, 0.5, 3.0, inf])
    assert certify(rows)[4].isnan()
    assert certify(rows).tolist()[5:] == [2.0, inf]


def appendages() -> Tensor:
    mask = torch.zeros(80, 84, dtype=torch.bool)
    mask[8:72, 2:66] = True
    mask[16:64, 66:82] = mask[2:8, 20:52] = True
    return mask


@pytest.mark.parametrize("mask", [problems.disc(32), problems.disc(40), appendages()], ids=["disc32", "disc40", "S2"])
def test_at_most_40_sweeps_a_pixel_of_radius(mask: Tensor) -> None:
    problem = posed(mask[None])
    solved = iterate(AcceleratedValueIteration, problem, 1e-9, None)
    assert solved.error_bound <= 1e-9
    assert 1 < solved.num_sweeps.item() <= 40 * problem.radius.item()
