"""What a live run shows: recordings read back against the figures, and seen in a real browser."""

from __future__ import annotations

import functools
import math
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np
import pytest

import rsflow
from browser import opened_browser
from rsflow import live, synthetic

pytest.importorskip("rerun", reason="the viewer is not installed (extra viewer)")

from rsflow.live.viewing import outputs

CAMERA = rsflow.Camera(150.0, 150.0, 79.5, 59.5, width=160, height=120)
SETTLED = {"camera_motion": "moving", "camera": CAMERA, "height_m": 0.2, "height_std_m": 0.002}


@pytest.fixture(scope="module")
def flight() -> synthetic.Flight:
    return synthetic.flight_with_object(CAMERA, frames=24, velocity_m_s=(0.04, 0.0, 0.0), seed=3)


@pytest.fixture(scope="module")
def recorded(flight, tmp_path_factory):
    """A recording, and the figures that it is of."""
    folder, seen = tmp_path_factory.mktemp("recorded"), []
    done = live.watch(flight, record=folder / "run.rrd", out=folder, on_frame=seen.append, **SETTLED)
    assert done.files["recording"] == folder / "run.rrd"
    return done, seen


def read(path):
    """Rows of each entity of a recording, in the order of the frames, without what is static."""
    from rerun.chunk import RrdReader

    tables: dict[str, list[dict]] = {}
    for chunk in RrdReader(path).stream():
        if not chunk.is_static:
            tables.setdefault(chunk.entity_path.strip("/"), []).extend(chunk.to_record_batch().to_pylist())
    return {entity: sorted(rows, key=lambda row: row.get("frame", -1)) for entity, rows in tables.items()}


def frames_of(rows):
    return [row["frame"] for row in rows]


def component(row, name):
    """Give a component of a row, as the list that it is."""
    (key,) = [key for key in row if key.endswith(f":{name}")]
    return row[key]


def test_a_recording_has_the_figures_of_every_frame(recorded):
    done, seen = recorded
    tables = read(done.files["recording"])
    times = np.array([frame.measured.frame.t_s for frame in seen])

    def plotted(entity):
        rows = tables[entity]
        assert frames_of(rows) == list(range(24)), entity
        np.testing.assert_allclose([row["t_s"].total_seconds() for row in rows], times, atol=1e-5)
        return np.array([component(row, "scalars") for row in rows], np.float64)

    for entity, name in (("velocity/vx_m_s", "vx"), ("velocity/vz_m_s", "vz"), ("displacement/dy_px", "dy")):
        values = plotted(entity)
        source = [frame.measured.velocity_row if name[0] == "v" else frame.measured.motion for frame in seen]
        unit = "m_s" if name[0] == "v" else "px"
        middle = np.array([row[f"{name}_{unit}"] for row in source])
        std = np.array([row[f"{name}_std_{unit}"] for row in source])
        std[~np.isfinite(std)] = math.nan
        # Of the first frame nothing is known: a gap in the line.
        assert np.isnan(values[0]).all() or name == "dy"
        np.testing.assert_allclose(values, np.stack([middle, middle - std, middle + std], axis=1), rtol=1e-12)
    brightness = plotted("light/brightness")[:, 0]
    np.testing.assert_allclose(brightness, [frame.measured.frame.image.mean() for frame in seen], atol=2.0)
    np.testing.assert_array_equal(plotted("light/gain")[:, 0], [frame.measured.motion["gain"] for frame in seen])
    np.testing.assert_array_equal(plotted("things/count")[1:, 0], [f.measured.motion["objects"] for f in seen[1:]])
    # A file is not waited for: nothing is late.
    assert np.isnan(plotted("timing/delay_ms")).all()


