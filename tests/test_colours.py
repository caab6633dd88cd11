"""Colours, palettes, transparency and odd depths: two colours are two values, more are labels."""

import io
import struct
import sys
import zlib
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from torchlinf.scoring import UnreadableMaskError, find_masks, read_mask, score_masks

MASK = np.zeros((21, 34), dtype=bool)
MASK[2:17, 3:25] = True
MASK[6:9, 8:15] = False
MASK[10:13, 28:32] = True

RED, GREEN, BLUE, WHITE, BLACK = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255), (0, 0, 0)
STRIPES = MASK * (1 + np.arange(34) // 12)  # 1, 2 and 3
COLOURS = np.array([BLACK, RED, GREEN, BLUE], np.uint8)[STRIPES]


def coloured(inside: tuple[int, ...], outside: tuple[int, ...]) -> np.ndarray:
    return np.where(MASK[..., None], np.uint8(inside), np.uint8(outside))


def png(rows: list[bytes], width: int, bits: int, kind: int, chunks: bytes = b"") -> bytes:
    """A PNG by its definition, for what Pillow does not write."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, len(rows), bits, kind, 0, 0, 0))
    extra = chunk(b"tRNS", chunks) if chunks else b""
    data = chunk(b"IDAT", zlib.compress(b"".join(b"\0" + row for row in rows)))
    return b"\x89PNG\r\n\x1a\n" + header + extra + data + chunk(b"IEND", b"")


@pytest.mark.parametrize("colour", [RED, GREEN, BLUE, WHITE, (1, 0, 0), (128, 128, 0), (90, 90, 90)])
def test_a_colour_on_black_is_inside(colour: tuple[int, int, int], tmp_path: Path) -> None:
    Image.fromarray(coloured(colour, BLACK)).save(tmp_path / "a.png")
    np.save(tmp_path / "a.npy", coloured(colour, BLACK))
    for name in ("a.png", "a.npy"):
        np.testing.assert_array_equal(read_mask(tmp_path / name), MASK)


@pytest.mark.parametrize("outside", [BLUE, WHITE, (254, 0, 0)])
def test_two_colours_without_black_must_be_asked(outside: tuple[int, int, int], tmp_path: Path) -> None:
    Image.fromarray(coloured(RED, outside)).save(tmp_path / "a.png")
    ids = sorted([255, outside[0] + 256 * outside[1] + 65536 * outside[2]])
    (row,) = score_masks(find_masks([tmp_path]))
    assert f"2 colours (R + 256 G + 65536 B: {ids[0]}, {ids[1]})" in row.error
    assert "pass --labels" in row.error
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png", label=255), MASK)


def test_more_colours_are_labels(tmp_path: Path) -> None:
    Image.fromarray(COLOURS).save(tmp_path / "a.png")
    with pytest.raises(UnreadableMaskError, match=r"4 colours .* 0, 255, 65280, 16711680\)"):
        read_mask(tmp_path / "a.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png", nonzero=True), MASK)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png", threshold=127), MASK)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png", label=65280), STRIPES == 2)
    rows = list(score_masks(find_masks([tmp_path]), labels=True))
    assert [(row.label, row.pixels) for row in rows] == [
        (255, (STRIPES == 1).sum()), (65280, (STRIPES == 2).sum()), (16711680, (STRIPES == 3).sum())
    ]  # fmt: skip


@pytest.mark.parametrize(("inside", "outside"), [(RED, BLACK), (WHITE, BLACK), ((200, 255, 90), (0, 20, 10))])
def test_lossy_colours_on_dark_ground(inside: tuple[int, ...], outside: tuple[int, ...], tmp_path: Path) -> None:
    Image.fromarray(coloured(inside, outside)).save(tmp_path / "a.jpg", quality=95, subsampling=0)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.jpg"), MASK)


@pytest.mark.parametrize(("inside", "outside"), [(RED, BLUE), (RED, WHITE), ((90, 0, 0), (0, 0, 90))])
def test_other_lossy_colours_must_be_asked(inside: tuple[int, ...], outside: tuple[int, ...], tmp_path: Path) -> None:
    Image.fromarray(coloured(inside, outside)).save(tmp_path / "a.jpg", quality=95, subsampling=0)
    with pytest.raises(UnreadableMaskError, match="changed by compression: pass --threshold for the brightest"):
        read_mask(tmp_path / "a.jpg")
    with pytest.raises(UnreadableMaskError, match="lossy compression changes labels"):
        read_mask(tmp_path / "a.jpg", label=255)


def palette(indices: np.ndarray, *colours: tuple[int, int, int]) -> Image.Image:
    image = Image.frombytes("P", indices.shape[::-1], indices.astype(np.uint8).tobytes())
    image.putpalette([channel for colour in colours for channel in colour])
    return image


@pytest.mark.parametrize("suffix", ["png", "gif", "bmp"])
@pytest.mark.parametrize("ground", [WHITE, BLACK, BLUE])
def test_index_0_of_a_palette_is_outside(ground: tuple[int, int, int], suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    palette(MASK, ground, RED).save(path)
    np.testing.assert_array_equal(read_mask(path), MASK)
    palette(STRIPES, ground, RED, GREEN, (8, 7, 6)).save(path)
    np.testing.assert_array_equal(read_mask(path, label=2), STRIPES == 2)
    with pytest.raises(UnreadableMaskError, match=r"4 values \(0, 1, 2, 3\)"):
        read_mask(path)
    if suffix == "gif":
        return  # Pillow takes what is not used out of the palette
    palette(2 - MASK, ground, RED, GREEN).save(path)  # 1 and 2: none is background
    with pytest.raises(UnreadableMaskError, match=r"2 values \(1, 2\)"):
        read_mask(path)


def test_the_labels_of_a_grey_palette_are_its_indices(tmp_path: Path) -> None:
    palette(STRIPES, BLACK, (80, 80, 80), (160, 160, 160), WHITE).save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png", label=2), STRIPES == 2)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png", threshold=100), STRIPES > 1)


@pytest.mark.parametrize("mode", ["1", "L", "I;16", "RGB"])
def test_transparency_by_a_value(mode: str, tmp_path: Path) -> None:
    """White where the mask is, on a transparent ground; and black, where the opacity is the mask."""
    dtype = {"1": bool, "I;16": np.uint16}.get(mode, np.uint8)
    top = 1 if mode == "1" else np.iinfo(dtype).max
    for ink, ground in ((top, 0), (0, top)):
        array = np.where(MASK, ink, ground).astype(dtype)
        image = Image.fromarray(np.dstack([array] * 3) if mode == "RGB" else array)
        image.save(tmp_path / "a.png", transparency=(ground,) * 3 if mode == "RGB" else int(ground))
        with Image.open(tmp_path / "a.png") as again:
            assert again.mode.startswith(mode[:1])
            assert "transparency" in again.info
        np.testing.assert_array_equal(read_mask(tmp_path / "a.png"), MASK)


@pytest.mark.parametrize("bits", [1, 2, 4, 8, 16])
def test_grey_of_every_depth(bits: int, tmp_path: Path) -> None:
    labels = np.where(2**bits - 1 < STRIPES, 1, STRIPES)[:, :32]
    if bits == 16:
        rows = [row.astype(">u2").tobytes() for row in labels]
    else:
        each = (labels[..., None] >> np.arange(bits)[::-1]) & 1
        rows = [np.packbits(row.ravel()).tobytes() for row in each]
    (tmp_path / "a.png").write_bytes(png(rows, 32, bits, 0))
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png", label=1), labels == 1)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png", nonzero=True), labels != 0)
    found = {row.label for row in score_masks(find_masks([tmp_path]), labels=True)}
    assert found == set(np.unique(labels)) - {0}
    clear = struct.pack(">H", 1)
    (tmp_path / "a.png").write_bytes(png(rows, 32, bits, 0, clear))
    if bits > 1:
        np.testing.assert_array_equal(read_mask(tmp_path / "a.png", nonzero=True), labels > 1)


@pytest.mark.parametrize("kind", [2, 4, 6])
def test_colours_of_16_bits_in_a_png_keep_all_bits_or_are_refused(
    kind: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    channels = {2: 3, 4: 2, 6: 4}[kind]
    rows = [np.repeat(row, channels).astype(">u2").tobytes() for row in STRIPES]
    (tmp_path / "a.png").write_bytes(png(rows, 34, 16, kind))
    if kind == 2 and find_spec("imagecodecs") is not None:  # three equal channels are grey
        np.testing.assert_array_equal(read_mask(tmp_path / "a.png", label=1), STRIPES == 1)
    monkeypatch.setitem(sys.modules, "imagecodecs", None)
    with pytest.raises(UnreadableMaskError, match="16-bit colours needs imagecodecs"):
        read_mask(tmp_path / "a.png")


@pytest.mark.parametrize("last", [1, 3, 4])
def test_a_last_axis_of_channels(last: int, tmp_path: Path) -> None:
    white = np.repeat(255 * MASK[..., None].astype(np.uint8), last, axis=-1)
    if last == 4:
        white[..., 3] = 255
    np.save(tmp_path / "a.npy", white)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.npy"), MASK)
    stack = np.stack([white, white[::-1]])
    np.save(tmp_path / "a.npy", stack)
    rows = list(score_masks(find_masks([tmp_path]), stack=True))
    assert [(row.path[-3:], row.pixels, row.depth) for row in rows] == [
        ("[0]", MASK.sum(), None), ("[1]", MASK.sum(), None)
    ]  # fmt: skip
    np.save(tmp_path / "a.npy", np.ones((5, 6, last), np.uint8))
    assert read_mask(tmp_path / "a.npy", volume=True).shape == (5, 6, last)


def test_colours_in_a_buffer_of_signed_numbers(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", COLOURS.astype(np.int64))
    np.testing.assert_array_equal(read_mask(tmp_path / "a.npy", label=255), STRIPES == 1)
    np.save(tmp_path / "a.npy", COLOURS / 255)
    with pytest.raises(UnreadableMaskError, match="colours must be unsigned integers"):
        read_mask(tmp_path / "a.npy")


def test_big_endian_arrays(tmp_path: Path) -> None:
    soft = np.asarray(Image.fromarray(255 * MASK.astype(np.uint8)).resize((60, 44), Image.Resampling.BILINEAR))
    for dtype in ("<u2", ">u2"):
        np.save(tmp_path / "a.npy", (soft.astype(np.uint16) * 257).astype(dtype))
        np.testing.assert_array_equal(read_mask(tmp_path / "a.npy"), soft > 127)
    file = io.BytesIO()
    np.savez(file, STRIPES.astype(">i4"))
    (tmp_path / "a.npz").write_bytes(file.getvalue())
    np.testing.assert_array_equal(read_mask(tmp_path / "a.npz", label=3), STRIPES == 3)
