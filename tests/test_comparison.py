"""Two tables side by side: which masks meet, and the numbers of those that do."""

import csv
import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import spearmanr
from typer.testing import CliRunner

from torchlinf import Measure
from torchlinf.cli import app
from torchlinf.scoring import (
    COLUMNS,
    WINDOWS,
    Comparison,
    Pair,
    Score,
    compare_scores,
    numeric_columns,
    open_table,
    write_pairs,
    write_table,
)

SETTINGS = Measure(windows=WINDOWS).settings()

run = CliRunner(env={"TERM": "dumb", "COLUMNS": "120"}).invoke


def rows(**numbers: float | None) -> list[Score]:
    """Rows of masks by name; None is one that failed."""
    return [scored(f"{name}.png", number, None if number is not None else "empty") for name, number in numbers.items()]


def scored(path: str, number: float | None, error: str | None = None) -> Score:
    """A row of the usual columns with a complexity."""
    values = {"complexity": number, "complexity_low": None, "complexity_high": None}
    return Score(path, values=values, error=error, measure=SETTINGS)


def test_every_mask_is_there_once_with_its_status() -> None:
    old = rows(a=2.0, b=None, c=1.0, d=None, e=4.0)
    new = rows(f=7.0, e=3.5, d=None, c=None, b=6.0, a=2.25, g=None)
    assert compare_scores(old, new).pairs == (
        Pair("a.png", "compared", 2.0, 2.25),
        Pair("b.png", "failed in old", None, 6.0),
        Pair("c.png", "failed in new", 1.0, None),
        Pair("d.png", "failed in both", None, None),
        Pair("e.png", "compared", 4.0, 3.5),
        Pair("f.png", "only in new", None, 7.0),
        Pair("g.png", "only in new", None, None),
    )
    found = compare_scores(new, old)
    assert found.counts == {
        "compared": 2, "only in old": 2, "failed in old": 1, "failed in new": 1, "failed in both": 1
    }  # fmt: skip
    assert sorted(found.changes) == [-0.25, 0.5]
    assert [pair.mask for pair in found.largest(5)] == ["e.png", "a.png"]
    assert [pair.mask for pair in found.largest(1)] == ["e.png"]
    assert found.largest(1)[0].change == 0.5
    assert found.pairs[0].change is None


def test_what_did_not_change_is_no_large_change() -> None:
    assert [pair.mask for pair in compare_scores(rows(a=1.0, b=2.0), rows(a=1.0, b=1.5)).largest(9)] == ["b.png"]


@pytest.mark.parametrize("decimals", [1, 9])  # with many equal numbers, and with none
def test_rank_correlation(decimals: int) -> None:
    generator = np.random.default_rng(decimals)
    old = generator.random(50).round(decimals)
    new = (old + 0.3 * generator.random(50)).round(decimals)
    found = compare_scores(
        rows(**{f"m{i}": float(x) for i, x in enumerate(old)}), rows(**{f"m{i}": float(x) for i, x in enumerate(new)})
    )
    assert found.rank_correlation == pytest.approx(spearmanr(old, new).statistic, abs=1e-12)
    assert 0.3 < found.rank_correlation < 0.99


def test_rank_correlation_of_too_little() -> None:
    assert math.isnan(compare_scores([], []).rank_correlation)
    assert math.isnan(compare_scores(rows(a=1.0), rows(a=2.0)).rank_correlation)
    assert math.isnan(compare_scores(rows(a=1.0, b=1.0), rows(a=2.0, b=3.0)).rank_correlation)
    assert compare_scores(rows(a=1.0, b=2.0), rows(a=2.0, b=9.0)).rank_correlation == pytest.approx(1)
    assert compare_scores(rows(a=1.0, b=2.0), rows(a=9.0, b=2.0)).rank_correlation == pytest.approx(-1)


PATHS = {  # old, new, and which joins find that they are the same two masks
    ("a.png", "b/c.png"): [("a.png", "b/c.png"), {"path", "folder", "name", "stem"}],
    ("/old/x/a.png", "/old/y/b.png"): [("new/x/a.png", "new/y/b.png"), {"folder", "name", "stem"}],
    ("old/a.png", "old/b.1.png"): [("new/a.npy", "new/b.1.npy"), {"stem"}],
    ("s/1.tar:x/a.png", "s/2.tar:x/b.png"): [("t/3.TAR:y/a.png", "t/3.TAR:y/b.png"), {"name", "stem"}],
    ("old/a.png", "old/b.png"): [("s/1.tar:x/a.mask.png", "s/1.tar:x/b.mask.png"), {"stem"}],
    ("old.json:17", "old.json:18"): [("in/new.json:17", "in/new.json:18"), {"name", "stem"}],
    ("old/12:30.png", "old/12:31.png"): [("new/13:30.png", "new/13:31.png"), set()],
}


