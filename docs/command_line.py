"""The commands and their options, read from the parsers, as Markdown for docs/reference/command-line.md.

python docs/command_line.py         rewrites what stands between its two lines there
"""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

from rsflow.cli import COMMANDS, Parser

PAGE = Path(__file__).resolve().parent / "reference" / "command-line.md"
BEGIN, END = "<!-- commands-start -->\n", "<!-- commands-end -->"


def parser_of(command: str) -> tuple[Parser, str]:
    """Give the parser of a command, and what its help begins with."""
    module = importlib.import_module(COMMANDS[command][0])
    parser = Parser(prog=f"rsflow {command}", allow_abbrev=False)
    module.add_arguments(parser)
    return parser, module.DESCRIPTION


def _names(action: argparse.Action) -> str:
    """Give an argument as it is typed: `--stop N`, `SOURCE...`."""
    values = action.metavar
    if values is None and action.nargs != 0:
        values = "{" + ",".join(map(str, action.choices)) + "}" if action.choices else action.dest.upper()
    if action.nargs == 0:
        values = ""
    elif isinstance(values, tuple):
        values = " ".join(values)
    elif action.nargs in ("*", "+"):
        values += "..."
    elif isinstance(action.nargs, int):
        values = " ".join([values] * action.nargs)
    if not action.option_strings:
        return f"`{values}`".replace("|", "\\|")
    return ", ".join(f"`{option} {values}`" if values else f"`{option}`" for option in action.option_strings).replace(
        "|", "\\|"
    )


def _meaning(action: argparse.Action, parser: Parser) -> str:
    """Give the help of an argument in one line, without what a table or Markdown would take for its own."""
    values = {**vars(action), "prog": parser.prog}
    text = " ".join(((action.help or "") % values).split())
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*").replace("_", "\\_").replace("$", "\\$")


def section(command: str) -> str:
    """Describe one command."""
    parser, description = parser_of(command)
    summary = COMMANDS[command][1]
    parts = [f"### rsflow {command}", summary[:1].upper() + summary[1:] + ".", f"```text\n{description.strip()}\n```"]
    actions = [action for action in parser._actions if action.help != argparse.SUPPRESS and action.dest != "help"]
    rows = [f"| {_names(action)} | {_meaning(action, parser)} |" for action in actions]
    parts.append("\n".join(["| argument | meaning |", "|---|---|", *rows]))
    return "\n\n".join(parts)


def with_commands(page: str) -> str:
    """Give the page with all commands between its two lines."""
    begin, end = page.index(BEGIN) + len(BEGIN), page.index(END)
    made = "\n\n".join(section(command) for command in sorted(COMMANDS))
    return f"{page[:begin]}\n{made}\n\n{page[end:]}"


if __name__ == "__main__":
    PAGE.write_text(with_commands(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
