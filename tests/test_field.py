"""Tests of the field against closed forms and slow oracles, for every method."""

from functools import cache

import numpy as np
import problems
import pytest
import torch
from torch import Tensor

from torchlinf import Status, chessboard_distance, linf_field, solve_field
from torchlinf.kernels import has_compiler

EVERY_METHOD = [
    "monotone",
    "accelerated",
    "batched",
    pytest.param("compiled", marks=pytest.mark.skipif(not has_compiler(), reason="needs numba")),
    "auto",
]
SIZES = [(40,), (11, 14), (5, 6, 7), (3, 4, 5, 4)]


@cache
def oracle(name: str, rho: float | None) -> np.ndarray:
    return problems.naive_field(problems.catalogue()[name], rho)


@cache
def random_case(sizes: tuple[int, ...]) -> tuple[Tensor, np.ndarray]:
    masks = problems.random_batch(len(sizes), 6, sizes)
    return masks, np.stack([problems.naive_field(mask) for mask in masks.numpy()])


def relative_error(value: Tensor, exact: np.ndarray) -> np.ndarray:
    """Largest |value - exact| / exact of each shape of a batch; the value must be 0 wherever the exact one is."""
    found = value.double().numpy()
    assert (found[exact == 0] == 0).all()
    error = np.divide(np.abs(found - exact), exact, out=np.zeros_like(exact), where=exact > 0)
    return error.reshape(len(exact), -1).max(axis=1)


@pytest.mark.parametrize("name", ["throw", "compile"])
def test_flags_are_checked(name: str) -> None:
    with pytest.raises(TypeError, match=f"{name} must be True or False; got 1. Pass a bool"):
        solve_field(torch.ones(1, 1, 3, 4), **{name: 1})  # type: ignore[arg-type]


@pytest.mark.parametrize("method", EVERY_METHOD)
@pytest.mark.parametrize("name", problems.catalogue())
def test_awkward_shapes_equal_the_oracle(name: str, method: str) -> None:
    mask = torch.from_numpy(problems.catalogue()[name])
    for rho in (None, 0.4, 6.0):
        solution = solve_field(mask[None], rho=rho, method=method, spatial_ndim=2)
        assert relative_error(solution.value, oracle(name, rho)[None]) <= 1e-9
        assert solution.error_bound <= 1e-9
        assert solution.status.item() == (Status.CONVERGED if mask.any() else Status.EMPTY)


@pytest.mark.parametrize("method", EVERY_METHOD)
@pytest.mark.parametrize("sizes", SIZES)
def test_random_shapes_equal_the_oracle_in_1_to_4_dimensions(sizes: tuple[int, ...], method: str) -> None:
    masks, exact = random_case(sizes)
    solution = solve_field(masks, method=method, spatial_ndim=len(sizes))
    assert (relative_error(solution.value, exact) <= 1e-9).all()
    assert (solution.status == Status.CONVERGED).all()


@pytest.mark.parametrize("method", EVERY_METHOD)
@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("max_sweeps", [1, 3, 4, 30, 60])
def test_the_bound_holds_at_any_stage(sizes: tuple[int, ...], method: str, max_sweeps: int) -> None:
    masks, exact = random_case(sizes)
    solution = solve_field(masks, method=method, tol=1e-12, max_sweeps=max_sweeps, throw=False, spatial_ndim=len(sizes))
    error = relative_error(solution.value, exact)
    assert (error <= solution.error_bound.numpy() + 1e-11).all()
    assert (solution.num_sweeps <= max_sweeps).all()
    # the bound is no wild overestimate either, once it is small
    for i, mask in enumerate(masks.numpy()):
        rho = float(problems.naive_distance(mask).max())
        residual = np.abs(problems.naive_residual(solution.value[i].numpy(), mask, rho)).max()
        assert solution.error_bound[i] == pytest.approx(residual, abs=1e-12) or solution.error_bound[i] == torch.inf


@pytest.mark.parametrize(
    "sizes", [(1,), (2,), (9,), (16,), (3, 8), (7, 7), (10, 4), (4, 5, 9), (6, 6, 6), (3, 4, 5, 6)]
)
@pytest.mark.parametrize("method", EVERY_METHOD)
def test_boxes_have_a_closed_form_that_the_start_meets(sizes: tuple[int, ...], method: str) -> None:
    for rho in (None, 0.25, 40.0):
        solution = solve_field(torch.ones(1, *sizes), rho=rho, method=method, spatial_ndim=len(sizes))
        assert relative_error(solution.value, problems.box_field(sizes, rho)[None]) <= 1e-13
        assert solution.num_sweeps.item() == 1
        assert solution.num_solves.item() == 0
        values, distance = solution.value, chessboard_distance(torch.ones(1, *sizes), spatial_ndim=len(sizes))
        for level in distance.unique():
            assert len(values[distance == level].unique()) == 1


