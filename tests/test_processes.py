"""Kernels in other processes, without a compiler, from a read-only folder, and interrupted."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from torch.utils.data import DataLoader, Dataset

import torchlinf

ROOT = Path(torchlinf.__file__).parents[1]


class Discs(Dataset[float]):
    """The complexity of discs, computed where the sample is loaded."""

    def __len__(self) -> int:
        return 6

    def __getitem__(self, index: int) -> float:
        return torchlinf.complexity(torchlinf.shapes.disc(10 + index), spatial_ndim=2).item()


def run(script: str, *, path: Path = ROOT, **environment: str) -> str:
    """What a fresh interpreter prints that imports torchlinf from `path`, warnings being errors."""
    command = [sys.executable, "-W", "error", "-c", script]
    variables = {**os.environ, "PYTHONPATH": str(path), **environment}
    result = subprocess.run(command, env=variables, cwd="/", capture_output=True, text=True, timeout=120, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_loader_workers_after_the_parent_used_the_kernels(start: str) -> None:
    dataset = Discs()
    expected = [dataset[i] for i in range(len(dataset))]  # the parent compiles, and has used its threads
    torchlinf.complexity(torch.stack([torchlinf.shapes.disc(12)] * 4), spatial_ndim=2)
    loader = DataLoader(dataset, num_workers=2, multiprocessing_context=start, timeout=100)
    assert [value.item() for value in loader] == expected


# What a forked child can do after its parent has used the threads of OpenMP, on inputs that torch would divide among
# them: shapes of 78,000 pixels, and 400 shapes at 100 scales.
FORKED = {
    "distance": "torchlinf.chessboard_distance(masks, spatial_ndim=2).numpy().sum()",
    "field": "torchlinf.solve_field(masks, spatial_ndim=2).value.numpy().sum()",
    "normalised field": "torchlinf.linf_field(grey, spatial_ndim=2).numpy().sum()",
    "complexity": "torchlinf.complexity(grey, spatial_ndim=2).tolist()",
    "standard deviation": "torchlinf.complexity(masks, estimator='std', levels='rim', spatial_ndim=2).tolist()",
    "map": "np.nansum(torchlinf.complexity_map(masks, spatial_ndim=2).numpy())",
    "profile": "[p := torchlinf.complexity_profile(many, spatial_ndim=2), p.mean().tolist(), p.peak()[1].tolist()][1:]",
    "objects": "torchlinf.complexity(masks, per='object', orientation='mean', spatial_ndim=2).tolist()",
    "frames": "torchlinf.complexity(many, orientation='least', rotations=2, spatial_ndim=2).tolist()",
    "transform": "ShapeComplexityScore(orientation='own', per='object')(grey).tolist()",
    "labels": "complexity_table(masks[0].numpy().astype(int), properties=['area'])['complexity'].tolist()",
    "shapes": "[shapes.disc(120).numpy().sum(), shapes.diagonal_pair(200, 90).numpy().sum()]",
}


@pytest.mark.skipif(sys.platform == "win32", reason="forks")
def test_a_forked_child_does_not_wait_for_threads_that_its_parent_had() -> None:
    script = f"""
import multiprocessing, os
import numpy as np, torch, torchlinf
from torchlinf import shapes
from torchlinf.labels import complexity_table
from torchlinf.transforms import ShapeComplexityScore
torch.set_num_threads(2)
y, x = np.mgrid[:260, :300]
one = (np.abs(x - 150) / 140.0) ** 3 + (np.abs(y - 130) / 120.0) ** 3 < 1
one[:, 10:20] = False
masks = torch.from_numpy(np.stack([one, one[::-1] & (x > 30)]))
grey = torch.from_numpy(masks.numpy().astype(np.float32))
many = torch.from_numpy(np.stack([np.tri(9, 11, dtype=bool)] * 400))
calls = {FORKED!r}
def call(name):
    return eval(calls[name])
torch.ones(3000, 3000).sum()  # on both threads
expected = {{name: call(name) for name in calls}}
pool = multiprocessing.get_context("fork").Pool(1)
for name in calls:
    try:
        found = pool.apply_async(call, [name]).get(60)
        print(name, "differs" if found != expected[name] else "", flush=True)
    except multiprocessing.TimeoutError:
        print(name, "hangs", flush=True)
        break