def test_a_recording_has_the_pictures_with_what_moves(recorded):
    done, seen = recorded
    tables = read(done.files["recording"])
    assert done.not_shown == 0
    for entity in ("picture", "moving", "arrows", "things", "paths"):
        assert frames_of(tables[f"camera/{entity}"]) == list(range(24))

    def decoded(entity, number):
        data = component(tables[entity][number], "blob")
        while isinstance(data[0], list):
            (data,) = data
        return cv2.imdecode(np.array(data, np.uint8), cv2.IMREAD_COLOR)

    last = seen[-1].measured
    assert np.abs(decoded("camera/picture", 23)[..., 0].astype(int) - last.frame.image).mean() < 6
    np.testing.assert_array_equal(decoded("camera/moving", 23)[..., 2] > 0, last.segmentation.moving)
    labels = component(tables["camera/things"][23], "labels")
    rows = [row for row in last.objects if row["area_px"] > 0]
    assert rows
    assert labels == [f"{row['id']}: {row['speed_m_s']:.3g} m/s" for row in rows]
    halves = np.array(component(tables["camera/things"][23], "half_sizes"))
    np.testing.assert_allclose(2 * halves, [(row["width_px"], row["height_px"]) for row in rows])
    # The path ends where the thing is, and goes back along its way over the ground.
    (path,) = component(tables["camera/paths"][23], "strips")
    np.testing.assert_allclose(path[-1], [rows[0]["x_px"] + 0.5, rows[0]["y_px"] + 0.5], atol=0.05)
    ways = np.diff(np.array(path)[5:], axis=0).mean(axis=0)
    assert abs(ways[0]) < 0.25 < ways[1]
    vectors = np.array(component(tables["camera/arrows"][23], "vectors"))
    uv = last.flow.uv[last.flow.valid]
    zoom = np.median(np.hypot(*vectors.T)) / np.median(np.hypot(*uv.T))
    assert zoom == pytest.approx(round(zoom), abs=0.35)
    text = component(tables["figures"][23], "text")[0]
    assert "### 1 thing that moves" in text
    assert re.search(r"\| vx \| 0\.0[34]\d* ± ", text)


SIGNALS = """
import resource, sys, signal
from rsflow import live, synthetic
from rsflow.live.viewing import outputs, viewer

flight = synthetic.flight(frames=40, seed=1)


def endless():
    for number in range(10**6):
        yield flight.images[min(number % 78, 77 - number % 78)], number / 30


def run(name, **options):
    done = live.watch(record=f"{sys.argv[1]}/{name}.rrd", camera_motion="moving", **options)
    print(done.ended, done.frames, done.files["recording"], *done.notes)


def interrupt(*_):
    signal.raise_signal(signal.SIGINT)


run("a", source=endless(), on_frame=interrupt)
run("b", source=endless(), on_frame=lambda frame: frame.measured.frame.index == 7 and interrupt())
real = outputs.FileOutput.close
outputs.FileOutput.close = lambda self: (interrupt(), real(self))
run("d", source=flight, frames=3)
outputs.FileOutput.close = real
viewer._CHECK_S = 0.0
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
run("e", source=flight)
"""


