"""ShapeComplexity for torchmetrics: the core's numbers, however they are spread over batches and processes."""

import math
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest
import torch
import torch.distributed as dist
from problems import random_batch
from torch import Tensor
from torchmetrics import ClasswiseWrapper, JaccardIndex, MetricCollection, MetricTracker

import torchlinf
from torchlinf import complexity_profile, shapes
from torchlinf.metrics import ShapeComplexity


@pytest.fixture(autouse=True)
def _close_figures() -> Iterator[None]:
    yield
    plt.close("all")


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


@pytest.mark.parametrize("sizes", [(40,), (19, 26), (7, 9, 8)])
def test_the_values_are_those_of_the_core(sizes: tuple[int, ...]) -> None:
    found = masks(sizes)
    expected = by_class(found, 0.1, 0.7)
    options: dict[str, Any] = {"low": 0.1, "high": 0.7}
    for average, value in (("none", expected.mean(0)), ("macro", expected.mean()), ("micro", expected.mean())):
        metric = ShapeComplexity(3, average=average, **options)
        torch.testing.assert_close(metric(found), value.float())
    metric = ShapeComplexity(3, average="none", **options)
    for part in found.split([1, 3, 2]):
        metric.update(part)
    torch.testing.assert_close(metric.compute(), expected.mean(0).float())
    assert (metric.num_empty + metric.num_shapes).tolist() == [6, 6, 6]
    assert metric.num_empty[1] >= 1


def test_macro_and_micro_differ_where_classes_are_rare() -> None:
    found = masks()
    target = found.clone()
    target[1:, 0] = False  # class 0 is in one sample only
    expected = by_class(found)
    there = target.flatten(2).any(2)
    none = torch.stack([expected[there[:, c], c].mean() for c in range(3)]).float()
    assert torch.allclose(ShapeComplexity(3, average="none")(found, target), none)
    assert torch.allclose(ShapeComplexity(3)(found, target), none.mean())
    micro = ShapeComplexity(3, average="micro")(found, target)
    assert torch.allclose(micro, expected[there].mean().float())
    assert not torch.allclose(micro, none.mean(), atol=1e-3)


def test_an_empty_prediction_never_improves_the_score() -> None:
    preds = masks()
    before = ShapeComplexity(3)(preds)
    for b, c in ((0, 0), (4, 2)):
        emptied = preds.clone()
        emptied[b, c] = False
        metric = ShapeComplexity(3)
        assert metric(emptied) > before
        assert metric.num_empty.sum() == 1 + (~preds.flatten(2).any(2)).sum()
    nothing = ShapeComplexity(3)(torch.zeros_like(preds))
    assert nothing == 10.0
    assert ShapeComplexity(3, estimator="std")(torch.zeros_like(preds)) == 0.5
    assert ShapeComplexity(3, bins=64)(torch.zeros_like(preds)) == 6.0


def test_empty_predictions_may_be_skipped_but_are_counted() -> None:
    preds = masks()
    metric = ShapeComplexity(3, empty="skip", average="none")
    expected = torchlinf.complexity(preds).nanmean(dim=0)
    torch.testing.assert_close(metric(preds), expected.float())
    assert metric.num_empty.tolist() == preds.flatten(2).any(2).logical_not().sum(0).tolist()
    assert ShapeComplexity(3, empty="skip")(torch.zeros_like(preds)).isnan()


@pytest.mark.parametrize("options", [{"bins": 32, "rho": 3.0}, {"estimator": "std", "tol": 1e-6, "low": 0.3}])
def test_the_options_of_the_measure_reach_the_value(options: dict[str, Any]) -> None:
    found = masks()
    expected = torchlinf.complexity(found, **options)
    metric = ShapeComplexity(3, empty="skip", average="none", sync_on_compute=False, **options)
    torch.testing.assert_close(metric(found), expected.nanmean(dim=0).float())
    assert metric.measure == torchlinf.Measure(**options)
    assert metric.sync_on_compute is False
    worst = ShapeComplexity(3, **options)(torch.zeros_like(found))
    assert worst == (5.0 if "bins" in options else 0.5)


@pytest.mark.parametrize("default", [torch.float16, torch.float64])
def test_the_default_dtype_does_not_matter(default: torch.dtype) -> None:
    found = masks()
    expected = ShapeComplexity(3)(found)
    before = torch.get_default_dtype()
    torch.set_default_dtype(default)
    try:
        other = ShapeComplexity(3)(found)
    finally:
        torch.set_default_dtype(before)
    assert other.dtype == torch.float32
    assert other == expected


