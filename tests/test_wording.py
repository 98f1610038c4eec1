"""An argument is refused in one wording, ``name: got X, expected Y``, and one knob is described in the same words."""

from __future__ import annotations

import ast
import inspect
import re
from pathlib import Path

import pytest

import rsflow
from messages import messages
from rsflow import _core
from rsflow._checks import knobs

PACKAGE = Path(rsflow.__file__).parent
# These are not about an argument's value: they say what stands in the way of writing a file.
ABOUT_FILES = {"_results/folder.py", "_results/inputs.py"}
# The text is what `doubtful_step` gives.
PASSED_ON = {"capture/times.py: times: ..."}
ALIKE = re.compile(r": got .*expected ")

LENGTH = "The longest displacement to look for, a length in pixels"
LONGER = ": longer ones are not sought, and none is valid."


def test_every_refusal_says_what_it_got_and_what_it_expected():
    found = [
        (path.relative_to(PACKAGE).as_posix(), text)
        for path in sorted(PACKAGE.rglob("*.py"))
        for _, text in messages(path)
    ]
    assert len(found) > 100
    others = {f"{name}: {text}" for name, text in found if not ALIKE.search(text) and name not in ABOUT_FILES}
    assert others == PASSED_ON


def test_a_message_that_differs_is_found(tmp_path):
    path = tmp_path / "a.py"
    path.write_text('def f(x):\n    raise OptionError(f"x must be {x}")\nraise ShapeError("a" + f"{1}: got")\n')
    assert messages(path) == [(2, "x must be ..."), (3, "a...: got")]


@pytest.mark.parametrize(
    "described",
    [rsflow.estimate_shift, rsflow.dense_flow, rsflow.track_points],
    ids=lambda function: function.__name__,
)
def test_max_displacement_is_one_thing(described):
    text = " ".join((inspect.getdoc(described) or "").split())
    assert f"max_displacement : float, optional {LENGTH}{LONGER} By default " in text


@pytest.mark.parametrize(
    "described", [rsflow.MotionSegmenter, rsflow.extract, rsflow.live.readings], ids=lambda function: function.__name__
)
def test_max_displacement_of_a_sequence_is_the_same_thing(described):
    text = " ".join((inspect.getdoc(described) or "").split())
    assert f"{LENGTH} from frame to frame{LONGER} By default " in text


def test_light_is_one_type():
    """A parameter of this name has the type of `_checks.knobs`, or is checked by it."""
    types = set()
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.arg, ast.AnnAssign)) and node.annotation is not None:
                name = node.arg if isinstance(node, ast.arg) else getattr(node.target, "id", "")
                if name == "illumination":
                    types.add(ast.unparse(node.annotation))
    # "object" is what the check itself takes.
    assert types == {"Illumination", "knobs.Illumination", "object"}
    defined = [path.name for path in PACKAGE.rglob("*.py") if "Illumination = Literal" in path.read_text("utf-8")]
    assert defined == ["knobs.py"]


def test_the_core_takes_the_words_of_the_type():
    for word in knobs.Illumination.__args__:
        _core.DenseFlow("fast", word, None, False)
    with pytest.raises(rsflow.OptionError, match="illumination"):
        _core.DenseFlow("fast", "gain", None, False)
