"""From shards to parts, in this process: what a worker of any cluster does."""

import dataclasses
import io
import os
import tarfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from torchlinf.scoring import COLUMNS, Score, ScoreOptions, find_masks, read_table, score_masks, score_measure, shards
from torchlinf.scoring.shards import LOST, Part, find_shards, open_folder, read_part, score_shard, tidy

DEFAULTS = ScoreOptions()


def png(seed: int) -> bytes:
    """A random shape with holes, touching the border, in several components."""
    file = io.BytesIO()
    Image.fromarray(np.random.default_rng(seed).random((11, 17)) > 0.15).save(file, "PNG")
    return file.getvalue()


def tar(path: Path, count: int, seed: int = 0) -> Path:
    with tarfile.open(path, "w") as archive:
        for number in range(count):
            content = png(seed + number)
            member = tarfile.TarInfo(f"{number:03}.png")
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    return path


def files(folder: Path, count: int) -> Path:
    folder.mkdir()
    for number in range(count):
        (folder / f"{number:03}.png").write_bytes(png(100 + number))
    return folder


def untimed(rows: Iterator[Score]) -> list[Score]:
    return sorted((dataclasses.replace(row, seconds=None) for row in rows), key=lambda row: row.path)


def score_all(paths: list[Path], out: Path, options: ScoreOptions = DEFAULTS, run: int = 1000) -> list[Part]:
    shards = find_shards(paths, files=run)
    open_folder(out, shards, options)
    return [score_shard(shard, out, options) for shard in shards]


def test_archives_are_shards_and_single_files_come_in_runs(tmp_path: Path) -> None:
    for name in ("a.tar", "b/a.tar", "b/two words.tar", "c.json", "1.png", "2.npz", "b/3.tif", "b/4.bmp", "5.gif"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"")
    shards = find_shards([tmp_path, tmp_path / "c.json", tmp_path / "a.tar", tmp_path / "gone.png"], files=2)
    names = [[os.path.relpath(file.path, tmp_path) for file in shard.files] for shard in shards]
    assert names == [
        ["a.tar"], ["b/a.tar"], ["b/two words.tar"], ["c.json"], ["1.png", "2.npz"], ["5.gif", "b/3.tif"],
        ["b/4.bmp", "gone.png"],
    ]  # fmt: skip
    parts = [shard.part for shard in shards]
    assert len(set(parts)) == len(parts)
    assert [part.rsplit("-", 1)[0] for part in parts] == [
        "a.tar", "a.tar", "two_words.tar", "c.json", "files", "files", "files",
    ]  # fmt: skip
    with pytest.raises(ValueError, match="files must be 1 or more; got 0"):
        find_shards([tmp_path], files=0)


def test_the_name_of_a_part_follows_from_the_path_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (before,) = find_shards([tar(tmp_path / "a.tar", 2)])
    tar(tmp_path / "a.tar", 3)
    monkeypatch.chdir(tmp_path)
    (after,) = find_shards(["a.tar"])
    assert after.part == before.part
    (other,) = find_shards([tar(tmp_path / "b.tar", 2)])
    assert other.part != before.part


def test_rows_are_those_of_the_local_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files(tmp_path / "single", 5)
    np.savez(tmp_path / "single" / "two.npz", a=np.tri(5, 7), b=np.ones((4, 6)))
    (tmp_path / "single" / "broken.png").write_bytes(png(0)[:40])
    tar(tmp_path / "whole.tar", 4)
    (tmp_path / "cut.tar").write_bytes((tmp_path / "whole.tar").read_bytes()[:1700])
    (tmp_path / "none.tar").write_bytes(b"no archive")
    monkeypatch.chdir(tmp_path)
    shards = find_shards(["."], files=3)
    expected = untimed(score_masks(find_masks(["."])))
    monkeypatch.chdir("/")  # where the workers of a cluster run
    out = tmp_path / "out"
    open_folder(out, shards, DEFAULTS)
    parts = [score_shard(shard, out, DEFAULTS) for shard in shards]
    assert untimed(read_table(out)) == expected
    assert sum(part.masks for part in parts) == len(expected) >= 12
    failed = sum(row.error is not None for row in expected)
    assert sum(part.failed for part in parts) == failed >= 3
    assert all(part.seconds > 0 for part in parts)


def test_settings_reach_the_masks(tmp_path: Path) -> None:
    for options in (ScoreOptions(0.5, True), ScoreOptions(max_pixels=11 * 17 - 1, measure=score_measure({"bins": 64}))):
        out = tmp_path / f"out{options.invert}"
        score_all([tar(tmp_path / "a.tar", 2)], out, options)
        expected = untimed(
            score_masks(find_masks([tmp_path / "a.tar"]), **dataclasses.asdict(options.reading), **options.measuring)
        )
        assert untimed(read_table(out)) == expected
    assert "limit" in expected[0].error
    score_all([tar(tmp_path / "b.tar", 12)], tmp_path / "some", ScoreOptions(members="*1.png"))
    assert [row.path.rsplit(":")[-1] for row in untimed(read_table(tmp_path / "some"))] == ["001.png", "011.png"]


