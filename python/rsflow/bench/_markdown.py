"""Tables of Markdown."""

from __future__ import annotations

from collections.abc import Sequence


def markdown(cells: Sequence[Sequence[str]], *, words: int = 2) -> str:
    """Write rows of cells, the first of them the header; the first `words` columns are words, the others numbers."""
    widths = [max(len(row[j]) for row in cells) for j in range(len(cells[0]))]

    def line(row: Sequence[str]) -> str:
        padded = (f"{cell:{'<' if j < words else '>'}{widths[j]}}" for j, cell in enumerate(row))
        return f"| {' | '.join(padded)} |"

    rule = "|" + "|".join("-" * (w + 2) if j < words else "-" * (w + 1) + ":" for j, w in enumerate(widths)) + "|"
    return "\n".join([line(cells[0]), rule, *map(line, cells[1:])])
