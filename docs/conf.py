"""Settings of the documentation; built by `make docs`, with warnings as errors."""

import re
from pathlib import Path
from typing import Any

from sphinx_gallery.sorting import ExplicitOrder

import torchlinf

project = "torchlinf"
author = "The torchlinf authors"
copyright = "2026, The torchlinf authors"
version = release = torchlinf.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "gallery/**/*.md5", "gallery/**/*.py", "gallery/**/*.ipynb"]

myst_enable_extensions = ["amsmath", "attrs_inline", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
# Entry points carry the options of the measure in `__signature__`, which is not what their source says.
autodoc_preserve_defaults = False
napoleon_google_docstring = True
napoleon_numpy_docstring = False
# A dataclass documents its fields under "Attributes:"; as cross-reference targets they would appear twice.
napoleon_use_ivar = True
napoleon_use_rtype = False
# `x` in a docstring is code.
default_role = "code"

copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

# By name, but what newcomers should read comes first. The pages on the paper are numbered in its order.
GALLERY = sorted(path.name for path in (Path(__file__).parents[1] / "examples").rglob("plot_*.py"))
GALLERY.sort(key="plot_quickstart.py".__ne__)

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "within_subsection_order": ExplicitOrder([*GALLERY, "*"]),
    "filename_pattern": r"/plot_",
    # The demo is a program with its own `make demo`, not a page.
    "ignore_pattern": r"demo\.py$",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    # The seconds of one build say nothing to a reader, and change every page at every build.
    "min_reported_time": 600,
    "write_computation_times": False,
}

html_theme = "furo"
html_title = f"torchlinf {release}"


def escape_formulas(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep stars and bars of docstrings as they are: they belong to shapes and formulas, `(*lead, L)` and `|x|`.

    Docstrings are read in the source and by help() more often than here, so they stay free of backslashes.
    """
    for i, line in enumerate(lines):
        if not line.lstrip().startswith((">>>", "...")):
            parts = re.split(r"(`+[^`]*`+)", line)
            parts[::2] = [re.sub(r"(?<!\\)(\*(?=\w)|\|)", r"\\\1", part) for part in parts[::2]]
            lines[i] = "".join(parts)


def setup(app: Any) -> None:
    """Run before napoleon, which turns the sections of a docstring into markup (it has the default priority, 500)."""
    app.connect("autodoc-process-docstring", escape_formulas, priority=100)
