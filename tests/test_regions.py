"""Decision regions: what is measured is what the core measures on masks made by hand, in either boundary condition."""

import copy
import warnings
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest
import torch
from sklearn.datasets import make_moons
from sklearn.ensemble import IsolationForest
from sklearn.linear_model import LogisticRegression, Ridge, RidgeClassifier
from sklearn.model_selection import FixedThresholdClassifier, GridSearchCV
from sklearn.multiclass import OneVsRestClassifier
from sklearn.multioutput import MultiOutputClassifier
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC, OneClassSVM
from sklearn.tree import DecisionTreeClassifier
from torch import Tensor, nn

import torchlinf
from tests.problems import Pixel, catalogue, random_mask
from torchlinf import Measure, regions
from torchlinf.regions import bounds_around, decision_plane, decision_plane_complexity, decision_region_complexity
from torchlinf.regions.open_boundary import open_profile

BOUNDS = [(-2.0, 2.5), (-1.0, 1.5)]
X, Y = make_moons(60, noise=0.3, random_state=0)


def stripes(points: Tensor) -> Tensor:
    return (points[:, 0] + points[:, 1] ** 2).floor().long() % 3


# --- the open boundary ------------------------------------------------------------------------------------------------


def within(pixel: Pixel, shape: tuple[int, ...]) -> list[Pixel]:
    """The block of a pixel, cut at the edge of the array."""
    around = product(*(range(max(i - 1, 0), min(i + 2, size)) for i, size in zip(pixel, shape, strict=True)))
    return list(around)


def naive_open_levels(mask: np.ndarray, rho: float | None = None) -> list[float]:
    """Entropies of the levels by the definition: distances and blocks that end at the edge, Gauss-Seidel sweeps."""
    inside, outside = (np.argwhere(part) for part in (mask, ~mask))
    distance = {tuple(x): int(np.abs(outside - x).max(axis=1).min()) for x in inside.tolist()}
    radius = max(distance.values())
    rho = rho or radius
    field = dict.fromkeys(np.ndindex(mask.shape), 0.0)
    change = np.inf
    while change > 1e-15 * max(field.values()):
        change = 0.0
        for pixel in distance:
            values = [field[other] for other in within(pixel, mask.shape)]
            new = (max(values) + min(values) + 1) / (2 + 1 / rho**2)
            change, field[pixel] = max(change, abs(new - field[pixel])), new
    top, levels = max(field.values()), []
    for k in range(1, radius + 1):
        bins = [int(min(field[p] / top * 1024 + 1e-6, 1023)) for p in distance if distance[p] == k]
        share = np.unique(bins, return_counts=True)[1] / len(bins)
        levels.append(float(-(share * np.log2(share)).sum()))
    return levels


OPEN = {name: mask for name, mask in catalogue().items() if mask.any() and not mask.all()}


@pytest.mark.parametrize("name", OPEN)
def test_open_boundaries_follow_the_definition(name: str) -> None:
    for mask in (OPEN[name], ~OPEN[name]):
        profile = open_profile(torch.from_numpy(mask)[None], Measure())
        np.testing.assert_allclose(profile.levels()[0], naive_open_levels(mask), rtol=0, atol=1e-9)
        assert profile.field_error_bound <= 1e-9


@pytest.mark.parametrize("sizes", [(17,), (11, 8), (6, 5, 7), (4, 3, 5, 4)])
def test_open_boundaries_of_random_shapes_in_every_dimension(sizes: tuple[int, ...]) -> None:
    generator = np.random.default_rng(3)
    masks = [random_mask(generator, sizes) for _ in range(6)]
    masks = [mask for mask in masks if mask.any() and not mask.all()]
    assert len(masks) >= 3
    profile = open_profile(torch.from_numpy(np.stack(masks)), Measure())
    for levels, mask in zip(profile.levels(), masks, strict=True):
        np.testing.assert_allclose(levels, naive_open_levels(mask), rtol=0, atol=1e-9)