pool._pool[0].kill()
os._exit(0)
"""
    assert run(script).split("\n")[:-1] == [f"{name} " for name in FORKED]


@pytest.mark.skipif(sys.platform == "win32", reason="forks")
def test_a_forked_pool_after_the_parent_scored_objects() -> None:
    """No call of the pipeline starts OpenMP's threads, which a forked child would wait for without end."""
    script = """
import multiprocessing, os, threading
import numpy as np, torch, torchlinf
from torchlinf.labels import complexity_table
torch.set_num_threads(2)
label_map = np.zeros((40, 90), dtype=int)
label_map[2:30, 2:30], label_map[5:38, 40:73] = 1, 2 * np.tri(33, dtype=int)
def score(_):
    # A child that hangs dies, and the pool with it.
    threading.Timer(60, os._exit, [1]).start() if multiprocessing.parent_process() else None
    masks = torch.stack([torchlinf.shapes.disc(12)] * 4)
    return complexity_table(label_map)["complexity"].tolist() + torchlinf.complexity(masks, spatial_ndim=2).tolist()
expected = score(0)
pool = multiprocessing.get_context("fork").Pool(2)
print(pool.map_async(score, range(4)).get(50) == [expected] * 4, flush=True)
os._exit(0)
"""
    assert run(script) == "True\n"


def test_without_numba_everything_works_on_the_torch_path() -> None:
    script = """
import sys
sys.modules["numba"] = None  # importing it now fails, as if it were not installed
import importlib.util
find = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name == "numba" else find(name, *rest)
import torch, torchlinf
mask = torchlinf.shapes.disc(16)
print(*[torchlinf.complexity(mask, estimator=name, spatial_ndim=2).item() for name in ("entropy", "std")])
print(torchlinf.complexity(mask, per="object", spatial_ndim=2).item())
for call in (
    lambda: torchlinf.solve_field(mask, method="compiled", spatial_ndim=2),
    lambda: torchlinf.complexity(mask, orientation="own", spatial_ndim=2),
):
    try:
        call()
    except ImportError as error:
        print(error)
"""
    numbers, of_object, message, of_frame = run(script).splitlines()
    mask = torchlinf.shapes.disc(16)
    here = [torchlinf.complexity(mask, estimator=name, spatial_ndim=2).item() for name in ("entropy", "std")]
    assert [float(number) for number in numbers.split()] == pytest.approx(
        here, rel=1e-8
    )  # each is certified to 1e-9 alone
    assert float(of_object) == float(numbers.split()[0])
    assert "pip install numba" in message
    assert of_frame.startswith("orientation turns images by kernels that numba compiles")


@pytest.mark.skipif(sys.platform == "win32", reason="permissions are set as on POSIX")
def test_read_only_install_without_a_home_still_computes(tmp_path: Path) -> None:
    """Where numba finds no folder for its cache, the kernels compile in memory, and one warning says so."""
    shutil.copytree(ROOT / "torchlinf", tmp_path / "torchlinf", ignore=shutil.ignore_patterns("__pycache__"))
    blocker = tmp_path / "blocker"
    blocker.write_text("a file, where a folder would be needed")
    for path in (tmp_path / "torchlinf").rglob("*"):
        if path.is_dir():
            (path / "__pycache__").write_text("no folder either")  # holds for root too, unlike permissions
    script = """
import warnings
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    import torchlinf
    print(torchlinf.chessboard_distance(torchlinf.shapes.disc(9), spatial_ndim=2).sum().item())
    import torchlinf.kernels.stencil
print(len(caught), "NUMBA_CACHE_DIR" in str(caught[0].message))
"""
    printed, told = run(
        script, path=tmp_path, PYTHONDONTWRITEBYTECODE="1", HOME=str(blocker), XDG_CACHE_HOME=str(blocker / "cache")
    ).splitlines()
    assert told == "1 True"
    assert int(printed) == torchlinf.chessboard_distance(torchlinf.shapes.disc(9), spatial_ndim=2).sum()


@pytest.mark.skipif(sys.platform == "win32", reason="sends a POSIX signal")
def test_interrupt_ends_a_batch_promptly() -> None:
    script = """
import signal, torch, torchlinf
signal.signal(signal.SIGINT, signal.default_int_handler)
torch.set_num_threads(2)
rng = torch.Generator().manual_seed(0)
torchlinf.solve_field(torchlinf.shapes.disc(8), spatial_ndim=2)
masks = torch.rand(400, 400, 400, generator=rng) > 0.01
print("ready", flush=True)
try:
    torchlinf.solve_field(masks, tol=1e-12, spatial_ndim=2)
    print("finished")
except KeyboardInterrupt:
    print("interrupted")
"""
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(ROOT)}, cwd="/", stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        sent = time.monotonic()
        assert process.communicate(timeout=60)[0] == "interrupted\n"
        assert time.monotonic() - sent < 20
    finally:
        process.kill()


def test_import_is_light() -> None:
    heavy = ["numba", "scipy", "skimage", "networkx", "matplotlib", "typer", "rich", "pyarrow", "ray", "PIL", "kornia"]
    script = "import sys, torch; before = set(sys.modules); import torchlinf; "
    script += f"print([name for name in {heavy} if name in set(sys.modules) - before])"
    assert run(script).strip() == "[]"
