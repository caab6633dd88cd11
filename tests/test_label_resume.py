"""Label maps in tables that are continued: all labels of a map are there, or none, whatever stopped the run."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from torchlinf.cli import app
from torchlinf.scoring import JOURNAL, Score, find_masks, open_table, read_table, score_masks

run = CliRunner(env={"TERM": "dumb", "COLUMNS": "200"}).invoke


def label_map(path: Path, labels: int, seed: int = 0) -> None:
    """Boxes side by side, with labels 1 to `labels`."""
    values = np.zeros((9, 6 * labels + 3), dtype=np.uint8)
    for label in range(1, labels + 1):
        values[2 : 6 + (label + seed) % 3, 6 * label - 4 : 6 * label] = label
    Image.fromarray(values).save(path)


def untimed(rows: list[Score]) -> list[dict[str, object]]:
    return [{**row.cells(), "seconds": None} for row in rows]


@pytest.fixture
def maps(tmp_path: Path) -> Path:
    folder = tmp_path / "maps"
    folder.mkdir()
    for i in range(3):
        label_map(folder / f"{i}.png", 4 + i, i)
    return folder


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_killed_within_the_rows_of_a_map(suffix: str, maps: Path, tmp_path: Path) -> None:
    out = tmp_path / f"scores.{suffix}"
    command = ["score", str(maps), "--labels", "--out", str(out), "--workers", "1"]
    assert run(app, command).exit_code == 0
    whole = list(read_table(out))
    assert [row.path for row in whole] == [f"{maps}/{i}.png#{n}" for i in range(3) for n in range(1, 5 + i)]
    out.unlink()
    with pytest.raises(KeyboardInterrupt), open_table(out) as put:  # noqa: PT012
        put(*whole[:4])
        put(*whole[4:9])
        raise KeyboardInterrupt
    journal = Path(f"{out}{JOURNAL}")
    data = journal.read_bytes()
    first = data.index(b"\n") + 1
    # A kill cuts a long write anywhere, also behind the row of a label.
    ends = [first + data[first:].index(b'{"path"', at) for at in (20, 300, 900)] if len(data) > first + 900 else []
    for size in sorted({0, 5, first - 1, first, first + 1, len(data) - 1, *ends}):
        journal.write_bytes(data[:size])
        result = run(app, command)
        assert result.exit_code == 0, result.stderr
        done = 1 if size >= first else 0
        assert (f"{done} of 3 masks are in" in result.stderr) == bool(done)
        assert untimed(list(read_table(out))) == untimed(whole), size
        assert sorted(os.listdir(tmp_path)) == ["maps", out.name]
        out.unlink()


def test_a_map_that_is_repaired_takes_the_place_of_its_failure(maps: Path, tmp_path: Path) -> None:
    out = tmp_path / "scores.csv"
    whole = (maps / "1.png").read_bytes()
    (maps / "1.png").write_bytes(whole[:60])
    command = ["score", str(maps), "--labels", "--out", str(out)]
    assert run(app, command).exit_code == 1
    assert [row.path for row in read_table(out) if row.error] == [f"{maps}/1.png"]
    (maps / "1.png").write_bytes(whole)
    assert run(app, command).exit_code == 1  # it stays failed
    result = run(app, [*command, "--retry"])
    assert (result.exit_code, "2 of 3 masks are in" in result.stderr) == (0, True)
    rows = {row.path: row.error for row in read_table(out)}
    assert set(rows) == {f"{maps}/{i}.png#{n}" for i in range(3) for n in range(1, 5 + i)}
    assert not any(rows.values())


def test_a_map_with_one_label_that_failed_is_scored_as_a_whole(maps: Path, tmp_path: Path) -> None:
    out = tmp_path / "scores.jsonl"
    command = ["score", str(maps), "--labels", "--out", str(out)]
    assert run(app, command).exit_code == 0
    whole = list(read_table(out))
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    lines[5] |= {"error": "RuntimeError: the field did not converge", "complexity": None}  # label 2 of 1.png
    lines.insert(6, {**lines[6], "path": f"{maps}/1.png#99"})  # a label that the map has no more
    out.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert run(app, command).exit_code == 1
    assert run(app, [*command, "--retry"]).exit_code == 0
    rows = {row["path"]: row for row in untimed(list(read_table(out)))}
    assert list(rows.values()) == sorted(untimed(whole), key=lambda row: "/1.png" in row["path"])
    # Stopped after the new rows came, and before the table was made of them, it is the same.
    out.write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(KeyboardInterrupt), open_table(out, retry=True) as put:  # noqa: PT012
        assert list(put.failed) == [f"{maps}/1.png#2"]
        put(*whole[4:9], instead_of=[f"{maps}/1.png#99"])
        raise KeyboardInterrupt
    assert run(app, [*command, "--retry"]).exit_code == 0
    assert {row["path"]: row for row in untimed(list(read_table(out)))} == rows


def test_sources_whose_own_names_look_like_labels_are_done_once(tmp_path: Path) -> None:
    for name in ("a", "a#2", "b[1]"):
        label_map(tmp_path / "x.png", 2)
        (tmp_path / "x.png").rename(tmp_path / name)
    out = tmp_path / "scores.csv"
    command = ["score", *(str(tmp_path / name) for name in ("a#2", "b[1]")), "--labels", "--out", str(out)]
    assert run(app, command).exit_code == 0
    before = out.read_bytes()
    assert "2 of 2 masks are in" in run(app, command).stderr
    assert out.read_bytes() == before
    rows = list(score_masks(find_masks(tmp_path / "a#2"), labels=True))
    assert [row.path for row in rows] == [f"{tmp_path}/a#2#1", f"{tmp_path}/a#2#2"]
