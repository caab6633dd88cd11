"""Run the README of the installed package as a reader would, in an environment without tools for development.

Run by `make dist-check`:

    python tools/run_readme.py core  # after `pip install torchlinf`: the first example; the command names its extra
    python tools/run_readme.py all   # with the extras cli, plot, metrics and report: every example, and every command
"""

import doctest
import importlib.metadata
import re
import shlex
import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
COMMAND = str(Path(sys.executable).with_name("torchlinf"))
WRITTEN = ("--out", "--plot")  # the options of the command whose value is a file that it writes


def main() -> None:
    import torchlinf

    assert "site-packages" in torchlinf.__file__, f"not the installed package: {torchlinf.__file__}"
    readme = str(importlib.metadata.metadata("torchlinf").json["description"])
    with tempfile.TemporaryDirectory() as folder:
        {"core": run_core, "all": run_all}[sys.argv[1]](readme, Path(folder))


def run_core(readme: str, folder: Path) -> None:
    """Run the first example, and the command, which must say in one line which extra it needs."""
    run_examples(re.findall(r"^```python\n(.*?)^```", readme, re.MULTILINE | re.DOTALL)[0])
    finished = run([COMMAND, "--version"], folder)
    assert finished.returncode == 1, finished
    assert "pip install 'torchlinf[cli]'" in finished.stderr, finished
    assert len(finished.stderr.splitlines()) == 1, finished
    print(f"without the extra: {finished.stderr.strip()}")


def run_all(readme: str, folder: Path) -> None:
    """Run all examples, and all lines `$ torchlinf ...`, beside files under the names that they read."""
    run_examples(readme)
    lines = re.findall(r"^\$ (torchlinf .*)$", readme, re.MULTILINE)
    assert lines
    for line in lines:
        words = shlex.split(line, comments=True)[1:]
        written = [word for before, word in pairwise(words) if before in WRITTEN]
        for word in set(words) - set(written):
            make_input(folder / word, is_folder=word.endswith("/"))
        finished = run([COMMAND, *words], folder)
        assert finished.returncode == 0, (line, finished.stdout, finished.stderr)
        assert all((folder / name).stat().st_size for name in written), line
        print(f"ran: {line}")


def run_examples(text: str) -> None:
    examples = doctest.DocTestParser().get_doctest(text, {"__name__": "__main__"}, "README.md", None, 0)
    result = doctest.DocTestRunner(optionflags=FLAGS).run(examples)
    assert result.attempted > 5
    assert not result.failed
    print(f"{result.attempted} lines of Python ran")


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)


def make_input(path: Path, *, is_folder: bool) -> None:
    """A folder of masks, a mask or a table of scores, as the name asks for; nothing for words that are no such name."""
    from PIL import Image

    from torchlinf import shapes

    if path.exists():
        return
    if is_folder:
        for name in ("square.png", "disc.png"):
            make_input(path / name, is_folder=False)
    elif path.suffix == ".png":
        mask = shapes.disc(32, margin=2) if "disc" in path.stem else shapes.square(64, margin=2)
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(mask.numpy()).save(path)
    elif path.suffix == ".csv":
        make_input(path.parent / "scored", is_folder=True)
        finished = run([COMMAND, "score", "scored", "--out", path.name], path.parent)
        assert finished.returncode == 0, finished


if __name__ == "__main__":
    main()
