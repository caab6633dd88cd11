"""Scores in datasets: whatever form a mask comes in, and whichever process it is scored in."""

import pickle
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from problems import catalogue, random_batch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

import torchlinf
from torchlinf import shapes
from torchlinf.transforms import ComplexitySampler, ShapeComplexityScore, ShapeComplexityScored

MASK = shapes.with_appendages((14, 22), [shapes.Appendage("top", 5, 4)], margin=3)  # (H, W) with H != W


def expected(mask: Tensor, **options: Any) -> Tensor:
    return torchlinf.complexity(mask, spatial_ndim=2, **options)


class Silhouettes(Dataset[Any]):
    """Masks as PIL images, with a transform."""

    def __init__(self, transform: Any, wrap: bool = False) -> None:
        self.masks = random_batch(8, 7, (31, 42)).numpy()
        self.transform = transform
        self.wrap = wrap

    def __len__(self) -> int:
        return len(self.masks)

    def __getitem__(self, index: int) -> Any:
        mask = Image.fromarray(self.masks[index])
        return self.transform({"mask": mask, "name": str(index)} if self.wrap else mask)


@pytest.mark.parametrize("name", catalogue())
def test_scores_are_those_of_the_core(name: str) -> None:
    mask = torch.from_numpy(catalogue()[name])
    found = ShapeComplexityScore(low=0.1, high=0.8)(mask)
    torch.testing.assert_close(found, expected(mask, low=0.1, high=0.8), rtol=0, atol=1e-9, equal_nan=True)
    assert found.shape == ()
    assert found.dtype == torch.float64


@pytest.mark.parametrize("dtype", [torch.uint8, torch.int64, torch.float16, torch.bfloat16, torch.float64])
def test_tensors_and_arrays_of_every_dtype(dtype: torch.dtype) -> None:
    score = ShapeComplexityScore()
    assert score(MASK.to(dtype)) == expected(MASK)
    if dtype != torch.bfloat16:
        assert score(MASK.to(dtype).numpy()) == expected(MASK)


@pytest.mark.parametrize("mode", ["1", "L", "I", "F", "P"])
def test_images_of_every_mode_with_one_band(mode: str) -> None:
    image = Image.fromarray(MASK.numpy()).convert(mode)
    threshold = 0.5 if mode == "F" else None
    assert ShapeComplexityScore(threshold=threshold)(image) == expected(MASK)


def test_all_labels_may_be_taken_as_one_shape() -> None:
    labels = 3 * MASK.long() + 4 * MASK.flip(0).long()
    assert ShapeComplexityScore(threshold=0)(labels) == expected(labels > 0)
    assert ShapeComplexityScore()(labels == 7) == expected(labels == 7)


@pytest.mark.parametrize("options", [{"bins": 32, "rho": 3.0}, {"estimator": "std", "tol": 1e-6, "low": 0.3}])
def test_the_options_of_the_measure_reach_the_score(options: dict[str, Any]) -> None:
    score = ShapeComplexityScore(**options)
    assert score(MASK) == expected(MASK, **options) != expected(MASK)
    assert score.measure == torchlinf.Measure(**options)


def test_several_windows_come_from_one_solve() -> None:
    windows = {"fine": (0.0, 0.25), "coarse": (0.25, 1.0)}
    masks = torch.stack([MASK, MASK.flip(0), torch.zeros_like(MASK)])
    found = ShapeComplexityScore(windows=windows, dtype=torch.float32)(masks)
    assert list(found) == ["fine", "coarse"]
    for name, (low, high) in windows.items():
        assert found[name].dtype == torch.float32
        torch.testing.assert_close(found[name], expected(masks, low=low, high=high).float(), equal_nan=True)
        assert found[name].isnan().tolist() == [False, False, True]
    sample = ShapeComplexityScored("mask", windows=windows)({"mask": MASK})
    assert list(sample) == ["mask", "mask_fine", "mask_coarse"]
    assert sample["mask_coarse"] == expected(MASK, low=0.25)