def test_windows_share_one_solve() -> None:
    found = masks()
    windows = {"fine": (0.0, 0.25), "coarse": (0.25, 1.0)}
    both = ShapeComplexity(3, windows=windows, average="none")(found)
    assert list(both) == ["fine", "coarse"]
    for name, (low, high) in windows.items():
        torch.testing.assert_close(both[name], by_class(found, low, high).mean(0).float())
        assert torch.equal(both[name], ShapeComplexity(3, low=low, high=high, average="none")(found))


def test_a_batch_without_samples_or_targets_changes_nothing() -> None:
    found = masks()
    metric = ShapeComplexity(3)
    before = metric(found)
    metric.update(found[:0])
    metric.update(found, torch.zeros_like(found))
    assert torch.equal(metric.compute(), before)
    metric.reset()
    assert metric.num_shapes.sum() == 0
    with pytest.warns(UserWarning, match="before the ``update``"):
        assert metric.compute().isnan()


def test_batches_do_not_matter_to_the_last_bit() -> None:
    found = masks(batch=9)
    whole, parts = ShapeComplexity(3), ShapeComplexity(3)
    whole.update(found)
    for part in reversed(found.split(2)):
        parts.update(part)
    assert torch.equal(whole.compute(), parts.compute())


def test_it_pickles_moves_and_keeps_its_state() -> None:
    found = masks()
    metric = ShapeComplexity(3, windows={"a": (0.0, 0.5)}, threshold=0.5)
    metric.update(found)
    other = pickle.loads(pickle.dumps(metric))
    assert torch.equal(other.compute()["a"], metric.compute()["a"])
    other.update(~found)
    metric.clone().update(found)
    assert not torch.equal(other.compute()["a"], metric.compute()["a"])
    metric.persistent(True)
    fresh = ShapeComplexity(3, windows={"a": (0.0, 0.5)}, threshold=0.5)
    fresh.persistent(True)
    fresh.load_state_dict(metric.state_dict())
    assert torch.equal(fresh.total, metric.total)
    assert metric.half().double().to("cpu").total.dtype == torch.int64


def test_in_a_collection_beside_other_metrics() -> None:
    index = labels()
    logits = torch.nn.functional.one_hot(index, 3).movedim(-1, 1).float()
    names = ["background", "cell", "edge"]
    collection = MetricCollection(
        {
            "complexity": ShapeComplexity(3),
            "each": ClasswiseWrapper(ShapeComplexity(3, average="none"), labels=names),
            "windows": ShapeComplexity(3, windows={"fine": (0.0, 0.25), "coarse": (0.25, 1.0)}),
            "iou": JaccardIndex("multiclass", num_classes=3),
        }
    )
    for part in (slice(0, 2), slice(2, 6)):
        collection.update(logits[part], index[part])
    found = collection.compute()
    assert {"complexity", "fine", "coarse", "iou", "shapecomplexity_cell"} <= set(found)
    alone = ShapeComplexity(3)
    alone.update(logits, index)
    assert torch.equal(found["complexity"], alone.compute())


def test_a_collection_takes_no_two_windows_for_one() -> None:
    """After a batch of boxes all windows have equal sums; torchmetrics would go on with one of them."""
    boxes = torch.zeros(2, 1, 15, 18)
    boxes[..., 2:9, 3:12] = 1
    collection = MetricCollection(
        {
            "all": ShapeComplexity(1, threshold=0.5),
            "fine": ShapeComplexity(1, threshold=0.5, high=0.25),
            "std": ShapeComplexity(1, threshold=0.5, estimator="std"),
            "again": ShapeComplexity(1, threshold=0.5, average="micro"),
            "other bins": ShapeComplexity(1, threshold=0.5, bins=16),
            "other rho": ShapeComplexity(1, threshold=0.5, rho=2.0),
            "coarse tol": ShapeComplexity(1, threshold=0.5, tol=0.1),
            "same window": ShapeComplexity(1, threshold=0.5, windows={"a": (0.0, 1.0)}),
        }
    )
    disc = shapes.disc(9)[None, None].float()
    for batch in (boxes, disc):
        collection.update(batch)
    found = collection.compute()
    mean = float(torchlinf.complexity(disc)) / 3
    fine = float(torchlinf.complexity(disc, high=0.25)) / 3
    std = float(torchlinf.complexity(disc, estimator="std")) / 3
    assert [found[name].item() for name in ("all", "fine", "std", "again")] == pytest.approx([mean, fine, std, mean])
    bins = float(torchlinf.complexity(disc, bins=16)) / 3
    rho = float(torchlinf.complexity(disc, rho=2.0)) / 3
    coarse = float(torchlinf.complexity(disc, tol=0.1)) / 3
    assert [found[name].item() for name in ("other bins", "other rho", "coarse tol", "a")] == pytest.approx(
        [bins, rho, coarse, mean]
    )
    assert sorted(len(group) for group in collection.compute_groups.values()) == [1] * 6 + [2]


