"""Check the wheel and the source distribution in a folder: files, metadata, and the page that a package index shows.

Run by `make dist-check`: python tools/check_dist.py dist
"""

import re
import subprocess
import sys
import tarfile
import zipfile
from email.message import Message
from email.parser import BytesParser
from pathlib import Path

from readme_renderer import markdown

ROOT = Path(__file__).parents[1]
IN_SDIST = ["pyproject.toml", "README.md", "CHANGELOG.md", "CITATION.cff", "LICENSE", "PKG-INFO"]


def main() -> None:
    folder = Path(sys.argv[1])
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    with zipfile.ZipFile(wheel) as archive:
        check_wheel_files(archive.namelist(), tracked)
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = BytesParser().parsebytes(archive.read(name))
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/entry_points.txt"))
        assert "torchlinf = torchlinf.__main__:main" in archive.read(name).decode()
    check_metadata(metadata)
    check_page(str(metadata.get_payload()))
    with tarfile.open(sdist) as archive:
        check_sdist_files([name.partition("/")[2] for name in archive.getnames()], tracked)
    for file in (wheel, sdist):
        print(f"{file.name}: {file.stat().st_size / 1e3:.0f} KB, files, metadata and page are as they should be")


def check_wheel_files(names: list[str], tracked: list[str]) -> None:
    """The wheel has every tracked file of the package, the license, and nothing else."""
    package = {name for name in names if ".dist-info/" not in name}
    expected = {name for name in tracked if name.startswith("torchlinf/")}
    assert package == expected, f"missing: {expected - package}; not tracked by git: {package - expected}"
    assert {"torchlinf/py.typed", "torchlinf/__init__.pyi"} <= package
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)


def check_sdist_files(names: list[str], tracked: list[str]) -> None:
    """The source distribution can be tested and documented, and has nothing that git does not track."""
    assert set(IN_SDIST) <= set(names), set(IN_SDIST) - set(names)
    for folder in ("torchlinf", "tests", "docs", "examples"):
        missing = {name for name in tracked if name.startswith(f"{folder}/")} - set(names)
        assert not missing, missing
    assert not set(names) - set(tracked) - {"PKG-INFO"}, set(names) - set(tracked)


def check_metadata(metadata: Message) -> None:
    """The core dependencies have lower bounds only; the extras are there; the README is Markdown."""
    requirements = metadata.get_all("Requires-Dist", [])
    core = [str(text) for text in requirements if "extra ==" not in str(text)]
    assert core, requirements
    assert all(re.fullmatch(r"[\w.-]+>=[\d.]+", text) for text in core), core
    command = [text for text in requirements if re.match(r"(typer|rich)\b", str(text))]
    assert len(command) >= 2, command
    assert all("extra ==" in str(text) for text in command), command
    assert {"cli", "plot", "metrics", "coco", "parquet", "ray"} <= set(metadata.get_all("Provides-Extra", []))
    assert str(metadata["Description-Content-Type"]).startswith("text/markdown")
    assert metadata.get_all("Project-URL")


def check_page(readme: str) -> None:
    """The page renders as an index renders it, and each link and each picture has an absolute address."""
    page = markdown.render(readme)
    assert page, "the README does not render"
    addresses = re.findall(r'(?:href|src)="([^"]*)"', page)
    assert addresses
    relative = [address for address in addresses if not re.match(r"https?://|mailto:|#", address)]
    assert not relative, f"relative addresses lead nowhere on a package index: {relative}"
    named = set(re.findall(r"<code>([\w./-]+\.(?:md|cff|txt|toml))</code>", page))
    missing = [name for name in named if not (ROOT / name).exists()]
    assert not missing, f"the page names files that are not in the repository: {missing}"


if __name__ == "__main__":
    main()
