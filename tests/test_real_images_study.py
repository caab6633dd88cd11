"""That the study on photographs runs, on toy images, and that its rulers are right."""

import sys
from pathlib import Path

import numpy as np
import pytest
import torch

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # `benchmarks` is not installed with the library

from benchmarks.regulariser.real_images import __main__ as command  # noqa: E402
from benchmarks.regulariser.real_images import data, methods, training  # noqa: E402
from benchmarks.regulariser.real_images.afterwards import opened_and_closed  # noqa: E402
from benchmarks.regulariser.real_images.measures import boundary_f, complexity  # noqa: E402
from benchmarks.regulariser.real_images.network import DESIGNS, UNet  # noqa: E402
from benchmarks.regulariser.real_images.tables import difference, mean_and_error  # noqa: E402


def test_no_image_is_in_two_parts(facades: Path) -> None:
    parts = [data.load("facades", part) for part in ("train", "choose", "held-out")]
    assert [len(part.images) for part in parts] == [7, 2, 3]
    everything = torch.cat([part.images for part in parts]).flatten(1)
    assert len(everything.unique(dim=0)) == 12
    assert (parts[0].masks.unique() == torch.tensor([0.0, 1.0])).all()


def test_without_data_the_study_says_what_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TORCHLINF_FACADES", raising=False)
    with pytest.raises(SystemExit, match="TORCHLINF_FACADES"):
        data.load("facades", "train")


def test_images_and_masks_are_mirrored_and_turned_together(facades: Path) -> None:
    images = data.load("facades", "train")
    pictures, masks = data.batch(images, 16, False, 4, torch.Generator().manual_seed(0))
    assert pictures.shape == (16, 3, 128, 128)
    assert masks.shape == (16, 1, 128, 128)
    for picture, mask in zip(pictures.mean(1), masks[:, 0], strict=True):
        if mask.any() and not mask.all():
            assert picture[mask > 0].mean() > picture[mask == 0].mean() + 0.2


@pytest.mark.parametrize("name", DESIGNS)
def test_a_network_gives_a_logit_a_pixel(name: str) -> None:
    assert UNet(name)(torch.rand(2, 3, 64, 96)).shape == (2, 1, 64, 96)


def test_boundary_score_of_known_masks() -> None:
    square = np.zeros((40, 50), bool)
    square[10:30, 10:30] = True
    moved = np.roll(square, 2, axis=1)
    far = np.roll(square, 19, axis=1)
    assert boundary_f(square, square) == 1
    assert boundary_f(square, moved) == 1  # 2 pixels off still counts
    assert boundary_f(square, far) == pytest.approx(24 / 76)  # one side, and two pixels of two others
    nothing = np.zeros_like(square)
    assert (boundary_f(nothing, nothing), boundary_f(square, nothing)) == (1.0, 0.0)


def test_an_opening_and_closing_takes_a_thin_bar_and_keeps_a_block_at_the_border() -> None:
    mask = torch.zeros(1, 1, 30, 40, dtype=torch.bool)
    mask[..., :12, :15] = True
    clean = mask.clone()
    mask[..., 4, 15:30] = True
    assert torch.equal(opened_and_closed(mask, 3), clean)


def test_a_turned_block_is_simple_in_its_own_frame_only() -> None:
    y, x = torch.meshgrid(torch.arange(80) - 40.0, torch.arange(90) - 45.0, indexing="ij")
    mask = ((0.8 * x + 0.6 * y).abs() < 25) & ((0.8 * y - 0.6 * x).abs() < 15)
    assert complexity("object, own frame", mask[None, None])[0] < 0.2
    assert complexity("object, grid", mask[None, None])[0] > 1


def test_differences_are_paired_by_image() -> None:
    def run(shift: float) -> dict[str, dict[str, dict[str, list[float]]]]:
        base = [0.2, 0.9, float("nan")]
        return {
            "a": {"held-out": {"IoU": base}},
            "b": {"held-out": {"IoU": [value + shift for value in base]}},
        }

    value, error = difference({"0": run(0.1), "1": run(0.3)}, "b", "a", "IoU")
    assert (value, error) == pytest.approx((0.2, 0.0))
    assert mean_and_error([1.0, 3.0, float("nan")]) == pytest.approx((2.0, 1.0))


def test_the_study_runs_is_not_repeated_and_writes_its_tables(
    facades: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(training, "STEPS", {"facades": 30})
    monkeypatch.setattr(training, "MORE_STEPS", 2)
    monkeypatch.setattr(training, "CROPS", 2)
    arguments = ["--sets", "facades", "--seeds", "0"]
    for option in ("states", "results", "out"):
        arguments += [f"--{option}", str(tmp_path / "study" / option)]
    (tmp_path / "study" / "out" / "images").mkdir(parents=True)
    command.main(arguments)
    printed = capsys.readouterr().out
    named = [*methods.terms(), *methods.afterwards("facades")]
    assert all(f"| {name} |" in printed for name in named)
    assert (tmp_path / "study/out/images/regulariser_curves.png").stat().st_size > 1000
    command.main(arguments)
    assert "facades 0" not in capsys.readouterr().out  # nothing was measured again
