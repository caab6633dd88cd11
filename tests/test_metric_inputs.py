"""What ShapeComplexity takes: predictions and targets in several formats, and what it refuses."""

from typing import Any

import pytest
import torch
from problems import random_batch
from torch import Tensor

import torchlinf
from torchlinf.metrics import ShapeComplexity


def masks(sizes: tuple[int, ...] = (19, 26), batch: int = 6, classes: int = 3) -> Tensor:
    """Random masks (B, C, *sizes); the second sample has no class 1, the fourth is full of class 2."""
    found = random_batch(5, batch * classes, sizes).reshape(batch, classes, *sizes)
    found[1, 1] = False
    found[3, 2] = True
    return found


def labels(sizes: tuple[int, ...] = (19, 26)) -> Tensor:
    """Integer labels (6, *sizes) of three classes; class 2 is in few samples."""
    found = masks(sizes)
    return torch.where(found[:, 0], 0, torch.where(found[:, 1], 1, 2))


def by_class(found: Tensor, low: float = 0.0, high: float = 1.0) -> Tensor:
    """(B, C) with 10 bits for what is empty."""
    return torchlinf.complexity(found, low=low, high=high).nan_to_num(10.0)


def test_logits_probabilities_and_labels_give_the_same_masks() -> None:
    generator = torch.Generator().manual_seed(0)
    logits = torch.randn(4, 3, 11, 14, generator=generator)
    index = logits.argmax(dim=1)
    one_hot = torch.nn.functional.one_hot(index, 3).movedim(-1, 1)
    expected = by_class(one_hot).mean().float()
    for preds in (logits, logits.softmax(dim=1), one_hot, one_hot.bool(), one_hot.float()):
        assert ShapeComplexity(3)(preds) == pytest.approx(expected.item(), rel=1e-6)
    assert torch.allclose(ShapeComplexity(3, input_format="index")(index), expected)
    assert torch.allclose(ShapeComplexity(3, input_format="index")(index.to(torch.uint8)), expected)


def test_a_threshold_makes_every_channel_a_mask_of_its_own() -> None:
    logits = torch.randn(4, 3, 11, 14, generator=torch.Generator().manual_seed(0))
    expected = by_class(logits > 0).mean().float()
    assert torch.allclose(ShapeComplexity(3, threshold=0.0)(logits), expected)
    assert torch.allclose(ShapeComplexity(3, threshold=0.5)(logits.sigmoid()), expected)
    alone = ShapeComplexity(1, threshold=0.0)(logits[:, :1])
    assert torch.allclose(alone, by_class(logits[:, :1] > 0).mean().float())


def test_grey_integers_may_be_thresholded_and_one_class_may_be_a_mask() -> None:
    grey = torch.randint(0, 256, (4, 3, 11, 14), generator=torch.Generator().manual_seed(0), dtype=torch.uint8)
    assert torch.allclose(ShapeComplexity(3, threshold=127)(grey), by_class(grey > 127).mean().float())
    mask = (grey > 127)[:, :1]
    for preds in (mask, mask.float(), mask.long()):
        assert torch.allclose(ShapeComplexity(1)(preds), by_class(mask).mean().float())
        assert torch.allclose(ShapeComplexity(1, threshold=0.5)(preds), by_class(mask).mean().float())


def test_what_is_not_in_the_target_is_left_out() -> None:
    index = labels()
    target = index.clone()
    target[target == 1] = 255
    target[2] = 2
    options: dict[str, Any] = {"input_format": "index", "average": "none", "ignore_index": 255}
    metric = ShapeComplexity(3, **options)
    found = metric(index, target)
    one_hot = index[:, None] == torch.arange(3)[:, None, None]
    there = target[:, None] == torch.arange(3)[:, None, None]
    there = there.flatten(2).any(2)
    expected = [by_class(one_hot)[there[:, c], c].mean().float() for c in range(3)]
    assert found[1].isnan()
    torch.testing.assert_close(found, torch.stack(expected), equal_nan=True)
    assert (metric.num_shapes + metric.num_empty).tolist() == there.sum(0).tolist()
    macro = ShapeComplexity(3, input_format="index", ignore_index=255)(index, target)
    torch.testing.assert_close(macro, torch.stack(expected).nanmean())
    # The target may be in the other format.
    assert torch.equal(ShapeComplexity(3, average="none")(one_hot, index), ShapeComplexity(3, **options)(index, index))
    assert torch.equal(ShapeComplexity(3, **options)(index, one_hot), ShapeComplexity(3, **options)(index, index))


def test_the_background_may_be_left_out() -> None:
    found = masks()
    metric = ShapeComplexity(3, include_background=False, average="none")
    torch.testing.assert_close(metric(found), by_class(found).mean(0)[1:].float())
    assert metric.num_shapes.shape == (2,)