@pytest.mark.parametrize("rho", [1.5, 40.0])
def test_open_boundaries_of_any_screening_length(rho: float) -> None:
    masks = [random_mask(np.random.default_rng(seed), (9, 12)) for seed in range(4)]
    stack, each = torch.from_numpy(np.stack(masks)), torch.full((4,), rho)
    for measure in (Measure(rho=rho), Measure(rho=each)):
        profile = open_profile(stack, measure)
        for levels, mask in zip(profile.levels(), masks, strict=True):
            np.testing.assert_allclose(levels, naive_open_levels(mask, rho), rtol=0, atol=1e-9)


def test_open_boundaries_are_the_middle_of_the_mirrored_shape() -> None:
    y, x = torch.meshgrid(torch.arange(9), torch.arange(14), indexing="ij")
    mask = 2 * x + y < 15
    far = np.pad(mask.numpy(), 60, mode="symmetric")
    field = torchlinf.solve_field(torch.from_numpy(far), rho=5.0, spatial_ndim=2).value[60:-60, 60:-60]
    distance = torchlinf.chessboard_distance(torch.from_numpy(far), spatial_ndim=2)[60:-60, 60:-60]
    profile = open_profile(mask[None], Measure())
    assert profile.radius.item() == distance.max() == 5
    for k, found in enumerate(profile.levels()[0], start=1):
        values = (field[distance == k] / field.max() * 1024 + 1e-6).floor().clamp(max=1023)
        share = values.unique(return_counts=True)[1].double() / len(values)
        assert found.item() == pytest.approx(-(share * share.log2()).sum().item(), abs=1e-9)


def test_what_is_straight_along_the_axes_is_simple_with_either_boundary() -> None:
    for cut, boundary in product((0, 1), ("background", "open")):
        found = decision_region_complexity(
            lambda p, cut=cut: p[:, cut], BOUNDS, resolution=(23, 16), threshold=0.4, boundary=boundary
        )
        assert found.mean().tolist() == [0.0, 0.0]
    band = decision_region_complexity(lambda p: p[:, 0].abs() < 0.5, BOUNDS, resolution=(23, 16), boundary="open")
    assert band.mean()[1] == 0.0


def test_boundary_conditions_differ_where_regions_touch_the_edge_alone() -> None:
    disc = [
        decision_region_complexity(lambda p: p.norm(dim=1) < 1, [(-2, 2)] * 2, resolution=31, boundary=f)
        for f in ("background", "open")
    ]
    assert disc[0].mean()[1] == disc[1].mean()[1] > 0  # the disc lies within
    assert disc[0].mean()[0] != disc[1].mean()[0]
    assert disc[0].profile.radius[0] < disc[1].profile.radius[0]


@pytest.mark.parametrize("boundary", ["background", "open"])
def test_a_class_everywhere_is_simple_and_a_class_nowhere_is_counted(boundary: str) -> None:
    found = decision_region_complexity(
        lambda p: torch.ones(len(p), 3).cumsum(1), BOUNDS, resolution=(12, 9), boundary=boundary
    )
    assert found.area.tolist() == [0, 0, 1]
    assert found.mean().isnan().tolist() == [True, True, False]
    assert (found.mean()[2], found.overall(), found.num_empty) == (0, 0, 2)
    nothing = decision_region_complexity(lambda p: p, BOUNDS, resolution=(12, 9), threshold=9.0, boundary=boundary)
    assert nothing.num_empty == 2
    assert nothing.overall().isnan()


# --- masks from classifiers -----------------------------------------------------------------------------------------


def naive_masks(labels: Callable[[list[float]], Any], classes: list[Any], sizes: tuple[int, ...]) -> np.ndarray:
    """Point by point, on NumPy's grid."""
    axes = [np.linspace(*ends, size) for ends, size in zip(BOUNDS * 2, sizes, strict=False)]
    masks = np.zeros((len(classes), *sizes), bool)
    for index in np.ndindex(sizes):
        masks[(classes.index(labels([axis[i] for axis, i in zip(axes, index, strict=True)])), *index)] = True
    return masks


