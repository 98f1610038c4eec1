"""Frames of videos, pictures and arrays, and their times."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow


def write_video(path: Path, count: int, rate: float, fourcc: str = "MJPG", size: tuple[int, int] = (64, 48)) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*fourcc), rate, size)
    assert writer.isOpened()
    for value in pictures(count, size):
        writer.write(cv2.cvtColor(value, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def pictures(count: int, size: tuple[int, int] = (64, 48)) -> list[np.ndarray]:
    """Grey pictures whose mean tells their number: 4 grey levels apart."""
    return [np.full((size[1], size[0]), 8 + 4 * i, np.uint8) for i in range(count)]


def numbers(source: rsflow.Frames) -> list[int]:
    return [round((float(frame.image.mean()) - 8) / 4) for frame in source]


def test_a_video_gives_its_frames_in_order_with_times(tmp_path):
    path = write_video(tmp_path / "clip.avi", 20, 25.0)
    with rsflow.frames(path) as source:
        assert source.size == (64, 48)
        assert source.frame_rate == pytest.approx(25.0)
        assert source.count == 20
        assert source.timestamps == "file"
        got = list(source)
    assert [frame.index for frame in got] == list(range(20))
    assert np.allclose([frame.t_s for frame in got], np.arange(20) / 25.0, atol=1e-9)
    assert [round((float(frame.image.mean()) - 8) / 4) for frame in got] == list(range(20))
    assert got[0].image.dtype == np.uint8
    assert got[0].image.ndim == 2


@pytest.mark.parametrize(
    ("start", "stop", "stride"), [(0, None, 1), (3, None, 4), (5, 12, 3), (18, 40, 1), (30, 40, 1)]
)
def test_start_stop_and_stride_are_those_of_range(tmp_path, start, stop, stride):
    expected = list(range(20))[start:stop:stride]
    video = write_video(tmp_path / "clip.avi", 20, 25.0)
    for source in (video, pictures(20), iter(pictures(20))):
        with rsflow.frames(source, start=start, stop=stop, stride=stride) as got:
            if got.count is not None:
                assert got.count == len(expected)
            assert numbers(got) == expected
