"""The main job: what it writes, how good it is, and what it refuses."""

import dataclasses
import json
import math
import re

import numpy as np
import pytest

import rsflow
from extraction_helpers import FILES, HEIGHT_M, made_flight, names_in, numbers, rows_of
from rsflow import synthetic
from rsflow.cli import main
from rsflow.errors import CaptureError, FormatError, OptionError
from rsflow.extraction.probe import camera_motion


@pytest.fixture(scope="module")
def flight():
    return made_flight()


@pytest.fixture(scope="module")
def done(flight, tmp_path_factory):
    folder = tmp_path_factory.mktemp("done") / "out"
    pairs = list(zip(flight.images, flight.t_s, strict=True))
    return rsflow.extract(pairs, folder, camera=flight.camera, height_m=HEIGHT_M, camera_motion="moving")


# --- what a whole run leaves ----------------------------------------------------------------------------------------


def test_files_are_there_and_nothing_else(done):
    assert done.complete
    assert names_in(done.folder) == FILES | {"velocity.csv", "trajectory.csv"}
    assert {path.name for path in done.files.values()} == names_in(done.folder)
    assert done.summary["files"] == {name: path.name for name, path in done.files.items()}


def test_displacement_and_its_deviation_are_true(done, flight):
    rows = rows_of(done.files["motion"])
    assert [int(row["frame"]) for row in rows] == list(range(16))
    assert rows[0]["status"] == "first_frame"
    assert rows[0]["dx_px"] == "nan"
    assert rows[0]["dx_std_px"] == "inf"
    assert {row["status"] for row in rows[1:]} == {"ok"}
    # V f / Z / rate, to the other side.
    true = -np.array([0.04, -0.015]) * 180.0 / HEIGHT_M / 30.0
    for axis, name in enumerate(("dx", "dy")):
        error = numbers(rows, f"{name}_px")[1:] - true[axis]
        assert np.sqrt(np.mean(error**2)) < 0.02
        assert (numbers(rows, f"{name}_std_px")[1:] < 0.05).all()
    np.testing.assert_allclose(numbers(rows, "t_s"), flight.t_s, atol=1e-6)
    np.testing.assert_allclose(numbers(rows, "flow_median_x_px")[1:], true[0], atol=0.1)
    assert (numbers(rows, "flow_valid_share")[1:] > 0.7).all()
    np.testing.assert_allclose(numbers(rows, "camera_dx_px")[1:], true[0], atol=0.1)


def test_velocity_and_track_are_true(done, flight):
    rows = rows_of(done.files["velocity"])
    assert {row["status"] for row in rows[1:]} == {"ok"}
    assert numbers(rows, "vx_m_s")[1:].mean() == pytest.approx(0.04, rel=0.01)
    assert numbers(rows, "vy_m_s")[1:].mean() == pytest.approx(-0.015, rel=0.02)
    track = rows_of(done.files["trajectory"])
    end = flight.position_m[-1] - flight.position_m[0]
    assert float(track[-1]["x_m"]) == pytest.approx(end[0], rel=0.01)
    assert float(track[-1]["y_m"]) == pytest.approx(end[1], rel=0.02)
    assert float(track[-1]["distance_m"]) == pytest.approx(np.hypot(*end[:2]), rel=0.01)
    assert done.summary["distance_m"] == pytest.approx(np.hypot(*end[:2]), rel=0.01)
    assert {row["segment"] for row in track} == {"1"}


def test_the_moving_thing_is_found(flight, tmp_path):
    overlap = []

    def look(measured):
        thing = flight.masks[measured.frame.index] > 0
        if measured.frame.index > 2:
            moving = measured.segmentation.moving
            overlap.append((moving & thing).sum() / (moving | thing).sum())

    out = rsflow.extract(list(flight.images), tmp_path, frame_rate=30, videos=False, on_frame=look)
    assert np.median(overlap) > 0.6
    objects = rows_of(out.files["objects"])
    assert len(objects) >= 10
    frame = int(objects[-1]["frame"])
    y, x = np.nonzero(flight.masks[frame])
    assert float(objects[-1]["x_px"]) == pytest.approx(x.mean(), abs=5)
    assert float(objects[-1]["y_px"]) == pytest.approx(y.mean(), abs=5)
    assert names_in(tmp_path) == FILES - {"flow.mp4", "moving.mp4", "static.mp4"}


