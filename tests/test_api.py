"""The public names and signatures are fixed: other people's code is written against them."""

import dataclasses
import inspect
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

import torchlinf
import torchlinf.decompose
import torchlinf.labels
import torchlinf.metrics
import torchlinf.order
import torchlinf.regions
import torchlinf.scoring
import torchlinf.scoring.compare
import torchlinf.scoring.ray
import torchlinf.transforms
from torchlinf import shapes

SOLVE = "rho=None, tol=1e-09"
TENSOR = "method='auto', spatial_ndim=None, dtype=None"
LEVEL = "bins=1024, estimator='entropy', rho=None, tol=1e-09"
SCORED = (
    "low=0.0, high=1.0, windows={'complexity': (0.0, 1.0), 'complexity_low': (0.0, 0.25), "
    "'complexity_high': (0.25, 1.0)}, bins=1024, estimator='entropy', rho=None, tol=1e-09"
)

READ = "threshold=None, label=None, nonzero=False, ignore=(), invert=False, max_pixels=67108864, volume=False"
EACH = f"{READ}, labels=False, stack=False"

RESPONSE = "boundary='background', response_method='auto', threshold=None, classes=None, chunk_size=None"


def parameters(function: Callable[..., object]) -> str:
    """Names, order, kinds and defaults, without annotations."""
    signature = inspect.signature(function)
    bare = [p.replace(annotation=inspect.Parameter.empty) for p in signature.parameters.values()]
    return str(inspect.Signature(bare))


def test_the_public_names() -> None:
    assert sorted(torchlinf.__all__) == [
        "ComplexityProfile",
        "FieldSolution",
        "Measure",
        "Status",
        "chessboard_distance",
        "complexity",
        "complexity_map",
        "complexity_profile",
        "decompose",
        "labels",
        "linf_field",
        "losses",
        "metrics",
        "order",
        "plot",
        "regions",
        "samplers",
        "scoring",
        "shapes",
        "soft_chessboard_distance",
        "soft_complexity",
        "soft_linf_field",
        "solve_field",
        "transforms",
    ]
    for name in torchlinf.__all__:
        assert getattr(torchlinf, name).__doc__


