"""Tar shards and patterns: which masks are found, that nothing is unpacked, and what is refused."""

import io
import os
import tarfile
from pathlib import Path

import numpy as np
import pytest

from tests.mask_files import noise, png
from torchlinf.scoring import Source, find_masks, read_source, score_masks


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def add(archive: tarfile.TarFile, name: str, content: bytes = b"", **fields: object) -> None:
    info = tarfile.TarInfo(name)
    info.size = len(content)
    for key, value in fields.items():
        setattr(info, key, value)
    archive.addfile(info, io.BytesIO(content))


def pack(path: Path, members: dict[str, bytes]) -> Path:
    with tarfile.open(path, "w") as archive:
        for name, content in members.items():
            add(archive, name, content)
    return path


def members(sources: list[Source]) -> list[str | None]:
    return [source.member for source in sources]


def test_the_members_of_a_shard_are_masks_in_its_order(tmp_path: Path) -> None:
    first, volume = noise(0, 9, 14), noise(1, 4, 6, 5)
    single = io.BytesIO()
    np.savez(single, first)
    content = {
        "b/01.png": png(first),
        "b/01.json": b"{}",
        "a/02.npy": npy(volume),
        "03.cls": b"3",
        "04.npz": single.getvalue(),
    }
    pack(tmp_path / "shard.tar", content)
    found = find_masks([tmp_path])
    assert [source.name for source in found] == [
        f"{tmp_path}/shard.tar:{n}" for n in ("b/01.png", "a/02.npy", "04.npz")
    ]
    for source, mask in zip(found, (first, volume, first), strict=True):
        np.testing.assert_array_equal(read_source(source, volume=mask.ndim == 3), mask)
    rows = list(score_masks(found, volume=True))
    assert [row.error for row in rows] == [None] * 3
    assert [row.pixels for row in rows] == [first.sum(), volume.sum(), first.sum()]
    assert os.listdir(tmp_path) == ["shard.tar"]


def test_which_members_are_masks_can_be_said(tmp_path: Path) -> None:
    content = {"1.jpg": b"?", "1.mask.png": png(noise(0, 5, 7)), "2.jpg": b"?", "2.mask.png": png(noise(1, 5, 7))}
    shard = pack(tmp_path / "shard.tar", content)
    assert members(find_masks([shard])) == list(content)
    assert members(find_masks([shard], members="*.mask.png")) == ["1.mask.png", "2.mask.png"]


def test_evil_members_are_rows_and_nothing_is_written(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (os.mkdir, (str(tmp_path / "ran"),))

    shard, good = tmp_path / "in" / "shard.tar", png(noise(0, 8, 5))
    shard.parent.mkdir()
    with tarfile.open(shard, "w") as archive:
        for name in (f"{tmp_path}/absolute.png", "../up.png", "a/../../up.png", "..\\up.png", "good.png", "good.png"):
            add(archive, name, good)
        add(archive, "link.png", type=tarfile.SYMTYPE, linkname="/etc/passwd")
        add(archive, "hard.png", type=tarfile.LNKTYPE, linkname="good.png")
        add(archive, "pipe.png", type=tarfile.FIFOTYPE)
        add(archive, "empty.png")
        add(archive, "pickle.npy", npy(np.array([[Bomb()]], dtype=object)))
        add(archive, "text.png", b"no image")
        add(archive, "folder.png", type=tarfile.DIRTYPE)
    rows = list(score_masks(find_masks([shard])))
    errors = [row.error for row in rows]
    assert [error for error in errors if error is None] == [None]  # one good member, once
    assert [row.path for row in rows if row.error is None] == [f"{shard}:good.png"]
    words = ["leads out"] * 4 + ["another member"] + ["not a plain file"] * 3
    words += ["empty", "got object", "not an image"]
    failed = [error for error in errors if error]
    assert len(failed) == len(words)
    assert all(word in error for word, error in zip(words, failed, strict=True))
    assert len({row.path for row in rows}) == len(rows)
    assert os.listdir(tmp_path) == ["in"]
    assert os.listdir(shard.parent) == ["shard.tar"]


@pytest.mark.parametrize("keep", [600, 700, 1500, 2048, 2100, 3072])
def test_a_truncated_shard_says_so_after_what_is_whole(keep: int, tmp_path: Path) -> None:
    mask = noise(0, 6, 9)
    shard = pack(tmp_path / "shard.tar", {f"{i}.png": png(mask) for i in range(3)})  # 1024 bytes each
    whole = shard.read_bytes()
    shard.write_bytes(whole[:keep])
    rows = list(score_masks(find_masks([shard])))
    complete = sum(1024 * i + 512 + len(png(mask)) <= keep for i in range(3))
    assert [row.pixels for row in rows if row.error is None] == [mask.sum()] * complete
    assert "damaged" in rows[-1].error


def test_what_is_no_tar_is_a_row(tmp_path: Path) -> None:
    (tmp_path / "a.tar").write_bytes(b"x" * 2000)
    (tmp_path / "b.tar").write_bytes(b"")
    with tarfile.open(tmp_path / "c.tar", "w:gz") as archive:
        add(archive, "1.png", png(noise(0, 5, 7)))
    rows = list(score_masks(find_masks([tmp_path])))
    assert [os.path.basename(row.path) for row in rows] == ["a.tar", "b.tar", "c.tar"]
    assert all("uncompressed tar" in row.error for row in rows)


def test_a_damaged_header_in_the_middle_is_not_the_end(tmp_path: Path) -> None:
    shard = pack(tmp_path / "shard.tar", {f"{i}.png": png(noise(i, 6, 9)) for i in range(3)})
    content = bytearray(shard.read_bytes())
    content[1024:1124] = b"?" * 100
    shard.write_bytes(content)
    rows = list(score_masks(find_masks([shard])))
    assert [row.error is None for row in rows] == [True, False]
    assert "at byte 1024" in rows[1].error


def test_a_member_cannot_read_past_its_end(tmp_path: Path) -> None:
    """A cut image is truncated, even if what comes after it in the archive would complete it."""
    content = png(noise(0, 60, 90))
    shard = pack(tmp_path / "shard.tar", {"1.png": content[:512], "2.png": content})
    rows = list(score_masks(find_masks([shard])))
    assert "truncated" in rows[0].error
    assert rows[1].error is None


def test_patterns(tmp_path: Path) -> None:
    for name in ("b.png", "a.png", "deep/c.png", "deep/d.npy", "[x].png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"?")

    def found(pattern: str) -> list[str]:
        return [os.path.relpath(source.name, tmp_path) for source in find_masks([tmp_path / pattern])]

    assert found("?.png") == ["a.png", "b.png"]
    assert found("**/*.png") == ["[x].png", "a.png", "b.png", "deep/c.png"]
    assert found("[x].png") == ["[x].png"]  # a file of that very name
    assert found("*.bmp") == []
    assert found("none.bmp") == ["none.bmp"]  # no pattern: a row that says it is missing
