"""WebP, AVIF, PBM, PGM and PPM, and PNG with 16-bit colours: the numbers that were written."""

import io
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, features

from torchlinf.scoring import UnreadableMaskError, find_masks, read_mask, score_masks

MASK = np.zeros((21, 34), dtype=bool)
MASK[2:17, 3:25] = True
MASK[6:9, 8:15] = False
MASK[10:13, 28:32] = True
LABELS = MASK * (1 + (np.arange(34) // 9))  # 1, 2, 3 and 4


def plain(kind: str, numbers: np.ndarray, top: int | None = None) -> bytes:
    """A plain PBM, PGM or PPM with comments, as its definition allows."""
    height, width = numbers.shape[:2]
    size = f"{kind} # a comment 3 4\n{width}\n# another\n {height}" + ("" if top is None else f"\t{top}") + "\n"
    return (size + "\n".join(" ".join(map(str, row.ravel())) for row in numbers)).encode()


def test_plain_and_binary_netpbm(tmp_path: Path) -> None:
    header = f"{MASK.shape[1]} {MASK.shape[0]}\n"
    black = ~MASK  # in a PBM 1 is black
    files = {
        "1.pbm": plain("P1", black.astype(int)),
        "2.pbm": b"P1\n" + header.encode() + "".join(map(str, black.ravel().astype(int))).encode(),
        "3.pbm": b"P4\n" + header.encode() + np.packbits(black, axis=1).tobytes(),
        "4.pgm": plain("P2", 255 * MASK.astype(int), 255),
        "5.pgm": f"P5 {header}255\n".encode() + (255 * MASK).astype(np.uint8).tobytes(),
        "6.pgm": f"P5 {header}65535\n".encode() + (65535 * MASK).astype(">u2").tobytes(),
        "7.ppm": f"P6 {header}255\n".encode() + np.repeat(255 * MASK, 3).astype(np.uint8).tobytes(),
        "8.ppm": plain("P3", np.stack([7 * MASK] * 3, axis=-1), 7),
        "9.pnm": f"P5\n#c\n{header}#d\n9\n".encode() + (9 * MASK).astype(np.uint8).tobytes(),
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        np.testing.assert_array_equal(read_mask(tmp_path / name), MASK, err_msg=name)
    assert len(find_masks([tmp_path])) == len(files)


@pytest.mark.parametrize("top", [4, 20, 255, 300, 65535])
def test_labels_are_not_scaled(top: int, tmp_path: Path) -> None:
    height, width = LABELS.shape
    dtype = ">u1" if top < 256 else ">u2"
    (tmp_path / "a.pgm").write_bytes(f"P5 {width} {height} {top} ".encode() + LABELS.astype(dtype).tobytes())
    (tmp_path / "b.pgm").write_bytes(plain("P2", LABELS, top))
    for name in ("a.pgm", "b.pgm"):
        np.testing.assert_array_equal(read_mask(tmp_path / name, label=3), LABELS == 3)


def test_grey_goes_by_its_own_white(tmp_path: Path) -> None:
    ramp = np.arange(21 * 34).reshape(21, 34) % 100
    (tmp_path / "a.pgm").write_bytes(plain("P2", ramp, 99))
    np.testing.assert_array_equal(read_mask(tmp_path / "a.pgm"), ramp > 49)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"P5 3 3 255 12345678", "truncated: 8 of 9"),
        (b"P2 3 2 255 1 2 3 4 5", "truncated: 5 of 6"),
        (b"P2 3 1 2 1 2 3", "holds the number 3"),
        (b"P4 9 2 abc", "truncated: 3 of 4"),
        (b"P5 3", "without width, height and largest number"),
        (b"P5 0 3 255 ", "an image of 0 x 3"),
        (b"P5 3 3 70000 ", "numbers up to 70000"),
        (b"P6 900000 900000 255 ", "more than the limit"),
        (b"P2 2 1 255 1 x", "damaged"),
    ],
)
def test_damaged_netpbm(content: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.pgm").write_bytes(content)
    with pytest.raises(UnreadableMaskError, match=words):
        read_mask(tmp_path / "a.pgm")


def test_webp_keeps_labels_where_it_is_lossless(tmp_path: Path) -> None:
    labels = Image.fromarray((60 * LABELS).astype(np.uint8))
    labels.save(tmp_path / "a.webp", lossless=True)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.webp", label=180), LABELS == 3)
    labels.convert("RGBA").save(
        tmp_path / "b.webp", lossless=True, save_all=True, append_images=[Image.new("RGBA", (34, 21))]
    )
    np.testing.assert_array_equal(read_mask(tmp_path / "b.webp", label=180), LABELS == 3)
    Image.fromarray((255 * MASK).astype(np.uint8)).save(tmp_path / "c.webp", quality=95)
    np.testing.assert_array_equal(read_mask(tmp_path / "c.webp"), MASK)
    with pytest.raises(UnreadableMaskError, match="lossy compression changes labels"):
        read_mask(tmp_path / "c.webp", label=255)
    clear = np.dstack([np.zeros((21, 34, 3), np.uint8), (255 * MASK).astype(np.uint8)])
    Image.fromarray(clear).save(tmp_path / "d.webp", lossless=True)
    np.testing.assert_array_equal(read_mask(tmp_path / "d.webp"), MASK)


@pytest.mark.skipif(not features.check("avif"), reason="this Pillow has no AVIF")
def test_avif_is_a_lossy_picture(tmp_path: Path) -> None:
    Image.fromarray((255 * MASK).astype(np.uint8)).save(tmp_path / "a.avif", quality=95)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.avif"), MASK)
    with pytest.raises(UnreadableMaskError, match="lossy compression changes labels"):
        read_mask(tmp_path / "a.avif", label=255)


@pytest.mark.parametrize("kind", ["webp", "avif"])
def test_without_a_decoder_the_row_says_what_to_do(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    starts = {"webp": b"RIFF\x20\0\0\0WEBPVP8L", "avif": b"\0\0\0\x20ftypavif\0\0\0\0avifmif1"}
    (tmp_path / f"a.{kind}").write_bytes(starts[kind] + b"\0" * 40)
    (row,) = score_masks(find_masks([tmp_path]))
    assert "Pillow" not in row.error
    monkeypatch.setattr(features, "check", lambda name: name != kind)
    plugin = "WebP" if kind == "webp" else "Avif"
    monkeypatch.setattr(f"PIL.{plugin}ImagePlugin.SUPPORTED", False)
    (row,) = score_masks(find_masks([tmp_path]))
    assert f"is installed without {kind.upper()}. Run: pip install --upgrade pillow" in row.error


def test_a_png_with_16_bit_colours_needs_imagecodecs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    imagecodecs = pytest.importorskip("imagecodecs")
    red = np.stack([MASK * 257, 0 * MASK, 0 * MASK], axis=-1).astype(np.uint16)  # the low bytes tell
    red[:, :9, 0] += 1
    (tmp_path / "a.png").write_bytes(imagecodecs.png_encode(red))
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png", label=258), MASK & (np.arange(34) < 9))
    monkeypatch.setitem(sys.modules, "imagecodecs", None)
    with pytest.raises(UnreadableMaskError, match=r"pip install 'torchlinf\[codecs\]'. Or save it as TIFF"):
        read_mask(tmp_path / "a.png")


def test_files_in_memory_are_known_by_their_beginning() -> None:
    from torchlinf.scoring.in_memory import InMemory, values_in_memory

    file = io.BytesIO()
    Image.fromarray((60 * LABELS).astype(np.uint8)).save(file, "WEBP", lossless=True)
    for content in (file.getvalue(), plain("P2", 60 * LABELS, 240)):
        np.testing.assert_array_equal(values_in_memory(InMemory(content), max_pixels=999).array, 60 * LABELS)