def test_videos_hold_a_picture_a_frame(done):
    for name in ("flow", "moving", "static"):
        with rsflow.frames(done.files[name]) as stream:
            assert len(list(stream)) == 16, name


def test_report_needs_no_network_and_no_other_file(done):
    text = done.files["report"].read_text(encoding="utf-8")
    without = re.sub(r"data:[a-z/0-9]+;base64,[A-Za-z0-9+/=]+", "", text).replace("http://www.w3.org/2000/svg", "")
    assert "http" not in without
    beside = {path.name for path in done.files.values()}
    assert set(re.findall(r'(?:src|href)="([^"#]+)"', without)) <= beside
    for word in ("complete", "px per frame", "m/s", "What could not be measured, and why", rsflow.__version__):
        assert word in text
    assert text.count("<svg") >= 6
    assert text.count("<video") == 3
    assert "nan</td>" not in text


def test_summary_is_json_without_nan(done):
    text = done.files["summary"].read_text()
    summary = json.loads(text, parse_constant=lambda word: pytest.fail(word))
    assert summary["frames"] == 16
    assert summary["measured"] == 15
    assert summary["complete"] is True
    assert summary["statuses"] == {"ok": 15, "first_frame": 1}
    assert summary["settings"]["height_m"] == "0.2"


def test_start_stop_stride_and_roi(flight, tmp_path):
    out = rsflow.extract(
        list(flight.images), tmp_path, start=2, stop=12, stride=3, roi=(16, 8, 128, 96), frame_rate=30,
        camera=flight.camera, height_m=HEIGHT_M, videos=False,
    )  # fmt: skip
    rows = rows_of(out.files["motion"])
    assert [int(row["frame"]) for row in rows] == [2, 5, 8, 11]
    np.testing.assert_allclose(numbers(rows, "dx_px")[1:], -3 * 0.04 * 180 / HEIGHT_M / 30, atol=0.1)
    velocity = rows_of(out.files["velocity"])
    np.testing.assert_allclose(numbers(velocity, "vx_m_s")[1:], 0.04, rtol=0.02)
    assert out.summary["size"] == [128, 96]


def test_heights_from_a_table(flight, tmp_path):
    (tmp_path / "h.csv").write_text("frame,height_m\n0,0.2\n1,0.2\n2,\n3,0.2\n")
    options = {"frame_rate": 30, "camera": flight.camera, "height_m": tmp_path / "h.csv", "videos": False}
    # One that is missing is carried on for a while.
    out = rsflow.extract(list(flight.images[:4]), tmp_path / "carried", **options)
    assert [row["status"] for row in rows_of(out.files["velocity"])] == ["first_frame", "ok", "ok", "ok"]
    assert "In 1 frame: the height is carried on by the pictures alone." in out.summary["notes"]
    sensors = rsflow.velocity.Sensors(max_height_gap_s=0.01)
    out = rsflow.extract(list(flight.images[:4]), tmp_path / "out", **options, sensors=sensors)
    rows = rows_of(out.files["velocity"])
    assert [row["status"] for row in rows] == ["first_frame", "ok", "no_height", "ok"]
    track = rows_of(out.files["trajectory"])
    assert [row["segment"] for row in track] == ["1", "1", "1", "2"]
    assert track[2]["x_m"] == "nan"
    report = out.files["report"].read_text()
    assert "no height over the ground is known at this time" in report
    assert "not measured" in report


def test_a_camera_of_another_size_is_scaled_and_said(flight, tmp_path):
    double = flight.camera.scaled(352, 288)
    out = rsflow.extract(
        list(flight.images[:3]), tmp_path, frame_rate=30, camera=double, height_m=HEIGHT_M, videos=False
    )
    assert out.summary["speed_median_m_s"] == pytest.approx(np.hypot(0.04, 0.015), rel=0.03)
    assert any("352 x 288" in note for note in out.summary["notes"])