def test_the_layout_in_memory_does_not_matter() -> None:
    found = masks()
    expected = ShapeComplexity(3)(found)
    assert torch.equal(ShapeComplexity(3)(found.transpose(2, 3).contiguous().transpose(2, 3)), expected)
    assert torch.equal(ShapeComplexity(3)(found.to(memory_format=torch.channels_last)), expected)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"num_classes": 0}, ValueError, "num_classes must be"),
        ({"num_classes": 1, "include_background": False}, ValueError, "num_classes of 2 or more"),
        ({"low": 0.5, "high": 0.2}, ValueError, "low < high"),
        ({"windows": {}}, ValueError, "windows must name"),
        ({"windows": [(0.0, 0.5)]}, TypeError, "windows must map"),
        ({"rho": torch.ones(3)}, TypeError, "rho must be None or one number"),
        ({"bins": 0}, ValueError, "bins must be"),
        ({"num_classes": "two"}, TypeError, "num_classes must be"),
        ({"threshold": True}, TypeError, "threshold must be a number or None"),
        ({"threshold": float("nan")}, ValueError, "threshold must be a number or None"),
        ({"threshold": 0.5, "input_format": "index"}, ValueError, "labels are not thresholded"),
        ({"ignore_index": 2.0}, TypeError, "ignore_index must be an int"),
        ({"ignore_index": 2}, ValueError, "ignore_index must be the number of no class"),
        ({"average": 3}, TypeError, "average must be one of"),
        ({"average": ""}, ValueError, "average must be one of"),
        ({"include_background": "no"}, TypeError, "include_background must be True or False"),
        ({"windows": {"fine": (0, 0.5)}, "high": 0.5}, ValueError, "instead of low and high"),
        ({"windows": {"fine": (0.5, 0.5)}}, ValueError, "low < high"),
        ({"average": "weighted"}, ValueError, "average must be one of"),
        ({"input_format": "mixed"}, ValueError, "input_format must be one of"),
        ({"empty": "zero"}, ValueError, "empty must be one of"),
        ({"threshold": "half"}, TypeError, "threshold must be a number"),
        ({"estimator": "mean"}, ValueError, "estimator must be"),
        ({"tol": -1.0}, ValueError, "tol must be"),
        ({"hgih": 0.5}, ValueError, "hgih"),
    ],
)
def test_wrong_options(options: dict[str, Any], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        ShapeComplexity(**{"num_classes": 3, **options})


@pytest.mark.parametrize(
    ("options", "preds", "error", "words"),
    [
        ({}, torch.zeros(2, 3), ValueError, 'Pass \\(B, C, \\*spatial\\), or input_format="index"'),
        ({}, torch.zeros(2, 4, 5, 6), ValueError, r"num_classes=3 channels; got \(2, 4, 5, 6\)"),
        ({}, torch.zeros(2, 4, 5, 6), ValueError, r"\. Pass num_classes=4"),
        ({}, torch.zeros(2, 5, 6, dtype=torch.long), ValueError, 'Pass input_format="index" for .* or num_classes=5'),
        ({}, torch.full((2, 3, 5, 6), torch.nan), ValueError, "no NaN"),
        ({}, torch.full((2, 3, 5, 6), 2), ValueError, "preds must hold only 0 and 1; got 2"),
        (
            {"num_classes": 1},
            torch.full((2, 1, 5, 6), 0.3),
            ValueError,
            "threshold must be a number for grey predictions",
        ),
        ({"input_format": "index"}, torch.zeros(2, 5, 6), TypeError, "integer labels; got torch.float32"),
        ({"input_format": "index"}, torch.full((2, 5, 6), 3), ValueError, "labels from 0 to 2; got 3"),
        ({"input_format": "index"}, torch.full((2, 5, 6), -1), ValueError, "labels from 0 to 2; got -1"),
        ({"input_format": "index"}, torch.zeros(2, dtype=torch.long), ValueError, "must have 2 to 5 dimensions"),
        ({}, [[1.0]], TypeError, "torch.Tensor; got list"),
    ],
)
def test_wrong_predictions(options: dict[str, Any], preds: Any, error: type[Exception], words: str) -> None:
    metric = ShapeComplexity(**{"num_classes": 3, **options})
    with pytest.raises(error, match=words):
        metric.update(preds)


@pytest.mark.parametrize(
    ("target", "error", "words"),
    [
        (torch.zeros(6, 3, 19, 25), ValueError, "batch and spatial sizes of preds"),
        (torch.zeros(6, 2, 19, 26), ValueError, "num_classes=3 channels"),
        (torch.zeros(6, 19, 26), TypeError, "integer labels"),
        (torch.full((6, 19, 26), 255), ValueError, "ignore_index"),
        (torch.zeros(6, dtype=torch.long), ValueError, "2 to 5 dimensions"),
        ("mask", TypeError, "torch.Tensor"),
    ],
)
def test_wrong_targets(target: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        ShapeComplexity(3).update(masks(), target)


@pytest.mark.parametrize("dtype", [torch.uint8, torch.uint16, torch.uint32, torch.uint64, torch.int8, torch.int64])
def test_labels_of_any_integer_dtype(dtype: torch.dtype) -> None:
    index = labels()
    metric = ShapeComplexity(3, input_format="index", average="none")
    expected = metric(index, index)
    assert torch.equal(
        ShapeComplexity(3, input_format="index", average="none")(index.to(dtype), index.to(dtype)), expected
    )
    with pytest.raises(ValueError, match="preds must hold labels from 0 to 1; got 2"):
        ShapeComplexity(2, input_format="index")(index.to(dtype))


def test_labels_of_one_class_are_0_outside_and_1() -> None:
    predicted = masks()[:, :1]
    target = torch.zeros(6, 19, 26, dtype=torch.long)
    assert ShapeComplexity(1)(predicted, target).isnan()
    target[2, 3, 4], target[4, 5, 6] = 1, 255
    metric = ShapeComplexity(1, ignore_index=255)
    assert torch.allclose(metric(predicted, target), by_class(predicted)[2].float())
    with pytest.raises(ValueError, match="target must hold 0 and 1 beside num_classes=1; got 255"):
        ShapeComplexity(1)(predicted, target)


@pytest.mark.parametrize("dtype", [torch.float16, torch.float64])
def test_states_stay_whole_numbers(dtype: torch.dtype) -> None:
    index = labels()
    expected = ShapeComplexity(3, input_format="index")(index)
    metric = ShapeComplexity(3, input_format="index")
    assert metric.set_dtype(dtype) is metric
    assert torch.equal(metric(index), expected)