@pytest.mark.parametrize("join", ["path", "folder", "name", "stem"])
@pytest.mark.parametrize("old", PATHS)
def test_joins(old: tuple[str, str], join: str) -> None:
    new, same = PATHS[old]
    tables = [[scored(path, float(i)) for i, path in enumerate(paths)] for paths in (old, new)]
    found = compare_scores(*tables, join=join)
    assert found.counts["compared"] == (2 if join in same else 0)
    assert len(found.pairs) == (2 if join in same else 4)
    assert not found.changes.any()


def test_what_does_not_tell_masks_apart_is_refused() -> None:
    table = [scored("x/a.png", 1.0), scored("y/a.png", 2.0)]
    with pytest.raises(ValueError, match=r"by name the new table holds a.png more than once \(x/a.png, y/a.png\)"):
        compare_scores([], table, join="name")
    with pytest.raises(ValueError, match=r"by path the old table holds x/a.png more than once"):
        compare_scores([*table, table[0]], [])
    with pytest.raises(ValueError, match=r"column must be one of height.*complexity.*; got 'error'"):
        compare_scores([], [], column="error")
    with pytest.raises(ValueError, match=r"join must be one of path.*; got 'id'"):
        compare_scores([], [], join="id")


def test_other_columns() -> None:
    found = compare_scores([Score("a.png", pixels=12)], [Score("a.png", pixels=15)], column="pixels")
    assert found.changes.tolist() == [3.0]
    old = [Score("a.png", values={"fine": 1.0, "all": 3.0})]
    new = [Score("a.png", values={"coarse": 1.0, "fine": 1.5})]
    assert compare_scores(old, new, column="fine").changes.tolist() == [0.5]
    with pytest.raises(ValueError, match=r"column must be one of .*components, fine, peak.*; got 'all'"):
        compare_scores(old, new, column="all")
    assert set(numeric_columns([])) == set(COLUMNS) - {
        "path",
        "inside",
        "spacing",
        "category",
        "image",
        "error",
        "version",
        "measure",
    }


def test_pairs_as_csv(tmp_path: Path) -> None:
    pairs = (Pair('a,"b"\n.png', "compared", 0.1, 0.30000000000000004), Pair("c", "only in old", 1.0, None))
    write_pairs(tmp_path / "changes.csv", Comparison("complexity", pairs).pairs)
    with (tmp_path / "changes.csv").open(newline="") as file:
        assert list(csv.reader(file)) == [
            ["mask", "status", "old", "new", "change"],
            ['a,"b"\n.png', "compared", "0.1", "0.30000000000000004", "0.20000000000000004"],
            ["c", "only in old", "1.0", "", ""],
        ]


# The command.


def test_rows_of_other_measures_are_pointed_out(tmp_path: Path) -> None:
    old = write(tmp_path / "old.csv", rows(a=2.0))
    other = [replace(row, measure=Measure(windows=WINDOWS, bins=64).settings()) for row in rows(a=2.5)]
    write_table(tmp_path / "new.csv", other, columns=COLUMNS)
    result = run(app, ["compare", old, str(tmp_path / "new.csv")])
    assert result.exit_code == 0
    assert "not all measured with the same options" in result.stderr
    assert run(app, ["compare", old, old]).stderr == ""


def write(path: Path, table: list[Score]) -> str:
    with open_table(path) as put:
        for row in table:
            put(row)
    return str(path)


def test_compare_prints_what_changed(tmp_path: Path) -> None:
    old = write(tmp_path / "old.csv", rows(a=2.0, b=1.0, c=3.0, d=None))
    new = write(tmp_path / "new.parquet", rows(a=2.5, b=1.0, c=1.0, e=9.0))
    result = run(app, ["compare", old, new, "--out", str(tmp_path / "changes.csv")])
    assert result.exit_code == 1
    for words in ("2.000", "1.500", "-0.500", "c.png", "-2.000", "+0.500", "only in old"):
        assert words in result.stdout, words
    with (tmp_path / "changes.csv").open(newline="") as file:
        written = list(csv.DictReader(file))
    assert [row["mask"][0] for row in written] == list("abcde")
    assert [row["status"] for row in written] == ["compared"] * 3 + ["only in old", "only in new"]
    assert [row["change"] for row in written] == ["0.5", "0.0", "-2.0", "", ""]
    assert "c.png" not in run(app, ["compare", old, new, "--largest", "0"]).stdout


