"""TIFF: every byte order, depth, sign and layout gives the numbers that were written."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from torchlinf.scoring import UnreadableMaskError, find_masks, read_mask, score_masks

# H != W, not symmetric, with a hole and a second component.
MASK = np.zeros((21, 34), dtype=bool)
MASK[2:17, 3:25] = True
MASK[6:9, 8:15] = False
MASK[10:13, 28:32] = True

LABELS = MASK * (1 + (np.arange(34) // 9))  # 1, 2, 3 and 4


@pytest.mark.parametrize("byteorder", ["<", ">"])
@pytest.mark.parametrize("bigtiff", [False, True])
@pytest.mark.parametrize("dtype", ["u1", "u2", "u4", "u8", "i1", "i2", "i4", "i8", "f2", "f4", "f8"])
def test_every_type_in_every_byte_order(dtype: str, bigtiff: bool, byteorder: str, tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, MASK.astype(dtype), byteorder=byteorder, bigtiff=bigtiff)
    np.testing.assert_array_equal(read_mask(path), MASK)
    tifffile.imwrite(path, LABELS.astype(dtype), byteorder=byteorder, bigtiff=bigtiff, metadata=None)
    np.testing.assert_array_equal(read_mask(path, label=3), LABELS == 3)
    if dtype[0] != "u":
        tifffile.imwrite(path, np.where(MASK, 1, -1).astype(dtype), byteorder=byteorder)
        np.testing.assert_array_equal(read_mask(path), MASK)
        np.testing.assert_array_equal(read_mask(path, threshold=-2), np.ones_like(MASK))


@pytest.mark.parametrize("byteorder", ["<", ">"])
def test_large_numbers_keep_every_bit(byteorder: str, tmp_path: Path) -> None:
    for dtype, value in (("u4", 2**32 - 5), ("u8", 2**63 - 7), ("i8", 2**62 + 1), ("u2", 65533)):
        labels = np.where(MASK, value, np.where(LABELS.T.reshape(MASK.shape) > 0, value - 1, 0)).astype(dtype)
        tifffile.imwrite(tmp_path / "a.tif", labels, byteorder=byteorder)
        np.testing.assert_array_equal(read_mask(tmp_path / "a.tif", label=value), MASK)
        if dtype == "u2":
            continue  # so fine a mixture of values is a picture
        (row,) = score_masks(find_masks([tmp_path]))
        assert f"--label {value}" in row.error or f"--label {value - 1}" in row.error


@pytest.mark.parametrize("compression", ["zlib", "lzma", None])
@pytest.mark.parametrize("tile", [None, (16, 16)])
def test_compression_and_tiles(compression: str | None, tile: tuple[int, int] | None, tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", LABELS.astype(np.uint16), compression=compression, tile=tile)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif", label=4), LABELS == 4)


@pytest.fixture
def no_imagecodecs(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the extra `codecs` were not installed: tifffile decides that when it is imported."""
    for name in [name for name in sys.modules if name.split(".")[0] in ("imagecodecs", "tifffile")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "imagecodecs", None)


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate", "packbits"])
def test_what_tifffile_alone_cannot_decompress(compression: str, tmp_path: Path) -> None:
    check_decompressed(compression, tmp_path)


@pytest.mark.usefixtures("no_imagecodecs")
@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate", "packbits"])
def test_what_pillow_decompresses_instead(compression: str, tmp_path: Path) -> None:
    check_decompressed(compression, tmp_path)


