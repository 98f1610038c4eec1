"""The Rust house keeps its shape: modules use what lies below, never in a circle; files and functions are short."""

from __future__ import annotations

from pathlib import Path

import pytest

from structure import LONGEST_FUNCTION, circle, rising
from structure_rust import rust_arrows, rust_files, too_long_in_rust

ROOT = Path(__file__).resolve().parent.parent
CORE = ROOT / "crates" / "lk-core"
BINDING = ROOT / "crates" / "rsflow-py"

# Rooms from the ground up: rooms of one floor do not know each other.
FLOORS = (
    ("error",),
    ("options", "memory", "threads", "simd"),
    ("illumination", "execution", "ink"),
    ("parallel", "scratch"),
    ("frame",),
    ("grey", "phase", "presmooth"),
    ("support", "displacement_hypotheses"),
    ("pyramid",),
    ("shift", "corners", "dense", "grid"),
    ("track", "plane"),
    ("segment",),
    ("",),
)


def test_no_circle_of_modules():
    assert circle(rust_arrows(CORE / "src", "lk_core")) == []
    assert circle(rust_arrows(BINDING / "src", "rsflow_py")) == []


def test_modules_use_what_lies_below_them():
    assert rising(rust_arrows(CORE / "src", "lk_core"), FLOORS, "lk_core") == []


def test_files_and_functions_are_short_or_say_why_not():
    files = [*CORE.rglob("*.rs"), *BINDING.rglob("*.rs")]
    assert len(files) > 150
    assert [line for path in sorted(files) for line in too_long_in_rust(path)] == []


def made(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


@pytest.mark.parametrize(
    "files",
    [
        {"lib.rs": "mod a;\nmod b;", "a.rs": "use crate::b::f;", "b.rs": "fn f() { super::a::g(); }"},
        {"lib.rs": "mod a;", "a/mod.rs": "mod b;\nuse b::f;", "a/b.rs": "use super::g;"},
        {"lib.rs": "mod a;\nmod b;", "a.rs": "use crate::b::{c::{self, d}, e};", "b.rs": "pub(crate) use crate::a;"}
        | {"b/c.rs": "use crate::a::x as y;"},
        # What is passed on is used by those who take it.
        {"lib.rs": "mod a;\nmod b;\npub use a::f;", "a.rs": "use crate::b::g;", "b.rs": "use crate::f;"},
    ],
    ids=["siblings", "parent and child", "a tree", "passed on"],
)
def test_a_circle_is_found(tmp_path, files):
    assert len(circle(rust_arrows(made(tmp_path, files), "house"))) > 2


def test_what_is_no_circle_is_none(tmp_path):
    files = {
        "lib.rs": "mod a;\nmod b;\npub use b::c::T;",
        "a.rs": "// use crate::d;\nuse std::fmt;\nuse crate::b::c::T;\n#[cfg(test)]\nmod tests {\n    use super::x;\n}",
        "b/mod.rs": "mod c;\npub(crate) use c::T;",
        "b/c.rs": 'pub(in crate::b) fn f() -> &str { "crate::a::g" }',
    }
    house = made(tmp_path, files)
    assert rust_arrows(house, "house") == {
        "house": set(),
        "house.a": {"house.b.c"},
        "house.b": set(),
        "house.b.c": set(),
    }
    assert list(rust_files(house)) == [("a",), ("b", "c"), ("b",), ()]


def test_what_is_too_long_is_found(tmp_path):
    path = tmp_path / "a.rs"
    body = "    x += 1;\n" * (LONGEST_FUNCTION - 2)
    path.write_text(f"pub(crate) fn f() {{\n{body}}}\n")
    assert too_long_in_rust(path) == []
    path.write_text(f"fn f() {{\n{body}    y += 1;\n}}\n")
    assert too_long_in_rust(path) == [f"a.rs: f has {LONGEST_FUNCTION + 1} lines"]
    path.write_text("//! Long because it is one table.\n" + "x\n" * 500)
    assert too_long_in_rust(path) == []
    path.write_text("x\n" * 500)
    assert len(too_long_in_rust(path)) == 1
