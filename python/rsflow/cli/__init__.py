"""The command line: ``rsflow COMMAND``. One file a command; see each for its options.

Exit codes: 0 done, 1 failed (one line on standard error says why), 2 wrong usage, 130 interrupted.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence

# Command -> (module with `DESCRIPTION`, `add_arguments(parser)` and `run(args) -> int`, one line of help).
COMMANDS: dict[str, tuple[str, str]] = {}


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line and name the help."""

    def error(self, message: str) -> None:  # type: ignore[override]
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def _overview() -> str:
    width = max((len(name) for name in COMMANDS), default=0)
    lines = "\n".join(f"  {name:<{width}}  {line}" for name, (_, line) in COMMANDS.items())
    return f"commands:\n{lines}\n\n'rsflow COMMAND --help' explains each, with examples."


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
    top = _Parser(
        prog="rsflow",
        description="Motion from picture sequences on a CPU: displacement, points, dense flow, velocity.",
        epilog=_overview(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        add_help=True,
    )
    from rsflow._core import __version__

    top.add_argument("--version", action="version", version=f"rsflow {__version__}")
    top.add_argument("command", choices=sorted(COMMANDS), metavar="COMMAND", help="one of the commands below")
    try:
        name = top.parse_args(arguments[:1]).command
        module = importlib.import_module(COMMANDS[name][0])
        parser = _Parser(
            prog=f"rsflow {name}",
            description=module.DESCRIPTION,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(parser)
        args = parser.parse_args(arguments[1:])
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else 2
    return _guarded(name, module.run, args)


def _guarded(name: str, run: object, args: argparse.Namespace) -> int:
    """Run a command; an expected failure is one line, without a traceback."""
    from rsflow.errors import RsflowError

    assert callable(run)
    try:
        return int(run(args) or 0)
    except BrokenPipeError:
        # The reader of our output went away, as `| head` does: not an error of ours.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print(f"rsflow {name}: interrupted", file=sys.stderr)
        return 130
    except (RsflowError, OSError) as error:
        if os.environ.get("RSFLOW_TRACEBACK"):
            raise
        print(f"rsflow {name}: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
