"""What is inside: masks, grey images and probabilities are clear, label maps are asked about."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from torchlinf._helpers.inside import UnclearMaskError, find_inside
from torchlinf.scoring import UnreadableMaskError, find_masks, read_mask, score_masks
from torchlinf.scoring.mask_rules import Reading
from torchlinf.transforms import ShapeComplexityScore

Y, X = np.mgrid[:90, :130]
DISC = np.hypot(Y - 44.3, X - 60.1) < 31
SQUARES = np.zeros((90, 130), dtype=bool)
SQUARES[10:50, 20:95] = SQUARES[60:80, 5:50] = True
FULL = 255 * DISC.astype(np.uint8)


def jpeg(mask: np.ndarray, quality: int) -> np.ndarray:
    """A mask after JPEG, with its ringing, as somebody saves it again as PNG."""
    file = io.BytesIO()
    Image.fromarray(255 * mask.astype(np.uint8)).save(file, format="JPEG", quality=quality)
    return np.asarray(Image.open(file))


def resized(mask: np.ndarray, method: Image.Resampling) -> np.ndarray:
    return np.asarray(Image.fromarray(255 * mask.astype(np.uint8)).resize((97, 71), method))


GREYS = {
    **{f"jpeg {quality}": jpeg(DISC, quality) for quality in (20, 50, 75, 90, 97)},
    **{f"jpeg of squares {quality}": jpeg(SQUARES, quality) for quality in (20, 50, 75, 90, 97)},
    **{f"{one.name} {name}": resized(mask, one) for one in (Image.Resampling.BILINEAR, Image.Resampling.LANCZOS)
       for name, mask in (("disc", DISC), ("squares", SQUARES))},
    "blurred": np.rint(ndimage.gaussian_filter(255.0 * SQUARES, 1)).astype(np.uint8),
    "very soft": np.rint(ndimage.gaussian_filter(255.0 * DISC, 9)).astype(np.uint8),
    "gradient": np.tile(np.arange(256, dtype=np.uint8).repeat(4), (20, 1)),
    "noise": np.random.default_rng(0).integers(0, 256, (40, 50), dtype=np.uint8),
    "16 bits": np.rint(ndimage.gaussian_filter(65535.0 * DISC, 2)).astype(np.uint16),
}  # fmt: skip


@pytest.mark.parametrize("name", GREYS)
def test_grey_images_are_cut_at_half(name: str, tmp_path: Path) -> None:
    half = np.iinfo(GREYS[name].dtype).max // 2
    inside, rule = find_inside(GREYS[name])
    np.testing.assert_array_equal(inside, GREYS[name] > half)
    assert rule == f"> {half}"
    Image.fromarray(GREYS[name]).save(tmp_path / "grey.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "grey.png"), GREYS[name] > half)


def cells(ids: list[int], dtype: type) -> np.ndarray:
    """A label map: areas of irregular form, with these labels in turn, on 0."""
    generator = np.random.default_rng(len(ids))
    seeds = np.ones((90, 130), dtype=bool)
    rows, columns = generator.permutation(90)[:, None][: len(ids), 0], generator.permutation(130)[: len(ids)]
    seeds[rows, columns] = False
    distance, nearest = ndimage.distance_transform_edt(seeds, return_indices=True)
    lookup = np.zeros((90, 130), dtype)
    lookup[rows, columns] = ids
    return np.where(distance < 14, lookup[tuple(nearest)], 0).astype(dtype)


VOC = cells([1, 15, 1, 15], np.uint8)
VOC[ndimage.binary_dilation(VOC > 0, iterations=3) & (VOC == 0)] = 255

LABEL_MAPS = {
    "VOC": VOC,
    "ADE": cells([1, 2, 5, 18, 40, 99, 120], np.uint8),
    "COCO-Stuff": cells([3, 17, 92, 105, 128, 149, 181, 255], np.uint8),
    "Cityscapes": cells([7, 8, 11, 23, 24000, 26001, 26002, 33000, 33001], np.uint16),
    "many nuclei": cells(list(range(1, 81)), np.uint8),
    "nuclei to 255": cells(list(range(176, 256)), np.uint8),
    "train ids": cells([*range(1, 19), 255], np.uint8),
    "trimap": np.where(ndimage.binary_erosion(DISC, iterations=4), 255, np.where(DISC, 128, 0)).astype(np.uint8),
    "int32": cells([3, 65535], np.int32),
    "float": cells([1, 2], np.float64),
    "no background": np.where(DISC, 9, 7).astype(np.uint8),
    "low contrast": np.rint(ndimage.gaussian_filter(90.0 * DISC, 2)).astype(np.uint8),
}


@pytest.mark.parametrize("name", LABEL_MAPS)
def test_label_maps_must_be_asked(name: str, tmp_path: Path) -> None:
    array = LABEL_MAPS[name]
    with pytest.raises(UnclearMaskError, match=rf"{len(np.unique(array))} values"):
        find_inside(array)
    with pytest.raises(ValueError, match=r"got \d+ values .* Pass mask == \d+ for one label"):
        ShapeComplexityScore()(array)
    np.save(tmp_path / "map.npy", array)
    (row,) = score_masks(find_masks([tmp_path]))
    assert "pass --labels for a row each, --label " in row.error
    assert (row.inside, row["complexity"]) == (None, None)


@pytest.mark.parametrize(
    ("values", "inside", "rule"),
    [
        (np.array([[True, False]]), [1, 0], "nonzero"),
        (np.array([[0, 7]], np.uint8), [0, 1], "nonzero"),
        (np.array([[0, 255]], np.uint8), [0, 1], "nonzero"),
        (np.array([[0, -1]], np.int16), [0, 1], "nonzero"),
        (np.array([[-1, 1]], np.int8), [0, 1], "> 0"),
        (np.array([[-4.0, 4.0]]), [0, 1], "> 0"),
        (np.array([[9, 9]], np.uint8), [1, 1], "nonzero"),
        (np.array([[0, 0]], np.uint8), [0, 0], "nonzero"),
        (np.array([[0.0, 255.0]]), [0, 1], "nonzero"),
        (np.array([[0.0, 1.0]], np.float16), [0, 1], "nonzero"),
        (np.array([[0.2, 0.9]]), [0, 1], "> 0.5"),
        (np.array([[0.6, 0.9]]), [1, 1], "> 0.5"),
        (np.array([[0.2, 0.2]]), [0, 0], "> 0.5"),
        (np.array([[0.1, 0.5, 0.9]]), [0, 0, 1], "> 0.5"),
    ],
)
def test_what_is_clear(values: np.ndarray, inside: list[int], rule: str) -> None:
    found = find_inside(values)
    assert (found[0].astype(int).tolist(), found[1]) == ([inside], rule)
    assert ShapeComplexityScore()(values).isnan() == (not any(inside))


def test_what_compression_leaves_of_black_is_outside() -> None:
    noise = np.array([[0, 1]], dtype=np.uint8)
    assert find_inside(noise, lossy=True)[0].tolist() == [[False, False]]
    assert find_inside(noise)[0].tolist() == [[False, True]]


def test_every_row_names_the_rule(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", VOC)
    (source,) = find_masks([tmp_path])
    expected = {
        "nonzero": ({"nonzero": True}, VOC != 0),
        "label 15": ({"label": 15}, VOC == 15),
        "> 14": ({"threshold": 14}, VOC > 14),
        "> 0.25 except 255": ({"threshold": 0.25, "ignore": 255}, (VOC > 0) & (VOC != 255)),
        "not label 15 except 255": ({"label": 15, "invert": True, "ignore": [255]}, (VOC != 15) & (VOC != 255)),
    }
    for rule, (options, mask) in expected.items():
        (row,) = score_masks([source], **options)
        assert (row.inside, row.pixels, row.label) == (rule, mask.sum(), options.get("label"))


def test_ignored_values_do_not_make_a_mask_unclear(tmp_path: Path) -> None:
    mask = np.where(DISC, 1, 0).astype(np.uint8)
    mask[:5] = 255
    np.save(tmp_path / "a.npy", mask)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.npy", ignore=255), mask == 1)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.npy", ignore=255, invert=True), mask == 0)
    with pytest.raises(UnreadableMaskError, match=r"3 values \(0, 1, 255\)"):
        read_mask(tmp_path / "a.npy")


def test_nan_is_outside_of_everything(tmp_path: Path) -> None:
    mask = DISC.astype(np.float32)
    mask[40:50, 50:60] = np.nan
    np.save(tmp_path / "a.npy", mask)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.npy"), mask == 1)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.npy", invert=True), mask == 0)
    np.save(tmp_path / "b.npy", np.where(np.isnan(mask), np.inf, mask))
    with pytest.raises(UnreadableMaskError, match="got infinity"):
        read_mask(tmp_path / "b.npy")


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"threshold": "127"}, TypeError, "threshold must be a number or None; got '127'"),
        ({"threshold": float("nan")}, ValueError, "threshold must be a number or None; got NaN"),
        ({"label": 1.5}, TypeError, "label must be None or an integer"),
        ({"ignore": "255"}, TypeError, "ignore must hold integers"),
        ({"nonzero": 1}, TypeError, "nonzero must be True or False"),
        ({"label": 1, "threshold": 3}, ValueError, "got threshold and label. Pass one"),
        ({"labels": True, "nonzero": True}, ValueError, "got nonzero and labels. Pass one"),
        ({"volume": True, "stack": True}, ValueError, "got volume and stack. Pass one"),
        ({"labels": True, "invert": True}, ValueError, "labels cannot be inverted"),
        ({"max_pixels": 0}, ValueError, "max_pixels must be"),
        ({"max_pixels": 1.5}, TypeError, "max_pixels must be"),
    ],
)
def test_options_that_contradict_each_other(options: dict[str, object], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        Reading(**options)
