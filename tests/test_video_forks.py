"""Videos that are being read or written while the process forks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rsflow

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")

# In a process of its own, as a child that crashes or hangs would take the tests with it.
_PROGRAM = """
import faulthandler, os, sys, threading, time, warnings
import numpy as np, rsflow
warnings.simplefilter("ignore")
grey = np.zeros((48, 64), np.uint8)
def fork(what):
    child = os.fork()
    if child == 0:
        faulthandler.dump_traceback_later(15, exit=True)
        what()
        sys.exit(0)
    ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert ended == 0, ended
def refused(what):
    for _ in range(2):
        try:
            what()
        except rsflow.RsflowError as error:
            assert "fork" in str(error), error
        else:
            raise AssertionError("no error")
"""


def run(folder: Path, body: str) -> None:
    subprocess.run([sys.executable, "-c", _PROGRAM + body], cwd=folder, check=True, timeout=100)


def make(path: Path, frames: int = 30) -> None:
    with rsflow.VideoWriter(path, frame_rate=25) as video:
        for grey in range(frames):
            video.write(np.full((48, 64), 8 * grey, np.uint8))


def test_a_child_lets_a_video_of_its_parent_alone(tmp_path: Path) -> None:
    make(tmp_path / "clip.mp4")
    run(
        tmp_path,
        """
held = [rsflow.frames("clip.mp4")]
next(held[0])
fork(lambda: refused(lambda: next(held[0])))
fork(lambda: held[0].close())
fork(held.clear)
fork(lambda: None)
fork(lambda: [None for _ in rsflow.frames("clip.mp4")])
assert len(list(held[0])) == 29
""",
    )


@pytest.mark.parametrize("codec", ["h264", "vp9", "mp4v"])
@pytest.mark.parametrize("library", ["av", "cv2"])
def test_a_child_lets_a_writer_of_its_parent_alone(tmp_path: Path, codec: str, library: str) -> None:
    if library == "cv2" and codec == "h264":
        pytest.skip("OpenCV does not write it")
    run(
        tmp_path,
        f"""
from rsflow import video
if {library!r} == "cv2":
    video.sinks.av_encoder = lambda _: None
elif video.sinks.av_encoder({codec!r}) is None:
    sys.exit()
held = [rsflow.VideoWriter("made.mp4", frame_rate=25, codec={codec!r})]
for _ in range(5):
    held[0].write(grey)
fork(lambda: refused(lambda: held[0].write(grey)))
fork(lambda: refused(held[0].finish))
fork(lambda: held[0].discard())
fork(lambda: held[0].__exit__(None, None, None))
fork(held.clear)
fork(lambda: None)
held[0].write(grey)
held[0].finish()
assert len(list(rsflow.frames("made.mp4"))) == 6
assert os.listdir(".") == ["made.mp4"]
""",
    )


def test_a_child_forked_while_a_thread_opens_videos_does_not_hang(tmp_path: Path) -> None:
    make(tmp_path / "clip.mp4", frames=4)
    run(
        tmp_path,
        """
rsflow.frames("clip.mp4").close()
stop = threading.Event()
def opens():
    while not stop.is_set():
        rsflow.frames("clip.mp4").close()
threads = [threading.Thread(target=opens) for _ in range(2)]
for thread in threads:
    thread.start()
try:
    for _ in range(20):
        fork(lambda: [None for _ in rsflow.frames("clip.mp4")])
        time.sleep(0.02)
finally:
    stop.set()
    for thread in threads:
        thread.join()
""",
    )
