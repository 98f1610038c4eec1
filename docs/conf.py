"""Sphinx: the pages of this folder and the docstrings of the installed package."""

import enum
from typing import Any

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


def _list_members(app: Any, what: str, name: str, described: object, options: object, lines: list[str]) -> None:
    """List what each member of a status says: autodoc finds docstrings of members in the source alone."""
    if isinstance(described, enum.EnumType):
        lines.append("")
        for member in described:
            lines += [f"``{member.name}`` = {member.value!r}", f"    {member.__doc__}", ""]


def setup(app: Any) -> None:
    """Let Sphinx call the above."""
    app.connect("autodoc-process-docstring", _list_members)