@pytest.mark.parametrize("default", [torch.float16, torch.float64])
def test_the_default_dtype_does_not_matter(default: torch.dtype) -> None:
    before = torch.get_default_dtype()
    torch.set_default_dtype(default)
    try:
        found = ShapeComplexityScore()(MASK)
        sampler = list(ComplexitySampler([2.5, 0.0, 1.0], weight=torch.exp))
    finally:
        torch.set_default_dtype(before)
    assert found.dtype == torch.float64
    assert found == expected(MASK)
    assert sampler == list(ComplexitySampler([2.5, 0.0, 1.0], weight=torch.exp))


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"keys": 3}, TypeError, "keys must be a string or several"),
        ({"keys": ["mask", 3]}, TypeError, "keys must be a string or several"),
        ({"keys": []}, ValueError, "keys must name one mask or more"),
        ({"keys": "mask", "postfix": 3}, TypeError, "postfix must be a string"),
        ({"keys": "mask", "allow_missing_keys": "yes"}, TypeError, "allow_missing_keys must be True or False"),
    ],
)
def test_wrong_keys(options: dict[str, Any], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        ShapeComplexityScored(**options)


def test_a_palette_stands_for_labels() -> None:
    image = Image.fromarray((7 * MASK).to(torch.uint8).numpy())
    image.putpalette(list(range(256)) * 3)
    assert image.mode == "P"
    assert ShapeComplexityScore()(image) == expected(MASK)


def test_leading_dimensions_stay() -> None:
    batch = random_batch(2, 6, (17, 24)).reshape(2, 3, 17, 24)
    batch[1, 2] = False
    found = ShapeComplexityScore(estimator="std")(batch)
    torch.testing.assert_close(found, expected(batch, estimator="std"), rtol=0, atol=1e-9, equal_nan=True)
    assert ShapeComplexityScore()(batch[:0]).shape == (0, 3)
    volume = random_batch(2, 1, (7, 9, 8))[0]
    found = ShapeComplexityScore(spatial_ndim=3)(volume)
    assert found == torchlinf.complexity(volume, spatial_ndim=3)
    assert found > 0


def test_with_a_threshold_what_is_larger_is_inside() -> None:
    probability = torch.rand(19, 26, generator=torch.Generator().manual_seed(1))
    assert ShapeComplexityScore(threshold=0.3)(probability) == expected(probability > 0.3)
    grey = (255 * probability).byte()
    assert ShapeComplexityScore(threshold=127)(Image.fromarray(grey.numpy())) == expected(grey > 127)


def test_the_mask_is_left_as_it_was() -> None:
    frozen = MASK.numpy().copy()
    frozen.flags.writeable = False
    score = ShapeComplexityScore()
    assert score(frozen) == score(np.asfortranarray(frozen)) == score(MASK.T.contiguous().T)
    np.testing.assert_array_equal(frozen, MASK)


def test_dictionaries_get_new_entries() -> None:
    sample = {"mask": MASK, "old": 255 * (~MASK).byte().numpy(), "name": "a"}
    transform = ShapeComplexityScored(["mask", "old"], high=0.5, postfix="bits")
    found = transform(sample)
    assert list(found) == ["mask", "old", "name", "mask_bits", "old_bits"]
    assert list(sample) == ["mask", "old", "name"]
    assert found["mask"] is MASK
    assert (found["mask_bits"], found["old_bits"]) == (expected(MASK, high=0.5), expected(~MASK, high=0.5))
    with pytest.raises(KeyError, match=r"keys must be in the sample; got \['label'\].*allow_missing_keys"):
        ShapeComplexityScored(["mask", "label"])(sample)
    some = ShapeComplexityScored(["mask", "label"], allow_missing_keys=True)(sample)
    assert "mask_complexity" in some
    assert "label_complexity" not in some
    with pytest.raises(TypeError, match="sample must be a dictionary; got Tensor"):
        ShapeComplexityScored("mask")(MASK)  # type: ignore[arg-type]


def test_they_pickle_and_say_what_they_are() -> None:
    for transform in (
        ShapeComplexityScore(low=0.1, high=0.5, threshold=0.5),
        ShapeComplexityScored("mask", low=0.1, high=0.5),
    ):
        again = pickle.loads(pickle.dumps(transform))
        assert repr(again) == repr(transform)
        assert "low=0.1, high=0.5" in repr(again)


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_in_the_workers_of_a_loader(start: str) -> None:
    score = ShapeComplexityScore()
    whole = Silhouettes(score)
    scores = score(torch.from_numpy(whole.masks))  # the parent uses its kernels and its threads before it forks
    loader = DataLoader(whole, batch_size=3, num_workers=2, multiprocessing_context=start, timeout=100)
    assert torch.equal(torch.cat(list(loader)), scores)
    scored = Silhouettes(_without_image, wrap=True)
    loader = DataLoader(scored, batch_size=3, num_workers=1, multiprocessing_context=start, timeout=100)
    batches = list(loader)
    assert torch.equal(torch.cat([batch["mask_complexity"] for batch in batches]), scores)
    assert [name for batch in batches for name in batch["name"]] == [str(i) for i in range(7)]


def _without_image(sample: dict[str, Any]) -> dict[str, Any]:
    found = ShapeComplexityScored("mask")(sample)
    del found["mask"]
    return found


@pytest.mark.parametrize(
    ("mask", "error", "words"),
    [
        (torch.tensor([[0.5, 1.5]]), ValueError, r"got numbers from 0\.5 to 1\.5\. .*threshold="),
        (torch.full((4, 5), torch.nan), ValueError, "must hold no NaN"),
        (torch.ones(5), ValueError, r"at least spatial_ndim=2 dimensions.*got \(5,\)"),
        (torch.ones(0, 5), ValueError, "size 1 or more"),
        (np.full((4, 5), "a"), TypeError, "bool, integer or real"),
        (torch.ones(4, 5, dtype=torch.complex64), TypeError, "bool, integer or real"),
        (Image.new("RGB", (4, 5)), TypeError, r"one band; got mode RGB.*convert\('L'\)"),
        (Image.new("LA", (4, 5)), TypeError, "one band; got mode LA"),
        (None, TypeError, "bool, integer or real"),
        (np.array([[0, 3, 7]]), ValueError, r"0 and one other value, .*; got 3 values \(0, 3, 7\)\. Pass mask == 3"),
        (np.array([[3, 7]], np.uint8), ValueError, r"got 2 values \(3, 7\)"),
        (np.array([[0, -1, 7]]), ValueError, r"got 3 values \(-1, 0, 7\)"),
    ],
)
def test_wrong_masks(mask: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        ShapeComplexityScore()(mask)


def test_nan_is_refused_beside_a_threshold_too() -> None:
    with pytest.raises(ValueError, match="must hold no NaN"):
        ShapeComplexityScore(threshold=0.5)(torch.full((4, 5), torch.nan))


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"low": 0.7, "high": 0.5}, ValueError, "low < high"),
        ({"threshold": "half"}, TypeError, "threshold must be a number"),
        ({"spatial_ndim": 5}, ValueError, "spatial_ndim must be"),
        ({"spatial_ndim": 2.0}, TypeError, "spatial_ndim must be"),
        ({"tol": 0}, ValueError, "tol must be"),
        ({"bins": 0}, ValueError, "bins must be"),
        ({"threshold": float("nan")}, ValueError, "threshold must be a number or None"),
        ({"dtype": torch.int64}, TypeError, "dtype must be a floating-point dtype"),
        ({"rho": torch.ones(2)}, TypeError, "rho must be None or one number"),
        ({"windows": {}}, ValueError, "windows must name"),
        ({"windows": {"fine": (0.0, 0.5)}, "low": 0.1}, ValueError, "instead of low and high"),
        ({"lwo": 0.1}, TypeError, "lwo is not an option here"),
        ({"estimator": "mean"}, ValueError, "estimator must be"),
    ],
)
def test_wrong_options(options: dict[str, Any], error: type[Exception], words: str) -> None:
    for make in (ShapeComplexityScore, lambda **kwargs: ShapeComplexityScored("mask", **kwargs)):
        with pytest.raises(error, match=words):
            make(**options)