@pytest.mark.parametrize("method", EVERY_METHOD)
def test_components_share_the_screening_of_the_largest(method: str) -> None:
    mask = torch.zeros(60)
    expected = np.zeros(60)
    for first, size in ((0, 21), (23, 8), (33, 1), (40, 14)):
        mask[first : first + size] = 1
        expected[first : first + size] = problems.box_field((size,), rho=11.0)
    solution = solve_field(mask[None], method=method, spatial_ndim=1)
    assert relative_error(solution.value, expected[None]) <= 1e-9


@pytest.mark.parametrize("method", EVERY_METHOD)
def test_a_batch_equals_its_shapes_one_by_one(method: str) -> None:
    masks = torch.cat([problems.random_batch(7, 7, (22, 31)), torch.zeros(1, 22, 31, dtype=torch.bool)])
    masks[2, 2:20, 3:28] = True  # radii from 0 to 9
    together = solve_field(masks[:, None], method=method)
    for i, mask in enumerate(masks):
        alone = solve_field(mask, method=method, spatial_ndim=2)
        assert torch.equal(together.value[i, 0], alone.value)
        assert together.error_bound[i, 0] == alone.error_bound
        assert together.num_sweeps[i, 0] == alone.num_sweeps
        assert together.status[i, 0] == alone.status


@pytest.mark.parametrize("method", EVERY_METHOD)
def test_the_place_in_the_grid_does_not_matter(method: str) -> None:
    mask = problems.random_batch(8, 3, (13, 17))
    wide = torch.zeros(3, 40, 45, dtype=torch.bool)
    wide[:, 20:33, 4:21] = mask
    found, expected = solve_field(wide, method=method, spatial_ndim=2), solve_field(mask, method=method, spatial_ndim=2)
    assert torch.equal(found.value[:, 20:33, 4:21], expected.value)
    assert torch.equal(found.num_sweeps, expected.num_sweeps)


@pytest.mark.parametrize("method", EVERY_METHOD)
@pytest.mark.parametrize("sizes", SIZES[1:])
def test_flips_and_axis_swaps(sizes: tuple[int, ...], method: str) -> None:
    masks, _ = random_case(sizes)
    ndim = len(sizes)
    solution = solve_field(masks, method=method, spatial_ndim=ndim)
    for turned, back in (
        (masks.flip(-1), lambda x: x.flip(-1)),
        (masks.flip(1), lambda x: x.flip(1)),
        (masks.transpose(1, -1), lambda x: x.transpose(1, -1)),
    ):
        other = solve_field(turned, method=method, spatial_ndim=ndim)
        if method in ("monotone", "accelerated"):  # these do the same operations on every pixel, whatever its place
            assert torch.equal(back(other.value), solution.value)
            assert torch.equal(other.num_sweeps, solution.num_sweeps)
        assert (relative_error(back(other.value), solution.value.numpy()) <= 2e-9).all()


def test_methods_agree() -> None:
    masks = problems.random_batch(9, 40, (24, 37))
    expected = solve_field(masks, method="accelerated", tol=1e-11, spatial_ndim=2).value
    found = solve_field(masks, tol=1e-10, spatial_ndim=2).value
    assert (relative_error(found, expected.numpy()) <= 1.2e-10).all()


def test_larger_shapes_have_larger_fields() -> None:
    large = problems.random_batch(10, 8, (15, 19))
    small = large & (torch.rand(large.shape, generator=torch.Generator().manual_seed(0)) < 0.9)
    fields = [solve_field(mask, rho=4.0, spatial_ndim=2).value for mask in (small, large)]
    assert (fields[0] <= fields[1] * (1 + 2e-9)).all()


@pytest.mark.parametrize(
    "dtype", [torch.uint8, torch.int32, torch.float16, torch.bfloat16, torch.float32, torch.float64]
)
def test_the_dtype_of_the_mask_does_not_matter(dtype: torch.dtype) -> None:
    mask = problems.random_batch(11, 4, (9, 14)).view(2, 2, 9, 14)
    found = solve_field(mask.to(dtype)).value
    assert found.dtype == torch.float64
    assert torch.equal(found, solve_field(mask).value)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32])