def test_what_neither_can_decompress_names_the_extra(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    imagecodecs = pytest.importorskip("imagecodecs")
    assert imagecodecs.LERC.available
    tifffile.imwrite(tmp_path / "a.tif", LABELS.astype(np.uint16), compression="lerc", metadata=None)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif", label=4), LABELS == 4)
    request.getfixturevalue("no_imagecodecs")
    with pytest.raises(UnreadableMaskError, match=r"needs imagecodecs.* pip install 'torchlinf\[codecs\]'"):
        read_mask(tmp_path / "a.tif", label=4)


def check_decompressed(compression: str, tmp_path: Path) -> None:
    images = {
        "L": Image.fromarray(LABELS.astype(np.uint8)),
        "I;16": Image.fromarray(LABELS.astype(np.uint16)),
        "F": Image.fromarray(LABELS.astype(np.float32)),
    }
    for name, image in images.items():
        image.save(tmp_path / f"{name}.tif", compression=compression)
        np.testing.assert_array_equal(read_mask(tmp_path / f"{name}.tif", label=4), LABELS == 4)
    for name in ("tiff_lzw", "group4", "tiff_ccitt"):
        Image.fromarray(MASK).save(tmp_path / "a.tif", compression=name)
        np.testing.assert_array_equal(read_mask(tmp_path / "a.tif"), MASK)


@pytest.mark.usefixtures("no_imagecodecs")
def test_signed_bytes_stay_signed_where_pillow_decompresses(tmp_path: Path) -> None:
    level = np.where(MASK, 1, -1).astype(np.int8)
    Image.fromarray(level.view(np.uint8)).save(tmp_path / "a.tif", compression="tiff_lzw", tiffinfo={339: 2})
    with tifffile.TiffFile(tmp_path / "a.tif") as tiff:
        assert tiff.pages[0].dtype == np.int8
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif"), MASK)


def test_jpeg_in_a_tiff_is_grey(tmp_path: Path) -> None:
    Image.fromarray(255 * MASK.astype(np.uint8)).save(tmp_path / "a.tif", compression="jpeg", quality=90)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif"), MASK)
    with pytest.raises(UnreadableMaskError, match="lossy compression changes labels"):
        read_mask(tmp_path / "a.tif", label=255)


@pytest.mark.parametrize("dtype", [bool, np.uint8, np.uint16])
def test_white_may_be_zero(dtype: type, tmp_path: Path) -> None:
    white = np.iinfo(dtype).max if dtype is not bool else True
    stored = np.where(MASK, 0, white).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric="miniswhite")
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif"), MASK)


@pytest.mark.usefixtures("no_imagecodecs")
@pytest.mark.parametrize("compression", ["tiff_lzw", "raw"])
@pytest.mark.parametrize("mode", ["1", "L"])
def test_white_may_be_zero_where_pillow_decompresses(mode: str, compression: str, tmp_path: Path) -> None:
    image = Image.fromarray(~MASK) if mode == "1" else Image.fromarray(255 * (~MASK).astype(np.uint8))
    image.save(tmp_path / "a.tif", compression=compression, tiffinfo={262: 0})
    with tifffile.TiffFile(tmp_path / "a.tif") as tiff:
        is_white_zero = tiff.pages[0].photometric == 0
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif"), np.asarray(Image.open(tmp_path / "a.tif")) != 0)
    assert is_white_zero


def test_the_sample_axis(tmp_path: Path) -> None:
    for config in ("contig", "separate"):
        number = 2 if config == "separate" else 1
        tag = (284, "H", 1, number, True)  # of one sample, where it says nothing
        tifffile.imwrite(tmp_path / "one.tif", LABELS.astype(np.int16), extratags=[tag], metadata=None)
        np.testing.assert_array_equal(read_mask(tmp_path / "one.tif", label=2), LABELS == 2)
        red = np.stack([MASK, 0 * MASK, 0 * MASK]).astype(np.uint16) * 300
        stored = red if config == "separate" else np.moveaxis(red, 0, -1)
        tifffile.imwrite(tmp_path / "rgb.tif", stored, photometric="rgb", planarconfig=config)
        np.testing.assert_array_equal(read_mask(tmp_path / "rgb.tif"), MASK)
        bands = np.stack([MASK] * 5).astype(np.int16)
        stored = bands if config == "separate" else np.moveaxis(bands, 0, -1)
        tifffile.imwrite(
            tmp_path / "bands.tif", stored, photometric="minisblack", planarconfig=config, metadata=None,
            extrasamples=[0] * 4,
        )  # fmt: skip
        with pytest.raises(UnreadableMaskError, match="got 5 bands that are no colours"):
            read_mask(tmp_path / "bands.tif")


def test_palettes(tmp_path: Path) -> None:
    colours = np.zeros((3, 256), dtype=np.uint16)
    colours[:, :5] = 257 * np.array([[0, 128, 0, 200, 9], [0, 0, 128, 10, 8], [0, 0, 0, 1, 250]])
    tifffile.imwrite(tmp_path / "a.tif", LABELS.astype(np.uint8), photometric="palette", colormap=colours)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif", label=3), LABELS == 3)
    tifffile.imwrite(tmp_path / "a.tif", 3 * MASK.astype(np.uint8), photometric="palette", colormap=colours)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif"), MASK)


