"""The command line where streams, encodings, names and folders are odd: no traceback, right exit codes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a POSIX shell starts them")

# What is done to the streams, and whether the command still ends as it would.
STREAMS = {
    "no stdout": (">&-", True),
    "no stderr": ("2>&-", True),
    "none at all": ("<&- >&- 2>&-", True),
    "a reader that went away": ("| true", False),
    "messages to a reader that went away": ("2>&1 | true", False),
}

COMMANDS = {
    "shift a.png b.png": 0,
    "shift a.png missing.png": 1,
    "shift a.png": 2,
    "extract pictures -o out-extract --no-videos --overwrite": 0,
    "shift --help": 0,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("streams")
    picture = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, (60, 80), np.uint8), (0, 0), 1.5)
    (folder / "pictures").mkdir()
    for number in range(3):
        cv2.imwrite(str(folder / "pictures" / f"{number}.png"), np.roll(picture, number, axis=1))
    cv2.imwrite(str(folder / "a.png"), picture)
    cv2.imwrite(str(folder / "b.png"), np.roll(picture, 1, axis=1))
    np.save(folder / "flow.npy", np.zeros((4, 5, 2), np.float32))
    return folder


def shell(command: str, streams: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[bytes]:
    line = f"set -o pipefail; {sys.executable} -W error -m rsflow {command} {streams}"
    return subprocess.run(
        ["bash", "-c", line],
        capture_output=True,
        cwd=folder,
        env={**os.environ, **environment},
        check=False,
        timeout=120,
    )


@pytest.mark.parametrize("streams", STREAMS)
@pytest.mark.parametrize("command", COMMANDS)
def test_closed_and_broken_streams(command: str, streams: str, folder: Path) -> None:
    redirection, same = STREAMS[streams]
    done = shell(command, redirection, folder)
    said = done.stdout + done.stderr
    assert b"Traceback" not in said
    assert b"internal error" not in said
    assert b"Exception ignored" not in said
    if same:
        assert done.returncode == COMMANDS[command], said
    else:
        assert done.returncode in (0, COMMANDS[command]), said


def test_a_closed_stream_is_not_taken_for_a_file(folder: Path) -> None:
    done = shell("convert flow.npy apart.npy", ">&- 2>&-", folder)
    assert done.returncode == 0
    assert np.load(folder / "apart.npy").shape == (4, 5, 2)


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
@pytest.mark.parametrize("name", ["größe-速度", "\udcff\udcfe"])
def test_names_that_an_encoding_cannot_say(name: str, encoding: str, folder: Path) -> None:
    source, out = folder / name, folder / f"out-{name}-{encoding}"
    source.mkdir(exist_ok=True)
    for picture in (folder / "pictures").iterdir():
        # OpenCV's own writer takes no such name.
        (source / picture.name).write_bytes(picture.read_bytes())
    commands = (
        "extract {0} -o {1} --no-videos",
        "track {0} -o {1}-t",
        "shift {0}/0.png {0}/9.png",
        "extract {0}9 -o {1}9",
    )
    for command, code in zip(commands, (0, 0, 1, 1), strict=True):
        words = command.format(source, out)
        done = subprocess.run(
            [os.fsencode(sys.executable), b"-W", b"error", b"-m", b"rsflow", *map(os.fsencode, words.split())],
            capture_output=True,
            cwd=folder,
            env={**os.environ, "PYTHONIOENCODING": encoding},
            check=False,
        )
        said = done.stdout + done.stderr
        assert b"Traceback" not in said, said
        assert b"internal error" not in said, said
        assert done.returncode == code, said


def test_a_home_that_is_not_there_and_a_folder_that_cannot_be_written(folder: Path, tmp_path: Path) -> None:
    nowhere = {"HOME": str(tmp_path / "nowhere"), "XDG_CACHE_HOME": "/proc/nowhere", "MPLCONFIGDIR": "/proc/nowhere"}
    done = shell("extract pictures -o homeless --no-videos", "", folder, **nowhere)
    assert done.returncode == 0, done.stderr
    done = shell("extract ../../pictures -o /proc/nowhere", "", folder, **nowhere)
    assert done.returncode == 1
    assert b"Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="/dev/full is of Linux")
@pytest.mark.parametrize("command", ["shift --help", "--version"])
def test_help_that_cannot_be_printed(command: str, folder: Path) -> None:
    done = shell(command, "> /dev/full", folder)
    assert done.returncode == 1
    assert b"Traceback" not in done.stderr
    assert done.stderr.endswith(b"No space left on device\n")
    assert len(done.stderr.splitlines()) == 1
