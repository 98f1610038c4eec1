"""What uses what in a Rust crate, and how long its files and functions are: read from the source."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from structure import LONGEST_FILE, LONGEST_FUNCTION, MARKER, Arrows, says_why

Names = tuple[str, ...]

_FUNCTION = re.compile(r"^( *)(?:pub(?:\([a-z: ]+\))? )?(?:const )?(?:unsafe )?fn (\w+)")


def rust_files(source: Path) -> dict[Names, Path]:
    """Give each module of a crate by its path from the root, which is of no name."""
    found = {}
    for path in sorted(source.rglob("*.rs")):
        parts = path.relative_to(source).with_suffix("").parts
        found[parts[:-1] if parts[-1] in ("mod", "lib") else parts] = path
    return found


def rust_arrows(source: Path, crate: str) -> Arrows:
    """Give the modules that each one uses, outside of its tests: by `use`, or by a path in its code.

    What a module passes on with `pub use` is not used by it, but by those who take it from there.
    """
    modules = {name: path for name, path in rust_files(source).items() if "tests" not in name}
    used: dict[Names, list[tuple[bool, Names]]] = {}
    for module, path in modules.items():
        text = _code(path.read_text(encoding="utf-8"))
        children = set(re.findall(r"\bmod (\w+);", text))
        uses = re.findall(r"\b(pub(?:\([^)]*\))? )?use ([^;]+);", text)
        body = re.sub(r"\buse [^;]+;", "", text)
        roots = "|".join(["crate", "super", "self", *sorted(children)])
        inline = re.findall(rf"(?<![\w:])(?:{roots})(?:::\w+)+", body)
        paths = [(bool(passed), name) for passed, tree in uses for name in _leaves(tree)]
        paths += [(False, tuple(name.split("::"))) for name in inline]
        used[module] = [
            (passed, whole) for passed, name in paths if (whole := _absolute(module, name, children)) is not None
        ]
    passed_on = {(*module, name[-1]): name for module, names in used.items() for passed, name in names if passed}
    arrows: Arrows = {}
    for module, names in used.items():
        targets = {_module_of(name, modules, passed_on) for passed, name in names if not passed}
        arrows[".".join((crate, *module))] = {".".join((crate, *name)) for name in targets if name != module}
    return arrows


def _code(text: str) -> str:
    """Leave out comments, texts, tests and how far a name may be seen."""
    text = re.sub(r"//[^\n]*", "", text)
    text = re.sub(r'"(?:\\.|[^"\\])*"', '""', text)
    text = re.sub(r"#\[cfg\(test\)\]\s*mod \w+ \{.*\Z", "", text, flags=re.DOTALL)
    return re.sub(r"pub\(in [^)]*\)", "pub(crate)", text)


def _leaves(tree: str) -> Iterator[Names]:
    """Give each path of a `use`."""
    tree = tree.strip()
    head, brace, inside = tree.partition("{")
    if not brace:
        yield tuple(part for part in re.sub(r" as \w+$", "", tree).replace(" ", "").split("::") if part)
        return
    above = tuple(part for part in head.replace(" ", "").split("::") if part)
    depth, item = 0, ""
    for sign in inside[: inside.rindex("}")] + ",":
        depth += (sign == "{") - (sign == "}")
        if sign == "," and depth == 0:
            yield from ((*above, *leaf) for leaf in _leaves(item) if leaf)
            item = ""
        else:
            item += sign


def _absolute(module: Names, name: Names, children: set[str]) -> Names | None:
    """Give a path from the root of the crate; None where it leads to another crate."""
    if name[:1] == ("crate",):
        return name[1:]
    if name[:1] == ("self",):
        return (*module, *name[1:])
    if name[:1] == ("super",):
        while name[:1] == ("super",):
            module, name = module[:-1], name[1:]
        return (*module, *name)
    return (*module, *name) if name[:1] and name[0] in children else None


def _module_of(name: Names, modules: dict[Names, Path], passed_on: dict[Names, Names]) -> Names:
    """Give the module that defines what a path names."""
    for count in range(len(name), 0, -1):
        if name[:count] in modules:
            return name[:count]
        if name[:count] in passed_on:
            return _module_of((*passed_on[name[:count]], *name[count:]), modules, passed_on)
    return ()


def too_long_in_rust(path: Path) -> list[str]:
    """Say what is too long in a Rust file."""
    lines = path.read_text(encoding="utf-8").splitlines()
    wrong = []
    if len(lines) > LONGEST_FILE and not says_why(lines):
        wrong.append(f"{path.name}: {len(lines)} lines, and its first ones do not say '{MARKER} ...'")
    begun: list[tuple[str, str, int]] = []
    for number, line in enumerate(lines):
        function = _FUNCTION.match(line)
        if function and not line.endswith(";"):
            begun.append((function[1], function[2], number))
        elif begun and line == begun[-1][0] + "}":
            _, name, first = begun.pop()
            if number - first + 1 > LONGEST_FUNCTION:
                wrong.append(f"{path.name}: {name} has {number - first + 1} lines")
    return wrong
