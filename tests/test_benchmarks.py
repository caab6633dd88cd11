"""That every benchmark runs, on toy sizes, and that its rulers and its baselines are right."""

import dataclasses
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # `benchmarks` is not installed with the library

import torchlinf  # noqa: E402
from benchmarks import __main__ as command  # noqa: E402
from benchmarks import probes, report, shapes, timing  # noqa: E402
from benchmarks.baselines.domain import Domain  # noqa: E402
from benchmarks.baselines.explicit import Compiled, Pooling, Vectorised, sweeps_from_zero  # noqa: E402
from benchmarks.baselines.policy import policy_iteration  # noqa: E402
from benchmarks.questions import QUESTIONS  # noqa: E402
from benchmarks.questions.common import Policy, Solve  # noqa: E402
from benchmarks.results import Result, Table, Target, load, markdown, save, show, target_table  # noqa: E402
from benchmarks.sizes import TOY  # noqa: E402
from torchlinf._helpers.parallel import threads  # noqa: E402
from torchlinf.shapes import disc, square  # noqa: E402

pytestmark = pytest.mark.slow  # most tests here wait for the run of all benchmarks


def small() -> torch.Tensor:
    """A shape off the corner of its array, with more than its start to solve."""
    mask = torch.zeros(40, 52, dtype=torch.bool)
    mask[5:30, 9:31] = mask[12:20, 20:47] = mask[28:36, 14:20] = True
    return mask


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Result]]:
    """All benchmarks on toy sizes, run through the command, their probes in this process to save starting others."""

    def here(question: str, *arguments: str, **_: str) -> dict[str, object]:
        with threads(torch.get_num_threads()):
            return probes.QUESTIONS[question](*arguments)

    folder = tmp_path_factory.mktemp("benchmarks")
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv(shapes.FOLDER, raising=False)
        patch.setattr(timing, "TURN", 0.001)
        patch.setattr("benchmarks.questions.memory.probe", here)
        patch.setattr("benchmarks.questions.startup.probe", here)
        command.main(["--size", "toy", "--out", str(folder)])
    return folder, report.stored(folder, list(QUESTIONS))


def test_every_benchmark_runs_and_is_stored(results: tuple[Path, list[Result]]) -> None:
    folder, found = results
    assert [result.name for result in found] == list(QUESTIONS)
    assert all(result.tables and result.targets and result.environment["size"] == "toy" for result in found)
    assert all(np.isfinite(target.reached) for result in found for target in result.targets)
    assert sorted(path.name for path in folder.glob("*.json")) == sorted(f"{name}.json" for name in QUESTIONS)


def test_tables_and_plots_are_written(results: tuple[Path, list[Result]]) -> None:
    folder, found = results
    text = (folder / report.TABLES).read_text(encoding="utf-8")
    for result in found:
        assert f"## {result.title}\n" in text
        assert all(target.what in text for target in result.targets)
    plots = sorted(path.name for path in (folder / report.IMAGES).iterdir())
    assert plots == ["performance_field.png", "performance_growth.png", "performance_work.png"]


def test_smaller_runs_leave_the_repository_alone(capsys: pytest.CaptureFixture[str]) -> None:
    stored = {path: path.stat().st_mtime_ns for path in [*command.RESULTS.glob("*"), *command.DOCS.glob("*")]}
    command.main(["--size", "toy", "--only", "batch"])
    assert "against one by one" in capsys.readouterr().out
    assert stored == {path: path.stat().st_mtime_ns for path in [*command.RESULTS.glob("*"), *command.DOCS.glob("*")]}


def test_the_report_uses_only_what_is_stored(tmp_path: Path) -> None:
    save(Result("work", "Work", [Target("effort", "<=", 4, None, 2.0)], [Table("t", ["a"], [[1]])]), tmp_path)
    found = report.stored(tmp_path, list(QUESTIONS))
    assert [result.name for result in found] == ["work"]
    assert found[0] == load(tmp_path / "work.json")


def test_a_fresh_process_answers() -> None:
    found = probes.probe("startup", "solve_field")
    assert 0 < found["again"] < found["first"]
    assert found["import"] > 0


def test_a_failing_probe_says_why() -> None:
    with pytest.raises(RuntimeError, match="no_such_call"):
        probes.probe("startup", "no_such_call")


def test_the_memory_ruler_sees_numpy_and_torch() -> None:
    size = 40 * 2**20
    for make in (lambda: np.ones(size, np.uint8), lambda: torch.ones(size, dtype=torch.uint8)):
        peak, _ = probes.peak_of(make)
        assert 0.9 * size < peak < 1.5 * size


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="the mark can be reset on Linux only")
def test_the_memory_ruler_forgets_what_was_freed() -> None:
    probes.peak_of(lambda: np.ones(80 * 2**20, np.uint8).sum())
    peak, _ = probes.peak_of(lambda: np.ones(20 * 2**20, np.uint8).sum())
    assert peak < 40 * 2**20


def test_ratios_follow_the_work() -> None:
    def busy(seconds: float) -> None:
        end = time.process_time() + seconds
        while time.process_time() < end:
            pass

    times = timing.alternate({"fast": lambda: busy(0.01), "slow": lambda: busy(0.04)}, rounds=3)
    found = timing.ratio(times["slow"], times["fast"])
    assert found.cpu == pytest.approx(4, rel=0.2)
    assert found.low <= found.median <= found.high
    assert [len(entry.wall) for entry in times.values()] == [3, 3]


