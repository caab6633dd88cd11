"""The implicit gradient of the field against unrolled sweeps, finite differences and symmetries."""

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

import torchlinf
from torchlinf import shapes
from torchlinf.field import adjoint
from torchlinf.field.stencil import block_max, block_min

PATHS = ["compiled", "torch"]


@pytest.fixture(params=PATHS)
def path(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == "torch":
        monkeypatch.setattr(adjoint, "usable", lambda x: False)
    return request.param


def sweep(weight: Tensor, count: int) -> Tensor:
    """The field by plain sweeps from 0, through which autograd can go."""
    field = torch.zeros_like(weight)
    for _ in range(count):
        field = weight * (block_max(field, weight.ndim - 1) + block_min(field, weight.ndim - 1) + 1)
    return field


def random_weights(spatial: tuple[int, ...], seed: int, batch: int = 3) -> tuple[Tensor, Tensor]:
    """Weights that make no two neighbours tie, with a mask; shape 1 is empty."""
    generator = torch.Generator().manual_seed(seed)
    mask = torch.rand(batch, *spatial, generator=generator) < 0.8
    mask[1] = False
    weight = 0.34 + 0.1 * torch.rand(batch, *spatial, generator=generator, dtype=torch.float64)
    return weight * mask, mask


def attached(weight: Tensor) -> Tensor:
    value = sweep(weight.detach(), 280)
    return adjoint.attach_gradient(value, weight, torch.zeros(len(weight), dtype=torch.float64))


@pytest.mark.parametrize("spatial", [(17,), (9, 13), (4, 5, 6), (3, 2, 4, 3)])
def test_implicit_gradient_is_the_unrolled_one(path: str, spatial: tuple[int, ...]) -> None:
    weight, mask = random_weights(spatial, seed=len(spatial))
    weight.requires_grad_()
    cotangent = torch.randn(weight.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    (implicit,) = torch.autograd.grad((attached(weight) * cotangent).sum(), weight)
    (unrolled,) = torch.autograd.grad((sweep(weight, 250) * cotangent).sum(), weight)
    # outside the shapes zeros tie, and there is no one derivative
    assert unrolled[mask].abs().max() > 1
    torch.testing.assert_close(implicit[mask], unrolled[mask], rtol=1e-9, atol=1e-9)


def test_an_outside_pixel_without_neighbours_inside_has_the_derivative_of_its_own_field(path: str) -> None:
    weight = torch.zeros(1, 7, 9, dtype=torch.float64)
    weight[0, 1, 1] = 0.4
    weight.requires_grad_()
    cotangent = torch.arange(63.0, dtype=torch.float64).view(1, 7, 9)
    (gradient,) = torch.autograd.grad((attached(weight) * cotangent).sum(), weight)
    assert gradient[0, 5, 6] == cotangent[0, 5, 6]


def noisy_disc() -> Tensor:
    generator = torch.Generator().manual_seed(5)
    disc = shapes.disc(9, margin=2)[:, 1:]
    return disc ^ (torch.rand(disc.shape, generator=generator) < 0.04)


def field_of_rho(rho: Tensor) -> Tensor:
    masks = torch.stack([noisy_disc(), torch.zeros_like(noisy_disc()), shapes.box(*noisy_disc().shape)])
    return torchlinf.linf_field(masks, rho=rho, spatial_ndim=2, tol=1e-12)


def test_gradcheck_of_rho(path: str) -> None:
    rho = torch.tensor([6.3, 4.0, 11.1], dtype=torch.float64, requires_grad=True)
    assert gradcheck(field_of_rho, rho, eps=1e-5, atol=1e-7, rtol=1e-6, fast_mode=True)
    (gradient,) = torch.autograd.grad(field_of_rho(rho).sum(), rho)
    assert gradient[0].abs() > 0.1
    assert gradient[1] == 0


@pytest.mark.parametrize("axes", [(0,), (1,), (0, 1), "swap"])
def test_gradients_turn_with_the_shape(path: str, axes: tuple[int, ...] | str) -> None:
    """On a symmetric shape nearly all neighbours tie; a rule that picks one of them fails here."""

    def turn(x: Tensor) -> Tensor:
        return x.transpose(1, 2) if axes == "swap" else x.flip([axis + 1 for axis in axes])

    def gradient(mask: Tensor, cotangent: Tensor) -> Tensor:
        weight = mask / (2 + torch.tensor(1 / 64, dtype=torch.float64))
        weight.requires_grad_()
        value = torchlinf.solve_field(mask, rho=8.0, spatial_ndim=2).value
        field = adjoint.attach_gradient(value, weight, torch.full((len(mask),), 1e-9, dtype=torch.float64))
        return torch.autograd.grad((field * cotangent).sum(), weight)[0]

    body = shapes.with_appendages((17, 17), [shapes.Appendage("right", 9, 6), shapes.Appendage("top", 3, 4)], margin=1)
    masks = torch.stack(
        [body, shapes.superellipse(9, 2.5, margin=40)[38 : 38 + body.shape[0], 38 : 38 + body.shape[1]]]
    )
    cotangent = torch.rand(masks.shape, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    turned = gradient(turn(masks), turn(cotangent))
    torch.testing.assert_close(turned, turn(gradient(masks, cotangent)), rtol=1e-7, atol=1e-7)


def test_the_same_bits_every_time_and_in_every_batch(path: str) -> None:
    weight, _ = random_weights((12, 10), seed=8)
    weight.requires_grad_()

    def gradient(part: slice) -> Tensor:
        return torch.autograd.grad(attached(weight)[part].square().sum(), weight)[0][part]

    assert torch.equal(gradient(slice(0, 3)), gradient(slice(0, 3)))
    torch.testing.assert_close(gradient(slice(2, 3)), gradient(slice(0, 3))[2:], rtol=1e-9, atol=0)


def test_a_failed_backward_raises(path: str) -> None:
    weight, _ = random_weights((5, 6), seed=2)
    weight.requires_grad_()
    with pytest.raises(RuntimeError, match="must be finite"):
        attached(weight).backward(torch.full_like(weight, torch.nan))


def test_a_linear_solve_that_stops_short_raises(path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    weight, _ = random_weights((5, 6), seed=2)
    weight.requires_grad_()
    field = attached(weight)
    monkeypatch.setitem(adjoint.TOL, torch.float64, (1e-11, 1e-40))  # less than rounding leaves
    with pytest.raises(RuntimeError, match="relative residual of at most 1e-40"):
        field.square().sum().backward()


def test_what_is_kept_does_not_depend_on_the_number_of_sweeps() -> None:
    """Three tensors, for one sweep's worth of work and for a thousand: long chains take most sweeps."""
    for spatial in [(1, 4096), (64, 64)]:
        saved: list[int] = []
        weight = torch.full((1, *spatial), 0.4999, dtype=torch.float64, requires_grad=True)
        value = torch.ones(1, *spatial, dtype=torch.float64)
        with torch.autograd.graph.saved_tensors_hooks(lambda x, s=saved: s.append(x.numel()) or x, lambda x: x):  # type: ignore[misc]
            adjoint.attach_gradient(value, weight, torch.zeros(1))
        assert sum(saved) == 2 * 4096 + 1


def test_second_derivatives_and_vmap_say_that_they_are_not_there() -> None:
    rho = torch.tensor([6.3, 4.0, 11.1], dtype=torch.float64, requires_grad=True)
    # Whether or not the loss is linear in the field, and whether the engine runs all of the graph or a part of it.
    for loss in (torch.sum, lambda field: field.square().sum()):
        (gradient,) = torch.autograd.grad(loss(field_of_rho(rho)), rho, create_graph=True)
        for derive in (lambda y: torch.autograd.grad(y, rho, retain_graph=True), lambda y: y.backward()):
            with pytest.raises(RuntimeError, match="can be differentiated once; got a second derivative"):
                derive(gradient.sum())
        with pytest.raises(RuntimeError, match="can be differentiated once"):
            torch.autograd.functional.hessian(lambda rho, loss=loss: loss(field_of_rho(rho)), rho.detach())
    weight, _ = random_weights((5, 6), seed=2)
    with pytest.raises(NotImplementedError, match="rho must be a tensor with data"):
        torch.func.vmap(lambda rho: torchlinf.linf_field(torch.ones(1, 1, 4, 5), rho=rho))(torch.ones(2))
    with pytest.raises(NotImplementedError, match="stack the shapes"):
        torch.func.vmap(adjoint.attach_gradient)(weight[None], weight[None], weight[None, :, 0, 0])


RHO = {
    "linf_field": lambda rho: torchlinf.linf_field(torch.ones(1, 1, 4, 5), rho=rho),
    "solve_field": lambda rho: torchlinf.solve_field(torch.ones(1, 1, 4, 5), rho=rho).value,
    "complexity": lambda rho: torchlinf.complexity(torch.ones(1, 1, 4, 5), rho=rho),
    "complexity_profile": lambda rho: torchlinf.complexity_profile(torch.ones(1, 1, 4, 5), rho=rho).mean(),
    "complexity_map": lambda rho: torchlinf.complexity_map(torch.ones(1, 1, 4, 5), rho=rho),
    "soft_linf_field": lambda rho: torchlinf.soft_linf_field(torch.ones(1, 1, 4, 5), rho=rho),
    "soft_complexity": lambda rho: torchlinf.soft_complexity(torch.ones(1, 1, 4, 5), rho=rho),
}


@pytest.mark.parametrize("name", RHO)
def test_transforms_of_torch_func_over_rho_are_refused_by_name(name: str) -> None:
    rho = torch.tensor(3.0, dtype=torch.float64)
    with pytest.raises(NotImplementedError, match=r"rho must be a tensor with data; .*torch\.autograd\.grad"):
        torch.func.grad(lambda rho: RHO[name](rho).sum())(rho)
    with pytest.raises(NotImplementedError, match="rho must be a tensor with data"):
        torch.func.vmap(RHO[name])(rho[None])
