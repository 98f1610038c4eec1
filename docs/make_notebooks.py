"""Notebooks made of the programs in examples/, which stay the one source: cells begin at `# %%`.

python docs/make_notebooks.py [FOLDER]
"""

from __future__ import annotations

import ast
import json
import re
import sys
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def _cell(kind: str, number: int, text: str) -> dict[str, Any]:
    cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}}
    cell["source"] = text.strip("\n").splitlines(keepends=True)
    return cell | ({"execution_count": None, "outputs": []} if kind == "code" else {})


def notebook(path: Path) -> dict[str, Any]:
    """Give the notebook of a program, not yet run: its docstring, then its cells of text and of code."""
    text = path.read_text(encoding="utf-8")
    docstring = ast.get_docstring(ast.parse(text)) or ""
    first, _, rest = docstring.partition("\n")
    title = path.stem.replace("_", " ").capitalize()
    # What the docstring says of the command line is indented there.
    rest = re.sub(r"^(?: {4})?(python examples/.*)$", r"    \1", rest.strip("\n"), flags=re.MULTILINE)
    cells = [
        _cell("markdown", 0, f"# {title}\n\n{first}\n\nAs a program:\n\n{rest}"),
        # A notebook's own arguments are not the program's.
        _cell("code", 1, f'import sys\n\nsys.argv = ["{path.name}"]'),
    ]
    code = text.split('"""', 2)[2]
    for part in re.split(r"^(?=# %%)", code, flags=re.MULTILINE):
        head, _, body = part.partition("\n") if part.startswith("# %%") else ("", "", part)
        if "[markdown]" in head:
            cells.append(_cell("markdown", len(cells), re.sub(r"^# ?", "", body.strip("\n"), flags=re.MULTILINE)))
        elif body.strip():
            cells.append(_cell("code", len(cells), body))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}


def write(folder: Path) -> list[Path]:
    """Write the notebook of each program where it is another one, and give their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for path in sorted(EXAMPLES.glob("*.py")):
        paths.append(folder / f"{path.stem}.ipynb")
        text = json.dumps(notebook(path), indent=1, ensure_ascii=False) + "\n"
        if not paths[-1].is_file() or paths[-1].read_text(encoding="utf-8") != text:
            paths[-1].write_text(text, encoding="utf-8")
    return paths


if __name__ == "__main__":
    print(*write(Path(sys.argv[1] if len(sys.argv) > 1 else "notebooks")), sep="\n")