def test_the_version_has_three_numbers() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", torchlinf.__version__)


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        (torchlinf.chessboard_distance, "(mask, *, spatial_ndim=None)"),
        (
            torchlinf.solve_field,
            f"(mask, *, {SOLVE}, method='auto', max_sweeps=None, throw=True, compile=False, "
            "spatial_ndim=None, dtype=None)",
        ),
        (torchlinf.linf_field, f"(mask, *, {SOLVE}, spatial_ndim=None, dtype=None)"),
        (torchlinf.complexity_profile, f"(mask, *, scales=None, {TENSOR}, {LEVEL})"),
        (torchlinf.complexity, f"(mask, *, {TENSOR}, low=0.0, high=1.0, {LEVEL})"),
        (torchlinf.complexity_map, f"(mask, *, {TENSOR}, low=0.0, high=1.0, {LEVEL})"),
        (torchlinf.soft_chessboard_distance, "(probability, *, spatial_ndim=None)"),
        (torchlinf.soft_linf_field, "(probability, *, rho=None, slices=4, tol=1e-09, spatial_ndim=None)"),
        (
            torchlinf.soft_complexity,
            "(probability, *, bandwidth=0.0009765625, slices=1, spatial_ndim=None, low=0.0, high=1.0, "
            "estimator='entropy', rho=None, tol=1e-09)",
        ),
        (torchlinf.order.kendall_tau, "(profiles)"),
        (
            torchlinf.order.dominance,
            "(profiles, *, windows={'fine': (0.0, 0.25), 'all': (0.0, 1.0)}, every_scale=False)",
        ),
        (torchlinf.plot.profile, f"(mask, *, label=None, color=None, style='-', ax=None, {LEVEL})"),
        (torchlinf.plot.levels, f"(mask, *, of='field', solution=None, color=None, ax=None, {SOLVE})"),
        (
            torchlinf.plot.complexity_map,
            f"(mask, *, shares=None, top=None, ax=None, low=0.0, high=1.0, {LEVEL})",
        ),
        (torchlinf.plot.shapes, f"(masks, *, solutions=None, {LEVEL})"),
        (torchlinf.plot.overview, f"(masks, *, solutions=None, {LEVEL})"),
        (
            torchlinf.plot.hasse,
            "(masks, *, profiles=None, order=None, windows={'fine': (0.0, 0.25), 'all': (0.0, 1.0)}, "
            f"every_scale=False, highlight=(), ax=None, {LEVEL})",
        ),
        (torchlinf.plot.decision_regions, "(regions, *, low=0.0, high=1.0, ax=None)"),
        (shapes.add_noise, "(shape, factor, count, *, seed=0)"),
        (torchlinf.ComplexityProfile.mean, "(self, low=0.0, high=1.0)"),
        (torchlinf.ComplexityProfile.levels, "(self)"),
        (torchlinf.ComplexityProfile.peak, "(self)"),
        (shapes.square, "(side, *, margin=0)"),
        (shapes.box, "(*sides, margin=0)"),
        (shapes.disc, "(radius, *, margin=0)"),
        (shapes.superellipse, "(radius, exponent, *, margin=0)"),
        (shapes.rectangle, "(height, width, *, margin=0)"),
        (shapes.band, "(points, width, *, margin=0)"),
        (shapes.diagonal_pair, "(side, shift, *, margin=0)"),
        (shapes.nested_appendages, "(side=128, depth=48, *, margin=0)"),
        (shapes.appendage_places, "(side=128, depth=32, *, margin=0)"),
        (shapes.appendage_dictionary, "(side=128, depth=32, *, numbers=(1, 2, 4), widths=(32, 80), margin=0)"),
        (shapes.cube_family, "(side=64, appendage_side=16, *, margin=0)"),
        (shapes.zero_complexity, "(side=32, *, margin=0)"),
        (shapes.Appendage, "(face, width, depth, offset=None)"),
        (shapes.with_appendages, "(sides, appendages, *, margin=0)"),
        (shapes.cube_with_appendages, "(side, appendage_side, faces, *, margin=0)"),
        (
            torchlinf.losses.ShapeComplexityLoss,
            "(*, weight=1.0, activation=None, reduction='mean', include_background=True, keep_area=True, "
            "threshold=0.5, max_flips=16, deformations=False, low=0.0, high=1.0, bins=1024, estimator='entropy', "
            "rho=None, tol=1e-09)",
        ),
        (
            torchlinf.metrics.ShapeComplexity,
            "(num_classes, *, threshold=None, input_format='one-hot', average='macro', include_background=True, "
            "ignore_index=None, empty='worst', low=0.0, high=1.0, windows=None, bins=1024, estimator='entropy', "
            "rho=None, tol=1e-09, **kwargs)",
        ),
        (
            torchlinf.transforms.ShapeComplexityScore,
            "(*, threshold=None, spatial_ndim=2, dtype=None, low=0.0, high=1.0, windows=None, bins=1024, "
            "estimator='entropy', rho=None, tol=1e-09)",
        ),
        (
            torchlinf.transforms.ShapeComplexityScored,
            "(keys, *, postfix='complexity', allow_missing_keys=False, threshold=None, spatial_ndim=2, dtype=None, "
            "low=0.0, high=1.0, windows=None, bins=1024, estimator='entropy', rho=None, tol=1e-09)",
        ),
        (
            torchlinf.samplers.ComplexitySampler,
            "(scores, *, between=None, share=1.0, weight=None, num_samples=None, seed=0, num_replicas=1, rank=0)",
        ),
        (
            torchlinf.regions.decision_region_complexity,
            f"(classifier, bounds, *, resolution=128, {RESPONSE}, {LEVEL})",
        ),
        (
            torchlinf.regions.decision_plane,
            f"(classifier, points, *, resolution=128, relative_margin=0.25, {RESPONSE}, {LEVEL})",
        ),
        (
            torchlinf.regions.decision_plane_complexity,
            "(classifier, X, *, num_planes=32, resolution=64, relative_margin=0.25, seed=0, "
            f"{RESPONSE}, low=0.0, high=1.0, {LEVEL})",
        ),
        (
            torchlinf.regions.DecisionRegionLoss,
            "(bounds=None, *, resolution=64, weight=1.0, keep_area=True, max_flips=16, relative_margin=0.25, "
            f"low=0.0, high=1.0, {LEVEL})",
        ),
        (torchlinf.scoring.find_masks, "(paths, *, members=None)"),
        (torchlinf.scoring.read_mask, f"(path, *, member=None, {READ})"),
        (torchlinf.scoring.score_masks, f"(sources, *, {EACH}, workers=1, isolated=False, {SCORED})"),
        (torchlinf.scoring.open_table, f"(path, *, as_json=False, resume=False, retry=False, {SCORED})"),
        (torchlinf.scoring.read_table, "(path)"),
        (torchlinf.scoring.compare_scores, "(old, new, *, column='complexity', join='path')"),
        (torchlinf.regions.bounds_around, "(X, *, eps=1.0)"),
        (
            torchlinf.decompose.parts,
            "(mask, *, penalty_per_part=0.0, objective='sum', candidates='openings', spatial_ndim=None, low=0.0, "
            "high=1.0, bins=1024, estimator='entropy', rho=None, tol=1e-09)",
        ),
        (
            torchlinf.scoring.ray.ScoreMasks,
            f"(column, *, name='path', {EACH}, spatial_ndim=2, {SCORED})",
        ),
        (torchlinf.scoring.ray.find_shards, "(paths, *, files=1000)"),
        (
            torchlinf.scoring.ray.score_shards,
            f"(shards, out, *, {EACH}, members=None, map_options=None, {SCORED})",
        ),
        (torchlinf.scoring.ray.connected, "(address='local', *, workers=None)"),
        (
            torchlinf.labels.complexity_table,
            "(label_map, *, properties=(), intensity_image=None, spacing=None, low=0.0, high=1.0, windows=None, "
            "bins=1024, estimator='entropy', rho=None, tol=1e-09)",
        ),
    ],
)
def test_signatures(function: Callable[..., object], expected: str) -> None:
    assert parameters(function) == expected


