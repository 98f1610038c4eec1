"""The main job when it ends early: what is kept, how it is named, what is said."""

import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

import rsflow
from extraction_helpers import FILES, made_flight, names_in, partials, rows_of
from rsflow.cli import main
from rsflow.errors import CaptureError


@pytest.fixture(scope="module")
def flight():
    return made_flight()


# --- early ends -----------------------------------------------------------------------------------------------------


def broken_after(images, count, error):
    yield from images[:count]
    raise error


def test_a_source_that_breaks_off_keeps_what_was_measured(flight, tmp_path):
    source = broken_after(list(flight.images), 7, CaptureError("camera 3: went away"))
    with pytest.raises(
        rsflow.PartialExtractionError, match=r"camera 3: went away; 7 frames are kept as \*\.partial\.\*"
    ) as caught:
        rsflow.extract(source, tmp_path)
    kept = caught.value.extraction
    assert isinstance(caught.value.__cause__, CaptureError)
    assert not kept.complete
    assert names_in(tmp_path) == partials(FILES)
    assert len(rows_of(tmp_path / "motion.partial.csv")) == 7
    for name in ("flow", "moving", "static"):
        with rsflow.frames(tmp_path / f"{name}.partial.mp4") as stream:
            assert len(list(stream)) == 7
    report = (tmp_path / "report.partial.html").read_text()
    assert "partial: the run ended early" in report
    assert "camera 3: went away" in report
    assert json.loads((tmp_path / "summary.partial.json").read_text())["complete"] is False


def test_pictures_of_different_sizes_break_off(flight, tmp_path):
    images = [*flight.images[:3], flight.images[3][:-2]]
    with pytest.raises(rsflow.PartialExtractionError, match=r"different sizes.*3 frames are kept"):
        rsflow.extract(images, tmp_path, videos=False)


