"""Sphinx configuration. Build with ``python tools/build_docs.py``: no network, warnings are errors."""

import os
import sys
from pathlib import Path

import dembrick

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tools"))
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT / "docs"), os.environ.get("PYTHONPATH")]))

project = "dembrick"
author = "The dembrick developers"
copyright = "The dembrick developers, MIT licence"
version = release = dembrick.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx-mathjax-offline",  # formulas without a content network, in the build and in the browser
]
exclude_patterns = ["_build", "**.ipynb_checkpoints", "reference/python_names.md"]
templates_path = []
html_theme = "furo"
html_title = f"dembrick {version}"
html_theme_options = {"top_of_page_buttons": []}
html_show_sourcelink = False

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence", "attrs_inline"]
myst_heading_anchors = 3
nb_execution_mode = "cache"
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_merge_streams = True
suppress_warnings = ["mystnb.unknown_mime_type"]

autodoc_typehints = "signature"
autodoc_member_order = "bysource"


def setup(app):
    """Write the generated reference pages before anything is read."""
    import reference_pages

    reference_pages.write(ROOT / "docs" / "reference")
