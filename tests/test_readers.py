"""Reading masks: every format gives the same mask, and what counts as inside."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from torchlinf.scoring import UnreadableMaskError, read_mask

# H != W, not symmetric, with a hole and a second component.
MASK = np.zeros((21, 34), dtype=bool)
MASK[2:17, 3:25] = True
MASK[6:9, 8:15] = False
MASK[10:13, 28:32] = True

GREY = np.where(MASK, 255, 0).astype(np.uint8)


def palette_image(indices: np.ndarray, colours: list[tuple[int, int, int]]) -> Image.Image:
    image = Image.frombytes("P", indices.shape[::-1], indices.astype(np.uint8).tobytes())
    image.putpalette([channel for colour in colours for channel in colour])
    return image


def rgba(colour: np.ndarray, opacity: np.ndarray) -> Image.Image:
    return Image.fromarray(np.dstack([colour, colour, colour, opacity]))


IMAGES = {
    "grey.png": Image.fromarray(GREY),
    "bilevel.png": Image.fromarray(MASK),
    "palette.png": palette_image(MASK, [(0, 0, 0), (255, 255, 255)]),
    "reversed.png": palette_image(~MASK, [(255, 255, 255), (0, 0, 0)]),
    "sixteen.png": Image.fromarray(GREY.astype(np.uint16) * 257),
    "dim.png": Image.fromarray(MASK.astype(np.uint8)),
    "red.png": Image.fromarray(np.dstack([GREY, 0 * GREY, 0 * GREY])),
    "blue.png": Image.fromarray(np.dstack([0 * GREY, 0 * GREY, GREY])),
    "opaque.png": rgba(GREY, np.full_like(GREY, 255)),
    "opacity.png": rgba(np.zeros_like(GREY), GREY),
    "white.png": rgba(np.full_like(GREY, 255), GREY),
    "black-on-white.png": rgba(255 - GREY, GREY),
    "grey-opacity.png": Image.fromarray(GREY).convert("LA"),
    "mask.gif": Image.fromarray(GREY),
    "mask.bmp": Image.fromarray(GREY),
    "mask.tif": Image.fromarray(GREY),
    "bilevel.tiff": Image.fromarray(MASK),
    "probability.tif": Image.fromarray(np.where(MASK, 0.9, 0.2).astype(np.float32)),
    "mask.jpg": Image.fromarray(GREY),
    "MASK.JPEG": Image.fromarray(GREY).convert("RGB"),
}

ARRAYS = {
    "bool": MASK,
    "uint8": MASK.astype(np.uint8),
    "int64": MASK.astype(np.int64),
    "negative": np.where(MASK, 3, -1),
    "float32": MASK.astype(np.float32),
    "float64": np.where(MASK, 255.0, 0.0),
    "fortran": np.asfortranarray(MASK),
    "big-endian": MASK.astype(">u2"),
    "leading axes": MASK[None, None],
}


@pytest.mark.parametrize("name", IMAGES)
def test_images(name: str, tmp_path: Path) -> None:
    IMAGES[name].save(tmp_path / name)
    mask = read_mask(tmp_path / name)
    assert mask.dtype == np.bool_
    np.testing.assert_array_equal(mask, MASK)


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays(name: str, tmp_path: Path) -> None:
    np.save(tmp_path / "mask.npy", ARRAYS[name])
    np.savez_compressed(tmp_path / "mask.npz", other=np.zeros((2, 3)), mask=ARRAYS[name])
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.npy"), MASK)
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.npz", member="mask"), MASK)


def test_volumes(tmp_path: Path) -> None:
    volume = np.random.default_rng(0).random((5, 7, 11)) > 0.4
    np.save(tmp_path / "volume.npy", volume)
    tifffile.imwrite(tmp_path / "pages.tif", np.where(volume, 255, 0).astype(np.uint8))
    tifffile.imwrite(tmp_path / "double.tif", volume.astype(np.float64))
    for name in ("volume.npy", "pages.tif", "double.tif"):
        np.testing.assert_array_equal(read_mask(tmp_path / name, volume=True), volume)
        with pytest.raises(UnreadableMaskError, match=r"three axes, \(5, 7, 11\): pass --stack if .* or --volume"):
            read_mask(tmp_path / name)


def test_tiff_beyond_pillow(tmp_path: Path) -> None:
    colour = np.dstack([GREY, 0 * GREY, 0 * GREY]).astype(np.uint16) * 257
    tifffile.imwrite(tmp_path / "colour16.tif", colour, photometric="rgb")
    tifffile.imwrite(tmp_path / "label64.tif", MASK.astype(np.int64) * 70_000)
    for name in ("colour16.tif", "label64.tif"):
        np.testing.assert_array_equal(read_mask(tmp_path / name), MASK)


def test_of_an_animation_the_first_frame_is_read(tmp_path: Path) -> None:
    first, second = Image.fromarray(GREY), Image.fromarray(255 - GREY)
    first.save(tmp_path / "film.gif", save_all=True, append_images=[second])
    np.testing.assert_array_equal(read_mask(tmp_path / "film.gif"), MASK)


def test_colours_of_a_palette_are_labels(tmp_path: Path) -> None:
    labels = MASK * (1 + np.arange(MASK.size).reshape(MASK.shape) % 3)
    path = tmp_path / "labels.png"
    palette_image(labels, [(0, 0, 0), (128, 0, 0), (0, 64, 0), (192, 128, 0)]).save(path)
    np.testing.assert_array_equal(read_mask(path, nonzero=True), MASK)
    np.testing.assert_array_equal(read_mask(path, label=2), labels == 2)
    np.testing.assert_array_equal(read_mask(path, label=2, ignore=[0, 3], invert=True), labels == 1)
    with pytest.raises(UnreadableMaskError, match=r"4 values \(0, 1, 2, 3\), .* pass --labels .* --label \d for one"):
        read_mask(path)


def test_threshold_and_invert(tmp_path: Path) -> None:
    ramp = np.arange(200, dtype=np.uint8).reshape(10, 20)
    Image.fromarray(ramp).save(tmp_path / "ramp.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "ramp.png"), ramp > 127)
    np.testing.assert_array_equal(read_mask(tmp_path / "ramp.png", threshold=42), ramp > 42)
    np.testing.assert_array_equal(read_mask(tmp_path / "ramp.png", threshold=42, invert=True), ramp <= 42)
    np.save(tmp_path / "logits.npy", ramp - 100.0)
    np.testing.assert_array_equal(read_mask(tmp_path / "logits.npy", threshold=0), ramp > 100)


def test_values_that_tell_no_inside(tmp_path: Path) -> None:
    np.save(tmp_path / "logits.npy", np.linspace(-3, 4, 12).reshape(3, 4))
    with pytest.raises(UnreadableMaskError, match=r"numbers from -3 to 4, .*pass --threshold"):
        read_mask(tmp_path / "logits.npy")
