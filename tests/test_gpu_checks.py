"""`make test-gpu` where there is no GPU, and the benchmark that it runs, on the CPU."""

import math
import sys
from pathlib import Path

import pytest
import torch

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]  # not installed with the library

import check_gpu  # noqa: E402

from benchmarks import gpu, shapes, timing  # noqa: E402
from benchmarks.timing import Times  # noqa: E402


def test_without_a_gpu_the_command_says_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert check_gpu.main() == 0
    assert capsys.readouterr().out == "Nothing was checked: torch finds no CUDA device here.\n"


def test_with_a_gpu_it_runs_the_tests_and_then_the_benchmark(monkeypatch: pytest.MonkeyPatch) -> None:
    ran, codes = [], iter([0, 0, 3])

    def run(command: list[str], **_: object) -> object:
        ran.append(command[2:])
        return type("Done", (), {"returncode": next(codes)})

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(check_gpu.subprocess, "run", run)
    assert check_gpu.main() == 0
    assert ran == [["pytest", "-m", "gpu", "tests"], ["benchmarks.gpu"]]
    assert check_gpu.main() == 3  # a failed test ends it
    assert len(ran) == 3


def test_the_row_is_the_least_number_of_shapes_from_which_the_device_is_sooner() -> None:
    device = gpu.ON_DEVICE[0]

    def took(there: float, trip: float) -> dict[str, Times]:
        slower = dict.fromkeys(gpu.ON_DEVICE, Times(wall=[9.0]))
        return {**slower, device: Times(wall=[there]), gpu.TRIP: Times(wall=[trip])}

    times = {
        (10, 1): took(1, 2),
        (10, 4): took(1, 2),
        (10, 8): took(1, 2),
        (20, 1): took(1, 2),  # sooner for one, but not for four
        (20, 4): took(2, 1),
        (20, 8): took(1, 2),
        (30, 1): took(2, 1),
        (30, 4): took(2, 1),
        (30, 8): took(2, 1),
    }
    assert gpu.row(times) == ((100, 1), (400, 8), (math.inf, math.inf))


def test_large_silhouettes_fill_their_square_and_have_steps_of_one_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(shapes.FOLDER, raising=False)
    found = shapes.batch(3, 512)
    assert found.shape == (3, 512, 512)
    for mask in found:
        rows, columns = mask.any(dim=1).nonzero(), mask.any(dim=0).nonzero()
        assert 500 <= max(int(rows.max() - rows.min()), int(columns.max() - columns.min())) < 512
        # Drawn as blocks of 2 x 2, every other row would equal the one before.
        differ = (mask[1:] != mask[:-1]).any(dim=1)
        assert differ[::2].sum() > 20
        assert differ[1::2].sum() > 20


@pytest.mark.slow
def test_the_benchmark_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delenv(shapes.FOLDER, raising=False)
    monkeypatch.setattr(timing, "TURN", 0.001)
    small = ["--counts", "1,3", "--sides", "24,40", "--batch-side", "40", "--flips", "2", "--rounds", "1"]
    gpu.main(["--device", "cpu", *small])
    printed = capsys.readouterr().out
    assert 'STAYS["cpu"] = ((576, ' in printed
    for size in ("1 x 24 x 24", "3 x 40 x 40", "3 x 1 x 24 x 24"):
        assert f"| {size} |" in printed
