"""The study of decision regions: its rivals by hand, its rank correlations against SciPy, and the stored results."""

import math
import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.stats import spearmanr
from sklearn.neighbors import KNeighborsClassifier

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # `benchmarks` is not installed with the library

from benchmarks.regions_study import __main__ as command  # noqa: E402
from benchmarks.regions_study import classifiers as bench  # noqa: E402
from benchmarks.regions_study import correlations, measures, windows  # noqa: E402
from benchmarks.regions_study.data import SYNTHETIC, VIEWS, split  # noqa: E402
from torchlinf.regions import decision_region_complexity, decision_region_summary  # noqa: E402

SQUARE = [(-1.0, 1.0)] * 2


def test_rank_correlations_are_those_of_scipy() -> None:
    generator = np.random.default_rng(0)
    first, second = generator.integers(0, 6, size=(2, 20))  # with ties
    assert correlations.spearman(first, second) == pytest.approx(spearmanr(first, second).statistic, abs=1e-12)
    assert correlations.spearman(first, -first) == pytest.approx(-1)
    assert math.isnan(correlations.spearman(first, np.ones(20)))


def test_partial_correlations_follow_the_formula() -> None:
    x, y, z = np.random.default_rng(1).normal(size=(3, 20)) + np.linspace(0, 3, 20)
    xy, xz, yz = (spearmanr(a, b).statistic for a, b in ((x, y), (x, z), (y, z)))
    expected = (xy - xz * yz) / math.sqrt((1 - xz**2) * (1 - yz**2))
    assert correlations.partial(x, y, [z]) == pytest.approx(expected, abs=1e-12)
    assert correlations.partial(x, y, []) == pytest.approx(xy, abs=1e-12)
    assert math.isnan(correlations.partial(x, y, [np.exp(x)]))  # nothing of x is left


def test_means_have_standard_errors() -> None:
    mean = correlations.mean_of([0.1, -0.2, 0.4, math.nan])
    assert (mean.above, mean.count) == (2, 3)
    assert (mean.value, mean.error) == pytest.approx((0.1, 0.3 / math.sqrt(3)))
    assert math.isnan(correlations.mean_of([math.nan]).value)
    assert math.isnan(correlations.mean_of([0.5]).error)
    runs: Any = [{"a": [1, 2, 3], "b": [1, 3, 2]}, {"a": [1, 2, 3], "b": [5, 5, 5]}]
    assert correlations.over_seeds(runs, "a", "b").tolist() == pytest.approx([0.5])


def test_the_boundary_has_its_length() -> None:
    """A straight boundary across the grid and a circle, in sides of the grid."""
    half = decision_region_complexity(lambda p: p[:, 0] > 0.1, SQUARE, resolution=64)
    assert measures.boundary_length(half) == pytest.approx(
        math.pi / 4 * 64 / 63
    )  # along an axis the count is too small
    circle = decision_region_summary(lambda p: (p - 0.03).norm(dim=1) < 0.5, SQUARE, resolution=256)
    lengths = [measures.boundary_length(regions) for regions in circle.regions]
    assert np.mean(lengths) == pytest.approx(math.pi * 0.5, rel=0.01)


def test_regions_are_counted() -> None:
    rings = decision_region_complexity(lambda p: (p.norm(dim=1) * 5).long().clamp(max=3) % 2, SQUARE, resolution=64)
    assert measures.number_of_regions(rings) == 4
    corners = decision_region_complexity(lambda p: p[:, 0] * p[:, 1] > 0, SQUARE, resolution=64)
    assert measures.number_of_regions(corners) == 4  # parts that meet at a corner alone are apart


def test_n1_is_that_of_a_tree_drawn_by_hand() -> None:
    """Points on a line are joined one to the next."""
    points = np.array([[0.0, 0], [1, 0], [2.1, 0], [3.3, 0], [4.6, 0], [4.6, 0]])
    assert measures.n1(points, np.array([0, 0, 1, 1, 1, 1])) == pytest.approx(2 / 6)
    assert measures.n1(points, np.array(["a", "b", "a", "b", "a", "a"])) == pytest.approx(5 / 6)
    assert measures.n1(points, np.zeros(6)) == 0


