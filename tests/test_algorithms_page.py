"""The page algorithms.md holds: its constants are the code's, and the sections that the code points to are there."""

from __future__ import annotations

import ast
import math
import operator
import os
import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / "docs" / "explanation" / "algorithms.md"
PAGE = FILE.read_text(encoding="utf-8")
CORE = ROOT / "crates" / "lk-core" / "src"
PACKAGE = ROOT / "python" / "rsflow"

OPERATORS: dict[type, Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.LShift: operator.lshift,
}


def rows(*header: str) -> list[list[str]]:
    """Cells of all tables of the page whose first columns are called so."""
    found, inside = [], False
    for line in PAGE.splitlines():
        cells = [cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if cells[: len(header)] == list(header):
            inside = True
        elif not cells:
            inside = False
        elif inside and not cells[0].startswith("---"):
            found.append(cells)
    return found


def worth(node: ast.expr) -> Any:
    """What an expression of numbers is worth; ValueError where it is none."""
    match node:
        case ast.Constant(value=int() | float() | str() as value):
            return value
        case ast.Tuple(elts=parts) | ast.List(elts=parts):
            return tuple(worth(part) for part in parts)
        case ast.Dict(keys=keys, values=values):
            return {worth(key): worth(value) for key, value in zip(keys, values, strict=True) if key is not None}
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -worth(operand)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            return OPERATORS[type(op)](worth(left), worth(right))
        case ast.Call(func=ast.Attribute(attr="radians"), args=[angle]):
            return math.radians(worth(angle))
        case ast.Call(func=ast.Attribute(attr="array"), args=[values]):
            return worth(values)
    raise ValueError(ast.dump(node))


def evaluated(text: str) -> Any:
    return worth(ast.parse(text.strip(), mode="eval").body)


def in_rust(source: str, name: str) -> list[Any]:
    """Values of a constant, or of `Type.field` the first literal that the field is given."""
    if "." in name:
        field = name.split(".")[1]
        given = [re.sub(r"Some\((.*)\)", r"\1", text) for text in re.findall(rf"\b{field}: ([^,\n]+),", source)]
        return [evaluated(text) for text in given if re.fullmatch(r"[-\d._e]+", text)][:1]
    found = re.findall(rf"\bconst {name}\s*:[^=]*=\s*(.*?);\n", source, re.DOTALL)
    return [evaluated("(" + re.sub(r"//.*", "", text).replace("..=", ", ") + ")") for text in found]


def in_python(source: str, name: str) -> list[Any]:
    """Values that a module gives to a name, or to some at once."""
    found = []
    for node in ast.parse(source).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if any(isinstance(to, ast.expr) and ast.unparse(to).strip("()") == name for to in targets):
            value = getattr(node, "value", None)
            assert isinstance(value, ast.expr)
            found.append(worth(value))
    return found


def source_of(file: str) -> str:
    return ((CORE if file.endswith(".rs") else PACKAGE) / file).read_text(encoding="utf-8")


CONSTANTS = rows("constant", "file", "value")


def holds(constant: str, file: str, value: str) -> bool:
    """Whether a file gives a constant this value, or has the piece of code that the page quotes in its place."""
    source = source_of(file)
    if not re.fullmatch(r"[A-Za-z_]\w*(\.\w+|, [A-Za-z_]\w*)*", constant):
        return " ".join(constant.split()) in " ".join(source.split())
    try:
        found = in_rust(source, constant) if file.endswith(".rs") else in_python(source, constant)
    except (ValueError, SyntaxError):
        # It is worth something else than numbers.
        return False
    return found == [evaluated(value)]


def elsewhere(constant: str, file: str, value: str) -> list[str]:
    """Other files of the same language that hold it."""
    root = CORE if file.endswith(".rs") else PACKAGE
    files = sorted(path.relative_to(root).as_posix() for path in root.rglob(f"*{Path(file).suffix}"))
    return [other for other in files if holds(constant, other, value)]


@pytest.mark.parametrize(("constant", "file", "value"), [row[:3] for row in CONSTANTS])
def test_the_page_has_the_values_of_the_code(constant: str, file: str, value: str) -> None:
    """With REGENERATE=1 rows whose constant has moved to another file name that one; values are changed by hand."""
    constant, file, value = constant.strip("`"), file.strip("`"), value.strip("`")
    path = (CORE if file.endswith(".rs") else PACKAGE) / file
    if path.is_file() and holds(constant, file, value):
        return
    now = elsewhere(constant, file, value)
    if os.environ.get("REGENERATE") == "1" and len(now) == 1:
        page = FILE.read_text(encoding="utf-8")
        row = f"| `{constant.replace('|', chr(92) + '|')}` | `{{}}` |"
        assert page.count(row.format(file)) == 1
        page = page.replace(row.format(file), row.format(now[0]))
        FILE.write_text(page, encoding="utf-8")
        return
    pytest.fail(f"algorithms.md: {constant} is not {value} in {file}, but in {', '.join(now) or 'no file'}")


def test_there_are_constants_to_compare() -> None:
    assert len(CONSTANTS) > 250
    named = {tuple(row[:2]) for row in CONSTANTS}
    assert len(named) == len(CONSTANTS), "a constant stands on the page twice"


TOKEN = re.compile(r"\.\.|[A-Za-z_]\w*(?:(?:::|\.)\w+)*|\d[\d_]*(?:\.\d+)?(?:e-?\d+)?|[{}\[\](),:;=>]")


class Recipes:
    """Constants of `recipe.rs`, read as far as they are names, numbers, arrays and `..base`, and what presets are."""

    def __init__(self, source: str) -> None:
        self.known: dict[str, Any] = {}
        self.tokens = TOKEN.findall(re.sub(r"//.*", "", source[source.index("const REFINE") :]))
        self.presets: dict[str, Any] = {}
        at = 0
        while at < len(self.tokens):
            token = self.tokens[at]
            if token == "const":
                # `NAME`, `:`, its type and `=`.
                self.known[self.tokens[at + 1]], at = self.read(at + 5)
            elif token.startswith("Preset::"):
                # `=` and `>`.
                self.presets[token.removeprefix("Preset::").lower()], at = self.read(at + 3)
            else:
                at += 1

    def read(self, at: int) -> tuple[Any, int]:
        """A value, and where the next token stands."""
        token = self.tokens[at]
        if token == "[":
            values, at = [], at + 1
            while self.tokens[at] != "]":
                value, at = self.read(at)
                if self.tokens[at] == ";":
                    values, at = [value] * int(self.tokens[at + 1]), at + 2
                else:
                    values.append(value)
                    at += self.tokens[at] == ","
            return values, at + 1
        if token[0].isdigit():
            return float(token), at + 1
        if self.tokens[at + 1] != "{":
            known: Any = self.known
            for part in token.split("."):
                known = (known or {}).get(part)
            return known, at + 1
        fields: dict[str, Any] = {}
        at += 2
        while self.tokens[at] != "}":
            name, at = self.tokens[at], at + 1
            if name == "..":
                base, at = self.read(at)
                fields = (base or {}) | fields
            elif self.tokens[at] == ":":
                fields[name], at = self.read(at + 1)
            else:
                fields[name] = self.known[name]
            at += self.tokens[at] == ","
        return fields, at + 1


PRESETS = rows("preset", "level")
LEVEL_FIELDS = ("steps", "sparse", "radius", "distance", "median", "half_rounds", "rounds", "sweeps")


def test_the_page_has_the_presets_of_the_code() -> None:
    presets = Recipes(source_of("dense/recipe.rs")).presets
    assert list(presets) == ["ultrafast", "fast", "balanced", "accurate"]
    assert [row[:2] for row in PRESETS] == [[name, level] for name in presets for level in ("0", "1", "2", "rest")]
    for preset, level, *figures in PRESETS:
        recipe = presets[preset]
        if figures[0] == "not measured":
            assert int(level) < recipe["finest"]
            continue
        of_level = recipe["coarse"] if level == "rest" else recipe["fine"][int(level)]
        assert [int(figure) for figure in figures] == [of_level[field] for field in LEVEL_FIELDS], (preset, level)


def test_files_that_the_page_names_are_there() -> None:
    for file in set(re.findall(r"`([a-z_/]+\.(?:rs|py))`", PAGE)):
        roots = (ROOT,) if file.startswith("tests/") else (CORE, PACKAGE)
        assert any((root / file).is_file() for root in roots), f"algorithms.md names {file}"


def test_sections_that_the_code_points_to_are_there() -> None:
    headings = re.findall(r"^#+ (.+)$", PAGE.replace("`", ""), re.MULTILINE)
    assert len(set(headings)) == len(headings)
    files = [*CORE.rglob("*.rs"), *PACKAGE.rglob("*.py")]
    for path in files:
        for section in re.findall(
            r'docs/explanation/algorithms\.md`?, section "([^"]+)"', path.read_text(encoding="utf-8")
        ):
            assert section in headings, f"{path.relative_to(ROOT)} points to a section {section!r}"


def test_every_section_has_an_anchor_that_stays() -> None:
    lines = PAGE.splitlines()
    anchors = [lines[at - 1] for at, line in enumerate(lines) if re.match(r"##+ ", line)]
    assert all(re.fullmatch(r"\(alg-[a-z-]+\)=", anchor) for anchor in anchors), anchors
    assert len(set(anchors)) == len(anchors)
    for target in re.findall(r"\]\(#([a-z-]+)\)", PAGE):
        assert f"({target})=" in anchors


def test_equations_that_the_page_names_are_there() -> None:
    labels = re.findall(r"^\$\$ \((eq-[a-z0-9-]+)\)$", PAGE, re.MULTILINE)
    assert len(set(labels)) == len(labels)
    assert set(re.findall(r"\{eq\}`([^`]+)`", PAGE)) <= set(labels)
