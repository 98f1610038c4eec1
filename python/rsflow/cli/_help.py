"""Help that fits the terminal: texts are written 120 columns wide, and wrapped anew where that is too wide."""

from __future__ import annotations

import argparse
import re
import textwrap
from collections.abc import Iterator

__all__ = ["HelpFormatter"]

_WRITTEN = 120
# A name, and what it says in a column of its own.
_ROW = re.compile(r"( +\S+(?: \S+)*  +)\S")
# A command, and what it does behind it.
_EXAMPLE = re.compile(r"(.*?)(?:\s{3,}(\S.*))?")
# Less than this beside a name is no column.
_LEAST = 20


class HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Leave what fits as it stands; wrap paragraphs and rows of two columns, and never a command to copy.

    What is said of a command behind it stands below where both do not fit in one line.
    """

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        lines = [indent + line for line in text.splitlines()]
        if max(map(len, lines), default=0) <= width:
            return "\n".join(lines)
        return "\n".join(line for block, hanging in _blocks(lines) for line in _wrapped(block, hanging, width))


def _blocks(lines: list[str]) -> Iterator[tuple[str, int]]:
    """Join what was wrapped at its writing: each line as it would be without a width, and where its text begins."""
    block, hanging, last = "", 0, ""
    for line in lines:
        begin = len(line) - len(line.lstrip())
        goes_on = bool(block.strip()) and bool(line.strip()) and begin == hanging
        if hanging == 0:
            # A line ends early where a new thing begins.
            goes_on = goes_on and len(last) + 1 + len(line.split()[0]) > _WRITTEN
        if goes_on:
            block += " " + line.strip()
        else:
            if last or block:
                yield block, hanging
            elif line is not lines[0]:
                yield "", 0
            row = _ROW.match(line)
            # Other lines that are indented stand for themselves, such as commands.
            block, hanging = line, len(row[1]) if row and not line.startswith("  rsflow ") else -1 if begin else 0
        last = line
    yield block, hanging


def _wrapped(block: str, hanging: int, width: int) -> list[str]:
    if len(block) <= width:
        return [block]
    if block.startswith("  rsflow "):
        command, comment = _EXAMPLE.fullmatch(block).groups()  # type: ignore[union-attr]
        said = textwrap.wrap(comment or "", width, initial_indent=" " * 6, subsequent_indent=" " * 6)
        return [command, *said]
    begin = len(block) - len(block.lstrip())
    indent = " " * (begin if hanging < 0 else hanging if width - hanging >= _LEAST else 4)
    return textwrap.wrap(block, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
