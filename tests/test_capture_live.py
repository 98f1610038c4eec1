"""A live camera: newest frames, the clock's times, and a camera that goes away. No hardware: a made-up VideoCapture."""

from __future__ import annotations

import threading
import time

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import Frames
from rsflow.capture.live import LiveReader


class FakeCapture:
    """A camera that gives frame after frame, `period_s` apart, until `ends` frames; then grab fails or hangs."""

    def __init__(self, *, period_s=0.002, ends=None, opened=True, hangs=False, size=(32, 24), broken=None):
        self.period_s, self.ends, self.opened, self.hangs, self.size = period_s, ends, opened, hangs, size
        self.broken = broken
        self.given = 0
        self.released = threading.Event()
        self.asked: dict[int, float] = {}

    def isOpened(self):  # noqa: N802
        return self.opened

    def get(self, what):
        return {
            cv2.CAP_PROP_FRAME_WIDTH: self.size[0],
            cv2.CAP_PROP_FRAME_HEIGHT: self.size[1],
            cv2.CAP_PROP_FPS: 30.0,
        }[what]

    def set(self, what, value):
        self.asked[what] = value
        return True

    def grab(self):
        if self.broken is not None:
            raise self.broken
        if self.ends is not None and self.given >= self.ends:
            if self.hangs:
                self.released.wait(5.0)
            return False
        time.sleep(self.period_s)
        self.given += 1
        return True

    def retrieve(self):
        return True, np.full((self.size[1], self.size[0], 3), self.given % 250, np.uint8)

    def release(self):
        self.released.set()


def live(*captures: FakeCapture, newest=True, timeout_s=0.5, camera_size=None, **options) -> Frames:
    """Frames of made-up cameras: the second and later ones are what opening again gives; then nothing opens."""
    left = list(captures)

    def opener(_source):
        return left.pop(0) if left else FakeCapture(opened=False)

    reader = LiveReader(
        options.pop("source", 0), newest=newest, timeout_s=timeout_s, camera_size=camera_size, opener=opener
    )
    given = {"grey": True, "color": False, "roi": None, "start": 0, "stop": None, "stride": 1} | options
    return Frames(reader, times=None, frame_rate=None, **given)


def test_a_slow_reader_gets_the_newest_frame_and_its_time():
    camera = FakeCapture(period_s=0.002)
    with live(camera, stop=5) as source:
        assert (source.live, source.timestamps, source.size, source.frame_rate) == (True, "clock", (32, 24), 30.0)
        got = []
        for frame in source:
            age_s = time.monotonic() - frame.t_s
            got.append(frame)
            assert 0 <= age_s < 0.1
            time.sleep(0.05)
    indices = np.array([frame.index for frame in got])
    assert len(got) == 5
    # 25 frames come while one is worked on: they are dropped, and the numbers tell.
    assert np.all(np.diff(indices) > 3)
    times = np.array([frame.t_s for frame in got])
    assert np.all(np.diff(times) > 0.03)
    assert camera.released.wait(2.0)


def test_every_frame_is_given_where_the_newest_is_not_asked_for():
    with live(FakeCapture(period_s=0.0005), newest=False, stop=100) as source:
        assert [frame.index for frame in source] == list(range(100))


def test_a_camera_that_comes_back_goes_on():
    with live(FakeCapture(ends=3), FakeCapture(), newest=False, timeout_s=2.0, stop=8) as source:
        got = list(source)
        assert source.notes == ("camera 0: opened again 1 times",)
    assert [frame.index for frame in got] == list(range(8))
    assert got[3].t_s - got[2].t_s > 0.1
    assert source.gaps == 1


def test_a_camera_that_vanishes_is_an_error_within_the_time_out():
    source = live(FakeCapture(ends=3), newest=False, timeout_s=0.4)
    begin, got = time.monotonic(), []
    with pytest.raises(rsflow.CaptureError, match=r"camera 0: gave no frame for 0\.4 s after frame 2: it went away"):
        got.extend(source)
    assert len(got) == 3
    assert 0.35 < time.monotonic() - begin < 2.5
    assert list(source) == []


def test_a_driver_that_hangs_does_not_hang_the_reader():
    camera = FakeCapture(ends=0, hangs=True)
    begin = time.monotonic()
    with pytest.raises(rsflow.CaptureError, match=r"gave no frame for 0\.3 s and never gave one"):
        next(live(camera, timeout_s=0.3))
    assert time.monotonic() - begin < 2.5
    camera.released.set()


def test_a_driver_that_fails_is_an_error_with_its_words():
    with pytest.raises(rsflow.CaptureError, match="camera 0: went away: ValueError: unplugged"):
        next(live(FakeCapture(broken=ValueError("unplugged"))))


