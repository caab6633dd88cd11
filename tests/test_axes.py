"""Axes that images come with: of a batch or channels of one, of colours, of stacks. What is unclear is asked."""

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

import torchlinf
from torchlinf import shapes
from torchlinf.labels import complexity_table
from torchlinf.metrics import ShapeComplexity
from torchlinf.scoring import score_mask
from torchlinf.transforms import ShapeComplexityScore

# docs/method, "Known values": the disc of radius 32 has D = 23 and a mean of 2.378 bits.
RADIUS, BITS = 23, 2.378
# A voxel of a volume that is one voxel thick has an outside neighbour, so D = 1, and f = (f + 0 + 1) / 3 is 1/2 on all.
THIN = 0.0


def disc() -> NDArray[np.bool_]:
    """The disc in an image (70, 83)."""
    image = np.zeros((70, 83), dtype=np.bool_)
    image[3:68, 9:74] = shapes.disc(32).numpy()
    return image


def labels() -> NDArray[np.uint8]:
    """Label 5 is the disc, label 9 a square of side 4, beside each other."""
    image = 5 * disc().astype(np.uint8)
    image[1:5, 77:81] = 9
    return image


ALIKE = {"(H, W)": (), "(1, H, W)": (0,), "(H, W, 1)": (-1,), "(1, H, W, 1)": (0, -1), "(1, 1, H, W)": (0, 0)}


@pytest.mark.parametrize("axes", ALIKE.values(), ids=ALIKE)
def test_label_maps_with_axes_of_length_1_are_images(axes: tuple[int, ...]) -> None:
    given, intensity = labels(), np.arange(70 * 83.0).reshape(70, 83)
    expected = [float(intensity[labels() == name].mean()) for name in (5, 9)]
    for axis in axes:
        given, intensity = np.expand_dims(given, axis), np.expand_dims(intensity, axis)
    for one in (given, torch.from_numpy(given)):
        table = complexity_table(one, properties=["intensity_mean", "bbox"], intensity_image=intensity)
        assert table["label"].tolist() == [5, 9]
        assert table["radius"].tolist() == [RADIUS, 2]
        assert table["complexity"] == pytest.approx([BITS, 0.0], abs=5e-4)
        assert table["intensity_mean"] == pytest.approx(expected)
        assert (table["bbox-0"].tolist(), table["bbox-3"].tolist()) == ([3, 1], [74, 81])
        assert table["touches_border"].tolist() == [False, False]


def test_label_maps_are_volumes_only_by_name() -> None:
    volume = np.zeros((6, 9, 11), dtype=np.int32)
    volume[1:5, 2:8, 3:10] = 2
    with pytest.raises(ValueError, match=r"label_map must be \(H, W\) .*got \(6, 9, 11\)\. Pass spatial_ndim=3 if"):
        complexity_table(volume)
    assert complexity_table(volume, spatial_ndim=3)["radius"].tolist() == [2]
    assert complexity_table(volume[None], spatial_ndim=3)["radius"].tolist() == [2]
    assert complexity_table(volume[..., None], spatial_ndim=3)["radius"].tolist() == [2]
    thin = complexity_table(labels()[None], spatial_ndim=3)
    assert (thin["radius"].tolist(), thin["complexity"].tolist()) == ([1, 1], [THIN, THIN])
    assert complexity_table(labels()[:, 41])["radius"].tolist() == [33]  # a line of 65 pixels
    with pytest.raises(ValueError, match=r"label_map must be \(D, H, W\) for spatial_ndim=3; got \(70, 83\)\. Pass"):
        complexity_table(labels(), spatial_ndim=3)
    with pytest.raises(ValueError, match=r"got \(2, 2, 2, 2, 2\)\. Pass one image at a time"):
        complexity_table(np.ones((2,) * 5, int))
    with pytest.raises(ValueError, match="spatial_ndim must be from 1 to 4"):
        complexity_table(labels(), spatial_ndim=7)


@pytest.mark.parametrize("channels", [3, 4])
def test_colours_are_no_labels_and_no_volume(channels: int) -> None:
    colours = np.repeat(labels()[..., None], channels, axis=2)
    words = rf"must have one number a pixel; got \(70, 83, {channels}\).*\. Pass .*\[\.\.\., 0\].*spatial_ndim"
    with pytest.raises(ValueError, match=f"label_map {words}"):
        complexity_table(colours)
    with pytest.raises(ValueError, match=f"mask {words}"):
        ShapeComplexityScore(threshold=0)(colours)
    with pytest.raises(ValueError, match=f"inside {words}"):
        score_mask(colours > 0)
    with pytest.raises(ValueError, match=r"preds must have one number a pixel; got \(2, 70, 83"):
        ShapeComplexity(10, input_format="index")(torch.from_numpy(np.stack([colours] * 2)))
    assert complexity_table(colours, spatial_ndim=3)["radius"].tolist() == [2, 2]
    assert ShapeComplexityScore(threshold=0, spatial_ndim=2)(colours).shape == (70,)