def test_targets_by_hand() -> None:
    """The nearest neighbour knows what it was fitted to; a threshold flips as often as noise crosses it."""
    halves = split(VIEWS["two moons"], 0)
    found = measures.targets(KNeighborsClassifier(1).fit(halves.train, halves.train_classes), halves, 0)
    assert found["train"] == 1.0
    assert found["gap"] == pytest.approx(1 - found["test"])
    threshold = SimpleNamespace(predict=lambda points: (points[:, 0] > 0).astype(int))
    far = SimpleNamespace(
        train=halves.train, test=np.array([[0.1, 0.0]] * 500), train_classes=halves.train_classes, test_classes=1
    )
    flips = measures.targets(threshold, far, 0)["flips"]  # of one standard deviation: 15.9 %
    assert flips == pytest.approx(0.5 * math.erfc(1 / math.sqrt(2)), abs=0.015)


@pytest.mark.parametrize("name", ["two moons", "wine", "digits"])
def test_halves_are_halves_in_two_dimensions(name: str) -> None:
    halves = split(VIEWS[name], 1)
    assert halves.train.shape[1] == halves.test.shape[1] == 2
    assert abs(len(halves.train) - len(halves.test)) <= 1
    assert len(halves.train) <= 300
    np.testing.assert_allclose(halves.train.std(axis=0), 1)
    assert set(halves.train_classes) == set(halves.test_classes)
    assert not np.array_equal(halves.train, split(VIEWS[name], 2).train)


def test_a_run_has_one_number_a_classifier(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "classifiers", lambda seed: dict(list(bench.classifiers(seed).items())[:5]))
    results = tmp_path / "results.json"
    arguments = ["--seeds", "2", "--resolution", "12", "--results", str(results), "--out", str(tmp_path)]
    command.main([*arguments, "--only", "iris", "--only", "wine"])
    stored = command._read(results)
    assert {name: (found["samples"], found["classes"]) for name, found in stored.items()} == {
        "iris": (150, 3),
        "wine": (178, 3),
    }
    assert {len(column) for column in stored["iris"]["1"].values()} == {5}
    for run in command.as_runs(stored)["iris"]:
        assert np.allclose(np.subtract(run["train"], run["gap"]), run["test"], atol=1e-4)
        assert all(least <= mean for least, mean in zip(run["least"], run["mean"], strict=True))
    tables = (tmp_path / command.FILE).read_text(encoding="utf-8")
    monkeypatch.setattr(command, "run", lambda *_: pytest.fail("what is kept was measured again"))
    command.main([*arguments, "--only", "iris", "--only", "wine"])
    assert (tmp_path / command.FILE).read_text(encoding="utf-8") == tables


def test_there_are_twenty_classifiers_and_enough_sets() -> None:
    assert len(bench.classifiers(0)) == 20
    assert len(set(VIEWS) - set(SYNTHETIC)) >= 8


def test_the_tables_are_those_of_the_stored_results(tmp_path: Path) -> None:
    stored = command._read(command.RESULTS)
    assert list(stored) == list(VIEWS)
    assert all({"0", "1", "2", "3", "4"} <= set(found) for found in stored.values())
    command.main(["--report", "--out", str(tmp_path)])
    assert (tmp_path / command.FILE).read_text(encoding="utf-8") == (command.DOCS / command.FILE).read_text(
        encoding="utf-8"
    )


def test_the_page_quotes_its_tables() -> None:
    page, tables, seen = (
        (command.DOCS / name).read_text(encoding="utf-8") for name in ("regions_study.md", command.FILE, windows.FILE)
    )
    quoted = re.findall(r"-?\d\.\d\d ± \d\.\d\d", page)
    assert len(quoted) >= 12
    assert [number for number in quoted if f" {number} " not in tables + seen] == []


def test_windows_see_what_they_hold() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, size=(4000, 2))
    assert windows.seen(points, SQUARE, "around") == 1.0
    assert windows.seen(points, SQUARE, "in every one") == pytest.approx(0.5, abs=0.02)  # half of the area of the box
    corner = np.array([[0.99, 0.99]])
    assert windows.seen(corner, SQUARE, "same side") == pytest.approx(1 / 6)  # of the box itself alone
    assert torch.tensor([windows.SIDES["largest within"](angle) for angle in (0.0, 90.0)]).allclose(torch.ones(2))
