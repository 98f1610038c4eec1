"""Messages in the words of the command line: options as they are typed, what was got and what is expected."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from typing import Any

__all__ = ["in_options", "usage_words"]

_KINDS = {"int": "a whole number", "float": "a number"}
# What names of arguments end in, where those of options do not.
_UNITS = {"m", "s", "px", "per", "hz", "rad", "deg", "size"}
# Arguments that the option says in another word.
_OTHERS = {"target": "mavlink", "acceleration_walk_m_s2": "filter"}


def usage_words(message: str) -> str:
    """Say what was got and what is expected where argparse says in its own words that a value is not valid.

    Examples
    --------
    >>> usage_words("argument --height: invalid float value: 'x'")
    "argument --height: got 'x', expected a number"
    >>> usage_words("argument --format: invalid choice: 'b' (choose from 'csv', 'npz')")
    "argument --format: got 'b', expected csv or npz"
    """
    if found := re.fullmatch(r"(argument .+): invalid (int|float) value: (.*)", message, re.DOTALL):
        return f"{found[1]}: got {found[3]}, expected {_KINDS[found[2]]}"
    if found := re.fullmatch(r"(argument .+): invalid choice: (.*) \(choose from (.*)\)", message, re.DOTALL):
        *most, last = (choice.strip("'\"") for choice in found[3].split(", "))
        return f"{found[1]}: got {found[2]}, expected {' or '.join([*([', '.join(most)] if most else []), last])}"
    return message


def in_options(message: str, parser: argparse.ArgumentParser, typed: Mapping[str, Any] | None = None) -> str:
    """Name options as they are typed where a message of the package begins with the name of an argument.

    A `path` is named after the option by which it was given; `typed` are the values by their names in the parser.

    Examples
    --------
    >>> parser = argparse.ArgumentParser()
    >>> _ = parser.add_argument("--scale", type=float)
    >>> in_options("scale_m_per_px: got -1.0, expected a positive number of metres, or None", parser)
    '--scale: got -1.0, expected a positive number of metres'
    >>> _ = parser.add_argument("-o", "--output")
    >>> in_options('path: got "x.doc", expected a name that ends in .flo', parser, {"output": "x.doc"})
    '--output: got "x.doc", expected a name that ends in .flo'
    """
    if file := re.match(r'path: got "(.*?)", ', message):
        given = [action for action in parser._actions if (typed or {}).get(action.dest) == file[1]]
        return f"{_typed_name(given[0])}{message[4:]}" if given else message
    found = re.match(r"([a-z]\w*(?:, [a-z]\w*)*): got ", message)
    if found is None:
        return message
    names = found[1].split(", ")
    options = [_option_of(name, parser) or name for name in names]
    if options == names:
        return message
    rest = re.sub(r",? or None$", "", message[found.end(1) :])
    # Another argument that goes with it, `camera=` say.
    rest = re.sub(r"\b([a-z]\w*)=(?=[\s,;:.]|$)", lambda other: _option_of(other[1], parser) or other[0], rest)
    return ", ".join(options) + rest


def _typed_name(action: argparse.Action) -> str:
    """Give the name under which the help has it: the long one, or of a value without a name what stands for it."""
    names = sorted(action.option_strings, key=len)
    return names[-1] if names else str(action.metavar or action.dest)


def _option_of(name: str, parser: argparse.ArgumentParser) -> str | None:
    """Give the option that a name of an argument is of, without its unit and in the singular."""
    options = {
        word.lstrip("-").replace("-", "_"): action.option_strings
        for action in parser._actions
        for word in action.option_strings
        if word.startswith("--")
    }
    words = _OTHERS.get(name, name).split("_")
    while True:
        typed = "_".join(words)
        for known in (typed, typed.removesuffix("s")):
            if known in options:
                return next(word for word in options[known] if word.startswith("--"))
        if len(words) == 1 or words[-1] not in _UNITS:
            return None
        words.pop()
