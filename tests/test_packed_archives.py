"""Archives that gzip has compressed: read in one pass, resumed, damaged; what folders hold beside masks; names."""

import csv
import gzip
import io
import os
import tarfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from tests.mask_files import noise, png
from torchlinf.cli import app
from torchlinf.scoring import find_masks, read_source, read_table, score_masks
from torchlinf.scoring.byte_ranges import PackedRange, open_packed
from torchlinf.scoring.shards import find_shards

run = CliRunner(env={"TERM": "dumb", "COLUMNS": "200"}).invoke


def pack(path: Path, members: list[tuple[str, bytes]]) -> Path:
    with tarfile.open(path, "w:gz") as archive:
        for name, content in members:
            info = tarfile.TarInfo(name)
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return path


@pytest.fixture
def shard(tmp_path: Path) -> Path:
    array = io.BytesIO()
    np.savez(array, noise(9, 8, 5))
    members = [(f"{i}.png", png(noise(i, 9, 14))) for i in range(4)]
    return pack(tmp_path / "shard.tar.gz", [*members, ("a.txt", b"x"), ("b/x.npz", array.getvalue())])


def test_members_are_read_in_any_order(shard: Path, tmp_path: Path) -> None:
    found = find_masks([tmp_path])
    names = [*(f"{i}.png" for i in range(4)), "b/x.npz"]
    assert [source.name for source in found] == [f"{shard}:{name}" for name in names]
    expected = [*(noise(i, 9, 14) for i in range(4)), noise(9, 8, 5)]
    for order in (range(5), (4, 2, 0, 1, 3)):
        for i in order:
            np.testing.assert_array_equal(read_source(found[i]), expected[i])
    assert [row.pixels for row in score_masks(found, workers=3)] == [mask.sum() for mask in expected]
    os.rename(shard, tmp_path / "shard.tgz")
    assert len(find_masks([tmp_path])) == 5
    assert [one.is_archive for one in find_shards([tmp_path])] == [True]


def test_a_later_archive_of_the_same_name_is_read_anew(shard: Path) -> None:
    (first, *_) = find_masks([shard])
    np.testing.assert_array_equal(read_source(first), noise(0, 9, 14))
    os.unlink(shard)
    pack(shard, [("0.png", png(noise(7, 9, 14)))])
    os.utime(shard, ns=(0, 0))
    np.testing.assert_array_equal(read_source(find_masks([shard])[0]), noise(7, 9, 14))


def test_in_order_the_archive_is_unpacked_once(shard: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = find_masks([shard])
    starts: list[Path] = []

    class Counted(gzip.GzipFile):
        def __init__(self, path: Path) -> None:
            starts.append(path)
            super().__init__(path)

        def rewind(self) -> None:
            starts.append(Path("rewound"))

    monkeypatch.setattr(gzip, "GzipFile", Counted)
    for source in found:
        read_source(source)
    assert len(starts) <= 1  # the stream of the test before may be open


@pytest.mark.parametrize("part", [0.4, 0.6, 0.9])
def test_a_truncated_archive_says_so_after_what_is_whole(part: float, tmp_path: Path) -> None:
    masks = [noise(i, 60, 70) for i in range(6)]
    shard = pack(tmp_path / "a.tgz", [(f"{i}.png", png(mask)) for i, mask in enumerate(masks)])
    content = shard.read_bytes()
    shard.write_bytes(content[: int(part * len(content))])
    rows = list(score_masks(find_masks([shard])))
    whole = [row for row in rows if row.error is None]
    assert 0 < len(whole) < 6
    assert [row.pixels for row in whole] == [mask.sum() for mask in masks[: len(whole)]]
    assert "compressed by gzip" in rows[-1].error
    assert "damaged" in rows[-1].error


def test_what_is_no_archive_is_a_row(tmp_path: Path) -> None:
    (tmp_path / "a.tar.gz").write_bytes(b"x" * 2000)
    (tmp_path / "b.tgz").write_bytes(b"")
    (tmp_path / "c.tgz").write_bytes(gzip.compress(b"x" * 2000))
    rows = list(score_masks(find_masks([tmp_path])))
    assert [os.path.basename(row.path) for row in rows] == ["a.tar.gz", "b.tgz", "c.tgz"]
    assert all("not a tar archive compressed by gzip" in row.error for row in rows)


def test_a_member_that_would_fill_the_memory_is_refused(tmp_path: Path) -> None:
    shard = pack(tmp_path / "a.tgz", [("bomb.png", bytes(3 * 2**20))])
    (row,) = score_masks(find_masks([shard]), max_pixels=1000)
    assert "more than a mask of 1000 pixels takes" in row.error
    with pytest.raises(EOFError):
        open_packed(shard, PackedRange(0, 5 * 2**20), max_pixels=2**20)


def test_the_same_command_goes_on(shard: Path, tmp_path: Path) -> None:
    out = tmp_path / "scores.csv"
    assert run(app, ["score", str(shard), "--out", str(out)]).exit_code == 0
    with out.open(newline="") as file:
        rows = list(csv.reader(file))
    with out.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows[:3])
    again = run(app, ["score", str(shard), "--out", str(out)])
    assert "2 of 5 masks are in" in again.stderr
    assert [row.path for row in read_table(out)] == [source.name for source in find_masks([shard])]


def test_names_of_second_members_are_not_those_of_labels(tmp_path: Path) -> None:
    labels = np.zeros((12, 19), np.uint8)
    labels[2:5, 3:9], labels[7:11, 3:15] = 2, 3
    file = io.BytesIO()
    Image.fromarray(labels).save(file, format="PNG")
    members = [("a.png", file.getvalue()), ("a.png", file.getvalue()), ("a.png~2", file.getvalue())]
    shard = pack(tmp_path / "a.tgz", members)
    rows = list(score_masks(find_masks([shard], members="a*"), labels=True))
    names = [row.path.removeprefix(f"{shard}:") for row in rows]
    assert names == ["a.png#2", "a.png#3", "a.png~2", "a.png~2~2#2", "a.png~2~2#3"]
    assert "another member of this name" in rows[2].error


def test_what_a_folder_holds_beside_masks_is_counted(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    for name in ("a.png", "b.txt", "c.TXT", "deep/d.json", "README", ".hidden.png", ".git/config", "e.tar.bz2"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(png(noise(0, 5, 7)))
    (folder / "gone.jsonl").symlink_to("nowhere")
    (folder / "gone.png").symlink_to("nowhere")
    passed_over: Counter[str] = Counter()
    found = find_masks([folder], passed_over=passed_over)
    assert [source.path.name for source in found] == ["a.png", "gone.png"]
    assert +passed_over == {
        ".txt": 2, ".json": 1, "without a suffix": 1, "hidden": 2, ".bz2": 1, ".jsonl": 1
    }  # fmt: skip
    result = run(app, ["score", str(folder)])
    assert "Passed over in folders: 8 (2 .txt, 2 hidden, " in result.stderr
    assert [row["error"] for row in csv.DictReader(io.StringIO(result.stdout))] == ["", "no such file"]
    nothing = run(app, ["score", str(folder / "deep")])
    assert nothing.exit_code == 2
    assert "Passed over in folders: 1 (1 .json)." in nothing.stderr
    assert "Passed over" not in run(app, ["score", str(folder / "a.png")]).stderr
