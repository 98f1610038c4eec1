"""Bad input at the command line: one line that says what, where, got and expected; an exit code; nothing half-made."""

from __future__ import annotations

import os
import re
import struct
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from rsflow.cli import main

SHARED = "-o out --rate 30 --height 0.2 --camera"

# Command, and what its one line on standard error must say. Exit code 1.
CASES: dict[str, tuple[str, str]] = {
    "missing video": ("extract missing.mp4 -o out", r"missing\.mp4: no such file or folder"),
    "empty video": ("extract empty.mp4 -o out", r"empty\.mp4: the file is empty"),
    "a video cut in its header": ("extract head.avi -o out", r"head\.avi \(200 bytes\): cannot be opened as a video"),
    "a folder without pictures": ("extract hollow -o out", r"hollow: the folder holds no picture"),
    "a file that is no picture": ("shift a.png text.png", r"text\.png: cannot be decoded as a picture"),
    "a missing picture": ("shift a.png missing.png", r"missing\.png: cannot be read: No such file"),
    "pictures of two sizes": ("shift a.png small.png", r"small\.png: got 80 x 50 pixels, expected 80 x 60 as a\.png"),
    "a window outside": ("shift a.png a.png --roi 70,0,60,60", r"roi: got .*expected a window inside of the frame"),
    "no board": ("calibrate pictures --board 9x6 --square 0.02", r"found in 0 of 4 pictures, expected at least 3"),
    "billion laughs": (f"velocity pictures {SHARED} laughs.yaml", r"laughs\.yaml: line 2: got a YAML alias"),
    "a python tag": (f"velocity pictures {SHARED} tag.yaml", r"tag\.yaml: line 1: not valid YAML.*python/object"),
    "broken YAML": (f"velocity pictures {SHARED} broken.yaml", r"broken\.yaml: line 2: not valid YAML"),
    "a matrix that lies": (f"velocity pictures {SHARED} lies.yml", r"lies\.yml: got a matrix of 3000000 x 3000000"),
    "a binary camera file": (f"velocity pictures {SHARED} binary.yaml", r"binary\.yaml: not a text file"),
    "a deep camera file": (f"velocity pictures {SHARED} deep.json", r"deep\.json: got YAML nested deeper than 20"),
    "no camera file": (f"velocity pictures {SHARED} keys.json", r"keys\.json: got the keys fx.*not a camera file"),
    "a missing camera file": (f"velocity pictures {SHARED} missing.yaml", r"missing\.yaml: No such file"),
    "a camera of another size": (f"velocity pictures {SHARED} camera.yaml", r"640 x 360.*80 x 60|80 x 60.*640 x 360"),
    "a camera without a height": ("extract pictures -o out --camera camera.yaml", r"a camera needs a height too"),
    "a height without a camera": ("extract pictures -o out --height 0.2", r"a height needs a camera too"),
    "a .flo that promises more": ("convert more.flo x.npy", r"says 1000000 x 1000000 .*but the file has 112"),
    "a .flo of negative size": ("convert negative.flo x.npy", r"says -4 x 5 pixels, expected at least 1 x 1"),
    "a .flo of another kind": ("convert magic.flo x.npy", r"not a \.flo file: starts with .*expected b'PIEH'"),
    "an array of objects": ("convert objects.npy x.flo", r"the array: got dtype .*, expected real numbers"),
    "an array of two dimensions": ("convert flat.npy x.flo", r"the array: got .*, expected \(height, width, 2\)"),
    "a camera that is not there": ("extract 97 -o out", r"camera 97: cannot be opened"),
    "a folder that cannot be made": ("extract pictures -o a.png", r"cannot make the folder a\.png: File exists"),
    "a folder under a file": ("segment pictures -o a.png/x", r"a\.png/x"),
    "a stride of nothing": ("extract pictures -o out --stride 0", r"stride: got 0, expected an integer of at least 1"),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> Path:
    """A folder of bad files, and a few good ones."""
    monkeypatch.chdir(tmp_path)
    picture = cv2.GaussianBlur(rng.integers(0, 256, (60, 80), np.uint8), (0, 0), 1.5)
    Path("pictures").mkdir()
    for number in range(4):
        cv2.imwrite(f"pictures/{number}.png", np.roll(picture, number, axis=1))
    cv2.imwrite("a.png", picture)
    cv2.imwrite("small.png", picture[:50])
    Path("hollow").mkdir()
    Path("text.png").write_text("hello")
    Path("empty.mp4").touch()
    Path("head.avi").write_bytes(b"RIFF\x00\x00\x10\x00AVI LIST" + bytes(184))
    chain = "".join(f"{c}: &{c} [{','.join(['*' + p] * 9)}]\n" for p, c in zip("abcdefgh", "bcdefghi", strict=True))
    Path("laughs.yaml").write_text("a: &a [x,x,x,x,x,x,x,x,x]\n" + chain)
    Path("tag.yaml").write_text("!!python/object/apply:os.system ['touch pwned']\n")
    Path("broken.yaml").write_text("image_width: [1, 2\n  x: {")
    Path("lies.yml").write_text(
        "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3000000\n   cols: 3000000\n"
        "   dt: d\n   data: [ 1. ]\n"
    )
    Path("binary.yaml").write_bytes(bytes(range(256)))
    Path("deep.json").write_text("[" * 100_000)
    Path("keys.json").write_text('{"fx": NaN, "fy": 1, "cx": 1, "cy": 1, "width": 80, "height": 60}')
    rsflow.Camera(500.0, 500.0, 319.5, 179.5, width=640, height=360).save("camera.yaml")
    for name, magic, size in (
        ("more", 202021.25, (1000000,) * 2),
        ("negative", 202021.25, (-4, 5)),
        ("magic", 1.0, (4, 5)),
    ):
        Path(f"{name}.flo").write_bytes(struct.pack("<fii", magic, *size) + bytes(100))
    head = b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }".ljust(117) + b"\n"
    Path("objects.npy").write_bytes(b"\x93NUMPY\x01\x00v\x00" + head + b"cos\nsystem\n(S'touch pwned'\ntR.")
    np.save("flat.npy", np.zeros((3, 4)))
    return tmp_path