def test_numbers_are_those_of_the_core() -> None:
    found = decision_region_complexity(stripes, BOUNDS, resolution=(31, 22))
    masks = naive_masks(lambda p: int(np.floor(p[0] + p[1] ** 2)) % 3, [0, 1, 2], (31, 22))
    np.testing.assert_array_equal(found.masks, masks)
    profile = torchlinf.complexity_profile(torch.from_numpy(masks), spatial_ndim=2)
    torch.testing.assert_close(found.profile.values, profile.values, rtol=0, atol=0)
    weights = masks.mean((1, 2))
    assert found.overall(0.1, 0.6).item() == pytest.approx(float(weights @ profile.mean(0.1, 0.6).numpy()), abs=1e-12)
    torch.testing.assert_close(found.overall_values(), torch.from_numpy(weights @ profile.values.numpy()))
    np.testing.assert_allclose(found.axes[1], np.linspace(-1, 1.5, 22))


@pytest.mark.parametrize("sizes", [(19,), (9, 7), (6, 5, 4), (5, 4, 3, 4)])
def test_one_to_four_features_in_chunks_of_any_size(sizes: tuple[int, ...]) -> None:
    bounds = (BOUNDS * 2)[: len(sizes)]
    masks = naive_masks(lambda p: int(sum(p) > 0.3), [0, 1], sizes)
    for chunk_size in (None, 1, 7, 10**6):
        calls: list[int] = []

        def classifier(points: Tensor, calls: list[int] = calls) -> Tensor:
            calls.append(len(points))
            return (points.sum(dim=1) > 0.3).long()

        found = decision_region_complexity(classifier, bounds, resolution=sizes, chunk_size=chunk_size)
        np.testing.assert_array_equal(found.masks, masks)
        assert sum(calls) == np.prod(sizes)
        assert max(calls) <= (chunk_size or 1 << 14)


