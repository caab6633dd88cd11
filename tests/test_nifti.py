"""NIfTI files, written byte by byte: every type, byte order and version gives the numbers that were written."""

import gzip
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from torchlinf.measure import complexity
from torchlinf.scoring import UnreadableMaskError, find_masks, read_mask, score_masks

CODES = {"u1": 2, "i2": 4, "i4": 8, "f4": 16, "f8": 64, "i1": 256, "u2": 512, "u4": 768, "i8": 1024, "u8": 1280}

# (X, Y, Z) as the file has it: no two sides are equal, two labels, a hole.
LABELS = np.zeros((9, 13, 6), dtype=np.int64)
LABELS[1:7, 2:11, 1:5] = 3
LABELS[3:5, 5:7, 2:4] = 0
LABELS[7:9, 0:6, 0:6] = 120


def value(mask: np.ndarray) -> float:
    return complexity(torch.from_numpy(np.ascontiguousarray(mask)), spatial_ndim=mask.ndim).item()


def nifti(
    array: np.ndarray,
    dtype: str = "u1",
    *,
    order: str = "<",
    version: int = 1,
    sizes: tuple[float, ...] = (1.0, 1.0, 1.0),
    slope: float = 0.0,
    intercept: float = 0.0,
    code: int | None = None,
) -> bytes:
    """A file by the definition of the format; the first axis of the array is the fastest one."""
    dims = [array.ndim, *array.shape, *[1] * (7 - array.ndim)]
    pixdim = [1.0, *sizes, *[1.0] * (7 - len(sizes))]
    stored = np.dtype(order + dtype)
    header = bytearray(348 if version == 1 else 540)
    kind = CODES[dtype] if code is None else code
    if version == 1:
        struct.pack_into(f"{order}i", header, 0, 348)
        struct.pack_into(f"{order}8h", header, 40, *dims)
        struct.pack_into(f"{order}hh", header, 70, kind, 8 * stored.itemsize)
        struct.pack_into(f"{order}8f", header, 76, *pixdim)
        struct.pack_into(f"{order}fff", header, 108, 352.0, slope, intercept)
        header[344:348] = b"n+1\0"
    else:
        struct.pack_into(f"{order}i8s", header, 0, 540, b"n+2\0\r\n\x1a\n")
        struct.pack_into(f"{order}hh8q", header, 12, kind, 8 * stored.itemsize, *dims)
        struct.pack_into(f"{order}8d", header, 104, *pixdim)
        struct.pack_into(f"{order}qdd", header, 168, 544, slope, intercept)
    return bytes(header) + b"\0" * 4 + array.astype(stored).tobytes(order="F")


def save(path: Path, content: bytes) -> Path:
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("dtype", list(CODES))
def test_every_type_in_both_byte_orders(dtype: str, order: str, version: int, tmp_path: Path) -> None:
    for name in ("a.nii", "a.nii.gz"):
        path = save(tmp_path / name, nifti(LABELS, dtype, order=order, version=version))
        np.testing.assert_array_equal(read_mask(path, label=120), LABELS.T == 120)
        np.testing.assert_array_equal(read_mask(path, nonzero=True), LABELS.T > 0)


def test_integers_stay_integers(tmp_path: Path) -> None:
    big = 2**62 + 1  # no float holds it
    path = save(tmp_path / "a.nii.gz", nifti(np.where(LABELS == 3, big, LABELS), "i8", slope=1.0))
    np.testing.assert_array_equal(read_mask(path, label=big), LABELS.T == 3)


def test_a_scale_in_the_header_counts(tmp_path: Path) -> None:
    path = save(tmp_path / "a.nii", nifti(LABELS, slope=2.0, intercept=5.0))
    np.testing.assert_array_equal(read_mask(path, label=11), LABELS.T == 3)
    shares = nifti(np.where(LABELS == 3, 200, LABELS), slope=1 / 255)
    np.testing.assert_array_equal(read_mask(save(path, shares)), LABELS.T == 3)
    np.testing.assert_array_equal(read_mask(save(path, nifti(LABELS, slope=float("nan"))), label=3), LABELS.T == 3)


def test_a_volume_needs_no_option_and_an_atlas_asks_for_labels(tmp_path: Path) -> None:
    save(tmp_path / "atlas.nii.gz", nifti(LABELS, "u2", sizes=(2.0, 2.0, 2.0)))
    save(tmp_path / "mask.nii", nifti(LABELS > 0))
    atlas, mask = score_masks(find_masks([tmp_path]))
    assert "3 values (0, 3, 120), and inside is not clear: pass --labels" in atlas.error
    assert (mask.depth, mask.height, mask.width, mask.pixels) == (6, 13, 9, (LABELS > 0).sum())
    rows = list(score_masks(find_masks([tmp_path / "atlas.nii.gz"]), labels=True))
    assert [row.label for row in rows] == [3, 120]
    assert [row.path for row in rows] == [f"{tmp_path}/atlas.nii.gz#{label}" for label in (3, 120)]
    assert [row.pixels for row in rows] == [(label == LABELS).sum() for label in (3, 120)]
    assert [row.spacing for row in rows] == ["2 x 2 x 2"] * 2
    alone = value(LABELS == 3)
    assert rows[0]["complexity"] == pytest.approx(alone, abs=1e-9)
    assert rows[1]["complexity"] == 0.0