def test_no_round_begins_after_the_budget() -> None:
    calls: list[str] = []

    def slow(name: str) -> None:
        calls.append(name)
        time.sleep(0.06)

    times = timing.alternate({name: lambda name=name: slow(name) for name in "ab"}, rounds=50, budget=0.3)
    assert 1 <= len(times["a"].wall) < 5
    assert len(times["a"].wall) == len(times["b"].wall)
    assert calls[:4] == ["a", "b", "a", "b"]  # the warm-up and the first round


@pytest.mark.parametrize("mask", [small(), shapes.volumes(13)[1].mask], ids=["2-D", "3-D"])
def test_the_explicit_schemes_are_one(mask: torch.Tensor) -> None:
    domain = Domain.of(mask)
    zero = torch.zeros(domain.inside.shape, dtype=torch.float64)
    compiled = Compiled(domain).sweep(zero.numpy().copy(), 17)
    torch.testing.assert_close(
        Vectorised(domain).sweep(zero.clone(), 17), torch.from_numpy(compiled), rtol=1e-13, atol=0
    )
    if mask.ndim == 2:
        pooled = Pooling(domain).sweep(zero.clone()[None, None], 17)[0, 0]
        torch.testing.assert_close(pooled, torch.from_numpy(compiled), rtol=1e-13, atol=0)
    assert compiled.max() > 4


@pytest.mark.parametrize("mask", [small(), shapes.volumes(13)[1].mask], ids=["2-D", "3-D"])
def test_the_baselines_find_the_field(mask: torch.Tensor) -> None:
    field = Solve(mask)
    field()
    domain = Domain.of(mask)
    outcome = policy_iteration(domain, sweeps=domain.radius // 2, tol=1e-9)
    assert outcome.converged
    assert 1 <= outcome.solves <= 20
    count = sweeps_from_zero(domain, 1e-9, np.inf)
    assert not count.extrapolated
    for value in (outcome.value, count.value):
        theirs = torch.from_numpy(domain.like_mask(value, tuple(mask.shape)))
        torch.testing.assert_close(field.solution.value, theirs, rtol=2.1e-9, atol=0)


def test_a_wrong_field_is_noticed() -> None:
    policy = Policy(small(), np.inf, sweeping=True)
    policy()
    field = Solve(small())
    field()
    policy.check(field.solution.value)
    with pytest.raises(AssertionError, match="agree"):
        policy.check(field.solution.value * (1 + 1e-8))


def test_impatience_is_told() -> None:
    outcome = policy_iteration(Domain.of(disc(20)), sweeps=0, tol=1e-9, patience=0.0)
    assert not outcome.converged
    assert outcome.bound > 1e-9


@pytest.mark.parametrize("mask", [small(), disc(17)], ids=["appendages", "disc"])
def test_the_extrapolated_count_is_right(mask: torch.Tensor) -> None:
    domain = Domain.of(mask)
    full, early = (sweeps_from_zero(domain, 1e-9, patience) for patience in (np.inf, 0.0))
    assert early.extrapolated
    assert early.sweeps == pytest.approx(full.sweeps, rel=0.05)
    assert full.sweeps / domain.radius**2 == pytest.approx(12, abs=2)


def test_enlargements_keep_the_shape() -> None:
    mask = small()
    for enlarge in (shapes.repeat, shapes.smooth):
        large = enlarge(mask, 3)
        assert int(large.sum()) == pytest.approx(9 * int(mask.sum()), rel=0.03)
        radius = torchlinf.chessboard_distance(torch.stack([large]), spatial_ndim=2).max()
        assert int(radius) == pytest.approx(3 * int(torchlinf.chessboard_distance(mask, spatial_ndim=2).max()), abs=2)
    assert not torch.equal(shapes.smooth(disc(9), 4)[16:-16, 16:-16], shapes.repeat(disc(9), 4))


def test_batches_are_full_and_varied() -> None:
    masks = shapes.batch(5, 24)
    assert masks.shape == (5, 24, 24)
    assert bool(masks.flatten(1).any(dim=1).all())
    assert len({mask.numpy().tobytes() for mask in masks}) == 5


def test_verdicts() -> None:
    def target(relation: str, reached: float, goal: float | None = 10.0, aim: float | None = None) -> str:
        return Target("w", relation, goal, aim, reached).verdict

    assert [target(">=", 9.9), target(">=", 10.0), target("<=", 10.1), target("<=", 3.0)] == [
        "missed",
        "met",
        "missed",
        "met",
    ]
    assert [target(">=", 30, aim=20), target("<=", 7, aim=5), target("<=", 7, None, 5)] == [
        "aim met",
        "met",
        "aim missed",
    ]


def test_numbers_in_tables() -> None:
    cells = [show(cell) for cell in (None, "x", 12_345, 12_345.6, 123.4, 0.012345, 99.96, float("nan"))]
    assert cells == ["", "x", "12,345", "12,300", "123", "0.0123", "100", "-"]
    assert (
        markdown(Table("T", ["a", "b"], [[1, 2.5]], "Note."))
        == "**T**\n\n| a | b |\n| --- | --- |\n| 1 | 2.5 |\n\nNote.\n"
    )
    result = Result("n", "N", [Target("speed", ">=", 15, 50, 20.5, "x", "why")], [])
    assert "| speed (why) | ≥ 15x | ≥ 50x | **20.5x** | met |" in target_table([result])


def test_toy_sizes_differ_from_the_full_run_everywhere() -> None:
    from benchmarks.sizes import FULL

    names = [field.name for field in dataclasses.fields(TOY)]
    assert [name for name in names if getattr(TOY, name) == getattr(FULL, name)] == []


def test_the_command_explains_itself() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "--help"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "--quick" in done.stdout
    assert square(2).all()
