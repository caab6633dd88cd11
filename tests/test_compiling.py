"""What a user is told of compiling, `warm_up`, and the library without numba."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

import torchlinf

ROOT = Path(torchlinf.__file__).parents[1]
DISTANCE = "import torchlinf; torchlinf.chessboard_distance(torchlinf.shapes.disc(9), spatial_ndim=2)\n"
LOGGED = "import logging, sys; logging.basicConfig(level='INFO', stream=sys.stdout, format='%(name)s %(levelname)s')\n"


def run(script: str, cache: Path | None = None) -> str:
    """What a fresh interpreter prints, warnings being errors."""
    variables = {**os.environ, "PYTHONPATH": str(ROOT), **({} if cache is None else {"NUMBA_CACHE_DIR": str(cache)})}
    command = [sys.executable, "-W", "error", "-c", script]
    done = subprocess.run(command, env=variables, cwd="/", capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def test_compiling_is_logged_once_and_never_again(tmp_path: Path) -> None:
    assert run(LOGGED + DISTANCE + DISTANCE, tmp_path) == "torchlinf INFO\n"
    assert run(LOGGED + DISTANCE, tmp_path) == ""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_compiling_is_shown_on_a_terminal(tmp_path: Path) -> None:
    main, other = pty.openpty()
    variables = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path)}
    for shown in (True, False):
        subprocess.run([sys.executable, "-c", DISTANCE], env=variables, cwd="/", stderr=other, timeout=600, check=True)
        os.write(other, b"end\n")
        assert (b"compiling" in os.read(main, 10_000)) == shown
    os.close(main)
    os.close(other)


def test_after_warm_up_no_call_compiles_or_loads_another_kernel() -> None:
    """Whatever types the library passes to its kernels, `warm_up` has passed them before."""
    script = """
import torch, torchlinf, numba, sys
from torchlinf import warm_up
def known():
    return {(name, key, str(one)) for name, module in list(sys.modules.items()) if name.startswith("torchlinf.kernels.")
            for key, kernel in vars(module).items() if isinstance(kernel, numba.core.dispatcher.Dispatcher)
            for one in kernel.signatures}
assert warm_up() > 0
before = known()
assert len(before) >= 25
for sides in ((300,), (60, 64), (300, 310), (21, 22, 23), (7, 7, 8, 6)):
    mask = torch.rand(sides, generator=torch.Generator().manual_seed(1)) < 0.95
    n = len(sides)
    for dtype in (torch.bool, torch.uint8, torch.float32):
        for rho in (None, 3, torch.tensor(4)):
            for estimator in ("entropy", "std"):
                torchlinf.complexity(mask.to(dtype), rho=rho, estimator=estimator, spatial_ndim=n)
        torchlinf.complexity_map(mask.to(dtype), spatial_ndim=n)
        torchlinf.chessboard_distance(mask.to(dtype).movedim(0, -1).contiguous().movedim(-1, 0), spatial_ndim=n)
    rho = torch.tensor(3.0, requires_grad=True)
    torchlinf.linf_field(mask, rho=rho, spatial_ndim=n).square().sum().backward()
    grey = torch.rand(sides, generator=torch.Generator().manual_seed(2))[tuple(slice(9) for _ in sides)]
    for dtype in (torch.float32, torch.float64):
        leaf = grey.to(dtype).requires_grad_()
        torchlinf.soft_complexity(leaf, spatial_ndim=n).backward()
        torchlinf.soft_chessboard_distance(leaf, spatial_ndim=n).sum().backward()
print(known() - before)
"""
    command = [sys.executable, "-c", script]
    variables = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, env=variables, cwd="/", capture_output=True, text=True, timeout=600, check=False)
    assert done.stdout == "set()\n", done.stdout + done.stderr


def test_without_numba_all_but_the_speed_is_the_same() -> None:
    script = """
import sys
import torch, torchlinf
from torchlinf.losses import ShapeComplexityLoss
torch.manual_seed(0)
mask = torch.rand(2, 1, 20, 23) < 0.9
grey = torch.rand(1, 1, 14, 15)
def slope(function, x):
    leaf = x.clone().requires_grad_()
    return torch.autograd.grad(function(leaf), leaf)[0].double().abs().sum().item()
print(*[float(value) for value in (
    torchlinf.complexity(mask).sum(), torchlinf.complexity(mask, estimator="std").sum(),
    torchlinf.complexity_map(mask)[0].sum(), torchlinf.soft_complexity(grey).sum(),
    slope(lambda x: torchlinf.soft_complexity(x).sum(), grey.double()),
    slope(lambda x: ShapeComplexityLoss()(x), grey),
    slope(lambda rho: torchlinf.linf_field(mask, rho=rho).sum(), torch.tensor(4.0).double()),
)])
"""
    blocked = "import sys; sys.modules['numba'] = None\n"
    expected = [float(value) for value in run(script).split()]
    assert [float(value) for value in run(blocked + script).split()] == pytest.approx(expected, rel=1e-7)


def test_warm_up_without_numba_says_so() -> None:
    script = "import sys; sys.modules['numba'] = None\nfrom torchlinf import warm_up\n"
    script += "try:\n    warm_up()\nexcept ImportError as error:\n    print(error)\n"
    assert "pip install numba" in run(script)