def test_the_dtype_of_the_result(dtype: torch.dtype) -> None:
    mask = problems.random_batch(12, 2, (9, 14))[:, None]
    solution = solve_field(mask, dtype=dtype)
    assert torch.equal(solution.value, solve_field(mask).value.to(dtype))
    assert solution.error_bound.dtype == torch.float64
    assert torch.equal(linf_field(mask, dtype=dtype), linf_field(mask).to(dtype))


@pytest.mark.parametrize("method", EVERY_METHOD)
def test_strides(method: str) -> None:
    mask = problems.random_batch(13, 3, (16, 11))
    swapped = solve_field(mask.mT, method=method, spatial_ndim=2)
    assert torch.equal(swapped.value, solve_field(mask.mT.contiguous(), method=method, spatial_ndim=2).value)
    expanded = solve_field(mask[:, None].expand(3, 4, 16, 11), method=method)
    assert torch.equal(expanded.value[:, 3], solve_field(mask, method=method, spatial_ndim=2).value)
    stepped = mask[:, ::2, 1::3]
    assert torch.equal(
        solve_field(stepped, method=method, spatial_ndim=2).value,
        solve_field(stepped.contiguous(), method=method, spatial_ndim=2).value,
    )


@pytest.mark.parametrize("method", EVERY_METHOD)
@pytest.mark.parametrize("lead", [(), (3,), (2, 1, 3), (0, 2)])
def test_leading_dimensions(lead: tuple[int, ...], method: str) -> None:
    solution = solve_field(torch.ones(*lead, 5, 7), method=method, spatial_ndim=2)
    assert solution.value.shape == (*lead, 5, 7)
    for entry in (solution.error_bound, solution.num_sweeps, solution.num_solves, solution.status):
        assert entry.shape == lead
    assert linf_field(torch.ones(*lead, 5, 7), spatial_ndim=2).shape == (*lead, 5, 7)


@pytest.mark.parametrize("method", EVERY_METHOD)
def test_rho_may_differ_by_shape(method: str) -> None:
    mask = problems.random_batch(14, 2, (12, 15))[:, None].expand(2, 3, 12, 15)
    rho = torch.tensor([1.0, 5.0, 50.0])
    solution = solve_field(mask, rho=rho, method=method)
    for channel in range(3):
        expected = solve_field(mask[:, channel], rho=rho[channel].item(), method=method, spatial_ndim=2).value
        assert torch.equal(solution.value[:, channel], expected)
    assert (solution.value[:, 0] <= solution.value[:, 1]).all()


@pytest.mark.parametrize("method", EVERY_METHOD)
def test_empty_shapes(method: str) -> None:
    masks = torch.zeros(2, 2, 6, 8)
    masks[1, 0, 1:5, 2:7] = 1
    solution = solve_field(masks, method=method)
    assert solution.status.tolist() == [[Status.EMPTY] * 2, [Status.CONVERGED, Status.EMPTY]]
    assert (solution.value[masks == 0] == 0).all()
    assert (solution.error_bound[solution.status == Status.EMPTY] == 0).all()
    assert (solution.num_sweeps[solution.status == Status.EMPTY] == 0).all()
    assert (linf_field(masks).amax(dim=(2, 3)) == torch.tensor([[0.0, 0.0], [1.0, 0.0]])).all()


@pytest.mark.parametrize("method", EVERY_METHOD)
def test_failures_name_the_shapes(method: str) -> None:
    masks = torch.ones(2, 3, 31, 40)
    masks[1, 2, 3:9, 5] = masks[0, 1, 20, 30:] = 0
    with pytest.raises(
        RuntimeError, match=r"certified to tol=1e-09; 2 of 6 are not\. \(0, 1\): MAX_SWEEPS, error bound"
    ) as error:
        solve_field(masks, method=method, max_sweeps=5)
    assert "(1, 2): MAX_SWEEPS" in str(error.value)
    assert Status.MAX_SWEEPS.advice in str(error.value)
    solution = solve_field(masks, method=method, max_sweeps=5, throw=False)
    assert (solution.status == Status.MAX_SWEEPS).nonzero().tolist() == [[0, 1], [1, 2]]
    assert (solution.error_bound[0, 1] > 1e-9).all()


@pytest.mark.parametrize("method", EVERY_METHOD)
@pytest.mark.parametrize("rho", [1e-200, 1e200])
def test_numbers_out_of_range(rho: float, method: str) -> None:
    mask = problems.random_batch(15, 2, (7, 9))
    solution = solve_field(mask, rho=rho, method=method, throw=False, spatial_ndim=2)
    assert (solution.status == Status.NONFINITE).all()
    assert not (solution.error_bound <= 1).any()
    with pytest.raises(RuntimeError, match=r"NONFINITE.*rho nearer to the radius"):
        solve_field(mask, rho=rho, method=method, spatial_ndim=2)