def test_transforms_score_a_channel_of_one_as_an_image() -> None:
    score = ShapeComplexityScore()
    for one, batch in ((disc(), ()), (disc()[..., None], ()), (disc()[None], (1,)), (disc()[None, ..., None], (1,))):
        for given in (one, torch.from_numpy(one)):
            assert score(given).shape == batch
            assert score(given).item() == pytest.approx(BITS, abs=5e-4)
    assert ShapeComplexityScore(spatial_ndim=3)(disc()[..., None]) == THIN
    # (N, H, W) are N masks: the disc, the box of 70 x 83, and nothing.
    found = score(np.stack([disc(), np.ones_like(disc()), np.zeros_like(disc())]))
    assert found[:2].tolist() == pytest.approx([BITS, 0.0], abs=5e-4)
    assert found[2].isnan()
    assert repr(score) == "ShapeComplexityScore(threshold=None, spatial_ndim=None)"


def test_masks_in_memory_follow_the_rule() -> None:
    for one in (disc(), disc()[None], disc()[..., None]):
        row = score_mask(one)
        assert (row["height"], row["width"], row["depth"], row["radius"]) == (70, 83, None, RADIUS)
        assert row["complexity"] == pytest.approx(BITS, abs=5e-4)
    assert score_mask(disc()[None], spatial_ndim=3)["radius"] == 1
    with pytest.raises(ValueError, match=r"inside must be \(H, W\) .*got \(2, 70, 83\)\. Pass spatial_ndim=3"):
        score_mask(np.stack([disc(), disc()]))


def index() -> Tensor:
    """Labels (2, 70, 83): of the first image 1 is the disc and 2 a square, of the second 2 is the disc."""
    first = torch.from_numpy(labels()).long()
    second = torch.from_numpy(disc()).long()
    return torch.stack([1 * (first == 5) + 2 * (first == 9), 2 * second])


def metric(**options: Any) -> ShapeComplexity:
    return ShapeComplexity(3, include_background=False, average="none", empty="skip", **options)


@pytest.mark.parametrize("axis", [None, 1, -1])
def test_index_labels_with_an_axis_of_channels_are_images(axis: int | None) -> None:
    given = index() if axis is None else index().unsqueeze(axis)
    expected = torch.tensor([BITS, BITS / 2])
    found = metric(input_format="index")
    torch.testing.assert_close(found(given), expected, rtol=0, atol=5e-4)
    assert found.num_shapes.tolist() == [1, 2]
    # Class 1 is in the first target only.
    predicted = torch.nn.functional.one_hot(index(), 3).movedim(-1, 1)
    for preds, form in ((given, "index"), (predicted, "one-hot")):
        found = metric(input_format=form)
        torch.testing.assert_close(found(preds, given), expected, rtol=0, atol=5e-4)
        assert found.num_shapes.tolist() == [1, 2]


def test_index_labels_are_volumes_only_by_name() -> None:
    thin = metric(input_format="index", spatial_ndim=3)
    assert thin(index()[:, None]).tolist() == [THIN, THIN]
    volumes = index()[:, 10:40, 10:40].reshape(2, 5, 6, 30)
    with pytest.raises(ValueError, match=r"preds must be \(B, H, W\) .*got \(2, 5, 6, 30\)\. Pass spatial_ndim=3"):
        metric(input_format="index")(volumes)
    one_hot = torch.nn.functional.one_hot(volumes, 3).movedim(-1, 1)
    expected = metric()(one_hot)
    torch.testing.assert_close(metric(input_format="index", spatial_ndim=3)(volumes), expected, equal_nan=True)
    torch.testing.assert_close(
        metric(input_format="index", spatial_ndim=3)(volumes[:, None], volumes[:, None]), expected, equal_nan=True
    )
    torch.testing.assert_close(metric(spatial_ndim=3)(one_hot), expected, equal_nan=True)
    with pytest.raises(
        ValueError, match=r"preds must be \(B, C, \*spatial\) with spatial_ndim=2 .*Pass spatial_ndim=3"
    ):
        metric(spatial_ndim=2)(one_hot)
    with pytest.raises(ValueError, match="spatial_ndim must be from 1 to 4"):
        metric(spatial_ndim=0)


def test_what_labels_one_hot_predictions_may_be_is_said() -> None:
    with pytest.raises(ValueError, match=r'num_classes=3 channels.*Pass input_format="index"'):
        metric()(index()[:, None])


def test_ignored_pixels_of_a_mask_are_not_present() -> None:
    """(B, 1, H, W) beside one class is a mask and labels at once: 255, the void, is not the class."""
    predicted = torch.from_numpy(np.stack([disc(), disc()]))[:, None]
    target = torch.zeros(2, 1, 70, 83, dtype=torch.uint8)
    target[0, 0, 20, 30], target[1, 0, 4, 5] = 1, 255
    found = ShapeComplexity(1, ignore_index=255)
    assert found(predicted, target).item() == pytest.approx(BITS, abs=5e-4)
    assert found.num_shapes.tolist() == [1]


def test_the_core_takes_every_axis_as_it_is_told() -> None:
    image = torch.from_numpy(disc())
    assert torchlinf.complexity(image[..., None], spatial_ndim=3) == THIN
    assert torchlinf.complexity(image[None, None]).item() == pytest.approx(BITS, abs=5e-4)
