"""Settings of the documentation; built by `make docs`, with warnings as errors."""

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

myst_enable_extensions = ["amsmath", "attrs_inline", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
# A dataclass documents its fields under "Attributes:"; as cross-reference targets they would appear twice.
napoleon_use_ivar = True

copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
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