def test_a_height_without_a_deviation_is_said_until_one_is_stated(flight, tmp_path):
    known = dataclasses.replace(flight.camera, std=dict.fromkeys(("fx", "fy", "cx", "cy"), 0.0))
    for std, unknown in ((None, True), (0.0, False), (0.01, False)):
        out = rsflow.extract(
            list(flight.images[:3]), tmp_path / str(std), frame_rate=30, camera=known, height_m=HEIGHT_M,
            height_std_m=std, videos=False,
        )  # fmt: skip
        said = "deviation of the height not stated: velocities are only as exact as the height"
        assert any(said in note.lower() for note in out.summary["notes"]) is unknown
        assert ("without that of height" in out.summary["text"]) is unknown
        assert out.summary["speed_std_without"] == (["height"] if unknown else [])
        assert ("velocities are only as exact as the height" in out.files["report"].read_text()) is unknown
        assert np.isfinite(out.summary["speed_std_median_m_s"])


def test_a_scene_cut_and_a_blank_frame_are_said_not_guessed(tmp_path):
    a = synthetic.shifted_pair(1.0, 0.0, size=(96, 72), seed=1)
    b = synthetic.shifted_pair(1.0, 0.0, size=(96, 72), seed=99)
    covered = np.random.default_rng(7).normal(20, 1, a.prev.shape).round().astype(np.uint8)
    images = [a.prev, a.next, b.prev, b.next, covered, b.next]
    out = rsflow.extract(images, tmp_path, frame_rate=10, videos=False)
    rows = rows_of(out.files["motion"])
    valid = [math.isfinite(float(row["dx_px"])) for row in rows]
    assert valid == [False, True, False, True, False, False]
    assert all(row["status"] not in {"ok", ""} for row, ok in zip(rows, valid, strict=True) if not ok)
    assert all(row["dx_std_px"] == "inf" for row, ok in zip(rows, valid, strict=True) if not ok)
    report = out.files["report"].read_text()
    for row in rows:
        assert f">{row['status']}</td>" in report


def test_pictures_without_times(flight, tmp_path):
    out = rsflow.extract(list(flight.images[:4]), tmp_path)
    assert out.summary["duration_s"] is None
    assert any("--rate" in note for note in out.summary["notes"])
    assert {row["t_s"] for row in rows_of(out.files["motion"])} == {"nan"}
    with rsflow.frames(out.files["flow"]) as stream:
        assert len(list(stream)) == 4


def test_one_frame_alone_is_an_error_and_leaves_nothing(flight, tmp_path):
    with pytest.raises(rsflow.CaptureError, match="has 1 frame, expected at least two"):
        rsflow.extract([flight.images[0]], tmp_path, frame_rate=30)
    assert not names_in(tmp_path)


def test_one_frame_before_an_interruption_is_kept_and_said(flight, tmp_path):
    def interrupted():
        yield flight.images[0]
        raise KeyboardInterrupt

    with pytest.raises(rsflow.ExtractionInterrupted) as caught:
        rsflow.extract(interrupted(), tmp_path, frame_rate=30)
    assert caught.value.extraction.frames == 1
    assert "There is one frame: a motion needs two." in caught.value.extraction.summary["notes"]
    assert names_in(tmp_path)


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_other_depths(flight, tmp_path, dtype):
    factor = 257 if dtype is np.uint16 else 1.0
    images = [(image.astype(np.float64) * factor).astype(dtype) for image in flight.images[:3]]
    out = rsflow.extract(images, tmp_path, frame_rate=30)
    assert out.summary["measured"] == 2


def test_rest_is_told_from_motion(tmp_path):
    still = synthetic.flight(frames=6, velocity_m_s=(0.0, 0.0, 0.0), seed=5)
    out = rsflow.extract(list(still.images), tmp_path / "still", frame_rate=30, videos=False)
    assert out.summary["camera_motion"] == "static"
    moving = synthetic.flight(frames=6, velocity_m_s=(0.03, 0.0, 0.0), seed=5)
    out = rsflow.extract(list(moving.images), tmp_path / "moving", frame_rate=30, videos=False)
    assert out.summary["camera_motion"] == "moving"
    assert camera_motion([]).motion == "moving"


