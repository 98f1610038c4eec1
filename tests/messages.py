"""Finds what a source file says when it refuses an argument."""

from __future__ import annotations

import ast
from pathlib import Path

# What is raised where an argument does not fit.
REFUSING = {"ShapeError", "DTypeError", "OptionError"}


def messages(path: Path) -> list[tuple[int, str]]:
    """Give the line and text of each message in which an argument is refused; what is filled in is an ellipsis."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in REFUSING and node.args:
            text = _text(node.args[0])
            if text is not None:
                found.append((node.lineno, text))
    return sorted(found)


def _text(node: ast.expr) -> str | None:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(_text(part) or "..." for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return f"{_text(node.left) or '...'}{_text(node.right) or '...'}"
    return None