def test_a_truncated_video_breaks_off(flight, tmp_path):
    whole = tmp_path / "whole.mp4"
    with rsflow.VideoWriter(whole, frame_rate=30) as video:
        for image in flight.images:
            video.write(image)
    data = whole.read_bytes()
    (tmp_path / "cut.mp4").write_bytes(data[: len(data) * 2 // 3])
    assert main(["extract", str(tmp_path / "cut.mp4"), "-o", str(tmp_path / "out"), "-q"]) == 1
    left = names_in(tmp_path / "out") if (tmp_path / "out").exists() else set()
    assert left in (set(), partials(FILES))


def test_a_fault_in_a_callback_keeps_what_was_measured(flight, tmp_path):
    def fail(measured):
        if measured.frame.index == 14:
            raise ValueError("of the caller")

    with pytest.raises(rsflow.PartialExtractionError, match="ValueError: of the caller"):
        rsflow.extract(list(flight.images), tmp_path, videos=False, on_frame=fail)
    assert "motion.partial.csv" in names_in(tmp_path)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_keeps_what_is_finished_and_says_how_to_go_on(flight, tmp_path, number):
    before = signal.getsignal(number)

    def pressed():
        for index, image in enumerate(flight.images):
            if index == 13:
                os.kill(os.getpid(), number)
            yield image, index / 30

    with pytest.raises(
        rsflow.ExtractionInterrupted, match=r"interrupted after frame 13; 14 frames .*--start 13"
    ) as caught:
        rsflow.extract(pressed(), tmp_path)
    assert signal.getsignal(number) is before
    assert isinstance(caught.value, KeyboardInterrupt)
    assert names_in(tmp_path) == partials(FILES)
    assert caught.value.extraction.summary["next_start"] == 13
    assert "--start 13" in (tmp_path / "report.partial.html").read_text()
    # Going on there measures every pair once: the first row of the rest is the last of the part, without a motion.
    rest = rsflow.extract(list(flight.images), tmp_path / "rest", start=13, frame_rate=30, videos=False)
    part = rows_of(tmp_path / "motion.partial.csv") + rows_of(rest.files["motion"])[1:]
    assert [int(row["frame"]) for row in part] == list(range(16))


def test_a_complete_run_replaces_the_partial_files(flight, tmp_path):
    with pytest.raises(rsflow.PartialExtractionError):
        rsflow.extract(broken_after(list(flight.images), 3, CaptureError("x")), tmp_path)
    rsflow.extract(list(flight.images[:4]), tmp_path, overwrite=True)
    assert names_in(tmp_path) == FILES


def test_an_early_end_leaves_an_earlier_result_alone(flight, tmp_path):
    rsflow.extract(list(flight.images[:4]), tmp_path, videos=False)
    before = (tmp_path / "motion.csv").read_bytes()
    with pytest.raises(rsflow.PartialExtractionError):
        rsflow.extract(broken_after(list(flight.images), 3, CaptureError("x")), tmp_path, videos=False, overwrite=True)
    assert (tmp_path / "motion.csv").read_bytes() == before


def test_command_interrupted_is_130_with_one_line(flight, tmp_path):
    np.save(tmp_path / "images.npy", flight.images)
    code = (
        "import sys, os, signal, numpy as np\n"
        "import rsflow.capture.opening as capture\n"
        "real = capture.frames\n"
        "images = np.load(sys.argv[1])\n"
        "def pressed():\n"
        "    for index, image in enumerate(images):\n"
        "        if index == 6: os.kill(os.getpid(), signal.SIGINT)\n"
        "        yield image\n"
        "capture.frames = lambda source, **options: real(pressed(), **options)\n"
        "from rsflow.cli import main\n"
        "sys.exit(main(['extract', 'x', '-o', sys.argv[2], '--json', '--rate', '30']))\n"
    )
    out = tmp_path / "out"
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "images.npy"), str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 130
    assert len(done.stderr.splitlines()) == 1
    assert "interrupted after frame 6; 7 frames are kept" in done.stderr
    assert json.loads(done.stdout)["next_start"] == 6
    assert names_in(out) == partials(FILES)


# A limit on the size of files acts as a full disk does: a write fails in the middle of a run.
FULL_DISK = """
import resource, sys, numpy as np
from rsflow.cli import main
import rsflow.capture.opening as capture
real = capture.frames
images = np.load(sys.argv[1])
capture.frames = lambda source, **options: real(list(images) * 6, **options)
import cv2, rsflow
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), resource.RLIM_INFINITY))
sys.exit(main(["extract", "x", "-o", sys.argv[2], "--rate", "30", *sys.argv[4:]]))
"""


@pytest.mark.parametrize(("limit", "options"), [(3000, ["--no-videos"]), (40_000, []), (10, [])])
def test_a_full_disk_is_one_line_and_keeps_what_fits(flight, tmp_path, limit, options):
    np.save(tmp_path / "images.npy", flight.images)
    out = tmp_path / "out"
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(tmp_path / "images.npy"), str(out), str(limit), *options],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "File too large" in done.stderr
    left = names_in(out) if out.exists() else set()
    assert all(".partial." in name and not name.startswith(".") for name in left), left
    if limit == 3000:
        assert "motion.partial.csv" in left
        rows = rows_of(out / "motion.partial.csv")
        assert 5 < len(rows) < 96
        assert [int(row["frame"]) for row in rows] == list(range(len(rows)))
        assert all(row["segmentation_status"] for row in rows)


def test_a_video_that_is_cut_anywhere_is_whole_or_an_error(flight, tmp_path):
    # Pictures whose references are cut off leave pauses, and what came before those is not the end.
    whole, cut = tmp_path / "whole.mp4", tmp_path / "cut.mp4"
    with rsflow.VideoWriter(whole, frame_rate=30) as video:
        for image in flight.images:
            video.write(image)
    data = whole.read_bytes()
    broken = 0
    for percent in range(40, 100, 2):
        cut.write_bytes(data[: len(data) * percent // 100])
        try:
            with rsflow.frames(cut) as stream:
                assert len(list(stream)) == len(flight.images)
        except rsflow.CaptureError:
            broken += 1
    assert broken >= 20
