"""Files that hold no mask: explained in words, and refused before memory is taken for them."""

import io
import os
import struct
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from torchlinf.scoring import UnreadableMaskError, read_mask

MASK = np.arange(21 * 34).reshape(21, 34) % 5 > 1

GREY = np.where(MASK, 255, 0).astype(np.uint8)


def png_header(width: int, height: int) -> bytes:
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    end = b"\0\0\0\0IEND" + struct.pack(">I", zlib.crc32(b"IEND"))
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header)) + end


def npy_header(shape: tuple[int, ...], dtype: str = "|u1") -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": dtype, "fortran_order": False, "shape": shape})
    return file.getvalue()


def bombs(folder: Path) -> dict[str, str]:
    """Small files that claim to be huge, and what the message says of each."""
    (folder / "png.png").write_bytes(png_header(12_000, 12_000))
    (folder / "pillow.png").write_bytes(png_header(900_000, 900_000))
    (folder / "npy.npy").write_bytes(npy_header((1 << 20, 1 << 20)))
    with zipfile.ZipFile(folder / "npz.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("zeros.npy", npy_header((9_000, 9_000)) + bytes(9_000 * 9_000))
    tifffile.imwrite(folder / "tiff.tif", np.zeros((2, 3), np.uint8))
    forged = (folder / "tiff.tif").read_bytes()
    forged = forged.replace(struct.pack("<HHII", 256, 4, 1, 3), struct.pack("<HHII", 256, 4, 1, 20_000))
    forged = forged.replace(struct.pack("<HHII", 257, 4, 1, 2), struct.pack("<HHII", 257, 4, 1, 6_000))
    (folder / "tiff.tif").write_bytes(forged)
    return {
        "png.png": "limit of",
        "pillow.png": "900000 x 900000",
        "npy.npy": "1048576 x 1048576",
        "npz.npz": "9000 x 9000",
        "tiff.tif": "6000 x 20000",
    }


def test_bombs_are_refused_by_their_header(tmp_path: Path) -> None:
    expected = bombs(tmp_path)
    tracemalloc.start()
    try:
        for name, words in expected.items():
            with pytest.raises(UnreadableMaskError, match=words):
                read_mask(tmp_path / name)
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()


def test_the_limit_can_be_moved(tmp_path: Path) -> None:
    Image.fromarray(GREY).save(tmp_path / "mask.png")
    read_mask(tmp_path / "mask.png", max_pixels=MASK.size)
    with pytest.raises(UnreadableMaskError, match="21 x 34 pixels are more than the limit of 713"):
        read_mask(tmp_path / "mask.png", max_pixels=MASK.size - 1)


def bad_files(folder: Path) -> dict[str, str]:
    """Files of every kind that hold no mask, and what the message says of each."""
    Image.fromarray(GREY).save(folder / "whole.png")
    np.save(folder / "whole.npy", MASK)
    Image.fromarray(GREY).save(folder / "pages.tif", save_all=True, append_images=[Image.fromarray(GREY[:, :9])])
    contents = {
        "empty.png": b"",
        "empty.npy": b"",
        "text.png": b"this is no image",
        "text.npy": b"this is no array",
        "text.npz": b"this is no archive",
        "text.tif": b"this is no TIFF",
        "magic.tif": b"II*\0\x08\0\0\0\xff\xff",
        "cut.png": (folder / "whole.png").read_bytes()[:70],
        "header.png": (folder / "whole.png").read_bytes()[:20],
        "cut.npy": (folder / "whole.npy").read_bytes()[:200],
        "header.npy": (folder / "whole.npy").read_bytes()[:9],
        "size0.npy": npy_header((0, 5)),
        "flat.npy": npy_header((5,)) + bytes(5),
        "four.npy": npy_header((2, 2, 2, 2)) + bytes(16),
        "complex.npy": npy_header((2, 2), "<c8") + bytes(32),
        "text-values.npy": npy_header((2, 2), "<U1") + bytes(16),
    }
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    np.save(folder / "pickle.npy", np.array([[{}]], dtype=object), allow_pickle=True)
    (folder / "folder.png").mkdir()
    return {
        "missing.png": "no such file",
        "empty.png": "empty",
        "empty.npy": "empty",
        "text.png": "not an image",
        "text.npy": "not a .npy array",
        "text.npz": "not an .npz archive",
        "text.tif": "not a TIFF",
        "magic.tif": "TIFF|damaged",
        "cut.png": "truncated",
        "header.png": "not an image|truncated",
        "cut.npy": "truncated",
        "header.npy": "truncated",
        "size0.npy": r"got shape \(0, 5\)",
        "flat.npy": r"got shape \(5,\)",
        "four.npy": r"got shape \(2, 2, 2, 2\)",
        "complex.npy": "got complex64",
        "text-values.npy": "got <U1",
        "pickle.npy": "got object",
        "pages.tif": "of one size",
        "folder.png": "not a regular file",
    }


def test_bad_files_are_explained(tmp_path: Path) -> None:
    for name, words in bad_files(tmp_path).items():
        with pytest.raises(UnreadableMaskError, match=words):
            read_mask(tmp_path / name)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
def test_a_named_pipe_is_not_waited_for(tmp_path: Path) -> None:
    for name in ("pipe.png", "pipe.npz"):
        os.mkfifo(tmp_path / name)
        with pytest.raises(UnreadableMaskError, match="not a regular file"):
            read_mask(tmp_path / name)


def test_pickle_is_not_run(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (os.mkdir, (str(tmp_path / "ran"),))

    np.savez(tmp_path / "bomb.npz", np.array([[Bomb()]], dtype=object))
    with pytest.raises(UnreadableMaskError, match="got object"):
        read_mask(tmp_path / "bomb.npz")
    assert not (tmp_path / "ran").exists()


def test_which_array_of_an_archive(tmp_path: Path) -> None:
    np.savez(tmp_path / "two.npz", a=MASK, b=~MASK)
    np.testing.assert_array_equal(read_mask(tmp_path / "two.npz", member="b"), ~MASK)
    with pytest.raises(UnreadableMaskError, match="it holds 2"):
        read_mask(tmp_path / "two.npz")
    with pytest.raises(UnreadableMaskError, match="no item named"):
        read_mask(tmp_path / "two.npz", member="c")
