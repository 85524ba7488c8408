"""Configuration of the site of guide and reference: ``python -m sphinx -c .docs softness_bayes/docs ../pages``.

The guide is the pages of that folder, with the README in front; the pages in ``reference`` are written anew from the
declarations and docstrings. Any warning, such as a link that leads nowhere, stops the build with ``-W``.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import softness_bayes

sys.path.insert(0, str(Path(__file__).parent))

project = "softness-bayes"
author = "The softness-bayes developers"
version = release = softness_bayes.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_heading_anchors = 3
suppress_warnings = ["myst.header"]

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"members": True}
napoleon_google_docstring = False

html_theme = "furo"
html_title = f"softness-bayes {version}"
html_show_sphinx = html_show_copyright = False
html_copy_source = False
html_show_sourcelink = False


def setup(app: Any) -> None:
    """Write the pages of the reference before the site is built."""
    from reference_pages import write_pages

    app.connect("builder-inited", lambda app: write_pages(Path(app.srcdir) / "reference"))