@pytest.mark.parametrize("method", ["auto", "predict", "predict_proba", "decision_function"])
@pytest.mark.parametrize("labels", [Y, np.array(["no", "yes"])[Y], (X[:, 0] // 1).astype(int), Y.astype(float)])
def test_estimators_give_the_masks_of_predict(method: str, labels: np.ndarray) -> None:
    estimator = LogisticRegression().fit(X, labels)
    found = decision_region_complexity(estimator, BOUNDS, resolution=(14, 11), response_method=method)
    assert found.classes == tuple(estimator.classes_.tolist())
    masks = naive_masks(lambda p: estimator.predict([p])[0], list(estimator.classes_), (14, 11))
    np.testing.assert_array_equal(found.masks, masks)


def test_estimators_without_scores_and_with_thresholds() -> None:
    tree = DecisionTreeClassifier(max_depth=3, random_state=0).fit(X, Y)
    assert decision_region_complexity(tree, BOUNDS, resolution=40).overall() > 0
    near = KNeighborsClassifier(4).fit(X, Y)
    points = np.stack(np.meshgrid(*(np.linspace(*b, 9) for b in BOUNDS), indexing="ij"), -1).reshape(-1, 2)
    found = decision_region_complexity(near, BOUNDS, resolution=9, threshold=0.6)
    np.testing.assert_array_equal(found.masks.flatten(1), near.predict_proba(points).T > 0.6)
    assert found.area.sum() < 1


def grid_points(resolution: int) -> np.ndarray:
    return np.stack(np.meshgrid(*(np.linspace(*b, resolution) for b in BOUNDS), indexing="ij"), -1).reshape(-1, 2)


@pytest.mark.parametrize("classes", [3, 4])
def test_what_is_measured_is_what_an_estimator_predicts(classes: int) -> None:
    labels = np.digitize(X[:, 0], np.quantile(X[:, 0], np.arange(1, classes) / classes))
    pairs = SVC(decision_function_shape="ovo").fit(X, labels)
    tuned = FixedThresholdClassifier(LogisticRegression(), threshold=0.9).fit(X, Y)
    for estimator in (pairs, make_pipeline(StandardScaler(), pairs).fit(X, labels), SVC().fit(X, labels), tuned):
        found = decision_region_complexity(estimator, BOUNDS, resolution=31)
        predicted = estimator.predict(grid_points(31))
        np.testing.assert_array_equal(found.masks.flatten(1), predicted == np.array(found.classes)[:, None])
    for estimator in (pairs, make_pipeline(StandardScaler(), pairs), GridSearchCV(pairs, {"C": [1.0]}, cv=2)):
        estimator.fit(X, labels)
        for options in ({"response_method": "decision_function"}, {"threshold": 0.0}):
            with pytest.raises(
                ValueError, match=r'"ovo", which scores pairs of classes\. Pass response_method="predict"'
            ):
                decision_region_complexity(estimator, BOUNDS, resolution=9, **options)


def test_classes_of_an_estimator_can_be_renamed() -> None:
    estimator = LogisticRegression().fit(X, Y)
    for method in ("auto", "predict", "decision_function"):
        found = decision_region_complexity(estimator, BOUNDS, resolution=9, classes=["a", "b"], response_method=method)
        assert found.classes == ("a", "b")
        np.testing.assert_array_equal(found.masks[1].flatten(), estimator.predict(grid_points(9)))
    with pytest.raises(ValueError, match=r"classes must name the 2 classes of the classifier, \[0, 1\]"):
        decision_region_complexity(estimator, BOUNDS, resolution=9, classes=["a", "b", "c"])


def test_one_class_estimators() -> None:
    for estimator in (OneClassSVM(nu=0.3), IsolationForest(n_estimators=9, contamination=0.2, random_state=0)):
        found = decision_region_complexity(estimator.fit(X), BOUNDS, resolution=9)
        assert found.classes == (-1, 1)
        np.testing.assert_array_equal(found.masks[1].flatten(), estimator.predict(grid_points(9)) == 1)


SEVERAL = np.stack([Y, X[:, 0] > 0.5], axis=1).astype(int)


@pytest.mark.parametrize(
    "estimator",
    [
        DecisionTreeClassifier(),
        KNeighborsClassifier(),
        MultiOutputClassifier(LogisticRegression()),
        OneVsRestClassifier(LogisticRegression()),
        RidgeClassifier(),
        Ridge(),
        make_pipeline(StandardScaler(), DecisionTreeClassifier()),
    ],
)
@pytest.mark.parametrize("options", [{}, {"response_method": "predict"}, {"threshold": 0.5}])
def test_several_answers_a_point_are_refused(estimator: Any, options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"classifier must predict one class for each point; got \w+, which predicts"):
        decision_region_complexity(estimator.fit(X, SEVERAL), BOUNDS, resolution=9, **options)


def test_labels_of_several_classes_are_no_scores() -> None:
    def both(points: Tensor) -> Tensor:
        return points > 0

    with pytest.raises(ValueError, match=r"one class; got a row with 0 of 2 labels. Pass threshold=0\.5"):
        decision_region_complexity(both, BOUNDS, resolution=9)
    found = decision_region_complexity(both, BOUNDS, resolution=9, threshold=0.5)
    np.testing.assert_array_equal(found.masks.flatten(1), (grid_points(9) > 0).T)
    one_hot = decision_region_complexity(lambda p: torch.stack([p[:, 0] > 0, p[:, 0] <= 0], 1), BOUNDS, resolution=9)
    assert one_hot.area.sum() == 1


def test_estimators_fitted_on_tables_get_tables() -> None:
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame(X, columns=["width", "height"], index=range(100, 160))
    seen = []

    class Watching(LogisticRegression):
        def predict(self, points: Any) -> np.ndarray:
            seen.append(points)
            return super().predict(points)

    estimator = Watching().fit(table, pandas.Series(Y))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = decision_region_complexity(estimator, bounds_around(table), resolution=9)
        planes = decision_plane_complexity(estimator, table, num_planes=2, resolution=9)
    assert all(list(points.columns) == ["width", "height"] for points in seen)
    plain = LogisticRegression().fit(X, Y)
    assert torch.equal(found.masks, decision_region_complexity(plain, bounds_around(X), resolution=9).masks)
    assert torch.equal(planes.values, decision_plane_complexity(plain, X, num_planes=2, resolution=9).values)


def test_points_of_any_kind() -> None:
    frozen = X.copy()
    frozen.flags.writeable = False
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for points in (frozen, X.astype(">f8"), X.tolist(), np.ma.masked_array(X)):
            assert bounds_around(points) == bounds_around(torch.from_numpy(X))
    with pytest.raises(ValueError, match="X must have no masked entries"):
        bounds_around(np.ma.masked_array(X, mask=X > 2))
    with pytest.raises(TypeError, match="X must be an array of numbers"):
        bounds_around(np.array([["a", "b"]]))


def test_a_threshold_that_is_no_number() -> None:
    with pytest.raises(ValueError, match="threshold must be a number or None; got NaN"):
        decision_region_complexity(lambda p: p[:, 0], BOUNDS, resolution=9, threshold=float("nan"))


def test_modules_are_asked_in_evaluation_mode_and_left_as_they_were() -> None:
    torch.manual_seed(0)
    model = nn.Sequential(nn.Linear(2, 16), nn.BatchNorm1d(16), nn.Dropout(0.9), nn.Tanh(), nn.Linear(16, 3)).double()
    model[1].eval()
    modes = [part.training for part in model.modules()]
    before = {name: value.clone() for name, value in model.state_dict().items()}
    found = decision_region_complexity(model, BOUNDS, resolution=(21, 13), chunk_size=50)
    assert [part.training for part in model.modules()] == modes
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items())
    model.eval()
    masks = naive_masks(lambda p: int(model(torch.tensor([p], dtype=torch.float64)).argmax()), [0, 1, 2], (21, 13))
    np.testing.assert_array_equal(found.masks, masks)


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_one_logit_needs_a_threshold(dtype: torch.dtype) -> None:
    torch.manual_seed(0)
    model = nn.Sequential(nn.Linear(2, 1, bias=False)).to(dtype)
    with pytest.raises(ValueError, match=r"threshold must be a number.*threshold=0\.0 for logits"):
        decision_region_complexity(model, BOUNDS, resolution=9)
    zero, one = decision_region_complexity(model, BOUNDS, resolution=9, threshold=0.0).masks
    assert bool((zero ^ one).all())
    assert 0 < one.sum() < 81


def test_labels_by_name() -> None:
    def name(points: Tensor) -> np.ndarray:
        return np.where(points[:, 0] > 0, "b", "c")

    assert decision_region_complexity(name, BOUNDS, resolution=9).classes == ("b", "c")
    found = decision_region_complexity(name, BOUNDS, resolution=9, classes=["a", "b", "c"])
    assert (found.num_empty, found.area[0]) == (1, 0)
    with pytest.raises(ValueError, match=r"classes must hold every label.*without 'c'"):
        decision_region_complexity(name, BOUNDS, resolution=9, classes=["a", "b"])


def test_bad_answers() -> None:
    def broken(points: Tensor) -> Tensor:
        return torch.where(points[:, :1] > 2.4, torch.nan, points)

    with pytest.raises(ValueError, match=r"without NaN; got NaN at 9 of 81 points, the first at \(2\.5, -1\)"):
        decision_region_complexity(broken, BOUNDS, resolution=9)
    with pytest.raises(ValueError, match=r"NaN at 8 of 10 points"):  # that were asked at a time
        decision_region_complexity(broken, BOUNDS, resolution=9, chunk_size=10)
    with pytest.raises(ValueError, match=r"NaN at 9 of 81 points"):
        decision_region_complexity(lambda p: broken(p)[:, 0], BOUNDS, resolution=9, threshold=0.0)
    with pytest.raises(ValueError, match=r"NaN at \d+ of 81 points"):
        decision_plane(lambda p: p / 0 * 0, X[:3], resolution=9)
    with pytest.raises(ValueError, match=r"NaN at \d+ of 81 points"):
        decision_plane_complexity(lambda p: p.log(), X, num_planes=4, resolution=9)
    answers = [lambda p: p[:-1], lambda p: p[:, :, None], lambda p: p[:, :0], lambda p: (p, p)]
    for answer in answers:
        with pytest.raises(ValueError, match=r"classifier must answer \(81,\) or \(81, classes\)"):
            decision_region_complexity(answer, BOUNDS, resolution=9)


class Undecided:
    """An estimator that has no answer for some points."""

    classes_ = np.array([0, 1])

    def predict(self, points: np.ndarray) -> np.ndarray:
        return np.where(points[:, 0] > 2.4, np.nan, points[:, 0] > 0)

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        return np.stack([self.predict(points), 1 - self.predict(points)], axis=1)


@pytest.mark.parametrize("method", ["predict", "predict_proba"])
def test_estimators_that_answer_nan(method: str) -> None:
    with pytest.raises(ValueError, match="NaN at 9 of 81 points"):
        decision_region_complexity(Undecided(), BOUNDS, resolution=9, response_method=method)


@pytest.mark.parametrize("boundary", ["background", "open"])
def test_options_of_the_measure_reach_the_core(boundary: str) -> None:
    options = {"bins": 16, "estimator": "std", "levels": "rim", "rho": 3.0, "tol": 1e-7, "tol_bits": 0.1}
    found = decision_region_complexity(stripes, BOUNDS, resolution=(31, 22), boundary=boundary, **options)
    assert found.profile.measure == Measure(**options)
    assert (found.profile.seconds > 0).all()
    if boundary == "background":
        same = torchlinf.complexity_profile(found.masks, spatial_ndim=2, **options)
    else:
        same = open_profile(found.masks, Measure(**options))
    assert torch.equal(found.profile.level_values, same.level_values)
    planes = decision_plane_complexity(
        stripes, X, num_planes=2, resolution=12, boundary=boundary, low=0.1, high=0.6, **options
    )
    assert planes.measure == Measure(low=0.1, high=0.6, **options)
    one = decision_plane(stripes, X[planes.triples[0]], resolution=12, boundary=boundary, **options)
    assert one.overall(0.1, 0.6) == planes.values[0]
    with pytest.raises(TypeError, match="low is not an option here"):
        decision_plane(stripes, X[:3], low=0.5)


def test_infinite_answers_are_answers() -> None:
    found = decision_region_complexity(lambda p: torch.where(p > 0, torch.inf, p), BOUNDS, resolution=(12, 9))
    same = decision_region_complexity(lambda p: torch.where(p > 0, 9.0, p), BOUNDS, resolution=(12, 9))
    assert torch.equal(found.masks, same.masks)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"boundary": "closed"}, ValueError, "boundary must be one of 'background', 'open'"),
        ({"response_method": "score"}, ValueError, "response_method must be one of"),
        ({"response_method": "predict"}, ValueError, "beside a function. Leave it out"),
        ({"threshold": "half"}, TypeError, "threshold must be a number or None"),
        ({"chunk_size": 0}, ValueError, "chunk_size must be an integer of 1 or more"),
        ({"bounds": [(0, 0), (0, 1)]}, ValueError, "finite pairs with low < high"),
        ({"bounds": [(0, 1)] * 5}, ValueError, "use decision_plane"),
        ({"bounds": []}, ValueError, "1 to 4 features"),
        ({"bounds": (-2, 2)}, TypeError, r"one \(low, high\) for each feature; got \(-2, 2\)"),
        ({"bounds": None}, TypeError, "for each feature; got None"),
        ({"resolution": (3, 4, 5)}, ValueError, "one for each of the 2 features; got 3"),
        ({"resolution": 1}, ValueError, "resolution must be 2 or more"),
        ({"classifier": 3}, TypeError, "classifier must be a torch.nn.Module, a scikit-learn estimator or a callable"),
        ({"bins": 0}, ValueError, "bins must be"),
        ({"rho": -1.0}, ValueError, "rho must be finite and above 0"),
        ({"windows": {"a": (0, 1)}}, TypeError, "windows is not an option here"),
        ({"bounds": ["ab", "cd"]}, TypeError, r"one \(low, high\) for each feature"),
        ({"classes": "ab"}, TypeError, "classes must be a sequence of names; got 'ab'"),
        ({"classes": [1, 1, 2]}, ValueError, r"classes must differ from each other; got \[1, 1, 2\]"),
    ],
)
def test_bad_arguments(change: dict[str, Any], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        decision_region_complexity(**{"classifier": stripes, "bounds": BOUNDS, "resolution": 9, **change})


def test_bounds_around_data() -> None:
    assert regions.bounds_around(X, eps=0.5) == [(x.min() - 0.5, x.max() + 0.5) for x in X.T]
    for wrong in (X[:, 0], X[:0], np.ones((3, 5)), np.full((2, 2), np.nan)):
        with pytest.raises(ValueError, match="X must be"):
            regions.bounds_around(wrong)


# --- planes ---------------------------------------------------------------------------------------------------------


def test_planes_go_through_their_points_isometrically() -> None:
    points = torch.randn(3, 2, 5, 4, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    plane = decision_plane(lambda p: p.flatten(1)[:, :3], points, resolution=8).plane
    assert plane is not None
    torch.testing.assert_close(plane.points(plane.corners), points)
    torch.testing.assert_close(torch.pdist(plane.corners), torch.pdist(points.flatten(1)))


def test_planes_do_not_depend_on_the_order_of_the_points() -> None:
    points = torch.randn(3, 6, generator=torch.Generator().manual_seed(2))
    found = [
        decision_plane(lambda p: p[:, :3], points[list(order)], resolution=30)
        for order in [(0, 1, 2), (2, 0, 1), (1, 0, 2)]
    ]
    assert found[0].overall() > 0
    for other in found[1:]:
        torch.testing.assert_close(other.mean(), found[0].mean(), equal_nan=True)


def test_a_plane_of_two_features_is_that_grid() -> None:
    corners = torch.tensor([[-2.0, 0.0], [2.0, 0.0], [0.0, 1.0]])
    found = decision_plane(stripes, corners, resolution=25, relative_margin=0.5)
    # centred on the triangle's box, 4 + 2 * 0.5 * 4 wide, and as high
    same = decision_region_complexity(lambda p: stripes(p), [(-4, 4), (-3.5, 4.5)], resolution=25)
    torch.testing.assert_close(found.masks, same.masks)
    assert [(axis[0].item(), axis[-1].item()) for axis in found.axes] == [(-2, 6), (-3.5, 4.5)]


def test_means_over_planes_have_the_textbook_error() -> None:
    data = torch.randn(30, 5, generator=torch.Generator().manual_seed(3))
    found = decision_plane_complexity(
        lambda p: p[:, :3], data, num_planes=7, resolution=20, high=0.5, boundary="open", seed=4
    )
    one_by_one = [
        decision_plane(lambda p: p[:, :3], data[triple], resolution=20, boundary="open").overall(0.0, 0.5)
        for triple in found.triples
    ]
    torch.testing.assert_close(found.values, torch.stack(one_by_one))
    assert found.mean() == pytest.approx(np.mean(one_by_one))
    assert found.standard_error() == pytest.approx(np.std(one_by_one, ddof=1) / np.sqrt(7))
    again = decision_plane_complexity(lambda p: p[:, :2], data, num_planes=7, resolution=8, seed=4)
    assert torch.equal(again.triples, found.triples)
    assert all(len(set(triple)) == 3 for triple in found.triples.tolist())
    other = decision_plane_complexity(lambda p: p[:, :2], data, num_planes=7, resolution=8, seed=5)
    assert not torch.equal(other.triples, found.triples)


def test_means_over_planes_do_not_depend_on_a_rotation() -> None:
    data = torch.randn(30, 5, generator=torch.Generator().manual_seed(6), dtype=torch.float64)
    turn = torch.linalg.qr(torch.randn(5, 5, generator=torch.Generator().manual_seed(7), dtype=torch.float64)).Q
    found = decision_plane_complexity(lambda p: p.double()[:, :3], data, num_planes=6, resolution=20)
    turned = decision_plane_complexity(lambda p: (p.double() @ turn)[:, :3], data @ turn.T, num_planes=6, resolution=20)
    assert found.mean() > 0
    assert turned.mean() == pytest.approx(found.mean(), rel=1e-3)


def test_planes_without_regions_are_counted() -> None:
    data = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [100.0, 1.0], [101.0, 3.0]])
    found = decision_plane_complexity(lambda p: p[:, [0, 0]], data, num_planes=40, resolution=8, threshold=50.0)
    assert 0 < found.num_empty < 39
    kept = found.values[~found.values.isnan()].numpy()
    assert found.mean() == pytest.approx(kept.mean())
    assert found.standard_error() == pytest.approx(kept.std(ddof=1) / np.sqrt(len(kept)))


