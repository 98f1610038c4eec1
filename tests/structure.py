"""What imports what in a package, and how long files and functions are: read from the source, nothing is imported."""

from __future__ import annotations

import ast
import graphlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

Arrows = dict[str, set[str]]

LONGEST_FILE = 400
LONGEST_FUNCTION = 80
# Begins, within the first lines of a file, the reason why it is longer.
MARKER = "Long because"
_FIRST_LINES = 6


def python_files(package: Path) -> dict[str, Path]:
    """Give each module of a package by its dotted name; the `__init__` of a folder by the folder's."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def python_arrows(package: Path, *, compiled: str = "_core") -> Arrows:
    """Give the modules of the package that each one imports: at its top, in a function, for types alone.

    To import ``a.b.c`` runs ``a`` and ``a.b`` too: these count, but for those that the importer stands in, which have
    begun before it.
    """
    files = python_files(package)
    known = {*files, f"{package.name}.{compiled}"}
    arrows: Arrows = {}
    for module, path in files.items():
        inside = module if path.stem == "__init__" else module.rpartition(".")[0]
        arrows[module] = set()
        for target in _imported(ast.parse(path.read_text(encoding="utf-8")), inside, known):
            parents = target.split(".")[:-1]
            runs = {".".join(parents[:count]) for count in range(1, len(parents) + 1)}
            arrows[module] |= {name for name in runs if not f"{module}.".startswith(f"{name}.")} | {target}
        arrows[module].discard(module)
    return arrows


def _imported(tree: ast.AST, inside: str, known: set[str]) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            parts = inside.split(".")
            above = parts[: len(parts) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                # A module where there is one of that name, else something that `base` defines.
                target = f"{base}.{alias.name}"
                target = target if target in known else base
                if target in known:
                    yield target


def circle(arrows: Mapping[str, set[str]]) -> list[str]:
    """Give one circle, its first member again at its end; empty where there is none."""
    try:
        graphlib.TopologicalSorter(arrows).prepare()
    except graphlib.CycleError as error:
        return list(reversed(error.args[1]))
    return []


def rising(arrows: Mapping[str, set[str]], floors: Sequence[Sequence[str]], package: str) -> list[str]:
    """Give the arrows that do not run down: to a higher floor, or to another room of the same one.

    `floors` names the rooms of each floor, the lowest first: a module or a folder of `package`, or "", the package
    itself. A module belongs to the longest name that fits it; one that none fits is told as well.
    """
    floor_of = {room: number for number, rooms in enumerate(floors) for room in rooms}

    def room_of(module: str) -> str | None:
        name = module.removeprefix(package).removeprefix(".")
        fitting = [room for room in floor_of if room and f"{name}.".startswith(f"{room}.")]
        return max(fitting, key=len) if fitting else "" if name == "" and "" in floor_of else None

    wrong = []
    for module, targets in sorted(arrows.items()):
        here = room_of(module)
        if here is None:
            wrong.append(f"{module}: on no floor")
            continue
        for target in sorted(targets):
            there = room_of(target)
            if there is not None and there != here and floor_of[there] >= floor_of[here]:
                wrong.append(f"{module} -> {target}")
    return wrong


def says_why(lines: Sequence[str]) -> bool:
    """Say whether the first lines of a file tell why it is long."""
    return any(MARKER in line for line in lines[:_FIRST_LINES])


def too_long(path: Path) -> list[str]:
    """Say what is too long in a Python file; of a function its docstring does not count."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    wrong = []
    if len(lines) > LONGEST_FILE and not says_why(lines):
        wrong.append(f"{path.name}: {len(lines)} lines, and its first ones do not say '{MARKER} ...'")
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        assert node.end_lineno is not None
        length = node.end_lineno - node.lineno + 1
        first = node.body[0]
        if ast.get_docstring(node, clean=False) is not None and first.end_lineno is not None:
            length -= first.end_lineno - first.lineno + 1
        if length > LONGEST_FUNCTION:
            wrong.append(f"{path.name}: {node.name} has {length} lines")
    return wrong