@pytest.mark.parametrize("case", CASES)
def test_one_line_and_nothing_left(case: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command, says = CASES[case]
    before = sorted(folder.rglob("*"))
    assert main(command.split()) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"rsflow {command.split()[0]}: ")
    assert re.search(says, line), line
    assert "Traceback" not in line
    assert sorted(folder.rglob("*")) == before


def test_what_was_whole_of_a_source_that_breaks_off_is_kept_as_partial(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite("pictures/9.png", np.zeros((50, 80), np.uint8))
    assert main(["extract", "pictures", "-o", "out", "--no-videos"]) == 1
    (line,) = capfd.readouterr().err.splitlines()
    assert re.search(
        r"pictures of different sizes: .*got 80 x 50 pixels, expected 80 x 60 as .*; 4 frames are kept as \*\.partial",
        line,
    )
    assert all(".partial." in path.name for path in Path("out").iterdir())


@pytest.mark.parametrize(
    "command", ["extract pictures -o out", "flow pictures", "track pictures -o out", "segment pictures -o out"]
)
def test_pictures_of_one_pixel_are_measured_as_nothing(
    command: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for path in Path("pictures").iterdir():
        cv2.imwrite(str(path), np.full((1, 1), 7, np.uint8))
    assert main(command.split()) == 0
    out, err = capfd.readouterr()
    assert err == ""
    assert "nan %" not in out


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="/dev/full is of Linux")
@pytest.mark.parametrize("command", ["shift a.png a.png", "flow pictures", "shift a.png a.png --json"])
def test_output_that_cannot_be_printed(command: str, folder: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "rsflow", *command.split()],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert done.stderr == f"rsflow {command.split()[0]}: No space left on device\n"


LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.RLIM_INFINITY))
from rsflow.cli import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="RLIMIT_FSIZE is POSIX")
@pytest.mark.parametrize(
    "command",
    [
        "flow pictures -o out",
        "flow pictures --picture out.mp4",
        "segment pictures -o out",
        "track pictures -o out",
        "convert field.npy field.flo",
        "demo -o out --frames 12",
    ],
)
def test_a_full_disk_leaves_nothing_under_the_final_name(command: str, folder: Path) -> None:
    np.save("field.npy", np.zeros((60, 80, 2), np.float32))
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, *command.split()],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONWARNINGS": "error"},
    )
    assert done.returncode == 1, done.stderr
    (line,) = done.stderr.splitlines()
    assert re.match(rf"rsflow {command.split()[0]}: .*cannot write .*: ", line), line
    left = [path for name in ("out", "out.mp4", "field.flo") for path in [*Path(name).rglob("*"), Path(name)]]
    assert [path for path in left if path.is_file()] == []