def test_points_that_span_no_plane() -> None:
    line = torch.tensor([[0.0, 1.0], [1.0, 2.0], [5.0, 6.0], [1.0, 2.0]])
    for wrong in (line[:3], line[1:], line[[1, 1, 1]]):
        with pytest.raises(ValueError, match="points must span a plane"):
            decision_plane(stripes, wrong)
    with pytest.raises(ValueError, match=r"points must be three.*got \(4, 2\)"):
        decision_plane(stripes, line)
    with pytest.raises(ValueError, match="got 0 in 20 tries"):
        decision_plane_complexity(stripes, line, num_planes=2)
    with pytest.raises(ValueError, match="num_planes must be 2 or more"):
        decision_plane_complexity(stripes, X, num_planes=1)
    with pytest.raises(ValueError, match="relative_margin must be"):
        decision_plane(stripes, X[:3], relative_margin=-0.1)
    with pytest.raises(TypeError, match="points must be an array of numbers; got str"):
        decision_plane(stripes, "three")
    with pytest.raises(ValueError, match="seed must be an integer of 0 or more; got -1"):
        decision_plane_complexity(stripes, X, seed=-1)


# --- the loss -------------------------------------------------------------------------------------------------------


def small_network(outputs: int = 2) -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(2, 32), nn.Tanh(), nn.Linear(32, 32), nn.Tanh(), nn.Linear(32, outputs))