def test_not_a_number_is_outside(tmp_path: Path) -> None:
    holed = np.where(LABELS == 0, np.nan, 1.0)
    path = save(tmp_path / "a.nii.gz", nifti(holed, "f4"))
    np.testing.assert_array_equal(read_mask(path), LABELS.T > 0)
    np.testing.assert_array_equal(read_mask(path, threshold=2, invert=True), LABELS.T > 0)


def test_axes_of_one_voxel_are_dropped(tmp_path: Path) -> None:
    for index, kept in ((np.s_[:, :, 2:3], (9, 13)), (np.s_[:, 5:6, :], (9, 6)), (np.s_[4:5, :, :], (13, 6))):
        plane = LABELS[index] == 3
        read = read_mask(save(tmp_path / "a.nii", nifti(plane)))
        np.testing.assert_array_equal(read, plane.reshape(kept).T)
    line = LABELS[:, 3:4, 2:3] == 3
    assert read_mask(save(tmp_path / "a.nii", nifti(line))).shape == (1, 9)


def test_several_volumes_are_a_stack(tmp_path: Path) -> None:
    one = save(tmp_path / "one.nii", nifti((LABELS > 0)[..., None]))
    np.testing.assert_array_equal(read_mask(one), LABELS.T > 0)
    film = np.stack([LABELS == 3, LABELS == 120], axis=-1)
    path = save(tmp_path / "film.nii.gz", nifti(film, sizes=(1.0, 1.0, 2.0)))
    with pytest.raises(UnreadableMaskError, match=r"2 volumes, \(2, 6, 13, 9\): pass --stack"):
        read_mask(path)
    rows = list(score_masks(find_masks([path]), stack=True))
    assert [row.path for row in rows] == [f"{path}[0]", f"{path}[1]"]
    assert [row.pixels for row in rows] == [(LABELS == 3).sum(), (LABELS == 120).sum()]
    assert {row.spacing for row in rows} == {"2 x 1 x 1 in cubes of 1"}


def test_oblong_voxels_are_brought_to_cubes(tmp_path: Path) -> None:
    """The header's sizes are used, a box has exactly 0, and the numbers are those of the voxels repeated."""
    box = np.zeros((20, 30, 8), dtype=bool)
    box[3:15, 4:23, 2:7] = True
    notched = box.copy()
    notched[3:9, 4:13, 2:4] = False
    for name, mask in (("box.nii", box), ("notched.nii", notched)):
        save(tmp_path / name, nifti(mask, sizes=(0.9, 0.9, 2.7)))
    first, second = score_masks(find_masks([tmp_path]))
    assert (first["complexity"], first.spacing) == (0.0, "2.7 x 0.9 x 0.9 in cubes of 0.9")
    assert first.radius == 6  # of 15 x 19 x 12 cubes, not of 5 slices
    cubes = np.repeat(notched.T, 3, axis=0)
    assert second.pixels == notched.sum()
    assert second["complexity"] == pytest.approx(value(cubes), abs=1e-9)
    plain = list(score_masks(find_masks([tmp_path / "notched.nii"]), spacing="pixels"))
    assert plain[0].spacing is None
    assert plain[0]["complexity"] == pytest.approx(value(notched.T), abs=1e-9)
    assert plain[0]["complexity"] != pytest.approx(second["complexity"], abs=1e-3)


def test_what_is_no_mask_is_refused(tmp_path: Path) -> None:
    path, good = tmp_path / "a.nii", nifti(LABELS, "u2")
    for content, word in (
        (b"x" * 1000, "not a NIfTI image"),
        (good[:-100], "truncated"),
        (good[:345] + b"?" + good[346:], "not a NIfTI image"),
        (nifti(LABELS, code=32), "complex numbers"),
        (nifti(LABELS, code=128), "colours"),
        (nifti(np.zeros((3, 0, 4))), "must hold voxels"),
        (nifti(np.zeros((1, 1, 1)))[:40] + struct.pack("<8h", 3, 30000, 30000, 30000, 1, 1, 1, 1) + good[56:], "limit"),
    ):
        with pytest.raises(UnreadableMaskError, match=word):
            read_mask(save(path, content))
    packed = gzip.compress(nifti(np.random.default_rng(0).integers(0, 2, (20, 30, 40)), "u2"))
    (tmp_path / "a.nii.gz").write_bytes(packed[: len(packed) // 2])
    with pytest.raises(UnreadableMaskError, match="truncated"):
        read_mask(tmp_path / "a.nii.gz")


def test_without_nibabel_the_row_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "nibabel", None)
    save(tmp_path / "a.nii", nifti(LABELS))
    (row,) = score_masks(find_masks([tmp_path]))
    assert "pip install 'torchlinf[nifti]'" in row.error