def test_a_recording_is_closed_by_ctrl_c_at_any_moment_and_by_a_file_that_can_grow_no_more(tmp_path):
    from rerun.chunk import RrdReader

    done = subprocess.run([sys.executable, "-c", SIGNALS, tmp_path], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    ended = ["interrupted", "interrupted", "frames", "end"]
    assert [line.split()[0] for line in lines] == ended
    names = [f"{name}.rrd" for name in "abd"] + ["e.partial.rrd"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    for line in lines[:3]:
        _, frames, path = line.split()
        # Its index is at the end: it was closed.
        assert RrdReader(path).store() is not None
        assert len(read(path)["light/gain"]) == int(frames)
    # The figures went on.
    assert lines[3].startswith(f"end 40 {tmp_path / 'e.partial.rrd'} {tmp_path / 'e.rrd'}: ")
    assert "written" in lines[3]


def test_a_recording_on_a_full_disk_ends_and_the_figures_go_on(flight, tmp_path, monkeypatch):
    usage = outputs.shutil.disk_usage(tmp_path)
    seen = []

    def nearly_full(_path):
        return usage._replace(free=1 << 20) if len(seen) > 5 else usage

    monkeypatch.setattr(outputs.shutil, "disk_usage", nearly_full)
    monkeypatch.setattr("rsflow.live.viewing.viewer._CHECK_S", 0.0)
    done = live.watch(flight, record=tmp_path / "run.rrd", out=tmp_path, on_frame=seen.append, **SETTLED)
    assert done.frames == 24
    assert any("ends here, as the disk is nearly full (1 MB left)" in note for note in done.notes)
    assert done.files["recording"] == tmp_path / "run.rrd"
    assert 0 < len(read(done.files["recording"])["light/gain"]) < 24
    assert len(done.files["motion"].read_text().splitlines()) == 25


def test_a_recording_is_not_written_over_and_a_missing_viewer_is_named(flight, tmp_path, monkeypatch, capsys):
    path = tmp_path / "run.rrd"
    path.write_text("mine")
    with pytest.raises(rsflow.OptionError, match="expected a new file, or overwrite"):
        live.watch(flight, record=path)
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(rsflow.errors.MissingExtraError, match=r"needs the package 'rerun'.*rsflow-motion\[viewer\]"):
        live.watch(flight, record=path, overwrite=True, out=tmp_path / "out")
    assert path.read_text() == "mine"
    assert not (tmp_path / "out").exists()


def test_a_viewer_that_is_held_up_holds_nothing_up(flight, monkeypatch, tmp_path):
    """Each picture takes the viewer a fifth of a second: pictures are dropped and counted, figures are not."""
    from rsflow.live.viewing.scene import Scene

    real = Scene.entities

    def slow(self, *arguments):
        time.sleep(0.2)
        return real(self, *arguments)

    monkeypatch.setattr(Scene, "entities", slow)
    delays, begin_s = {}, time.time()
    shown = {"serve": f"127.0.0.1:{free_ports()}", "record": tmp_path / "run.rrd"}
    for name, options in (("without", {}), ("with", shown)):
        seen = []
        done = live.watch(flight, real_time=True, on_frame=seen.append, **options, **SETTLED)
        delays[name] = np.median([frame.delay_s for frame in seen])
        assert done.frames + done.not_measured == 24
    assert done.not_shown >= min(5, done.frames // 3)
    assert delays["with"] < 1.5 * delays["without"] + 0.12
    # Plots have what pictures have not, and of what is live the time of day.
    tables = read(done.files["recording"])
    assert len(tables["timing/delay_ms"]) == done.frames > len(tables["camera/picture"])
    np.testing.assert_allclose([component(row, "scalars")[0] for row in tables["timing/delay_ms"]],
                               [1e3 * frame.delay_s for frame in seen])  # fmt: skip
    for row in (*tables["timing/delay_ms"], *tables["camera/picture"]):
        assert begin_s - 1 < row["clock"].timestamp() < time.time() + 1


def free_ports() -> int:
    """A port that is free together with the next one."""
    for _ in range(50):
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            try:
                second.bind(("127.0.0.1", first.getsockname()[1] + 1))
            except OSError:
                continue
            return first.getsockname()[1]
    raise AssertionError


def test_a_port_that_is_taken_and_no_screen_are_said_before_anything_is_written(flight, tmp_path, monkeypatch):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(rsflow.CaptureError, match=rf"port {port} cannot be had: it is in use"):
            live.watch(flight, serve=f"127.0.0.1:{port}", out=tmp_path / "out", record=tmp_path / "run.rrd")
    monkeypatch.setattr(outputs, "has_screen", lambda: False)
    with pytest.raises(rsflow.OptionError, match=r"without a screen, expected one: serve it .*--serve.*--record"):
        live.watch(flight, view=True, out=tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("code", "note"), [(0, "the viewer was closed; the run goes on"), (1, "exit code 1: try --serve")]
)
def test_a_window_is_a_process_that_may_be_closed(flight, monkeypatch, code, note):
    """No window is opened here: the process in its place connects to the server, and ends."""
    started, real = [], outputs.subprocess.Popen

    def popen(command, **options):
        started.append(command)
        port = re.search(r":(\d+)/proxy", command[3])[1]
        ends = f"import socket, sys\nsocket.create_connection(('127.0.0.1', {port}), 5).close()\nsys.exit({code})"
        process = real([sys.executable, "-c", ends], **options)
        process.wait()
        return process

    monkeypatch.setattr(outputs, "has_screen", lambda: True)
    monkeypatch.setattr(outputs.subprocess, "Popen", popen)
    done = live.watch(flight, view=True, frames=3, **SETTLED)
    ((python, *command),) = started
    assert python == sys.executable
    assert command[:2] == ["-m", "rerun"]
    assert command[-5:-2] == ["auto", "--bind", "127.0.0.1"]
    assert done.frames == 4
    assert any(note in told for told in done.notes)


def test_a_file_is_shown_until_somebody_ends_it(flight, tmp_path):
    """Who comes late finds it: the port is open until Ctrl-C, and what is written is whole before that."""
    port, notes, showing = free_ports(), [], []

    def on_wait(_waited_s):
        if showing[0].notes and not notes:
            notes.extend(showing[0].notes)
            assert (tmp_path / "motion.csv").exists()
            assert (tmp_path / "run.rrd").exists()
            socket.create_connection(("127.0.0.1", port + 1), 5).close()
            signal.raise_signal(signal.SIGINT)

    done = live.watch(
        flight, serve=f"127.0.0.1:{port}", record=tmp_path / "run.rrd", out=tmp_path, linger=True,
        on_open=showing.append, on_wait=on_wait, **SETTLED,
    )  # fmt: skip
    assert (done.ended, done.frames) == ("end", 24)
    assert set(done.files) == {"motion", "objects", "velocity", "recording"}
    assert notes == ["all is measured; it is shown until Ctrl-C"]
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", port + 1), 1)


SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--use-gl=angle", "--ignore-gpu-blocklist")


def test_a_recording_is_seen_in_a_browser(recorded, tmp_path):
    """The web viewer over the recording: the picture, the red mask, the green box and lines of the plots are there."""
    import rerun

    path = recorded[0].files["recording"]

    class Handler(SimpleHTTPRequestHandler):
        def end_headers(self):
            self.send_header("Access-Control-Allow-Origin", "*")
            super().end_headers()

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=path.parent))
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
    port = free_ports()
    with opened_browser(*SOFTWARE) as browser:
        rerun.serve_web_viewer(web_port=port, open_browser=False)
        page = browser.new_page(viewport={"width": 640, "height": 420})
        address = f"http://127.0.0.1:{server.server_port}/{path.name}"
        page.goto(f"http://127.0.0.1:{port}/?url={address}")
        page.wait_for_selector("canvas")
        deadline = time.monotonic() + 60
        while True:
            picture = cv2.imdecode(np.frombuffer(page.screenshot(timeout=100_000), np.uint8), cv2.IMREAD_COLOR).astype(
                int
            )
            blue, green, red = picture[:, :480].transpose(2, 0, 1)
            textured = (np.abs(red - green) < 3) & (np.abs(red - blue) < 3) & (red > 30) & (red < 220)
            if textured.mean() > 0.2 or time.monotonic() > deadline:
                break
    server.shutdown()
    server.server_close()
    cv2.imwrite(str(tmp_path / "viewer.png"), picture)
    print(tmp_path / "viewer.png")
    assert textured.mean() > 0.2
    # What moves is reddish, and a plotted line below is red.
    assert ((red - blue > 25) & (red - green > 15))[60:300].sum() > 100
    assert ((red > 150) & (green < 120) & (blue < 110))[320:].sum() > 15
