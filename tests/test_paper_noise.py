"""The repetition of the paper's noisy squares: its squares, and its ruler for what chance does."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy import ndimage

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # `benchmarks` is not installed with the library

from benchmarks.paper_noise import __main__ as command  # noqa: E402
from benchmarks.paper_noise import agreement  # noqa: E402
from benchmarks.paper_noise.squares import Assumptions, noisy_squares, seed_of  # noqa: E402
from torchlinf.shapes import add_noise, noise, square  # noqa: E402

SMALL = Assumptions(side=40, counts=(5, 20))


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_the_defaults_are_those_of_the_library(factor: int) -> None:
    for count, mask in zip(SMALL.counts, noisy_squares(SMALL, factor, 3), strict=True):
        assert torch.equal(mask, add_noise(square(40), factor, count, seed=3_000_000 + 1_000 * factor + count))


@pytest.mark.parametrize(
    "change",
    [{"lines": "half"}, {"lines": "both"}, {"lines": "to the nearer end"}, {"closing": "last"}, {"boundary": "first"}],
)
def test_each_assumption_changes_the_squares(change: dict[str, str]) -> None:
    assumed, changed = (noisy_squares(a, 4, 0)[1] for a in (SMALL, replace(SMALL, **change)))
    assert assumed.shape != changed.shape or not torch.equal(assumed, changed)
    # For a single addition longer lines add more, and all else is the same.
    first = [int(noisy_squares(replace(a, counts=(1,)), 4, 0)[0].sum()) for a in (SMALL, replace(SMALL, **change))]
    assert (first[1] > first[0]) if change.get("lines") == "both" else (first[1] == first[0] or "lines" in change)


def test_growing_squares_only_gain() -> None:
    few, many = noisy_squares(replace(SMALL, growing=True), 3, 0)
    # Both are cut to their boxes; the smaller must lie in the larger at some offset.
    windows = many.unfold(0, few.shape[0], 1).unfold(1, few.shape[1], 1)
    assert bool((windows | ~few).flatten(2).all(dim=2).any())
    assert int(few.sum()) < int(many.sum())


@pytest.mark.parametrize("factor", [2, 5])
def test_closing_always_is_closing_the_whole(factor: int) -> None:
    """Against closings and boundaries of the whole canvas after each addition, by SciPy."""
    canvas = np.pad(np.ones((40, 40), dtype=bool), 120)
    for place, lengths in noise.random_patches(factor, 20, seed_of(1, factor, 20)):
        boundary = np.argwhere(canvas & ~ndimage.binary_erosion(canvas, np.ones((3, 3))))
        row, column = boundary[int(place * len(boundary))]
        away = ((column < 140, column >= 140), (row < 140, row >= 140))
        patch = noise.drawn(lengths, away)
        row, column = row - len(patch) // 2, column - len(patch) // 2
        canvas[row : row + len(patch), column : column + len(patch)] |= patch
        canvas = ndimage.binary_closing(canvas, np.ones((factor, factor)))
    rows, columns = canvas.any(axis=1).nonzero()[0], canvas.any(axis=0).nonzero()[0]
    expected = canvas[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    found = noisy_squares(SMALL, factor, 1)[1]
    assert np.array_equal(found.numpy(), expected)


def test_the_paper_table_is_read_from_the_page() -> None:
    means, stds = (agreement.paper_table(name) for name in ("PAPER_MEANS", "PAPER_STDS"))
    for table in (means, stds):
        assert list(table)[5:7] == ["factor 6", "50 patches"]
        assert {len(row) for row in table.values()} == {9}
    assert means["factor 4"][3] == 0.85
    assert [row.count(0.28) for row in stds.values()] == [0, 0, 0, 1, 1, 0, 0, 0, 0, 0]
    assert stds["factor 4"][3] == stds["factor 5"][6] == 0.28


def test_taus_of_both_orders() -> None:
    tau = agreement.taus(SMALL, "at", 2)
    assert tau.shape == (2, 8, 9)
    assert set(np.unique(tau[:, :6])) <= {-1.0, 1.0}  # one pair
    assert np.allclose(tau[:, 6:] * 15, np.round(tau[:, 6:] * 15))  # fifteen pairs
    assert not np.array_equal(tau, agreement.taus(SMALL, "up to", 2))


def test_chance_is_what_the_normal_distribution_says() -> None:
    """Independent entries of standard deviation 0.2, compared with a paper from the same data, and with another."""
    random = np.random.default_rng(0)
    tau = 0.5 + 0.2 * random.standard_normal((100, 10, 9))
    paper = (0.5 + 0.2 * random.standard_normal((50, 10, 9))).mean(axis=0).round(2)
    found = agreement.fit_means(tau, paper)
    assert found.expected == pytest.approx(np.sqrt(2 / np.pi) * 0.2 * np.sqrt(1 / 50 + 1 / 100), rel=0.05)
    assert found.expected < found.limit < 1.3 * found.expected
    assert found.mean == pytest.approx(found.expected, rel=0.3)
    assert not agreement.fit_means(tau, paper + 0.05).fits
    assert agreement.redrawn_stds(tau).mean() == pytest.approx(0.2, rel=0.02)


def test_chance_of_deviations_is_what_the_normal_distribution_says() -> None:
    """The deviation of n normal numbers has itself one of about std / sqrt(2 n)."""
    random = np.random.default_rng(1)
    tau = 0.2 * random.standard_normal((100, 10, 9))
    paper = (0.2 * random.standard_normal((50, 10, 9))).std(axis=0, ddof=1).round(2)
    found = agreement.fit_stds(tau, paper)
    assert found.expected == pytest.approx(np.sqrt(2 / np.pi) * 0.2 * np.sqrt(1 / 100 + 1 / 200), rel=0.1)
    assert found.expected < found.limit < 1.3 * found.expected
    assert found.fits
    assert not agreement.fit_stds(tau, paper + 0.04).fits


def test_the_command_writes_its_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small = replace(SMALL, side=24, counts=(2, 4, 6, 8))
    monkeypatch.setattr(command, "VARIATIONS", {command.BASE: (small, "at"), "other": (small, "up to")})
    command.main(["--sets", "3", "--other-sets", "2", "--out", str(tmp_path)])
    text = (tmp_path / command.FILE).read_text(encoding="utf-8")
    assert text in capsys.readouterr().out
    assert text.count("\n| factor 4 |") == 2
    assert text.count("\n| the paper's |") == 20
    assert text.count("0.28 or more at factor") == 2
    assert "| other | 2 |" in text
