"""Every example runs: docstrings of the package, and the Python and shell blocks of the README and of docs/."""

from __future__ import annotations

import contextlib
import doctest
import importlib
import inspect
import io
import pkgutil
import re
import shlex
from pathlib import Path

import pytest

import rsflow
from rsflow.cli import main as rsflow_command

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    ROOT / "README.md",
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if "_build" not in page.relative_to(ROOT).parts),
]
BLOCK = re.compile(r"^```(python|sh)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def _modules() -> list[str]:
    return sorted(
        info.name for info in pkgutil.walk_packages(rsflow.__path__, "rsflow.") if not info.name.endswith("__main__")
    )


@pytest.mark.parametrize("name", _modules())
def test_docstring_examples(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    result = doctest.testmod(module, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert result.failed == 0


# Whose names users import: each has an example of its own.
PUBLIC = [
    "rsflow.batch",
    "rsflow.bench",
    "rsflow.calibration",
    "rsflow.camera.board",
    "rsflow.camera.calibration",
    "rsflow.camera.capture",
    "rsflow.camera.formats",
    "rsflow.camera.model",
    "rsflow.capture",
    "rsflow.errors",
    "rsflow.extraction",
    "rsflow.flow",
    "rsflow.interop.flow_sensor",
    "rsflow.interop.mavlink",
    "rsflow.interop.opencv",
    "rsflow.interop.ros",
    "rsflow.io",
    "rsflow.live",
    "rsflow.objects",
    "rsflow.plotting",
    "rsflow.reproduce",
    "rsflow.scale",
    "rsflow.segmentation",
    "rsflow.shift",
    "rsflow.synthetic",
    "rsflow.tracking",
    "rsflow.velocity",
    "rsflow.video",
]


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_class_and_function_has_an_example(name: str):
    module = importlib.import_module(name)
    documented = [getattr(module, public) for public in module.__all__]
    documented = [item for item in documented if isinstance(item, type) or inspect.isroutine(item)]
    assert documented
    assert [item.__name__ for item in documented if ">>>" not in (item.__doc__ or "")] == []


def test_examples_of_the_core_are_run():
    """Of a compiled module doctest takes only what names the module as its own."""
    found = doctest.DocTestFinder(exclude_empty=True).find(rsflow._core, "core")
    assert {"core.build_info", "core.get_num_threads", "core.set_num_threads"} <= {test.name for test in found}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_blocks_of_a_page(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Blocks run in order, in one folder and one namespace; a block after `<!-- not run: reason -->` does not."""
    monkeypatch.chdir(tmp_path)
    text = re.sub(r"<!-- not run: [^>]+-->\n```.*?^```$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    namespace: dict[str, object] = {"__name__": "__page__"}
    for language, code in BLOCK.findall(text):
        if language == "python":
            exec(compile(code, f"{page.name}: {code.splitlines()[0]}", "exec"), namespace)
            continue
        for line in code.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            if not words:
                continue
            assert words[0] == "rsflow", f"{page.name}: a block runs {line!r}; only rsflow commands are run here"
            # In this process: a new one for each command would spend most of its time on imports.
            said = io.StringIO()
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                code = rsflow_command(words[1:])
            assert code == 0, f"{line}\n{said.getvalue()}"