# --- wrong use ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"preset": "best"}, OptionError, 'preset: got "best"'),
        ({"illumination": "sun"}, OptionError, 'illumination: got "sun"'),
        ({"camera_motion": "no"}, OptionError, 'camera_motion: got "no"'),
        ({"height_m": 0.2}, OptionError, "a height needs a camera"),
        ({"height_m": -1.0, "camera": "c.json"}, OptionError, "height_m: got -1.0"),
        ({"height_std_m": -1.0}, OptionError, "height_std_m: got -1.0"),
        ({"start": 2, "stop": 2}, CaptureError, "has 3 frames, and none is left by start=2, stop=2"),
        ({"roi": (0, 0, 999, 10)}, OptionError, "roi"),
        ({"camera": "missing.json", "height_m": 1.0}, OSError, "missing.json"),
    ],
)
def test_wrong_options_leave_nothing(flight, tmp_path, options, error, words):
    with pytest.raises(error, match=re.escape(words)):
        rsflow.extract(list(flight.images[:3]), tmp_path / "out", **({"frame_rate": 30} | options))
    assert not (tmp_path / "out").exists()


def test_a_camera_of_another_shape_is_refused(flight, tmp_path):
    square = rsflow.Camera(100.0, 100.0, 49.5, 49.5, width=100, height=100)
    with pytest.raises(OptionError, match=r"100 x 100 pixels, expected the shape of .*, 176 x 144"):
        rsflow.extract(list(flight.images[:3]), tmp_path / "out", frame_rate=30, camera=square, height_m=0.2)
    assert not (tmp_path / "out").exists()


def test_a_wrong_table_of_heights_is_refused(flight, tmp_path):
    (tmp_path / "h.csv").write_text("a,b\n1,2\n")
    with pytest.raises(FormatError, match="height_m"):
        rsflow.extract(list(flight.images[:3]), tmp_path / "out", camera=flight.camera, height_m=tmp_path / "h.csv")
    assert not (tmp_path / "out").exists()


def test_an_empty_or_missing_source_leaves_nothing(tmp_path):
    (tmp_path / "empty.mp4").write_bytes(b"")
    for source in (tmp_path / "empty.mp4", tmp_path / "none.mp4"):
        with pytest.raises(CaptureError, match=source.name):
            rsflow.extract(source, tmp_path / "out")
        assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_written(flight, tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError, match="file"):
        rsflow.extract(list(flight.images[:3]), tmp_path / "file" / "out")
    assert main(["extract", str(tmp_path / "file"), "-o", str(tmp_path / "file" / "out")]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert (tmp_path / "file").read_text() == "in the way"


def test_errors_can_be_sent_between_processes(done):
    import pickle

    for kind in (rsflow.PartialExtractionError, rsflow.ExtractionInterrupted):
        copy = pickle.loads(pickle.dumps(kind("why", done)))
        assert str(copy) == "why"
        assert copy.extraction.files == done.files


# --- demo -----------------------------------------------------------------------------------------------------------


def test_demo_holds_what_it_promises(tmp_path, capsys):
    assert main(["demo", "-o", str(tmp_path), "--frames", "30", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert all(row["passed"] for row in found["rows"])
    assert (tmp_path / "report.html").is_file()
    assert names_in(tmp_path / "input") == {"flight.avi", "camera.json"}


def test_without_pyav_the_videos_are_written_and_the_page_says_so(flight, tmp_path, monkeypatch):
    from rsflow import video

    monkeypatch.setattr(video.sinks, "av_encoder", lambda codec: None)
    out = rsflow.extract(list(flight.images[:4]), tmp_path, frame_rate=30)
    assert out.summary["video_codec"] == "mp4v"
    with rsflow.frames(out.files["moving"]) as stream:
        assert len(list(stream)) == 4
    text = out.files["report"].read_text()
    assert "<video" not in text
    assert "pip install &#x27;rsflow-motion[video]&#x27; brings H.264" in text
