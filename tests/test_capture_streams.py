"""Videos that are complete, cut, damaged or change within, and files with several pictures."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from encoded_video import SIZE, encode, scene


def mux(path: Path, codec: str, packets: Sequence[bytes], *, first_s: float = 0.0) -> Path:
    av = pytest.importorskip("av")
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30)
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        stream.time_base = Fraction(1, 30)
        container.start_encoding()
        for number, data in enumerate(packets):
            packet = av.Packet(data)
            packet.pts = packet.dts = number + round(30 * first_s)
            packet.duration, packet.time_base, packet.stream = 1, Fraction(1, 30), stream
            packet.is_keyframe = number in (0, 10)
            container.mux(packet)
    return path


@pytest.mark.parametrize("first_s", [0.0, 0.2, 60.0, 4000.0])
@pytest.mark.parametrize(("suffix", "codec"), [("mkv", "mpeg4"), ("webm", "libvpx"), ("mp4", "mpeg4")])
def test_a_file_is_complete_wherever_its_times_begin(tmp_path, suffix, codec, first_s):
    path = mux(tmp_path / f"late.{suffix}", codec, encode(codec, 40), first_s=first_s)
    with rsflow.frames(path) as source:
        got = list(source)
        assert source.count == 40
    assert np.allclose([frame.t_s for frame in got], np.arange(40) / 30, atol=1.1e-3)
    assert [frame.index for frame in got] == list(range(40))
    assert source.lost == 0
    assert source.notes == ()


@pytest.mark.parametrize("first_s", [0.0, 0.2, 60.0])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_file_that_is_cut_is_told_wherever_its_times_begin(tmp_path, first_s, share):
    data = mux(tmp_path / "whole.mkv", "mjpeg", encode("mjpeg", 90), first_s=first_s).read_bytes()
    path = tmp_path / "cut.mkv"
    path.write_bytes(data[: int(len(data) * share)])
    got = []
    with pytest.raises(rsflow.CaptureError, match="the video is truncated: it ends after frame"):
        got.extend(rsflow.frames(path))
    assert abs(len(got) - 90 * share) < 8


def test_sound_that_goes_on_longer_does_not_make_a_file_cut(tmp_path):
    av = pytest.importorskip("av")
    path = tmp_path / "sound.mkv"
    with av.open(str(path), "w") as container:
        video = container.add_stream("mpeg4", rate=30)
        video.width, video.height, video.pix_fmt = *SIZE, "yuv420p"
        audio = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        for number in range(30):
            frame = av.VideoFrame.from_ndarray(scene(number), format="gray").reformat(format="yuv420p")
            container.mux(video.encode(frame))
        container.mux(video.encode())
        for part in range(50):
            sound = av.AudioFrame.from_ndarray(np.zeros((1, 1600), np.int16), format="s16", layout="mono")
            sound.sample_rate, sound.pts, sound.time_base = 8000, 1600 * part, Fraction(1, 8000)
            container.mux(audio.encode(sound))
    with rsflow.frames(path) as source:
        assert len(list(source)) == 30
        assert source.lost == 0


CHANGES = (
    "mjpeg.avi mjpeg.mkv mjpeg.mjpeg mpeg4.avi mpeg4.mkv libvpx.webm libvpx-vp9.webm libx264.mp4 libx264.ts "
    "libx264.h264 libx265.mkv mpeg2video.ts"
)
WHOLE = "mpeg4.mkv mpeg4.avi libx264.mp4 libx264.ts libx264.avi libx264.h264 mpeg2video.mpg libvpx.webm libvpx-vp9.webm"


@pytest.mark.parametrize("name", CHANGES.split())
@pytest.mark.parametrize("after", [(128, 96), (96, 128), (64, 80)])
def test_a_size_that_changes_within_the_stream_is_an_error(tmp_path, name, after):
    av = pytest.importorskip("av")
    codec, suffix = name.split(".")
    try:
        packets = encode(codec, 10) + encode(codec, 10, after)
    except (av.FFmpegError, ValueError) as error:
        pytest.skip(f"PyAV has no encoder: {error}")
    path = mux(tmp_path / f"change.{suffix}", codec, packets)
    got = []
    message = rf"change\.\w+: frame 10 at .* s: got {after[0]} x {after[1]} pixels, expected 64 x 48 as before"
    with pytest.raises(rsflow.ShapeError, match=message):
        got.extend(rsflow.frames(path))
    assert [frame.index for frame in got] == list(range(10))
    with pytest.raises(rsflow.ShapeError, match=message):
        list(rsflow.frames(path, start=15))
    assert len(list(rsflow.frames(path, stop=10))) == 10


@pytest.mark.parametrize("name", WHOLE.split())
def test_no_picture_is_called_lost_that_is_not(tmp_path, name):
    av = pytest.importorskip("av")
    codec, suffix = name.split(".")
    path = tmp_path / f"whole.{suffix}"
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        stream.codec_context.max_b_frames = 0 if codec.startswith("libvpx") else 2
        if codec == "libvpx":
            stream.codec_context.options = {"auto-alt-ref": "1", "lag-in-frames": "10", "deadline": "good"}
        for number in range(50):
            frame = av.VideoFrame.from_ndarray(scene(number), format="gray").reformat(format="yuv420p")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with rsflow.frames(path) as source:
        got = list(source)
        assert [frame.index for frame in got] == list(range(50))
        assert source.lost == 0
        rate = 25 if suffix == "h264" else 30
        assert suffix == "mpg" or np.allclose([frame.t_s for frame in got], np.arange(50) / rate, atol=2e-3)
        # The times of MPEG programme streams are not in order, which is told.
        assert source.notes == () or suffix == "mpg"


@pytest.mark.parametrize(
    ("codec", "suffix"), [("mjpeg", "avi"), ("mjpeg", "mkv"), ("mpeg4", "mkv"), ("libx264", "mp4")]
)
def test_pictures_that_cannot_be_decoded_keep_their_place(tmp_path, codec, suffix):
    packets = list(encode(codec, 40))
    lost = [0, 11, 12, 25, 39] if codec == "mjpeg" else [25]
    for number in lost:
        packets[number] = packets[number][:4] + bytes(len(packets[number]) - 4)
    path = mux(tmp_path / f"bad.{suffix}", codec, packets)
    kept = [number for number in range(40) if number not in lost]
    with rsflow.frames(path) as source:
        got = list(source)
        assert [frame.index for frame in got] == kept
        assert np.allclose([frame.t_s for frame in got], np.array(kept) / 30, atol=1.1e-3)
        assert source.lost == len(lost)
        assert f"{len(lost)} of 40 frames cannot be decoded, the first is frame {lost[0]}" in source.notes[0]
    # Times that are counted are those of the places too.
    assert np.allclose([frame.t_s for frame in rsflow.frames(path, frame_rate=10)], np.array(kept) / 10)
    assert [frame.t_s for frame in rsflow.frames(path, times=np.arange(40.0))] == kept
    with pytest.raises(rsflow.OptionError, match="got 41 times for the 40 frames"):
        list(rsflow.frames(path, times=np.arange(41.0)))


def test_what_is_lost_stands_in_the_report(tmp_path):
    packets = list(encode("mjpeg", 12))
    packets[5] = packets[5][:4] + bytes(len(packets[5]) - 4)
    path = mux(tmp_path / "bad.avi", "mjpeg", packets)
    done = rsflow.extract(path, tmp_path / "out")
    assert "1 of 12 frames cannot be decoded, the first is frame 5" in done.files["report"].read_text(encoding="utf-8")


def pages(count: int) -> list[np.ndarray]:
    return [np.full((24, 32, 3), 20 + 10 * number, np.uint8) for number in range(count)]


@pytest.mark.parametrize("suffix", [".webp", ".png", ".gif", ".apng"])
def test_all_frames_of_an_animation_are_read_with_their_times(tmp_path, suffix):
    if not hasattr(cv2, "imwriteanimation"):
        pytest.skip("needs OpenCV 4.11")
    animation = cv2.Animation()
    animation.frames, animation.durations = pages(5), [100, 50, 200, 70, 30]
    path = tmp_path / f"a{'.png' if suffix == '.apng' else suffix}"
    assert cv2.imwriteanimation(str(path), animation, [cv2.IMWRITE_WEBP_QUALITY, 101] if suffix == ".webp" else [])
    path = path.rename(tmp_path / f"a{suffix}")
    with rsflow.frames(path) as source:
        assert source.timestamps == "file"
        got = list(source)
    assert [frame.t_s for frame in got] == pytest.approx([0.0, 0.1, 0.15, 0.35, 0.42])
    assert [round((float(frame.image.mean()) - 20) / 10) for frame in got] == list(range(5))
    assert [frame.index for frame in rsflow.frames(path, start=1, stride=2)] == [1, 3]
    assert [frame.t_s for frame in rsflow.frames(path, times=[0, 1, 2, 3, 4])] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_all_pages_of_a_tiff_are_read(tmp_path, depth):
    path = tmp_path / "a.tif"
    assert cv2.imwritemulti(str(path), [page[..., 0].astype(depth) for page in pages(7)])
    with rsflow.frames(path) as source:
        assert source.count == 7
        got = list(source)
    assert [int(frame.image[0, 0]) for frame in got] == [20 + 10 * number for number in range(7)]
    assert all(frame.image.dtype == depth and np.isnan(frame.t_s) for frame in got)
    assert [frame.t_s for frame in rsflow.frames(path, frame_rate=10, stop=2)] == [0.0, 0.1]
    cv2.imwrite(str(tmp_path / "b.tif"), pages(1)[0])
    with pytest.raises(rsflow.CaptureError, match=r"a\.tif: holds 7 pages, expected one picture"):
        list(rsflow.frames([tmp_path / "b.tif", path]))
    with pytest.raises(rsflow.OptionError, match="got 6 times for the 7 frames"):
        rsflow.frames(path, times=np.arange(6.0))


def test_pages_of_different_sizes_are_an_error(tmp_path):
    path = tmp_path / "a.tif"
    cv2.imwritemulti(
        str(path), [np.zeros((24, 32), np.uint8), np.zeros((24, 32), np.uint8), np.zeros((8, 9), np.uint8)]
    )
    with pytest.raises(rsflow.ShapeError, match=r"frame 2: got 9 x 8 pixels, expected 32 x 24 as .*frame 0 has"):
        list(rsflow.frames(path))


def test_a_frame_that_lasts_no_time_is_told(tmp_path):
    if not hasattr(cv2, "imwriteanimation"):
        pytest.skip("needs OpenCV 4.11")
    animation = cv2.Animation()
    animation.frames, animation.durations = pages(3), [0, 0, 0]
    cv2.imwriteanimation(str(tmp_path / "a.webp"), animation)
    with rsflow.frames(tmp_path / "a.webp") as source:
        assert [frame.t_s for frame in source] == pytest.approx([0.0, 0.1, 0.2])
        assert "delay is 0" in source.notes[0]


def test_a_picture_under_a_videos_name_is_read_as_one(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((20, 30), 40000, np.uint16))
    path = (tmp_path / "a.png").rename(tmp_path / "a.mp4")
    (frame,) = rsflow.frames(path)
    assert frame.image.dtype == np.uint16


def test_a_video_of_more_than_8_bits_says_so(tmp_path):
    av = pytest.importorskip("av")
    path = tmp_path / "deep.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "gray16le"
        for number in range(4):
            image = scene(number).astype(np.uint16) * 256
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray16le")))
        container.mux(stream.encode())
    with rsflow.frames(path) as source:
        assert next(source).image.dtype == np.uint8
        assert "its pictures have 16 bits, of which OpenCV gives the upper 8" in source.notes[0]


def test_a_masked_array_is_refused_by_all_that_take_frames():
    plain = np.random.default_rng(0).integers(0, 255, (48, 64), np.uint8)
    masked = np.ma.masked_greater(plain, 100)
    calls = {
        "frames": lambda: list(rsflow.frames([masked])),
        "pairs": lambda: list(rsflow.frames([(masked, 0.0)])),
        "stack": lambda: list(rsflow.frames(np.ma.masked_greater(np.zeros((2, 48, 64), np.uint8), 1))),
        "estimate_shift": lambda: rsflow.estimate_shift(masked, plain),
        "dense_flow": lambda: rsflow.dense_flow(plain, masked),
        "DenseFlow": lambda: rsflow.DenseFlow().update(masked),
        "detect_corners": lambda: rsflow.detect_corners(masked),
        "track_points": lambda: rsflow.track_points(masked, plain, [(5, 5)]),
        "PointTracker": lambda: rsflow.PointTracker().update(masked),
        "calibrate": lambda: rsflow.calibrate([masked] * 4, board=(8, 6), square_size_m=0.02),
        "extract": lambda: rsflow.extract([masked, masked], "never"),
        "mask": lambda: rsflow.estimate_shift(plain, plain, mask=np.ma.masked_greater(plain > 3, 0)),
        "times": lambda: rsflow.frames([plain] * 2, times=np.ma.masked_greater([0.0, 1.0], 0.5)),
        "VelocityEstimator": lambda: rsflow.VelocityEstimator(
            rsflow.Camera(60, 60, 31.5, 23.5, width=64, height=48), height_m=1.0
        ).update(masked, 0.0),
    }
    for name, call in calls.items():
        try:
            call()
        except rsflow.RsflowError as error:
            assert "mask" in str(error), (name, str(error))  # noqa: PT017
        else:
            pytest.fail(f"{name} took a masked array")


def test_what_is_masked_in_a_flow_is_unknown(tmp_path):
    flow = np.ma.masked_equal(np.ones((4, 6, 2), np.float32), 2.0)
    flow[1, 2, 0] = np.ma.masked
    rsflow.write_flow(tmp_path / "a.flo", flow)
    again = rsflow.read_flow(tmp_path / "a.flo")
    assert np.argwhere(np.isnan(again).all(axis=2)).tolist() == [[1, 2]]
    assert not rsflow.flow_to_color(flow)[1, 2].any()


def test_commands_say_what_is_lost(tmp_path):
    packets = list(encode("mjpeg", 12))
    packets[5] = packets[5][:4] + bytes(len(packets[5]) - 4)
    path = mux(tmp_path / "bad.avi", "mjpeg", packets)
    for command in ("track", "segment"):
        words = [sys.executable, "-m", "rsflow", command, str(path), "-o", str(tmp_path / command)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert f"rsflow {command}: {path}: 1 of 12 frames cannot be decoded, the first is frame 5" in done.stderr


@pytest.mark.parametrize("place", [0, 5])
def test_a_damaged_packet_that_lies_of_its_size_is_no_change(tmp_path, place):
    packets = list(encode("mjpeg", 12))
    at = packets[place].index(b"\xff\xc0")
    packets[place] = packets[place][: at + 5] + b"\x3e\x80\x3e\x80" + packets[place][at + 9 :]
    path = mux(tmp_path / "bad.avi", "mjpeg", packets)
    with rsflow.frames(path) as source:
        assert [frame.index for frame in source] == [k for k in range(12) if k != place]
        assert source.lost == 1
