"""The files that describe the package agree: dependencies, constraints, tools, metadata."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
USER_EXTRAS = [
    "cli",
    "plot",
    "metrics",
    "lightning",
    "sklearn",
    "coco",
    "parquet",
    "ray",
    "geo",
    "report",
    "nifti",
    "codecs",
]
# Not in the job of lowest versions: an old torch is gigabytes, and the short form needs no Ray, Lightning or Bokeh.
NOT_LOWEST = {"torch", "ray", "lightning", "bokeh"}


def lower_bounds(*texts: str) -> dict[str, Version]:
    requirements = [Requirement(text) for text in texts]
    bounds = {}
    for requirement in requirements:
        if requirement.name != "torchlinf":
            (specifier,) = requirement.specifier
            assert specifier.operator == ">=", requirement
            bounds[canonicalize_name(requirement.name)] = Version(specifier.version)
    return bounds


def pinned(name: str) -> dict[str, Version]:
    lines = re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
    return {canonicalize_name(package): Version(version) for package, version in lines}


DECLARED = lower_bounds(*PROJECT["dependencies"], *(text for extra in USER_EXTRAS for text in EXTRAS[extra]))


@pytest.mark.parametrize("name", sorted(DECLARED.keys() - NOT_LOWEST))
def test_the_lowest_declared_versions_are_those_tested(name: str) -> None:
    assert pinned("constraints-lowest.txt")[name] == DECLARED[name]


@pytest.mark.parametrize("extra", ["core", *EXTRAS])
def test_the_pinned_versions_satisfy_the_bounds(extra: str) -> None:
    pins = pinned("constraints.txt")
    bounds = lower_bounds(*(PROJECT["dependencies"] if extra == "core" else EXTRAS[extra]))
    assert {name: bound for name, bound in bounds.items() if pins[name] < bound} == {}


def test_every_extra_that_a_message_names_exists() -> None:
    """The messages are written by `torchlinf._helpers.extras.require`; its third argument is the extra."""
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "torchlinf").rglob("*.py")]
    named = {extra for text in sources for extra in re.findall(r"torchlinf\[(\w+)\]", text)}
    named |= {extra for text in sources for extra in re.findall(r'require\([^()]*"(\w+)"\)', text)}
    assert "cli" in named
    assert named <= set(USER_EXTRAS)


def test_pre_commit_runs_the_pinned_ruff() -> None:
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    assert re.search(r"ruff-pre-commit\n\s+rev: v(\S+)", text)[1] == str(pinned("constraints.txt")["ruff"])


@pytest.mark.parametrize("missing", ["typer", "rich"])
def test_the_command_without_its_extra_names_it(missing: str) -> None:
    """A module that is None in sys.modules cannot be imported, as if it were not installed."""
    code = f"import sys; sys.modules[{missing!r}] = None; from torchlinf.__main__ import main; main()"
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert finished.returncode == 1
    assert finished.stderr == (
        f"torchlinf: The command torchlinf needs {missing}; it is not installed. Run: pip install 'torchlinf[cli]'\n"
    )