def test_what_is_there_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [tar(tmp_path / "a.tar", 3), tar(tmp_path / "b.tar", 2, seed=9), files(tmp_path / "single", 5)]
    first = score_all(paths, tmp_path / "out", run=4)
    before = untimed(read_table(tmp_path / "out"))
    b = tmp_path / "out" / first[1].name
    (tmp_path / "out" / first[0].name).unlink()
    b.write_bytes(b.read_bytes()[:-3])
    scored = []
    score = shards.score_groups
    monkeypatch.setattr(shards, "score_groups", lambda *a, **k: scored.append(1) or score(*a, **k))
    again = score_all(paths, tmp_path / "out", run=4)
    assert len(scored) == 2
    assert [part.seconds > 0 for part in again] == [True, True, False, False]
    assert [(part.name, part.masks, part.failed) for part in again] == [
        (part.name, part.masks, part.failed) for part in first
    ]
    assert untimed(read_table(tmp_path / "out")) == before


def test_an_archive_without_masks_is_done_too(tmp_path: Path) -> None:
    (part,) = score_all([tar(tmp_path / "a.tar", 0)], tmp_path / "out")
    assert (part.masks, part.failed) == (0, 0)
    assert read_part(tmp_path / "out" / part.name, COLUMNS) == dataclasses.replace(part, seconds=0.0)
    assert list(read_table(tmp_path / "out")) == []


def test_a_part_of_another_version_is_made_again(tmp_path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table({"path": ["a.png"]}), tmp_path / "old.parquet")
    assert read_part(tmp_path / "old.parquet", COLUMNS) is None
    assert read_part(tmp_path / "gone.parquet", COLUMNS) is None


def test_a_marker_of_a_lost_worker_isolates_the_masks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    score = shards.score_groups
    monkeypatch.setattr(shards, "score_groups", lambda *a, **k: seen.append(k["isolated"]) or score(*a, **k))
    (shard,) = find_shards([tar(tmp_path / "a.tar", 2)])
    rows = []
    for lost in (0, LOST - 1):
        out = tmp_path / f"out{lost}"
        out.mkdir()
        (out / f".{shard.part}.begun").write_text("this some-machine 17\n" * lost)
        score_shard(shard, out, DEFAULTS, "this")
        assert os.listdir(out) == [shard.part]
        rows.append(untimed(read_table(out)))
    assert seen == [False, True]
    assert rows[0] == rows[1]


def test_a_shard_that_costs_too_many_workers_is_given_up(tmp_path: Path) -> None:
    archive, run = find_shards([tar(tmp_path / "a.tar", 2), files(tmp_path / "single", 3)])
    out = tmp_path / "out"
    out.mkdir()
    for shard, names in ((archive, ["a.tar"]), (run, [f"single/{number:03}.png" for number in range(3)])):
        (out / f".{shard.part}.begun").write_text("this some-machine 17\n" * LOST)
        part = score_shard(shard, out, DEFAULTS, "this")
        assert (part.masks, part.failed) == (len(names), len(names))
        rows = list(read_table(out / part.name))
        assert [row.path for row in rows] == [str(tmp_path / name) for name in names]
        assert {row.error for row in rows} == {
            f"not scored: {LOST} workers were killed or crashed in its shard; delete {part.name} to try again"
        }
        (out / part.name).unlink()
        assert score_shard(shard, out, DEFAULTS).failed == 0


def test_workers_that_were_ended_with_their_run_do_not_count_against_the_shard(tmp_path: Path) -> None:
    (shard,) = find_shards([tar(tmp_path / "a.tar", 2)])
    out = tmp_path / "out"
    out.mkdir()
    marker = out / f".{shard.part}.begun"
    marker.write_text("".join(f"run-{number} some-machine 17\n" for number in range(2 * LOST)))
    assert score_shard(shard, out, DEFAULTS, "another").failed == 0
    (out / shard.part).unlink()
    marker.write_text("before some-machine 17\n" + "this some-machine 17\n" * LOST)
    assert score_shard(shard, out, DEFAULTS, "this").failed == 1


def test_a_part_that_cannot_be_written_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    (shard,) = find_shards([tar(tmp_path / "a.tar", 2)])
    out = tmp_path / "out"
    out.mkdir()
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        score_shard(shard, out, DEFAULTS)
    assert os.listdir(out) == []


def test_a_folder_holds_one_set_of_masks_in_one_way(tmp_path: Path) -> None:
    paths = [files(tmp_path / "single", 3), tar(tmp_path / "a.tar", 2)]
    out = tmp_path / "out"
    score_all(paths, out)
    score_all([*paths, tar(tmp_path / "b.tar", 2)], out)  # more archives change no other part
    with pytest.raises(ValueError, match=r'other settings.*"invert": false.*got.*"invert": true.*Pass the same'):
        score_all(paths, out, ScoreOptions(invert=True))
    with pytest.raises(ValueError, match=r'other settings.*"bins": 1024.*got.*"bins": 64.*Pass the same'):
        score_all(paths, out, ScoreOptions(measure=score_measure({"bins": 64})))
    (tmp_path / "single" / "more.png").write_bytes(png(7))
    with pytest.raises(ValueError, match=r"1 part\(s\) of another list of files, such as files-.*Pass another folder"):
        score_all(paths, out)
    assert len(list(read_table(out))) == 7


def test_what_killed_workers_left_is_removed_at_the_end(tmp_path: Path) -> None:
    shards = find_shards([tar(tmp_path / "a.tar", 2)])
    mine = [f".{shards[0].part}.begun", f".{shards[0].part}.4711.tmp"]
    for name in [*mine, ".other.parquet.4711.tmp", "notes.txt"]:
        (tmp_path / name).write_text("")
    tidy(tmp_path, shards)
    assert sorted(os.listdir(tmp_path)) == [".other.parquet.4711.tmp", "a.tar", "notes.txt"]
    tidy(tmp_path, [])
