"""What runs on CUDA only, as far as a CPU can tell: sweeps as captured graphs, and sweeps through torch.compile."""

import pytest
import torch
from torch import Tensor

from torchlinf import shapes, solve_field
from torchlinf.field import cuda_graphs, pose
from torchlinf.field.accelerated_value_iteration import AcceleratedValueIteration
from torchlinf.field.start import start
from torchlinf.field.stencil import Layout, System, fused_sweep
from torchlinf.field.value_iteration import ValueIteration


def method_of(kind: type, masks: Tensor) -> AcceleratedValueIteration | ValueIteration:
    problem = pose(masks, None, (len(masks),))
    layout = Layout(masks)
    inside = layout.rows(layout.pack(masks.double()))
    system = System(layout, inside, problem.screening[:, None], problem.radius.long())
    return kind(system, layout.pack(start(problem)))


def masks() -> Tensor:
    small = torch.nn.functional.pad(shapes.disc(8), (7, 0, 3, 4))
    return torch.stack([shapes.disc(11)[:, :23], torch.nn.functional.pad(small, (0, -1, 0, -1))[:23, :23]])


def addresses(method: object) -> dict[str, int]:
    owners = {"": method, "system.": method.system}  # type: ignore[attr-defined]
    return {
        prefix + name: value.data_ptr()
        for prefix, owner in owners.items()
        for name, value in vars(owner).items()
        if isinstance(value, Tensor)
    }


@pytest.mark.parametrize("kind", [AcceleratedValueIteration, ValueIteration])
def test_a_round_leaves_every_buffer_in_its_place(kind: type) -> None:
    """A captured graph knows buffers by address; one that moves would be read where it no longer is."""
    method = method_of(kind, masks())
    before = addresses(method)
    for _ in range(3):
        cuda_graphs.Replay(method)._steps()
        assert addresses(method) == before
    method.fall_back(torch.tensor([True, False]), method.system.layout.rows(method.line).clone())
    assert addresses(method) == before


@pytest.mark.parametrize("kind", [AcceleratedValueIteration, ValueIteration])
def test_replayed_rounds_give_the_same_values(kind: type, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a stand-in for the graph, which replays by doing the same again, rounds equal single steps to the bit."""
    captures = []

    def captured(steps: object) -> object:
        captures.append(steps)
        steps()  # type: ignore[operator]
        return steps

    monkeypatch.setattr(cuda_graphs, "captured", captured)
    monkeypatch.setattr(cuda_graphs, "uses_graphs", lambda line: True)
    plain, replayed = method_of(kind, masks()), method_of(kind, masks())
    taken = cuda_graphs.Replay(replayed).run(53)
    assert taken == 53 - 53 % plain.step_sweeps
    for _ in range(taken // plain.step_sweeps):
        plain.step()
    assert torch.equal(plain.line, replayed.line)
    assert len(captures) == 1


@pytest.mark.parametrize("sizes", [(40,), (13, 18), (6, 9, 7), (4, 5, 4, 3)])
def test_the_fused_sweep_equals_the_sweep(sizes: tuple[int, ...]) -> None:
    generator = torch.Generator().manual_seed(len(sizes))
    batch = torch.rand(3, *sizes, generator=generator) > 0.2
    method = method_of(ValueIteration, batch)
    system, layout = method.system, method.system.layout
    expected = torch.empty_like(layout.rows(method.line))
    system.sweep(method.line, out=expected)
    assert torch.equal(fused_sweep(method.line, system._weight, layout.strides), expected)


@pytest.mark.filterwarnings("ignore:`torch.jit.script_method`:DeprecationWarning")  # torch's own, on compiling
@pytest.mark.slow
def test_compile_gives_the_same_field() -> None:
    batch = masks()
    compiled = solve_field(batch, compile=True, spatial_ndim=2)
    plain = solve_field(batch, method="accelerated", spatial_ndim=2)
    assert torch.equal(compiled.num_sweeps, plain.num_sweeps)
    assert torch.equal(compiled.value, plain.value)


def test_compile_does_not_go_with_the_compiled_method() -> None:
    with pytest.raises(ValueError, match="compile=True fuses the sweeps"):
        solve_field(masks(), method="compiled", compile=True, spatial_ndim=2)