@pytest.mark.parametrize("outputs", [2, 3, 1])
def test_the_loss_is_the_hard_number(outputs: int) -> None:
    model = small_network(outputs)
    loss = regions.DecisionRegionLoss(BOUNDS, resolution=24, high=0.5, weight=3.0)(model)
    found = decision_region_complexity(model, BOUNDS, resolution=24, threshold=0.0 if outputs == 1 else None)
    assert found.overall(0.0, 0.5) > 0
    assert loss.item() == pytest.approx(3 * found.overall(0.0, 0.5).item(), rel=1e-5)
    points = X[:3]
    plane = decision_plane(model, points, resolution=20, threshold=0.0 if outputs == 1 else None)
    assert regions.DecisionRegionLoss(resolution=20)(model, points).item() == pytest.approx(
        plane.overall().item(), rel=1e-5
    )


def test_training_with_the_loss_makes_regions_simpler_at_equal_accuracy() -> None:
    found, target = make_moons(80, noise=0.35, random_state=0)
    inputs, classes, bounds = torch.tensor(found).float(), torch.tensor(target), regions.bounds_around(found, eps=0.5)
    loss = regions.DecisionRegionLoss(bounds, resolution=40, weight=0.1)

    def train(model: nn.Module, steps: int, rate: float, regularise: bool) -> nn.Module:
        optimiser = torch.optim.Adam(model.parameters(), lr=rate)
        for _ in range(steps):
            total = nn.functional.cross_entropy(model(inputs), classes)
            total = total + loss(model) if regularise else total
            optimiser.zero_grad()
            total.backward()
            optimiser.step()
        return model

    start = train(small_network(), 400, 1e-2, False)
    plain, simple = (train(copy.deepcopy(start), 60, 3e-3, regularise) for regularise in (False, True))
    before, after = (
        float(decision_region_complexity(model, bounds, resolution=40).overall()) for model in (plain, simple)
    )
    assert after < 0.9 * before
    assert bool((simple(inputs).argmax(dim=1) == classes).float().mean() >= 0.97)


