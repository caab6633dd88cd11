"""What the pages claim about names and numbers, against the code."""

import dataclasses
import doctest
import importlib.util
import inspect
import re
from pathlib import Path

import pytest
import typer

import torchlinf
from torchlinf.field.methods import METHODS
from torchlinf.scoring import COLUMNS, MAX_PIXELS

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "notes").glob("*.md")])
WITH_EXAMPLES = [page for page in PAGES if page.name != "README.md" and ">>> " in page.read_text(encoding="utf-8")]


def read(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def command_options() -> list[str]:
    from torchlinf.cli import app

    group = typer.main.get_command(app)
    return [name for command in group.commands.values() for option in command.params for name in option.opts]


def test_the_citation_names_this_version() -> None:
    assert re.search(r"^version: (.*)$", read("CITATION.cff"), re.MULTILINE)[1] == torchlinf.__version__


@pytest.mark.parametrize("name", [name for name in torchlinf.__all__ if name not in ("shapes", "Status")])
def test_the_api_page_holds_every_public_name(name: str) -> None:
    assert f":: torchlinf.{name}\n" in read("docs/api.md")


@pytest.mark.parametrize("method", METHODS)
def test_the_pages_explain_every_method(method: str) -> None:
    assert f'`"{method}"`' in read("docs/choosing.md")
    assert f'`method="{method}"`' in read("docs/method.md")


def test_the_command_page_explains_every_option() -> None:
    page = read("docs/command.md")
    options = [name for name in command_options() if name.startswith("-")]
    assert "--threshold" in options  # the list is not empty
    assert [name for name in options if not re.search(rf"(?<![\w-]){name}(?![\w-])", page)] == []


@pytest.mark.parametrize("column", COLUMNS)
def test_the_command_page_explains_every_column(column: str) -> None:
    assert f"`{column}`" in read("docs/command.md")


def test_the_command_page_names_the_limit() -> None:
    assert f"{MAX_PIXELS:,}" in read("docs/command.md")


@pytest.mark.parametrize(
    "module",
    [
        "losses",
        "metrics",
        "regions",
        "transforms",
        "samplers",
        "labels",
        "polygons",
        "order",
        "decompose",
        "plot",
        "scoring",
        "",
    ],
)
def test_options_are_keyword_only_as_the_api_page_says(module: str) -> None:
    assert "Options are keyword-only." in read("docs/api.md")
    home = getattr(torchlinf, module) if module else torchlinf
    public = {name: getattr(home, name) for name in getattr(home, "__all__", ["ComplexitySampler"])}
    records = (
        dataclasses.is_dataclass,
        lambda one: isinstance(one, type) and issubclass(one, (int, Exception)),
    )
    checked = {
        name: one
        for name, one in public.items()
        if (inspect.isroutine(one) or inspect.isclass(one)) and not any(is_record(one) for is_record in records)
    }
    assert checked
    for name, one in checked.items():
        for option in inspect.signature(one).parameters.values():
            by_position = option.kind is option.POSITIONAL_OR_KEYWORD and option.default is not option.empty
            # Where the regions are is data, but a loss for planes has it in each call.
            assert not by_position or option.name == "bounds", f"{module}.{name}: {option}"


def test_links_between_pages_lead_somewhere() -> None:
    assert len(PAGES) >= 20
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_pages_that_the_code_names_exist() -> None:
    for module in sorted((ROOT / "torchlinf").rglob("*.py")):
        for page in re.findall(r"\bdocs/((?:notes/)?\w+)", module.read_text(encoding="utf-8")):
            assert (ROOT / "docs" / f"{page}.md").exists(), f"{module.relative_to(ROOT)} names docs/{page}"


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=lambda page: page.stem)
def test_the_examples_of_a_page_run(page: Path) -> None:
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    failed, attempted = doctest.testfile(str(page), module_relative=False, optionflags=options)
    assert attempted
    assert not failed


def test_pages_with_examples_are_found() -> None:
    assert {"quickstart", "bits", "limitations", "labels"} <= {page.stem for page in WITH_EXAMPLES}


def test_the_page_on_bits_has_the_numbers_of_its_picture() -> None:
    spec = importlib.util.spec_from_file_location("bits_picture", ROOT / "docs" / "bits_picture.py")
    picture = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(picture)
    table = re.findall(
        r"^\| ([\w ]+) \| (\d\.\d{3}) \| (\d\.\d{3}) \| (\d\.\d{3}) \|$", read("docs/bits.md"), re.MULTILINE
    )
    stated = {name: tuple(map(float, numbers)) for name, *numbers in table}
    shapes = picture.silhouettes()
    assert list(stated) == list(shapes)
    for name, mask in shapes.items():
        profile = torchlinf.complexity_profile(mask, spatial_ndim=2)
        found = [profile.mean(low, high).item() for low, high in ((0.0, 1.0), (0.0, 0.25), (0.25, 1.0))]
        assert stated[name] == pytest.approx(found, abs=5.1e-4), name


def test_every_experiment_of_the_paper_is_on_its_page() -> None:
    pages = sorted((ROOT / "examples" / "paper").glob("plot_*.py"))
    assert len(pages) >= 7
    linked = re.findall(r"\{doc\}`gallery/paper/(\w+)`", read("docs/paper.md"))
    assert sorted(set(linked)) == [page.stem for page in pages]
