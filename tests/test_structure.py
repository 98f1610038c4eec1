"""The house keeps its shape: imports run one way, never in a circle; files and functions are short, or say why not."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest

import rsflow
from structure import LONGEST_FILE, LONGEST_FUNCTION, circle, python_arrows, rising, too_long

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "python" / "rsflow"

# Rooms from the ground up. An import leads to a lower floor or stays in its room: rooms of one floor do not know each
# other. The doors keep names where users import them from; nothing inside goes through them.
DOORS = ("objects", "camera.board", "camera.calibration", "camera.capture")
FLOORS = (
    ("_core", "errors"),
    ("_beside", "_checks", "_extras", "_rotation", "_shared"),
    ("_display",),
    ("io",),
    ("capture", "plotting", "video"),
    ("_results",),
    ("camera",),
    ("shift", "tracking", "flow", "grid", "calibration", "synthetic"),
    ("segmentation", "velocity"),
    ("interop",),
    ("extraction", "reproduce", "scale"),
    ("batch", "bench", "live"),
    DOORS,
    ("",),
    ("cli",),
    ("__main__",),
)

FILES = sorted(path for folder in ("python", "tests", "examples", "docs") for path in (ROOT / folder).rglob("*.py"))

TEXTS = {".py", ".pyi", ".md", ".rs", ".toml", ".lock", ".yml", ".yaml", ".sh", ".cfg", ".txt"}
# An extra of `rsflow`, or its installation: only flags and quotes may stand between the verb and the name.
STRANGER = re.compile(
    r"(?<![\w.])rsflow\\?\[[a-z{]|(?:pip|pipx|uv|cargo) (?:install|add|download)(?: -\S+)* ['\"`]?rsflow(?![\w-])"
)


def made(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = folder / "house" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder / "house"


def test_no_text_sends_to_a_strangers_program():
    # `rsflow` on PyPI and on crates.io belongs to others: what is ours is installed as rsflow-motion.
    texts = [path for path in ROOT.iterdir() if path.is_file() and path.suffix in {"", ".md", ".toml", ".lock"}]
    for folder in ("crates", "docs", "examples", "fuzz", "python", "rivals", "tests", ".ci", ".github"):
        texts += [path for path in (ROOT / folder).rglob("*") if path.suffix in TEXTS or path.parent.name == ".ci"]
    assert ROOT / "README.md" in texts
    assert ROOT / "python/rsflow/_extras.py" in texts
    found = {
        f"{path.relative_to(ROOT)}: {match[0]}"
        for path in texts
        if "_build" not in path.parts
        for match in STRANGER.finditer(path.read_text(encoding="utf-8"))
    }
    assert found == set()


@pytest.mark.parametrize(
    ("text", "sent"),
    [
        ("pip install 'rsf" + "low[plot]'", True),
        ("pip install -U rsf" + "low", True),
        ("cargo add rsf" + "low", True),
        ("uv add rsf" + "low.", True),
        ("pip install 'rsflow-motion[plot]'", False),
        ("pip install numpy; rsflow doctor", False),
        ("from an index: pip install rsflow-motion", False),
    ],
)
def test_what_sends_to_a_strangers_program(text, sent):
    assert (STRANGER.search(text) is not None) == sent


def test_no_circle_of_imports():
    assert circle(python_arrows(PACKAGE)) == []


def test_imports_run_down():
    assert rising(python_arrows(PACKAGE), FLOORS, "rsflow") == []


def test_nothing_inside_goes_through_a_door():
    doors = {f"rsflow.{door}" for door in DOORS}
    arrows = python_arrows(PACKAGE)
    assert {module: targets & doors for module, targets in arrows.items() if targets & doors} == {}


def test_files_and_functions_are_short_or_say_why_not():
    assert [line for path in FILES for line in too_long(path)] == []


@pytest.mark.parametrize(
    "files",
    [
        {"__init__.py": "", "a.py": "from . import b", "b.py": "from house.a import x"},
        {"__init__.py": "", "a.py": "import house.b", "b.py": "def f():\n    from .a import x"},
        {
            "__init__.py": "",
            "a.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .b import X",
            "b.py": "from .a import Y",
        },
        {"__init__.py": "from .a import x", "a.py": "from . import y"},
        # The folder's own file runs first, and asks for what is asking.
        {
            "__init__.py": "",
            "a.py": "from .room.b import x",
            "room/__init__.py": "from .c import y",
            "room/b.py": "",
            "room/c.py": "from ..a import z",
        },
    ],
    ids=["plain", "in a function", "for types", "the package", "a folder"],
)
def test_a_circle_is_found(tmp_path, files):
    found = circle(python_arrows(made(tmp_path, files)))
    assert len(found) > 2
    assert found[0] == found[-1]


def test_what_is_no_circle_is_none(tmp_path):
    files = {
        "__init__.py": "from .room import x",
        "a.py": "import os\nfrom . import _core\nfrom .room import b",
        "room/__init__.py": "from .b import x",
        "room/b.py": "from . import c\nfrom .._core import f",
        "room/c.py": "import typing",
    }
    house = made(tmp_path, files)
    assert python_arrows(house) == {
        "house": {"house.room"},
        "house.a": {"house._core", "house.room", "house.room.b"},
        "house.room": {"house.room.b"},
        "house.room.b": {"house.room.c", "house._core"},
        "house.room.c": set(),
    }
    assert circle(python_arrows(house)) == []


def test_an_import_that_runs_up_or_sideways_is_found(tmp_path):
    files = {
        "__init__.py": "",
        "low.py": "def f():\n    from .high import x",
        "high.py": "from .low import y",
        "beside.py": "from . import high",
        "other.py": "",
    }
    arrows = python_arrows(made(tmp_path, files))
    found = rising(arrows, (("low",), ("high", "beside"), ("",)), "house")
    assert found == ["house.beside -> house.high", "house.low -> house.high", "house.other: on no floor"]


def test_what_is_too_long_is_found(tmp_path):
    body = "    x = 1\n" * (LONGEST_FUNCTION - 1)
    path = tmp_path / "a.py"
    path.write_text(f'def f():\n    """Say.\n\n    More.\n    """\n{body}')
    assert too_long(path) == []
    path.write_text(f"class C:\n    def f():\n    {body.replace(chr(10), chr(10) + '    ')}    y = 1\n")
    assert too_long(path) == [f"a.py: f has {LONGEST_FUNCTION + 1} lines"]
    path.write_text("x = 1\n" * (LONGEST_FILE + 1))
    assert len(too_long(path)) == 1
    path.write_text("# Long because it is one table.\n" + "x = 1\n" * LONGEST_FILE)
    assert too_long(path) == []


def test_the_public_modules_are_there():
    """What `rsflow.X` and `import rsflow.X` reach."""
    for name in (*DOORS, *rsflow._SUBMODULES):
        __import__(f"rsflow.{name}")


def test_the_map_says_where_things_live():
    """Each answer of CONTRIBUTING.md's table is a file."""
    lines = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").splitlines()
    begin = lines.index("| What | File |")
    answers = list(itertools.takewhile(lambda line: line.startswith("|"), lines[begin + 2 :]))
    folders = {"core": ROOT / "crates" / "lk-core" / "src", "rsflow": PACKAGE}
    files = [re.findall(r"`(\w+)/([\w/]+\.\w+)`", line) for line in answers]
    assert len(files) == 22
    assert [line for line, named in zip(answers, files, strict=True) if not named] == []
    assert [name for named in files for folder, name in named if not (folders[folder] / name).is_file()] == []
