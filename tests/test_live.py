"""A live run: the tables of an extraction, gaps of a camera, frames that nobody is ready for, and every way to end."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import live, synthetic
from rsflow.capture.gaps import GapRule
from rsflow.cli import main
from rsflow.cli._live_lines import Lines, Status

CAMERA = rsflow.Camera(150.0, 150.0, 79.5, 59.5, width=160, height=120)


@pytest.fixture(scope="module")
def flight() -> synthetic.Flight:
    return synthetic.flight_with_object(CAMERA, frames=24, rate_hz=60.0, velocity_m_s=(0.06, 0.0, 0.0), seed=3)


@pytest.fixture(scope="module")
def pairs(flight):
    return [(frame.image, frame.t_s) for frame in flight]


@pytest.fixture(scope="module")
def clip(flight, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    with rsflow.VideoWriter(path, frame_rate=60) as video:
        for frame in flight:
            video.write(frame.image)
    return path


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_tables_of_a_file_are_those_of_an_extraction(pairs, tmp_path):
    options = {"camera": CAMERA, "height_m": 0.2, "height_std_m": 0.002}
    done = live.watch(pairs, out=tmp_path / "live", **options)
    rsflow.extract(pairs, tmp_path / "extract", videos=False, **options)
    assert (done.ended, done.frames, done.not_measured, done.gaps) == ("end", 24, 0, 0)
    assert set(done.files) == {"motion", "objects", "velocity"}
    for path in done.files.values():
        assert path.read_bytes() == (tmp_path / "extract" / path.name).read_bytes()
        assert path.parent == tmp_path / "live"
    assert len(rows(done.files["objects"])) > 10


def test_a_folder_of_another_run_is_left_alone(pairs, tmp_path):
    live.watch(pairs[:3], out=tmp_path, camera_motion="moving")
    live.watch(pairs[:3], out=tmp_path, camera_motion="moving")
    with pytest.raises(rsflow.OptionError, match="the result of another source"):
        live.watch(pairs[:4], out=tmp_path, camera_motion="moving")
    assert live.watch(pairs[:4], out=tmp_path, camera_motion="moving", overwrite=True).frames == 4


def test_it_ends_after_frames_or_seconds(pairs):
    assert live.watch(pairs, frames=5, camera_motion="moving").ended == "frames"

    def endless():
        for number in range(10**6):
            yield pairs[number % 24][0], float(number)

    begin = time.monotonic()
    done = live.watch(endless(), seconds=0.5, camera_motion="moving")
    assert (done.ended, done.frames > 1) == ("seconds", True)
    assert time.monotonic() - begin < 6.0


def test_an_error_in_a_callback_or_a_source_is_raised_and_what_is_measured_kept(pairs, tmp_path):
    def broken(frame):
        if frame.measured.frame.index == 5:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        live.watch(pairs, on_frame=broken, out=tmp_path / "a", camera_motion="moving")
    assert len(rows(tmp_path / "a" / "motion.partial.csv")) == 6

    def breaking():
        yield from pairs[:5]
        raise rsflow.CaptureError("it is gone")

    with pytest.raises(rsflow.CaptureError, match=r"it is gone; kept: .*motion\.csv"):
        live.watch(breaking(), out=tmp_path / "b", camera_motion="moving")
    assert len(rows(tmp_path / "b" / "motion.csv")) == 5
    # What is seen live is not the same another time.
    assert not [path for path in (tmp_path / "b").iterdir() if "working" in path.name]


def test_for_a_slow_reader_of_figures_frames_are_dropped_and_counted(pairs):
    """At 60 frames a second, with a program that takes 50 ms for each: the newest frame is measured, others are not."""
    slow = live.watch(
        pairs, real_time=True, camera_motion="moving", on_frame=lambda _: time.sleep(0.05), camera=CAMERA, height_m=0.2
    )
    assert slow.not_measured >= 5
    assert slow.frames + slow.not_measured <= 24


# --- gaps -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("times", "reopened", "gaps"),
    [
        ((0.0, 2.0, 4.0, 6.5), (), 0),
        ((0.0, 0.02, 0.3, 0.32, 1.4, 1.42), (), 1),
        ((0.0, 0.02, 0.3, 0.32), (2,), 1),
        ((0.0, 3.0), (0,), 0),
    ],
)
def test_when_there_is_a_gap(times, reopened, gaps):
    rule = GapRule()
    for number, t_s in enumerate(times):
        rule.take(t_s, reopened=number in reopened)
    assert rule.count == gaps


@pytest.mark.parametrize(("motion", "gap_s"), [("static", 0.6), ("moving", 0.6), ("moving", 30.0)])
def test_a_gap_is_none_of_the_motion_and_numbers_go_on_as_it_allows(motion, gap_s, monkeypatch):
    """A thing goes to the right at 90 px/s; the source is away for a while."""
    ground = synthetic.flight(CAMERA, frames=1, seed=5).images[0]
    patch = synthetic.flight(CAMERA, frames=1, seed=9).images[0][:24, :24] // 2 + 110
    times = [number / 30 for number in range(16)] + [15 / 30 + gap_s + number / 30 for number in range(8)]

    def picture(t_s):
        image = ground.copy()
        # Past a long gap it is at its place as well: another one, for all that is known.
        x = round(10 + 90 * (t_s if t_s < 1 or gap_s < 10 else t_s - gap_s + 0.6))
        image[40:64, x : x + 24] = patch
        return image

    found = []
    monkeypatch.setattr(
        rsflow.Frames, "gaps", property(lambda self: self._position > 16, lambda *_: None), raising=False
    )
    done = live.watch(
        [(picture(t_s), t_s) for t_s in times], camera_motion=motion, camera=CAMERA, height_m=0.2, on_frame=found.append
    )
    after = found[16]
    assert done.gaps == 1
    assert [frame.after_gap for frame in found] == [number == 16 for number in range(24)]
    assert after.reading is None
    assert after.measured.motion["status"] == "first_frame"
    assert after.measured.motion["dt_s"] == pytest.approx(gap_s + 0.0, abs=0.04)
    assert after.measured.velocity_row["status"] == "first_frame"
    # The camera stands still, and nothing else is said of the time when nothing was seen.
    velocities = [frame.reading.vx_m_s for frame in found if frame.reading is not None]
    np.testing.assert_allclose(velocities, 0.0, atol=2e-3)
    before = {thing.id for frame in found[10:16] for thing in frame.measured.segmentation.objects}
    last = {thing.id for thing in found[-1].measured.segmentation.objects}
    assert len(before) == len(last) == 1
    # Half a second on it is where it was to be; half a minute later nobody knows.
    assert (before == last) == (gap_s < 10)
    assert max(last) >= max(before)


class Stream:
    """A camera on the network (MJPEG over HTTP) that can be put away and brought back at the same address."""

    def __init__(self, images, port=0):
        outer = self
        self.away = threading.Event()
        self.given = 0

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                if outer.away.is_set():
                    self.send_error(503)
                    return
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                try:
                    while not outer.away.is_set():
                        data = cv2.imencode(".jpg", images[outer.given % len(images)])[1].tobytes()
                        head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                        self.wfile.write(head.encode() + data + b"\r\n")
                        outer.given += 1
                        time.sleep(0.02)
                except OSError:
                    pass

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self.server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self.server.server_port}/camera"
        threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()

    def close(self):
        self.away.set()
        self.server.shutdown()
        self.server.server_close()


def test_a_camera_on_the_network_goes_away_and_comes_back(flight, tmp_path):
    stream, seen = Stream(flight.images), []

    def on_frame(frame):
        seen.append(frame)
        if len(seen) == 8:
            stream.away.set()
            threading.Timer(0.7, stream.away.clear).start()

    try:
        done = live.watch(
            stream.url, frames=14, camera_motion="moving", out=tmp_path, on_frame=on_frame, timeout_s=20, reconnect_s=20
        )
    finally:
        stream.close()
    # On a busy machine there may be others.
    assert done.gaps >= 1
    assert max(frame.measured.motion["dt_s"] for frame in seen if frame.after_gap) > 0.5
    assert any("opened again" in note for note in done.notes)
    table = rows(done.files["motion"])
    assert [row["status"] for row in table].count("first_frame") == 1 + done.gaps
    assert math.isfinite(done.delay_p95_s)


def test_a_camera_that_stays_away_ends_the_run_and_keeps_the_tables(flight, tmp_path):
    stream = Stream(flight.images)
    try:
        with pytest.raises(rsflow.CaptureError, match=r"gave no frame for 0\.8 s after frame .*kept: .*motion\.csv"):
            live.watch(
                stream.url, camera_motion="moving", out=tmp_path, timeout_s=20, reconnect_s=0.8,
                on_frame=lambda frame: frame.measured.frame.index > 3 and stream.away.set(),
            )  # fmt: skip
    finally:
        stream.close()
    assert len(rows(tmp_path / "motion.csv")) > 3


# --- the command ----------------------------------------------------------------------------------------------------


def command(*arguments, **options):
    code = "import sys\nfrom rsflow.cli import main\nsys.exit(main(sys.argv[1:]))"
    return subprocess.Popen(
        [sys.executable, "-c", code, "live", *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options,
    )  # fmt: skip


def test_the_command_keeps_tables_and_prints_the_same_json_lines(clip, tmp_path, capsys):
    assert main(["live", str(clip), "-o", str(tmp_path / "out"), "--json"]) == 0
    out, err = capsys.readouterr()
    whole = [json.loads(line) for line in out.splitlines()]
    assert main(["live", str(clip), "--json"]) == 0
    light = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert whole == light
    assert len(whole) == 23
    assert err.splitlines()[0].startswith("24 frames in ")
    assert {path.name for path in (tmp_path / "out").glob("*.csv")} == {"motion.csv", "objects.csv"}


def test_ctrl_c_and_an_impatient_second_signal_leave_whole_tables(flight, tmp_path):
    stream = Stream(flight.images)
    try:
        run = command(stream.url, "-o", tmp_path / "out", "--json", "--camera-motion", "moving")
        lines = [run.stdout.readline() for _ in range(4)]
        run.send_signal(signal.SIGINT)
        run.send_signal(signal.SIGTERM)
        _out, err = run.communicate(timeout=30)
    finally:
        stream.close()
    assert run.returncode == 130, err
    assert err.splitlines()[-1] == "rsflow live: ended by Ctrl-C"
    table = rows(tmp_path / "out" / "motion.csv")
    assert len(table) >= 4
    assert json.loads(lines[0])["dx_px"] == pytest.approx(float(table[1]["dx_px"]), abs=1e-6)
    assert all(None not in row.values() for row in table)


def test_a_disk_that_is_full_for_the_tables_keeps_whole_rows(clip, tmp_path):
    limit = 3000
    run = command(
        clip, "-o", tmp_path / "out", "--camera-motion", "moving",
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )  # fmt: skip
    _out, err = run.communicate(timeout=30)
    assert run.returncode == 1
    assert "motion.csv" in err.splitlines()[-1] or "objects.csv" in err.splitlines()[-1]
    assert all(
        len(row) == len(rsflow.extraction.columns.MOTION) for row in rows(tmp_path / "out" / "motion.partial.csv")
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["7777"], ["camera 7777", "cannot be opened"]),
        (["nowhere.mp4", "--serve"], ["nowhere.mp4"]),
        (["nowhere.mp4", "--record", "a.mp4"], ["a.mp4", ".rrd"]),
    ],
)
def test_what_goes_wrong_is_said_in_a_line(arguments, words, capsys):
    assert main(["live", *arguments]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert all(word in line for word in words), line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--serve", "clip.mp4"], "stands before --serve"),
        (["--view", "--no-view"], "not allowed"),
        (["--window", "--serve"], "not allowed"),
        (["nowhere.mp4", "--record", "nowhere/a.rrd", "--view-rate", "0"], "--view-rate: got '0'"),
    ],
)
def test_wrong_usage(arguments, words, capsys):
    assert main(["live", *arguments]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("width", [40, 60, 80])
def test_lines_fit_the_terminal(pairs, width):
    readings = list(live.readings(pairs[:4], camera=CAMERA, height_m=0.2))
    lines = Lines(True, width)
    texts = [lines.header(), *(lines.line(reading) for reading in readings)]
    assert max(map(len, texts)) <= width
    assert all(text.endswith("ok") for text in texts[1:])
    assert f"{readings[0].vx_m_s:.4f}" in texts[1]
    seen = []
    live.watch(pairs[:4], camera=CAMERA, height_m=0.2, on_frame=seen.append, camera_motion="moving")
    status = Status.text(seen[-1], width)
    assert len(status) <= width
    assert status.startswith("frame 3  v +0.0")
    assert ("thing" in status) or width < 50


def test_the_status_says_that_a_camera_is_away():
    written = io.StringIO()
    status = Status(written)
    status.show(0.3, "camera 0")
    assert written.getvalue() == ""
    status.show(3.4, "camera 0")
    status.end()
    assert written.getvalue() == "\rcamera 0: no frame for 3 s, trying again\n"


def test_the_environment_says_whether_there_is_a_screen(monkeypatch):
    from rsflow.live.viewing.outputs import has_screen

    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert not has_screen()
    monkeypatch.setenv("DISPLAY", ":0")
    assert has_screen()
    assert os.environ["DISPLAY"] == ":0"