def test_a_camera_that_does_not_open_is_an_error_at_once():
    with pytest.raises(rsflow.CaptureError, match="camera 0: cannot be opened: no such camera or stream"):
        live(FakeCapture(opened=False))


def test_a_camera_is_asked_for_its_size():
    camera = FakeCapture()
    with live(camera, camera_size=(320, 240)) as source:
        next(source)
    assert camera.asked == {cv2.CAP_PROP_FRAME_WIDTH: 320, cv2.CAP_PROP_FRAME_HEIGHT: 240}


def test_a_camera_that_comes_back_with_another_size_is_an_error():
    with (
        live(FakeCapture(ends=2), FakeCapture(size=(64, 48)), newest=False, timeout_s=2.0) as source,
        pytest.raises(rsflow.ShapeError, match=r"frame 2: got 64 x 48 pixels, expected 32 x 24 as .*frame 0 has"),
    ):
        list(source)


def test_which_sources_are_live(monkeypatch):
    seen = []

    def opener(self, source, **_options):
        seen.append(source)
        raise rsflow.CaptureError("not here")

    monkeypatch.setattr(LiveReader, "__init__", opener)
    for source in (0, "1", "/dev/video7", "rtsp://host/a", "udp://@:5000"):
        with pytest.raises(rsflow.CaptureError, match="not here"):
            rsflow.frames(source)
    with pytest.raises(rsflow.CaptureError, match="not here"):
        rsflow.frames("http://host/camera", newest=True)
    assert seen == [0, 1, "/dev/video7", "rtsp://host/a", "udp://@:5000", "http://host/camera"]


def test_a_source_played_at_its_own_pace_is_live():
    pictures = [np.full((4, 6), value, np.uint8) for value in range(12)]
    begin = time.monotonic()
    with rsflow.frames(pictures, frame_rate=100.0, real_time=True, newest=False) as source:
        got = list(source)
    assert (source.live, source.timestamps, source.count) == (True, "clock", 12)
    assert [frame.index for frame in got] == list(range(12))
    np.testing.assert_allclose(np.diff([frame.t_s for frame in got]).min(), 0.01, atol=1e-6)
    assert time.monotonic() - begin >= 0.11
    assert begin < got[0].t_s < got[-1].t_s <= time.monotonic()


def test_of_a_paced_source_a_slow_reader_gets_the_newest_frame_and_the_end():
    times = [0.0, 0.02, 0.05, 0.06, 0.1, 0.12, 0.16]
    with rsflow.frames(np.zeros((7, 4, 6), np.uint8), times=times, real_time=True) as source:
        got = [source.__next__()]
        time.sleep(0.25)
        got += list(source)
    assert [frame.index for frame in got] == [0, 6]
    assert got[1].t_s - got[0].t_s == pytest.approx(0.16, abs=0.1)


def test_a_paced_source_says_what_is_wrong_and_can_be_left_in_the_middle():
    pictures = np.zeros((5, 4, 6), np.uint8)
    with pytest.raises(rsflow.OptionError, match="real_time: got True, expected frame_rate= with it"):
        rsflow.frames(pictures, real_time=True)
    with (
        rsflow.frames(pictures, times=[0.0, 0.01], real_time=True) as source,
        pytest.raises(rsflow.OptionError, match="got 2 times, expected one for each frame"),
    ):
        list(source)
    begin, threads = time.monotonic(), threading.active_count()
    with rsflow.frames(pictures, frame_rate=0.1, real_time=True) as source:
        next(source)
    assert time.monotonic() - begin < 2.0
    assert threading.active_count() == threads
    assert list(source) == []


def test_a_live_source_that_went_away_is_waited_for_longer_where_that_is_asked_for():
    left = [FakeCapture(ends=3)]

    def opener(_source):
        return left.pop(0) if left else FakeCapture(opened=False)

    reader = LiveReader(0, newest=False, timeout_s=5.0, reconnect_s=0.9, camera_size=None, opener=opener)
    begin = time.monotonic()
    for _ in range(3):
        assert reader.read(True) is not None
    with pytest.raises(rsflow.CaptureError, match=r"gave no frame for 0\.9 s after frame 2"):
        reader.read(True)
    assert 0.85 < time.monotonic() - begin < 4.0
    reader.close()


def test_a_live_source_has_its_own_times(monkeypatch):
    monkeypatch.setattr(LiveReader, "_opened", lambda _self: FakeCapture())
    with pytest.raises(rsflow.OptionError, match="got one for camera 0, which is live, expected None"):
        rsflow.frames(0, frame_rate=30.0)
