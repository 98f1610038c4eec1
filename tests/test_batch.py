"""The main job over many sources."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

import rsflow
from extraction_helpers import made_flight, names_in
from rsflow.batch import extract_many, folder_names
from rsflow.cli import main
from rsflow.errors import OptionError


@pytest.fixture(scope="module")
def flight():
    return made_flight()


# --- many sources ---------------------------------------------------------------------------------------------------


def test_folder_names():
    assert folder_names(["a/x.mp4", "b/x.mp4", "X.avi", 0, "rtsp://host/cam?id=1", "pics/*.png"]) == [
        "x", "x-2", "X-3", "camera-0", "cam-id-1", "source",
    ]  # fmt: skip


@pytest.fixture(scope="module")
def clips(flight, tmp_path_factory):
    import cv2

    folder = tmp_path_factory.mktemp("clips")
    for name in ("a", "b"):
        (folder / name).mkdir()
        for index, image in enumerate(flight.images[:4]):
            cv2.imwrite(str(folder / name / f"{index}.png"), image)
    return folder


def test_batch_over_processes_survives_a_bad_source(clips, tmp_path, capsys):
    arguments = [str(clips / "a"), str(clips / "none.mp4"), str(clips / "b")]
    assert main(["batch", *arguments, "-o", str(tmp_path), "--jobs", "2", "--rate", "30", "--no-videos"]) == 1
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert len(lines) == 4
    assert [line.split()[1] for line in lines[1:]] == ["done", "failed", "done"]
    assert "none.mp4" in err
    assert {"motion.csv", "report.html"} <= names_in(tmp_path / "a") & names_in(tmp_path / "b")
    assert not (tmp_path / "none").exists()


def test_batch_on_an_executor_of_the_caller(clips, tmp_path):
    seen = []
    with ThreadPoolExecutor(1) as pool:
        items = extract_many(
            [clips / "a", clips / "b"], tmp_path, executor=pool, on_done=seen.append, frame_rate=30, videos=False
        )
        assert pool.submit(int).result() == 0
    assert [item.status for item in items] == ["done", "done"]
    assert len(seen) == 2
    assert items[0].summary["frames"] == 4


def test_batch_refuses_wrong_options_at_once(tmp_path):
    with pytest.raises(OptionError, match="preset"):
        extract_many(["a.mp4"], tmp_path, preset="best")
    with pytest.raises(OptionError, match="sources: got none"):
        extract_many([], tmp_path)
    with pytest.raises(OptionError, match="jobs: got 0"):
        extract_many(["a.mp4"], tmp_path, jobs=0)


def test_runs_in_a_thread(flight, tmp_path):
    found = []
    worker = threading.Thread(
        target=lambda: found.append(rsflow.extract(list(flight.images[:3]), tmp_path, videos=False))
    )
    worker.start()
    worker.join()
    assert found[0].complete


def test_an_interrupted_batch_begins_no_more(clips, tmp_path, monkeypatch):
    from rsflow import batch

    real, calls = batch.wait, []

    def pressed_once(*arguments, **options):
        calls.append(1)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return real(*arguments, **options)

    monkeypatch.setattr(batch, "wait", pressed_once)
    items = extract_many([clips / "a", clips / "b", clips / "a"], tmp_path, jobs=1, frame_rate=30, videos=False)
    # What runs ends as it can, here to its end, since no signal reaches it; what waits is not begun.
    assert items[0].status in {"done", "cancelled"}
    assert [item.status for item in items[1:]] == ["cancelled", "cancelled"]
    assert all("not begun" in item.error for item in items[1:])
    assert not (tmp_path / "b").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="process groups are POSIX")
def test_ctrl_c_at_the_terminal_keeps_what_runs_beside_a_worker_that_waits(clips, tmp_path):
    """Every process of the group gets the signal: the one that is done and idle must not take the others with it."""
    long = tmp_path / "long"
    long.mkdir()
    pictures = sorted((clips / "a").iterdir())
    for number in range(600):
        (long / f"{number:04}.png").symlink_to(pictures[number % len(pictures)])
    command = [sys.executable, "-m", "rsflow", "batch", str(clips / "a"), str(long), "-o", str(tmp_path / "out")]
    process = subprocess.Popen(
        [*command, "--jobs", "2", "--rate", "30", "--no-videos"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    first = process.stderr.readline()
    assert "a: done" in first
    time.sleep(1.0)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert re.search(r"long: partial: interrupted after frame \d+", err), err
    assert re.search(r"long +partial", out), out
