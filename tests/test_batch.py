"""The main job over many sources."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

import pytest

import rsflow
from extraction_helpers import made_flight, names_in
from rsflow.batch import extract_many, folder_names
from rsflow.batch.stop import StopWish, stoppable
from rsflow.batch.workers import Workers
from rsflow.cli import main
from rsflow.errors import OptionError
from rsflow.extraction.stopping import StopRequest


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
    assert len(lines) == 5
    assert [line.split()[1] for line in lines[1:4]] == ["done", "failed", "done"]
    assert lines[4] == f"look at {tmp_path}/index.html"
    assert "none.mp4" in err
    assert {"motion.csv", "report.html"} <= names_in(tmp_path / "a") & names_in(tmp_path / "b")
    assert not (tmp_path / "none").exists()


def test_a_folder_that_cannot_be_made_is_told_before_anything_is_measured(clips, tmp_path, capsys):
    (tmp_path / "file").touch()
    assert main(["batch", str(clips / "a"), "-o", str(tmp_path / "file" / "out"), "--rate", "30"]) == 1
    out, err = capsys.readouterr()
    assert err == f"rsflow batch: cannot make the folder {tmp_path}/file/out: Not a directory\n"
    assert out == ""


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


def test_at_a_signal_a_caller_s_executor_is_waited_for_and_begins_no_more(clips, tmp_path):
    handler = signal.getsignal(signal.SIGINT)
    sources = [clips / "a", clips / "b", clips / "a", clips / "b"]
    options = {"frame_rate": 30, "videos": False}
    with ThreadPoolExecutor(1) as pool:
        items = extract_many(
            sources, tmp_path, executor=pool, on_done=lambda _: signal.raise_signal(signal.SIGINT), **options
        )
    assert items[0].status == "done"
    # The second one may have been begun before the first was seen to end.
    assert [item.status for item in items[2:]] == ["cancelled", "cancelled"]
    assert all("not begun" in item.error for item in items[2:])
    assert signal.getsignal(signal.SIGINT) is handler


def test_a_second_signal_leaves_a_caller_s_executor(clips, tmp_path):
    def pressed_twice(_):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    with ThreadPoolExecutor(1) as pool, pytest.raises(KeyboardInterrupt):
        extract_many(
            [clips / "a", clips / "b", clips / "a"],
            tmp_path,
            executor=pool,
            on_done=pressed_twice,
            frame_rate=30,
            videos=False,
        )


def test_an_error_of_the_caller_stops_what_runs(clips, tmp_path, long):
    def fails(_):
        raise ZeroDivisionError

    begin = time.monotonic()
    with pytest.raises(ZeroDivisionError):
        extract_many([clips / "none.mp4", long], tmp_path, jobs=2, on_done=fails, frame_rate=30, videos=False)
    assert time.monotonic() - begin < 20
    assert not (tmp_path / "long" / "motion.csv").exists()


@pytest.fixture
def long(clips, tmp_path):
    """A source that takes longer than any test waits: thousands of frames."""
    folder = tmp_path / "source" / "long"
    folder.mkdir(parents=True)
    pictures = sorted((clips / "a").iterdir())
    for number in range(6000):
        (folder / f"{number:04}.png").symlink_to(pictures[number % len(pictures)])
    return folder


@pytest.mark.skipif(sys.platform == "win32", reason="process groups are POSIX")
@pytest.mark.parametrize(
    ("send", "number"),
    [(os.killpg, signal.SIGINT), (os.kill, signal.SIGINT), (os.kill, signal.SIGTERM)],
    ids=["Ctrl-C at the terminal", "SIGINT to the parent alone", "SIGTERM to the parent alone"],
)
def test_a_signal_ends_a_batch_soon_and_keeps_what_is_finished(clips, tmp_path, long, send, number):
    """At the terminal every process of the group gets it: a worker that is idle must not take the others with it."""
    out_folder = tmp_path / "out"
    sources = [clips / "a", long, f"{long}/*.png", clips / "b"]
    command = [sys.executable, "-m", "rsflow", "batch"]
    process = subprocess.Popen(
        [*command, *sources, "-o", out_folder, "--jobs", "2", "--rate", "30", "--no-videos"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert "a: done" in process.stderr.readline()
    for name in ("long", "source"):
        until_measured(out_folder / name)
    send(process.pid, number)
    begin = time.monotonic()
    out, err = process.communicate(timeout=60)
    assert time.monotonic() - begin < 10
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert "rsflow batch: interrupted: of 4 sources 1 done, 2 partial, 1 cancelled" in err
    assert re.search(r"long: partial: interrupted after frame \d+; \d+ frames are kept", err), err
    assert re.search(r"long +partial", out), out
    for name in ("long", "source"):
        kept = names_in(out_folder / name)
        assert "motion.partial.csv" in kept
        assert all(".partial." in file and not file.startswith(".") for file in kept), kept
    assert names_in(out_folder) == {"a", "long", "source", "index.html"}


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="finds the worker in /proc")
def test_a_worker_that_is_killed_fails_its_own_source_alone(clips, tmp_path, long):
    """As the system does where memory runs out."""
    sources = [str(long), str(clips / "a"), str(clips / "none.mp4"), str(clips / "b")]
    items = []

    def kill_the_others(item):
        items.append(item)
        if item.folder.name == "a":
            # Only the worker of the long source is at work.
            until_measured(tmp_path / "out" / "long")
            for child in Path("/proc/self/task").joinpath(str(os.getpid()), "children").read_text().split():
                names = {path.name for path in (tmp_path / "out" / "long").glob(f".*working-{child}-*")}
                if names:
                    os.kill(int(child), signal.SIGKILL)

    extract_many(sources, tmp_path / "out", jobs=2, on_done=kill_the_others, frame_rate=30, videos=False)
    status = {item.folder.name: item.status for item in items}
    assert status == {"long": "failed", "a": "done", "none": "failed", "b": "done"}
    assert "the worker ended" in next(item.error for item in items if item.folder.name == "long")
    # Where the killed one got as far as a checkpoint, that is kept.
    assert names_in(tmp_path / "out") - {"long"} == {"a", "b", "index.html"}
    assert all((run / "checkpoint.npz").exists() for run in (tmp_path / "out").glob("long/.*"))


def test_a_process_that_dies_is_replaced():
    context = get_context("spawn")
    with Workers(context, StopWish(context).watch) as workers:
        other = workers.submit(time.sleep, 0.5)
        with pytest.raises(BrokenProcessPool):
            workers.submit(os._exit, 1).result(timeout=30)
        assert workers.submit(abs, -3).result(timeout=30) == 3
        other.result(timeout=30)
        # What is idle is used again.
        pids = {workers.submit(os.getpid).result(timeout=30) for _ in range(4)}
        assert len(pids) == 1


def work_until_interrupted(begun):
    """Stand in for a job that does not look at the wish to stop."""
    with stoppable(), StopRequest() as stop:
        begun.touch()
        try:
            while True:
                time.sleep(0.01)
        except KeyboardInterrupt:
            return stop.count


def test_the_second_wish_ends_a_job_at_once(tmp_path):
    context = get_context("spawn")
    wish = StopWish(context)
    begun = tmp_path / "begun"
    with Workers(context, wish.watch) as pool:
        job = pool.submit(work_until_interrupted, begun)
        until_there(begun)
        wish.ask()
        with pytest.raises(TimeoutError):
            job.result(timeout=0.5)
        wish.ask(2)
        assert job.result(timeout=10) >= 2
        # What comes too late is not begun.
        with pytest.raises(KeyboardInterrupt):
            pool.submit(work_until_interrupted, begun).result(timeout=10)


def until_there(path):
    end = time.monotonic() + 30
    while not path.exists():
        assert time.monotonic() < end, f"{path} did not come"
        time.sleep(0.01)


def until_measured(folder):
    """Wait until some frames of the source of `folder` are in its table."""
    end = time.monotonic() + 60
    while not any(table.stat().st_size > 2000 for table in folder.glob(".run.working-*/motion.csv")):
        assert time.monotonic() < end, f"{folder} has no table"
        time.sleep(0.01)


@pytest.mark.skipif(sys.platform == "win32", reason="kills as POSIX does")
def test_workers_end_when_their_parent_is_killed(tmp_path, long):
    process = subprocess.Popen(
        [sys.executable, "-m", "rsflow", "batch", long, "-o", tmp_path / "out", "--rate", "30", "--no-videos"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    folder = tmp_path / "out" / "long"
    until_measured(folder)
    process.kill()
    # The pipe ends when the last process that writes to it has ended.
    _, err = process.communicate(timeout=30)
    # Its locks are removed, and not said to have leaked.
    assert b"resource_tracker" not in err
    kept = names_in(folder)
    assert "motion.partial.csv" in kept
    assert all(".partial." in file and not file.startswith(".") for file in kept), kept
