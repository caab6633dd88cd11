"""What a list of paths is, and the one limit of an image's size."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from torchlinf.scoring import Source, find_masks, find_shards, read_mask, score_masks


def test_a_text_is_one_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Image.new("L", (5, 4), 255).save(tmp_path / "b.png")
    monkeypatch.chdir(tmp_path)
    for paths in ("b.png", Path("b.png"), ["b.png"], (Path("b.png"),), iter(["b.png"]), "*.png", "."):
        assert [source.name for source in find_masks(paths)] == ["b.png"]
    for paths in ("b.png", Path("b.png"), ["b.png"]):
        assert [shard.files for shard in find_shards(paths)] == [(Source(Path("b.png")),)]
    assert next(score_masks(find_masks("a/b.png"))).path == "a/b.png"
    for find in (find_masks, find_shards):
        for wrong in ("", ["b.png", ""]):
            with pytest.raises(ValueError, match=r"paths must not be empty; got ''\. Pass '\.'"):
                find(wrong)
        for other in ([3], [None], b"b.png", [b"b.png"]):
            with pytest.raises(TypeError, match=r"paths must be a path or several; got .*\. Pass"):
                find(other)
    for sources in ("b.png", Path("b.png"), find_masks("b.png")[0]):
        with pytest.raises(TypeError, match=r"sources must be what find_masks found; got .*b\.png.*Pass find_masks"):
            next(score_masks(sources))


@pytest.mark.parametrize("suffix", ["png", "gif", "bmp", "jpg"])
@pytest.mark.parametrize("mode", ["L", "P", "RGB"])
def test_max_pixels_is_the_only_limit(suffix: str, mode: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pillow's own limit is a global of the process: it is neither heeded nor changed."""
    mask = np.zeros((30, 41), dtype=bool)
    mask[4:20, 7:30] = True
    image = Image.fromarray(np.where(mask, 255, 0).astype(np.uint8))
    if mode != "L" and not (suffix == "jpg" and mode == "P"):
        image = image.convert(mode)
    image.save(tmp_path / f"a.{suffix}")
    for limit in (100, 1000):  # twice the limit is an error of Pillow's, once a warning, which is an error here
        monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", limit)
        np.testing.assert_array_equal(read_mask(tmp_path / f"a.{suffix}"), mask)
        with pytest.raises(ValueError, match="30 x 41 pixels are more than the limit of 1229"):
            read_mask(tmp_path / f"a.{suffix}", max_pixels=1229)
        assert limit == Image.MAX_IMAGE_PIXELS