@pytest.mark.parametrize("method", EVERY_METHOD)
@pytest.mark.parametrize("rho", [1e-3, 1e6, 1e100])
def test_extreme_but_sound_rho(rho: float, method: str) -> None:
    masks = problems.random_batch(16, 3, (9, 12))
    solution = solve_field(masks, rho=rho, method=method, spatial_ndim=2)
    assert (solution.error_bound <= 1e-9).all()
    residual = problems.naive_residual(solution.value[0].numpy(), masks[0].numpy(), rho)
    assert np.abs(residual).max() <= 1e-9 * max(1.0, solution.value.max().item())


def test_linf_field_is_the_field_over_its_maximum() -> None:
    masks = problems.random_batch(17, 4, (12, 9)).view(2, 2, 12, 9)
    value = solve_field(masks, rho=3.0).value
    torch.testing.assert_close(linf_field(masks, rho=3.0), value / value.amax(dim=(2, 3), keepdim=True))
    assert (linf_field(masks).amax(dim=(2, 3)) == 1).all()


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"rho": -1.0}, ValueError, r"rho must be finite and above 0; got -1\.0\. Pass"),
        ({"rho": float("nan")}, ValueError, "rho must be finite"),
        ({"rho": torch.tensor([1.0, 0.0])}, ValueError, r"rho must be finite and above 0; got 0\.0"),
        ({"rho": torch.ones(3)}, ValueError, r"rho must broadcast to the batch shape \(1, 2\); got \(3,\)"),
        ({"rho": torch.ones(2, dtype=torch.complex64)}, TypeError, "rho must be a real tensor; got torch.complex64"),
        ({"rho": "D"}, TypeError, "rho must be a number above 0; got 'D'"),
        ({"tol": 0}, ValueError, "tol must be finite and above 0; got 0"),
        ({"tol": -1e-9}, ValueError, "tol must be finite and above 0"),
        ({"tol": float("inf")}, ValueError, "tol must be finite and above 0; got inf"),
        ({"method": "newton"}, ValueError, "method must be one of 'auto', 'monotone'.*; got 'newton'"),
        ({"max_sweeps": 0}, ValueError, "max_sweeps must be an integer of 1 or more; got 0"),
        ({"max_sweeps": 2.5}, TypeError, "max_sweeps must be an integer of 1 or more; got 2.5"),
        ({"dtype": torch.int64}, TypeError, "dtype must be a floating-point dtype; got torch.int64"),
        ({"dtype": "float32"}, TypeError, "dtype must be a torch dtype; got 'float32'"),
        ({"spatial_ndim": 5}, ValueError, "spatial_ndim must be from 1 to 4; got 5"),
    ],
)
def test_bad_options_are_refused(options: dict[str, object], kind: type[Exception], message: str) -> None:
    with pytest.raises(kind, match=message):
        solve_field(torch.ones(1, 2, 4, 5), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("function", [solve_field, linf_field, chessboard_distance])
def test_bad_masks_are_refused(function: object) -> None:
    for mask, kind, message in (
        (
            torch.ones(64, 64),
            ValueError,
            r"mask must be \(B, C, \*spatial\).*Pass spatial_ndim=2 or mask\[None, None\]",
        ),
        (torch.full((1, 1, 3, 3), torch.nan), ValueError, "got NaN"),
        (torch.full((1, 1, 3, 3), 255, dtype=torch.uint8), ValueError, "mask must hold only 0 and 1; got 255"),
        (torch.ones(1, 1, 0, 3), ValueError, "size 1 or more"),
        (torch.ones(1, 1, 3, 3, dtype=torch.complex64), TypeError, "got torch.complex64"),
    ):
        with pytest.raises(kind, match=message):
            function(mask)  # type: ignore[operator]


@pytest.mark.parametrize(
    ("mask", "got"), [(torch.ones(1, 1, 3, 4).to_sparse(), "layout"), (torch.ones(1, 1, 3, 4, device="meta"), "meta")]
)
def test_masks_without_dense_data_are_refused(mask: torch.Tensor, got: str) -> None:
    with pytest.raises(TypeError, match=rf"mask must be a dense tensor with data; got .*{got}"):
        solve_field(mask)


def test_every_status_has_advice() -> None:
    assert [status.name for status in Status] == ["CONVERGED", "MAX_SWEEPS", "EMPTY", "NONFINITE"]
    assert len({status.advice for status in Status}) == 4
    assert all(status.advice.endswith(".") for status in Status)
