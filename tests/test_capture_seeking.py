"""A start in the middle of a video: the very frames of one that is read from its beginning."""

from fractions import Fraction

import numpy as np
import pytest

import rsflow
from encoded_video import SIZE, scene

FRAMES = 260


def written(path, codec, *, gop=30, uneven=False, options=None):
    av = pytest.importorskip("av")
    ticks = np.cumsum(np.random.default_rng(5).integers(5, 90, FRAMES)) if uneven else 33 * np.arange(FRAMES)
    with av.open(str(path), "w") as box:
        try:
            stream = box.add_stream(codec, rate=30, options=options or {})
        except ValueError as error:
            pytest.skip(str(error))
        stream.width, stream.height = SIZE
        stream.pix_fmt, stream.gop_size = "yuv420p", gop
        stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
        for number in range(FRAMES):
            frame = av.VideoFrame.from_ndarray(scene(number), format="gray").reformat(format="yuv420p")
            frame.pts, frame.time_base = int(ticks[number]), Fraction(1, 1000)
            box.mux(stream.encode(frame))
        box.mux(stream.encode())
    return path


@pytest.mark.parametrize(
    ("name", "codec", "options", "goes"),
    [
        ("even.mp4", "libx264", {"options": {"bf": "3"}}, True),
        ("uneven.mp4", "libx264", {"uneven": True}, True),
        ("open.mkv", "libx264", {"options": {"x264-params": "open-gop=1:bframes=3:log-level=none"}}, True),
        ("old.mp4", "mpeg4", {"gop": 50}, True),
        # One key frame: all is decoded.
        ("one.mp4", "libx264", {"gop": 10_000}, False),
        # Its container has no times of pictures.
        ("old.avi", "mpeg4", {}, False),
    ],
)
def test_frames_from_a_start_are_those_of_the_whole(tmp_path, monkeypatch, name, codec, options, goes):
    path = written(tmp_path / name, codec, **options)
    whole = list(rsflow.frames(path, color=True))
    assert len(whole) == FRAMES
    from rsflow.capture.video import VideoReader

    gone, skip = [], VideoReader.skip

    def noted(reader, index):
        gone.append(skip(reader, index))
        return gone[-1]

    monkeypatch.setattr(VideoReader, "skip", noted)
    for start in (100, 119, 120, 121, 187, 210, FRAMES - 1):
        with rsflow.frames(path, color=True, start=start, stride=3) as source:
            part = list(source)
        assert [frame.index for frame in part] == list(range(start, FRAMES, 3))
        for frame in part:
            other = whole[frame.index]
            assert frame.t_s == other.t_s
            assert frame.color.tobytes() == other.color.tobytes(), (name, start, frame.index)
    assert all(gone) if goes else not any(gone)


def test_pictures_that_do_not_follow_each_other_are_not_gone_to(tmp_path, monkeypatch):
    from rsflow.capture import seeking

    path = written(tmp_path / "clip.mp4", "libx264")
    whole = [frame.image.tobytes() for frame in rsflow.frames(path)]
    # A decoder that lands elsewhere than it was told.
    monkeypatch.setattr(seeking, "_decoded_to", lambda *_: False)
    with rsflow.frames(path, start=150) as source:
        assert [frame.image.tobytes() for frame in source] == whole[150:]


def test_a_start_behind_the_end_is_none(tmp_path):
    path = written(tmp_path / "clip.mp4", "libx264")
    assert list(rsflow.frames(path, start=FRAMES + 50)) == []