def test_a_tracker_keeps_the_simplest() -> None:
    metric = ShapeComplexity(1, threshold=0.5)
    tracker = MetricTracker(metric, maximize=metric.higher_is_better)  # None, which asks the metric, is newer
    for mask in (shapes.disc(9), shapes.box(9, 14), shapes.disc(5)):
        tracker.increment()
        tracker.update(mask[None, None])
    best, step = tracker.best_metric(return_step=True)
    assert (best, step) == (0.0, 1)


def test_plots() -> None:
    metric = ShapeComplexity(3, average="none")
    found = masks()
    metric.update(found)
    figure, axes = metric.plot()
    assert axes.get_ylabel() == "complexity (bits)"
    assert figure is axes.figure
    heights = sorted(float(line.get_ydata()[0]) for line in axes.lines if len(line.get_ydata()) == 1)
    assert heights == pytest.approx(sorted(metric.compute().tolist()))
    _, axes = plt.subplots()
    assert metric.plot([metric(found), metric(~found)], ax=axes)[1] is axes
    share = ShapeComplexity(3, estimator="std", windows={"fine": (0.0, 0.5), "coarse": (0.5, 1.0)})
    share.update(found)
    assert share.plot()[1].get_ylabel() == "complexity (share of max f)"


def work(rank: int, folder: str) -> None:
    torch.set_num_threads(1)
    dist.init_process_group("gloo", init_method=f"file://{folder}/meeting", rank=rank, world_size=2)
    metrics = {"each": ShapeComplexity(3, average="none"), "windows": ShapeComplexity(3, windows={"a": (0.0, 0.5)})}
    collection = MetricCollection(metrics)
    for part in masks(batch=7)[rank::2].split(2):  # four samples here, three there
        collection.update(part)
    found = collection.compute()
    with collection["each"].sync_context():
        found["empty"] = collection["each"].num_empty.clone()
    torch.save({**found, "own": collection["each"].num_empty}, Path(folder) / f"{rank}.pt")
    dist.destroy_process_group()


def test_two_processes_agree_with_one(tmp_path: Path) -> None:
    found = masks(batch=7)
    alone = ShapeComplexity(3, average="none")
    windows = ShapeComplexity(3, windows={"a": (0.0, 0.5)})
    expected = {"each": alone(found), **windows(found), "empty": alone.num_empty}
    torch.multiprocessing.spawn(work, args=(str(tmp_path),), nprocs=2)
    results = [torch.load(tmp_path / f"{rank}.pt") for rank in range(2)]
    for result in results:
        for name, value in expected.items():
            assert torch.equal(result[name], value), name
    assert torch.equal(results[0]["own"] + results[1]["own"], alone.num_empty)
    assert not torch.equal(results[0]["own"], alone.num_empty)


def test_without_torchmetrics_it_says_what_to_install() -> None:
    script = """
import sys
sys.modules["torchmetrics"] = None
import torchlinf
try:
    import torchlinf.metrics
except ImportError as error:
    print(error)
"""
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert out == ("torchlinf.metrics needs torchmetrics; it is not installed. Run: pip install 'torchlinf[metrics]'\n")


def test_the_bound_of_the_result_is_the_mean_of_the_bounds_of_the_shapes() -> None:
    masks = torch.stack([shapes.disc(9), torch.nn.functional.pad(shapes.box(9, 14), (0, 5, 0, 10))])[:, None]
    exact = ShapeComplexity(1)
    exact.update(masks)
    assert exact.error_bound().item() == 0.0
    rough = ShapeComplexity(1, tol=0.1, tol_bits=math.inf, windows={"fine": (0.0, 0.25), "all": (0.0, 1.0)})
    rough.update(masks)
    profile = complexity_profile(masks, tol=0.1, tol_bits=math.inf)
    for name, ends in {"fine": (0.0, 0.25), "all": (0.0, 1.0)}.items():
        assert rough.error_bound()[name].item() == pytest.approx(float(profile.error_bound(*ends).mean()), abs=1e-6)
    assert rough.error_bound()["all"] > 0
    assert abs(rough.compute()["all"] - exact.compute()) <= rough.error_bound()["all"] + 1e-6
