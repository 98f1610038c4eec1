"""The command line: ``rsflow COMMAND``. One file a command; see each for its options.

Exit codes: 0 done, 1 failed (one line on standard error says why), 2 wrong usage, 130 interrupted.
"""

from __future__ import annotations

import argparse
import difflib
import importlib
import os
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from rsflow.cli._help import HelpFormatter
from rsflow.cli._options import settle_range
from rsflow.cli._streams import give_up_output, printable, usable_streams
from rsflow.cli._words import in_options, usage_words

# Command -> (module with `DESCRIPTION`, `add_arguments(parser)`, `run(args) -> int` and, where argparse does not do,
# `check(parser, args)`; one line of help).
COMMANDS: dict[str, tuple[str, str]] = {
    "batch": ("rsflow.cli.batch", "extract from many sources at once, on this machine or a cluster"),
    "bench": ("rsflow.cli.bench", "accuracy and time beside OpenCV, on scenes with exact truth"),
    "calibrate": ("rsflow.cli.calibrate", "a camera file from pictures of a chessboard or ChArUco board"),
    "convert": ("rsflow.cli.convert", "flow files and camera files from one format to another"),
    "demo": ("rsflow.cli.demo", "no input needed: make a flight, extract its motion, compare with the truth"),
    "doctor": ("rsflow.cli.doctor", "versions, processor, OpenCV wheels, extras, and a self-test with times"),
    "extract": ("rsflow.cli.extract", "the main job: tables, videos and a report page from one source"),
    "flow": ("rsflow.cli.flow", "where every pixel went, of two pictures or a whole sequence"),
    "grid": ("rsflow.cli.grid", "displacement, strain and vorticity on a grid: fluids (PIV) and materials (DIC)"),
    "live": ("rsflow.cli.live", "figures from a running camera: seen in a viewer, recorded, as tables or lines"),
    "reproduce": ("rsflow.cli.reproduce", "repeat the report's experiments, its tables beside what rsflow measures"),
    "segment": ("rsflow.cli.segment", "what moves and what stands still, with numbers for the things that move"),
    "shift": ("rsflow.cli.shift", "how far a window moved from one picture to the next"),
    "track": ("rsflow.cli.track", "points through a sequence: trails in a video, and a table"),
    "velocity": ("rsflow.cli.velocity", "how fast the camera travels over flat ground, in metres per second"),
}

# Shown first in the overview: where a newcomer begins.
_FIRST = ("demo", "extract")

_OVERVIEW = """\
first steps:
  rsflow demo                                  make a flight, extract, compare with the truth
  rsflow extract clip.mp4 -o out               tables, videos and out/report.html
  rsflow extract clip.mp4 -o out --camera cam.yaml --height 0.2      the same, with metres per second

commands:
{commands}

'rsflow COMMAND --help' explains each, with examples.
{exit_codes}
RSFLOW_TRACEBACK=1 shows where in the program an error arose."""


_EXIT_CODES = "exit codes: 0 done, 1 failed (one line says why), 2 wrong usage, 130 interrupted."


