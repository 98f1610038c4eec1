"""Sphinx: the pages of this folder, the docstrings of the installed package, and what is made at each build.

That is the pictures of the gallery, each by its script, and the notebooks of the programs in examples/, which run.
"""

import enum
import os
import runpy
import shutil
import sys
from pathlib import Path
from typing import Any

import latex2mathml.converter
from docutils import nodes

import rsflow

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

project = "rsflow"
author = "the rsflow authors"
copyright = "2026, the rsflow authors"
version = release = rsflow.__version__

extensions = ["myst_nb", "numpydoc", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.intersphinx"]
# Links into numpy's documentation are resolved only where its inventory can be reached.
intersphinx_mapping = {}
numpydoc_show_class_members = False
autodoc_typehints = "none"
html_theme = "furo"
html_title = "rsflow"
html_static_path = ["_static"]
html_css_files = ["rsflow.css"]
exclude_patterns = ["_build", "jupyter_execute"]
# Notebooks run again where they have changed, in a folder of their own, where their programs write their files.
nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE / "_build" / "notebooks")
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 120
myst_heading_anchors = 3
# The algorithm page: $...$ in the text, $$...$$ (label) for numbered equations.
myst_enable_extensions = ["dollarmath"]
# Browsers draw MathML by themselves: no script from elsewhere, so that the pages are whole without a network.
html_math_renderer = "mathml"


def _list_members(app: Any, what: str, name: str, described: object, options: object, lines: list[str]) -> None:
    """List what each member of a status says: autodoc finds docstrings of members in the source alone."""
    if isinstance(described, enum.EnumType):
        lines.append("")
        for member in described:
            lines += [f"``{member.name}`` = {member.value!r}", f"    {member.__doc__}", ""]


def _draw_gallery(app: Any) -> None:
    """Draw each picture of the gallery that is missing or older than its script."""
    folder = HERE / "gallery" / "pictures"
    folder.mkdir(exist_ok=True)
    for script in sorted((HERE / "gallery").glob("*.py")):
        picture = folder / f"{script.stem}.png"
        if not picture.is_file() or picture.stat().st_mtime < script.stat().st_mtime:
            runpy.run_path(str(script))["draw"]().savefig(picture, dpi=100)


def _write_notebooks(app: Any) -> None:
    """Make the notebooks of the programs, in an environment in which a kernel finds this package."""
    import make_notebooks

    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    make_notebooks.write(HERE / "notebooks")


def _add_rust(app: Any, exception: Exception | None) -> None:
    """Put the crate's reference beside the pages, where `cargo doc` has written it."""
    crate = HERE.parent / "target" / "doc"
    if exception is None and app.builder.format == "html" and (crate / "lk_core").is_dir():
        shutil.copytree(crate, Path(app.outdir) / "rust", dirs_exist_ok=True)


def _inline_equation(self: Any, node: nodes.math) -> None:
    self.body.append(latex2mathml.converter.convert(node.astext()))
    raise nodes.SkipNode


def _equation(self: Any, node: nodes.math_block) -> None:
    # The element that a label leads to, with the number beside the equation.
    self.body.append(self.starttag(node, "div", CLASS="math-block"))
    self.body.append(latex2mathml.converter.convert(node.astext(), display="block"))
    if node["number"]:
        self.body.append(f'<span class="eqno">({node["number"]})')
        self.add_permalink_ref(node, "Link to this equation")
        self.body.append("</span>")
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Any) -> None:
    """Let Sphinx call the above."""
    # Before the sources are listed.
    _draw_gallery(app)
    _write_notebooks(app)
    app.connect("build-finished", _add_rust)
    app.add_html_math_renderer("mathml", (_inline_equation, None), (_equation, None))
    app.connect("autodoc-process-docstring", _list_members)