def test_the_status_says_whether_all_were_compared(tmp_path: Path) -> None:
    old = write(tmp_path / "old.csv", [scored("old/a.png", 2.0)])
    new = write(tmp_path / "new.jsonl", [scored("new/a.png", 3.0)])
    assert run(app, ["compare", old, old]).exit_code == 0
    assert run(app, ["compare", old, new, "--join", "folder"]).exit_code == 0
    result = run(app, ["compare", old, new])
    assert result.exit_code == 2
    assert "no mask of the two tables has the same path" in result.stderr
    assert "--join" in result.stderr
    assert "old/a.png in old, new/a.png in new" in result.stderr
    moved = write(tmp_path / "moved.csv", [scored("new/b.png", 3.0)])
    result = run(app, ["compare", old, moved, "--join", "folder"])
    assert "the same path below its table's folder" in result.stderr
    assert "Pass --join name or stem." in result.stderr  # not the one that was tried
    empty = write(tmp_path / "empty.csv", [])
    result = run(app, ["compare", old, empty])
    assert (result.exit_code, "empty.csv without a row" in result.stderr) == (2, True)


def test_what_cannot_be_compared_is_explained(tmp_path: Path) -> None:
    old = write(tmp_path / "old.csv", rows(a=2.0))
    (tmp_path / "notes.csv").write_text("no table\n")
    write_table(tmp_path / "twice.csv", [*rows(a=1.0), *rows(a=1.0)], columns=COLUMNS)
    wrong = {
        "gone.csv cannot be read (No such file or directory)": [old, str(tmp_path / "gone.csv")],
        "notes.csv is not a table of `torchlinf score`: its columns": [str(tmp_path / "notes.csv"), old],
        "column must be one of": [old, old, "--column", "error"],
        "is one of the tables": [old, old, "--out", old],
        "changes.parquet would hold CSV": [old, old, "--out", "changes.parquet"],
        "a.png would hold CSV": [old, old, "--out", "a.png"],
        "does not exist; make it, or pass another": [old, old, "--out", str(tmp_path / "no" / "out.csv")],
        "more than once": [str(tmp_path / "twice.csv"), old],
    }
    for words, arguments in wrong.items():
        result = run(app, ["compare", *arguments])
        assert result.exit_code == 2, words
        assert words in " ".join(result.stderr.replace("│", " ").split()), result.stderr


def test_numbers_that_cannot_be_written_leave_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    old, out = write(tmp_path / "old.csv", rows(a=2.0)), tmp_path / "changes.csv"
    out.write_text("before\n")
    monkeypatch.setattr(os, "fsync", full)
    result = run(app, ["compare", old, old, "--out", str(out)])
    assert (result.exit_code, result.stderr) == (2, f"{out} cannot be written (No space left on device).\n")
    assert out.read_text() == "before\n"
    assert sorted(os.listdir(tmp_path)) == ["changes.csv", "old.csv"]


def test_the_help_spells_the_columns_out_at_80_columns() -> None:
    result = CliRunner(env={"TERM": "dumb", "COLUMNS": "80"}).invoke(app, ["compare", "--help"])
    words = result.stdout.replace(",", " ").replace(".", " ").split()
    assert set(numeric_columns([])) <= set(words)


def test_a_difference_within_the_proven_bounds_is_no_change() -> None:
    old = [Score(f"{i}.png", values={"complexity": 2.0}, error_bound=0.01) for i in range(4)]
    moved = (2.0, 2.0 + 1e-13, 2.019, 2.021)
    new = [Score(f"{i}.png", values={"complexity": value}, error_bound=0.01) for i, value in enumerate(moved)]
    comparison = compare_scores(old, new)
    assert comparison.changes.tolist() == pytest.approx([0.0, 0.0, 0.0, 0.021])
    assert [pair.mask for pair in comparison.largest(9)] == ["3.png"]
    proven = compare_scores(
        [replace(row, error_bound=0.0) for row in old], [replace(row, error_bound=0.0) for row in new]
    )
    assert [pair.mask for pair in proven.largest(9)] == ["3.png", "2.png"]
