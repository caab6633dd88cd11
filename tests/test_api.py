"""The public names are fixed: other people's code is written against them. Their options: `test_contract`."""

import dataclasses
import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch

import torchlinf


def test_the_public_names() -> None:
    assert sorted(torchlinf.__all__) == [
        "ComplexityProfile",
        "FieldSolution",
        "Measure",
        "Simplification",
        "Status",
        "chessboard_distance",
        "complexity",
        "complexity_map",
        "complexity_profile",
        "decompose",
        "equal_spacing",
        "labels",
        "linf_field",
        "losses",
        "metrics",
        "order",
        "plot",
        "polygons",
        "regions",
        "samplers",
        "scoring",
        "shapes",
        "simplify",
        "soft_chessboard_distance",
        "soft_complexity",
        "soft_linf_field",
        "solve_field",
        "transforms",
        "warm_up",
    ]
    for name in torchlinf.__all__:
        assert getattr(torchlinf, name).__doc__


def test_the_version_has_three_numbers() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", torchlinf.__version__)


def test_the_fields_of_the_results() -> None:
    names = [field.name for field in dataclasses.fields(torchlinf.FieldSolution)]
    assert names == ["value", "error_bound", "num_sweeps", "num_solves", "status"]
    names = [field.name for field in dataclasses.fields(torchlinf.ComplexityProfile)]
    assert names == [
        "scales", "values", "radius", "field_error_bound", "level_values", "level_error_bound", "measure", "seconds",
        "angle", "parts",
    ]  # fmt: skip


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
