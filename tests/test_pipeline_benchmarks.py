"""That the benchmarks of the entry points run, and compare like with like."""

import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # `benchmarks` is not installed with the library

from benchmarks.pipeline import __main__ as command  # noqa: E402
from benchmarks.pipeline import files, labels, loader, shards  # noqa: E402
from torchlinf.labels import complexity_table  # noqa: E402
from torchlinf.scoring import find_masks, read_source, score_masks  # noqa: E402


# Ray's own settings trip over each other as soon as they are made.
@pytest.mark.filterwarnings("ignore:`use_:DeprecationWarning:ray.data.context")
@pytest.mark.slow
def test_every_question_is_answered(capsys: pytest.CaptureFixture[str]) -> None:
    command.main(["--toy"])
    printed = capsys.readouterr().out
    assert "| two workers, times as many |" in printed
    assert "`labels.complexity_table`, 9 objects" in printed
    assert "| a copy of half the side |" in printed
    assert "| with the open frame |" in printed
    assert "| all, by the workers of a local Ray |" in printed
    command.main(["--toy", "--only", "labels"])
    assert "loader" not in capsys.readouterr().out


def test_the_loops_give_the_numbers_of_the_table() -> None:
    found = labels.nuclei(200, 16)
    table = complexity_table(found)
    assert len(table["label"]) == 16
    assert len(np.unique(table["complexity"])) > 8
    for loop in (labels.over_crops(found), labels.over_masks(found, 16)):
        np.testing.assert_allclose(loop, table["complexity"], rtol=0, atol=1e-9)


def test_silhouettes_fill_their_files(tmp_path: Path) -> None:
    files.write(tmp_path, 50, 3)
    masks = [read_source(source) for source in find_masks([tmp_path])]
    assert [mask.shape for mask in masks] == [(50, 50)] * len(masks)
    assert len(masks) > 1
    for mask in masks:
        extents = [np.ptp(places) + 1 for places in np.nonzero(mask)]
        assert 45 <= max(extents) <= 50  # lines of a single pixel may be lost where a silhouette is made smaller


def test_samples_are_augmented_and_scored(tmp_path: Path) -> None:
    loader.write(tmp_path, 2, 48)
    plain = loader.Photographs(tmp_path)[1]
    image, mask, score = loader.Photographs(tmp_path, loader.SCORES["the mask"])[1]
    assert image.shape == (3, 48, 48)
    assert mask.shape == (48, 48)
    assert score > 0
    assert bool((image == plain[0]).all())
    assert bool((mask == plain[1]).all())
    assert 0 < mask.float().mean() < 1


def test_silhouettes_in_shards_differ(tmp_path: Path) -> None:
    pixels = shards.write(tmp_path / "shards", 42, 48, 4)
    rows = list(score_masks(find_masks([tmp_path / "shards"])))
    assert len({row.path.split(":")[0] for row in rows}) == 4
    assert {(row.height, row.width, row.error) for row in rows} == {(48, 48, None)}
    assert len({row["complexity"] for row in rows}) > 30
    assert sum(row.pixels for row in rows) / 42 == pixels > 48