def test_the_fields_of_the_results() -> None:
    names = [field.name for field in dataclasses.fields(torchlinf.FieldSolution)]
    assert names == ["value", "error_bound", "num_sweeps", "num_solves", "status"]
    names = [field.name for field in dataclasses.fields(torchlinf.ComplexityProfile)]
    assert names == ["scales", "values", "radius", "field_error_bound", "level_values", "measure", "seconds"]


def test_results_cannot_be_changed_and_compare_by_identity() -> None:
    profile = torchlinf.complexity_profile(torch.ones(1, 1, 3, 4))
    with pytest.raises(dataclasses.FrozenInstanceError):
        profile.radius = torch.zeros(1)  # type: ignore[misc]
    # Comparing tensors by value would give no single truth, so equality is that of the object.
    assert profile in [profile]
    assert profile != torchlinf.complexity_profile(torch.ones(1, 1, 3, 4))


def test_each_status_comes_with_a_sentence_of_advice() -> None:
    assert [status.name for status in torchlinf.Status] == ["CONVERGED", "MAX_SWEEPS", "EMPTY", "NONFINITE"]
    for status in torchlinf.Status:
        assert status.advice.endswith(".")


def test_importing_the_package_imports_nothing_heavy_beside_torch() -> None:
    code = "import sys, torch; before = set(sys.modules); import torchlinf; print(*set(sys.modules) - before)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    packages = {name.partition(".")[0] for name in out.split()}
    assert "torchlinf" in packages
    assert not packages & {"numba", "skimage", "scipy", "matplotlib", "typer", "rich", "PIL", "kornia", "torchmetrics"}


def test_the_readme_runs_on_the_import_it_names() -> None:
    # In a process of its own: here other tests have imported the modules that the README names as attributes.
    code = "import doctest; print(doctest.testfile('README.md', module_relative=False, optionflags=doctest.ELLIPSIS))"
    root = Path(torchlinf.__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert "failed=0" in done.stdout, done.stdout


def test_modules_come_with_the_package_and_at_first_use() -> None:
    names = "decompose labels losses metrics order plot regions samplers scoring shapes transforms"
    code = f"""
import torchlinf
for name in "{names}".split():
    assert getattr(torchlinf, name).__name__ == f"torchlinf.{{name}}"
assert not hasattr(torchlinf, "nonsense")
"""
    subprocess.run([sys.executable, "-c", code], check=True)