def test_the_loss_refuses() -> None:
    model = small_network()
    for wrong in (
        lambda: regions.DecisionRegionLoss()(model),
        lambda: regions.DecisionRegionLoss(BOUNDS)(model, X[:3]),
    ):
        with pytest.raises(ValueError, match="either bounds or points"):
            wrong()
    with pytest.raises(TypeError, match=r"rho must be None or one number here; got a tensor \(2,\)"):
        regions.DecisionRegionLoss(BOUNDS, rho=torch.ones(2))
    with pytest.raises(TypeError, match="relative_margin must be a number of 0 or more"):
        regions.DecisionRegionLoss(relative_margin="wide")(model, X[:3])
    with pytest.raises(ValueError, match="1 to 3 features"):
        regions.DecisionRegionLoss([(0, 1)] * 4)
    with pytest.raises(ValueError, match=r"model must answer \(64,\) or"):
        regions.DecisionRegionLoss(BOUNDS, resolution=8)(nn.Sequential(nn.Linear(2, 2), nn.Unflatten(1, (1, 2))))
    with torch.no_grad():
        model[0].bias.fill_(torch.nan)
    with pytest.raises(ValueError, match="model must answer finite numbers"):
        regions.DecisionRegionLoss(BOUNDS, resolution=8)(model)