def suggestion(word: str, known: Iterable[str]) -> str:
    """Give ``; did you mean 'x'?`` for the nearest of `known`, or nothing."""
    nearest = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"; did you mean {nearest[0]!r}?" if nearest else ""


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, name the help and suggest the nearest option.

    What begins with a minus and a digit is a value, `-1mm/px` as well as `-1`: no option is written so.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print help or version; argparse passes over an error, after which nobody would know that nothing came."""
        if message:
            (file or sys.stderr).write(message)

    def error(self, message: str) -> NoReturn:
        """Print `message` as one line and leave with exit code 2."""
        message = usage_words(message)
        unknown = re.match(r"unrecognized arguments: (--[^\s=]+)", message)
        if unknown:
            # Without the dashes, which all have in common.
            known = {option.lstrip("-"): option for option in self._option_string_actions}
            message += suggestion(unknown[1].lstrip("-"), known).replace("mean '", "mean '--")
        self.exit(2, f"{self.prog}: {printable(message)} (see '{self.prog} --help')\n")


def _overview() -> str:
    names = [name for name in _FIRST if name in COMMANDS] + sorted(set(COMMANDS) - set(_FIRST))
    width = max((len(name) for name in names), default=0)
    commands = "\n".join(f"  {name:<{width}}  {COMMANDS[name][1]}" for name in names)
    return _OVERVIEW.format(commands=commands, exit_codes=_EXIT_CODES)


def _top_parser() -> Parser:
    from rsflow._core import __version__

    top = Parser(
        prog="rsflow",
        usage="rsflow COMMAND [options]",
        description="Motion from picture sequences on a CPU: displacement, points, dense flow, velocity, "
        "what moves and what stands still.",
        epilog=_overview(),
        formatter_class=HelpFormatter,
        allow_abbrev=False,
    )
    top.add_argument("--version", action="version", version=f"rsflow {__version__}")
    top.add_argument("command", metavar="COMMAND", nargs="?", help=argparse.SUPPRESS)
    return top


def _parsed(arguments: list[str]) -> tuple[Parser, Callable[[argparse.Namespace], int | None], argparse.Namespace]:
    """Find the command, import it alone, and parse its arguments."""
    top = _top_parser()
    if arguments[:1] == ["help"]:
        arguments = [*arguments[1:2], "--help"]
    name = top.parse_args(arguments[:1]).command
    if name is None:
        top.error(f"a command is needed: {', '.join(sorted(COMMANDS))}")
    if name not in COMMANDS:
        top.error(f"there is no command {name!r}{suggestion(name, COMMANDS)}")
    module = importlib.import_module(COMMANDS[name][0])
    parser = Parser(
        prog=f"rsflow {name}",
        description=module.DESCRIPTION,
        # Where a command's codes mean no more than all others', they are said here.
        epilog=None if "exit code" in module.DESCRIPTION.lower() else _EXIT_CODES,
        formatter_class=HelpFormatter,
        allow_abbrev=False,
    )
    module.add_arguments(parser)
    for argument in arguments[1:]:
        option, equals, value = argument.partition("=")
        if option.startswith("--") and equals and value == "--":
            # argparse makes an empty list of it.
            parser.error(f"argument {option}: got '--', expected a value")
    args = parser.parse_args(arguments[1:])
    for action in parser._actions:
        if action.option_strings and getattr(args, action.dest, None) == "":
            # As a path it would be the folder one happens to be in.
            parser.error(f"argument {action.option_strings[-1]}: got '', expected a value")
    settle_range(args)
    if hasattr(module, "check"):
        # What argparse cannot say: which arguments go with which.
        module.check(parser, args)
    return parser, module.run, args


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments after the program's name; by default those of the process.

    Returns
    -------
    int
        0 done, 1 failed, 2 wrong usage, 130 interrupted.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    with usable_streams():
        return _guarded(arguments)


def _guarded(arguments: list[str]) -> int:
    """Run a command; an expected failure is one line, without a traceback."""
    from rsflow.errors import RsflowError

    name, parser, typed = "rsflow", None, {}
    try:
        try:
            parser, run, args = _parsed(arguments)
            name, typed = parser.prog, vars(args)
            code = int(run(args) or 0)
        except SystemExit as stop:
            code = 0 if stop.code is None else stop.code if isinstance(stop.code, int) else 2
        # What is still buffered must fail here, where it is told, not in the interpreter's shutdown.
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # The reader of our output went away, as `| head` does: not an error of ours.
        give_up_output()
        return 0
    except KeyboardInterrupt as stop:
        return _told(name, stop, 130, str(stop) or "interrupted")
    except (RsflowError, OSError) as error:
        words = _words(error)
        return _told(name, error, 1, in_options(words, parser, typed) if parser else words)
    except MemoryError as error:
        return _told(name, error, 1, f"out of memory{f': {error}' if str(error) else ''}")
    except Exception as error:
        why = f"{type(error).__name__}: {error} (a fault of rsflow; RSFLOW_TRACEBACK=1 shows where)"
        return _told(name, error, 1, f"internal error, {why}")


def _told(name: str, error: BaseException, code: int, words: str) -> int:
    """Print one line on standard error, or on the user's wish the whole way to it, and give the exit code."""
    if os.environ.get("RSFLOW_TRACEBACK") and code == 1:
        raise error
    print(f"{name}: {printable(words)}", file=sys.stderr, flush=True)
    if isinstance(error, OSError):
        # Standard output itself may be what failed; what it still holds would fail again.
        try:
            sys.stdout.flush()
        except (OSError, ValueError):
            give_up_output()
    return code


def _words(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        place = Path(str(error.filename or ""))
        if ".working-" in place.name:
            # The names of hidden files tell nobody anything.
            return f"cannot write into the folder {place.parent}: {error.strerror}"
        # Without the number: "[Errno 28] ..." says less than the words do.
        return error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"
    return str(error)
