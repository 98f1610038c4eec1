"""Sphinx: the pages of this folder and the docstrings of the installed package."""

import rsflow

project = "rsflow"
author = "the rsflow authors"
copyright = "2026, the rsflow authors"
version = release = rsflow.__version__

extensions = ["myst_parser", "numpydoc", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.intersphinx"]
# Links into numpy's documentation are resolved only where its inventory can be reached.
intersphinx_mapping = {}
numpydoc_show_class_members = False
autodoc_typehints = "none"
html_theme = "furo"
html_title = "rsflow"
exclude_patterns = ["_build"]
myst_heading_anchors = 3
# The algorithm page: $...$ in the text, $$...$$ (label) for numbered equations.
myst_enable_extensions = ["dollarmath"]
