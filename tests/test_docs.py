"""What the pages claim about names and numbers, against the code."""

import re
from pathlib import Path

import pytest
import typer

import torchlinf
from torchlinf.field.methods import METHODS
from torchlinf.scoring import COLUMNS, MAX_PIXELS

ROOT = Path(__file__).parents[1]


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


def test_links_between_pages_lead_somewhere() -> None:
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]
    assert len(pages) >= 6
    for page in pages:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_every_experiment_of_the_paper_is_on_its_page() -> None:
    pages = sorted((ROOT / "examples" / "paper").glob("plot_*.py"))
    assert len(pages) >= 7
    linked = re.findall(r"\{doc\}`gallery/paper/(\w+)`", read("docs/paper.md"))
    assert sorted(set(linked)) == [page.stem for page in pages]
