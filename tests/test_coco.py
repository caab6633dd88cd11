"""COCO files: polygons and run lengths, in their frame, against other ways to draw them; and what is refused."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from pycocotools import mask as coco
from skimage.draw import polygon2mask

from torchlinf.scoring import UnreadableMaskError, find_masks, read_source, score_masks
from torchlinf.scoring.coco import Outline, draw

HEIGHT, WIDTH = 40, 70


def polygon(*points: tuple[float, float]) -> list[float]:
    return [value for point in points for value in point]


def runs(mask: np.ndarray) -> list[int]:
    """Run lengths by the definition: down the columns, outside first."""
    counts, inside = [0], False
    for pixel in mask.T.ravel():
        if pixel != inside:
            counts.append(0)
            inside = pixel
        counts[-1] += 1
    return counts


def save(path: Path, *segmentations: object, height: object = HEIGHT, width: object = WIDTH) -> Path:
    annotations = [
        {"id": 10 + i, "image_id": 7, "segmentation": segmentation} for i, segmentation in enumerate(segmentations)
    ]
    images = [{"id": 7, "height": height, "width": width, "file_name": "7.jpg"}]
    path.write_text(json.dumps({"images": images, "annotations": annotations, "categories": []}))
    return path


def noise(seed: int, density: float) -> np.ndarray:
    return np.random.default_rng(seed).random((HEIGHT, WIDTH)) < density


@pytest.mark.parametrize("density", [0.0, 0.02, 0.5, 0.9, 1.0])
def test_run_lengths_of_both_kinds(density: float, tmp_path: Path) -> None:
    mask = noise(3, density)
    packed = coco.encode(np.asfortranarray(mask.astype(np.uint8)))["counts"].decode()
    size = [HEIGHT, WIDTH]
    path = save(tmp_path / "a.json", {"size": size, "counts": runs(mask)}, {"size": size, "counts": packed})
    found = find_masks([path])
    assert [source.name for source in found] == [f"{path}:10", f"{path}:11"]
    for source in found:
        np.testing.assert_array_equal(read_source(source), mask)
        np.testing.assert_array_equal(read_source(source, threshold=127, invert=True), ~mask)


INSIDE = polygon((10, 5), (50, 8), (60, 35), (30, 20), (12, 30))


@pytest.mark.parametrize("shift", [(0, 0), (-30, 4), (40, 3), (5, -20), (3, 25), (-40, -25), (45, 25)])
def test_polygons_that_leave_the_image_are_cut_at_its_border(shift: tuple[int, int]) -> None:
    points = np.array(INSIDE).reshape(-1, 2) + shift
    drawn = draw(Outline(HEIGHT, WIDTH, [points.ravel().tolist()]), 10**6)
    large = draw(Outline(HEIGHT + 200, WIDTH + 200, [(points + 100).ravel().tolist()]), 10**6)
    # pycocotools rounds towards zero, so that negative coordinates move by a fifth of a pixel.
    assert (drawn != large[100 : 100 + HEIGHT, 100 : 100 + WIDTH]).sum() <= 1
    other = polygon2mask((HEIGHT, WIDTH), points[:, ::-1] - 0.5)
    assert 0 < drawn.sum() < HEIGHT * WIDTH
    assert (drawn != other).sum() <= 6  # the two draw borders in their own ways


def test_several_polygons_are_one_mask() -> None:
    other = polygon((0, 30), (8, 30), (8, 40), (0, 40))
    both = draw(Outline(HEIGHT, WIDTH, [INSIDE, other]), 10**6)
    parts = [draw(Outline(HEIGHT, WIDTH, [points]), 10**6) for points in (INSIDE, other)]
    np.testing.assert_array_equal(both, parts[0] | parts[1])
    assert parts[1].sum() == 80


def test_outside_and_broken_outlines_are_rows(tmp_path: Path) -> None:
    size = [HEIGHT, WIDTH]
    total = HEIGHT * WIDTH
    cases = {
        "no foreground": [polygon((100, 100), (120, 100), (110, 120))],
        "finite": [[float("nan"), 5, 20, 6, 18, 15]],
        "at most 1e+06": [[1e12, 5, 20, 6, 18, 15]],
        "three or more": [[5, 5, 6, 6]],
        "pairs": [["a", 1, 2, 3, 4, 5]],
        "no segmentation": [],
        "add up": {"size": size, "counts": [100, 400]},
        "whole numbers": {"size": size, "counts": [-5, total + 5]},
        "that add up": {"size": size, "counts": ""},
        "end within": {"size": size, "counts": "o"},
        "a character": {"size": size, "counts": "\u00ff"},
        "of size": {"size": [WIDTH, HEIGHT], "counts": [total]},
    }
    path = save(tmp_path / "a.json", *cases.values(), [INSIDE])
    rows = list(score_masks(find_masks([path])))
    assert len(rows) == len(cases) + 1
    for words, row in zip(cases, rows, strict=False):
        assert words in row.error
    assert rows[-1].error is None
    assert (rows[-1].height, rows[-1].width) == (HEIGHT, WIDTH)


def test_annotations_without_an_image_or_an_id(tmp_path: Path) -> None:
    content = json.loads(save(tmp_path / "a.json", [INSIDE], [INSIDE], [INSIDE], [INSIDE]).read_text())
    content["annotations"][1]["image_id"] = 8
    del content["annotations"][2]["id"]
    content["annotations"][3]["id"] = 10
    (tmp_path / "a.json").write_text(json.dumps(content))
    found = find_masks([tmp_path / "a.json"])
    assert found[0].error is None
    assert "no image" in found[1].error
    # Without an id the position names it; a second mask of one id is a mask too.
    assert [(source.member, source.error) for source in found[2:]] == [("2", None), ("10~2", None)]


def test_huge_images_are_refused_before_they_are_drawn(tmp_path: Path) -> None:
    (source,) = find_masks([save(tmp_path / "a.json", [INSIDE], height=10**6, width=10**6)])
    with pytest.raises(UnreadableMaskError, match="limit"):
        read_source(source)
    (source,) = find_masks([save(tmp_path / "a.json", [INSIDE], height="40")])
    assert "no image of known size" in source.error


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"images": [], "annotations": 3}', '{"images": 5}', "\x00"])
def test_other_json_is_a_row(content: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(content)
    (source,) = find_masks([tmp_path / "a.json"])
    assert "not a COCO file" in source.error


def test_without_pycocotools_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = save(tmp_path / "a.json", [INSIDE])
    monkeypatch.setitem(sys.modules, "pycocotools.mask", None)
    with pytest.raises(ImportError, match=r"pip install 'torchlinf\[coco\]'"):
        find_masks([path])
