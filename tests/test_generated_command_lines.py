"""Every command with odd values for every argument and option: the right exit code, and one line that says why."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from rsflow.cli import COMMANDS, Parser, main

VALUES = [
    "", "0", "-1", "1", "2.9", "nan", "inf", "-inf", "1e300", "1e-300", f"{10**30}", "none", "True",
    "1,2", "1,2,3,4", "-1,-2,3,4", "a,b,c,d", "8x6", "0x0", "x", "../x", ".", "nowhere/nothing.png", "latin1.txt",
    "picture.png", "pictures", "*.nothing", "file://x",
    "\udcff", "größe", "a\nb", "x" * 300, "--", "--nothing", "-", "%s", "{}", "~",
]  # fmt: skip

# A line of arguments with which the command gets as far as to look at its options, but not to work for seconds: what
# it reads is not there, or is no clip.
LINES: dict[str, str] = {
    "batch": "nowhere.mp4 -o out --jobs 1",
    "bench": "--quick --rounds 0",
    "calibrate": "nowhere --board 8x6 --square 0.02",
    "convert": "nowhere.flo out.npy",
    "demo": "--frames 0 -o out",
    "doctor": "",
    "extract": "nowhere.mp4 -o out",
    "flow": "picture.png picture.png",
    "grid": "nowhere.mp4 -o out",
    "live": "nowhere.mp4",
    "reproduce": "--photographs nowhere",
    "segment": "nowhere.mp4 -o out",
    "shift": "picture.png picture.png",
    "track": "nowhere.mp4 -o out",
    "velocity": "nowhere.mp4 --camera camera.json --height 0.2",
}

# Commands that measure this machine or make their own input: what they take of odd values would run for seconds.
LONG = {"bench", "demo", "doctor", "reproduce", "batch"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("picture.png", np.random.default_rng(1).integers(0, 256, (24, 32), np.uint8))
    Path("pictures").mkdir()
    Path("latin1.txt").write_bytes("Höhe\n".encode("latin-1"))
    rsflow.Camera(40.0, 40.0, 15.5, 11.5, width=32, height=24).save("camera.json")
    return tmp_path


def actions(command: str) -> list[argparse.Action]:
    parser = Parser(prog=command)
    importlib.import_module(COMMANDS[command][0]).add_arguments(parser)
    return [action for action in parser._actions if not isinstance(action, argparse._HelpAction)]


def lines(command: str) -> list[list[str]]:
    """Give the command's line with each value in the place of each positional argument, and behind each option."""
    base = LINES[command].split()
    found = []
    for action in actions(command):
        for value in VALUES:
            if action.option_strings:
                name = action.option_strings[-1]
                found.append([*base, f"{name}={value}"] if name.startswith("--") else [*base, name, value])
            else:
                found.append([value, *base[1:]])
    return found


def test_every_command_has_a_line() -> None:
    assert set(LINES) == set(COMMANDS), "add a line of arguments for the new command to LINES"


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_odd_values_end_in_an_exit_code_and_one_line(
    command: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    wrong, calls = [], 0
    for arguments in lines(command):
        if command in LONG and not any(bad in arguments[-1] for bad in ("=nan", "=x", "=a,b", "=", "--nothing")):
            continue
        calls += 1
        code = main([command, *arguments])
        out, err = capfd.readouterr()
        fault = ""
        if code not in (0, 1, 2):
            fault = f"exit code {code}"
        elif "Traceback" in out + err or "internal error" in err:
            fault = "a fault of rsflow"
        elif code == 2 and len(err.splitlines()) != 1:
            fault = f"{len(err.splitlines())} lines of wrong usage"
        elif code == 1 and not 1 <= len(err.splitlines()) <= 2 and not out:
            fault = f"{len(err.splitlines())} lines of failure"
        if fault:
            wrong.append(f"{arguments}: {fault}: {err[-300:]!r}")
    print(f"{calls} command lines")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_an_option_that_is_not_there_is_wrong_usage(command: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--no-such-option"]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert "--no-such-option" in line or "required" in line