@pytest.mark.parametrize(
    ("nodata", "dtype"), [(255, np.uint8), (-9999, np.int16), (-1, np.float32), ("nan", np.float32)]
)
def test_nodata_of_a_geotiff_is_outside_of_everything(nodata: object, dtype: type, tmp_path: Path) -> None:
    stored = MASK.astype(dtype)
    stored[:4] = stored[:, 15:18] = nodata
    known = np.ones_like(MASK)
    known[:4] = known[:, 15:18] = False
    tag = (42113, "s", 0, f"{nodata} ", True)
    tifffile.imwrite(tmp_path / "a.tif", stored, extratags=[tag])
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif"), MASK & known)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif", invert=True), ~MASK & known)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif", nonzero=True), MASK & known)
    (row,) = score_masks(find_masks([tmp_path]), labels=True)
    assert (row.label, row.pixels) == (1, (MASK & known).sum())


def test_overviews_and_masks_inside_are_passed_over(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "cog.tif") as file:
        file.write(LABELS.astype(np.uint8), metadata=None)
        file.write(np.ones(MASK.shape, bool), metadata=None, subfiletype=4)  # a mask of what is valid
        file.write(LABELS[::2, ::2].astype(np.uint8), metadata=None, subfiletype=1)  # an overview
        file.write(np.ones((11, 17), bool), metadata=None, subfiletype=5)
    np.testing.assert_array_equal(read_mask(tmp_path / "cog.tif", label=2), LABELS == 2)
    with tifffile.TiffWriter(tmp_path / "pyramid.tif") as file:
        file.write(LABELS.astype(np.uint8), subifds=1, metadata=None)
        file.write(LABELS[::2, ::2].astype(np.uint8), subfiletype=1, metadata=None)
    np.testing.assert_array_equal(read_mask(tmp_path / "pyramid.tif", label=2), LABELS == 2)


@pytest.mark.parametrize("kind", ["imagej", "shaped", "pages", "ome"])
def test_pages_are_a_stack_or_a_volume(kind: str, tmp_path: Path) -> None:
    stack = np.stack([MASK, MASK[::-1], MASK[:, ::-1], ~MASK]).astype(np.uint16)
    name = "a.ome.tif" if kind == "ome" else "a.tif"
    options = {"imagej": {"imagej": True}, "shaped": {}, "pages": {"metadata": None}, "ome": {"ome": True}}[kind]
    tifffile.imwrite(tmp_path / name, stack, photometric="minisblack", **options)
    np.testing.assert_array_equal(read_mask(tmp_path / name, volume=True), stack)
    with pytest.raises(UnreadableMaskError, match=r"three axes, \(4, 21, 34\): pass --stack if these are 4 masks"):
        read_mask(tmp_path / name)
    rows = list(score_masks(find_masks([tmp_path]), stack=True))
    assert [row.path for row in rows] == [f"{tmp_path / name}[{page}]" for page in range(4)]
    assert [row.pixels for row in rows] == stack.sum(axis=(1, 2)).tolist()


def test_a_stack_with_one_directory(tmp_path: Path) -> None:
    """ImageJ writes stacks of more than 4 GB so: one directory, the images one after the other."""
    stack = np.stack([MASK, MASK[::-1], ~MASK]).astype(">u2")
    description = b"ImageJ=1.53t\nimages=3\nslices=3\nloop=false\n\0"
    start = 8 + len(description) + len(description) % 2
    entries = [
        (256, 4, 1, 34), (257, 4, 1, 21), (258, 4, 1, 16), (259, 4, 1, 1), (262, 4, 1, 1),
        (270, 2, len(description), 8), (273, 4, 1, start), (277, 4, 1, 1), (278, 4, 1, 21), (279, 4, 1, 21 * 34 * 2),
    ]  # fmt: skip
    directory = struct.pack(">H", len(entries)) + b"".join(struct.pack(">HHII", *one) for one in entries) + bytes(4)
    head = b"MM\0*" + struct.pack(">I", start + stack.nbytes) + description + bytes(len(description) % 2)
    (tmp_path / "a.tif").write_bytes(head + stack.tobytes() + directory)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.tif", volume=True), stack)
