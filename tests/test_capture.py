"""Frames of videos, pictures and arrays, and their times."""

from __future__ import annotations

import subprocess
import sys
from fractions import Fraction
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


def pictures(count: int, size: tuple[int, int] = (64, 48), step: int = 4) -> list[np.ndarray]:
    """Grey pictures whose mean tells their number: `step` grey levels apart."""
    return [np.full((size[1], size[0]), 8 + step * i, np.uint8) for i in range(count)]


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


def write_with_times(path: Path, times_ms: list[int], *, codec: str = "mpeg4", b_frames: int = 0) -> Path:
    """A video whose frame i is shown at times_ms[i], written by PyAV."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30)
        pixels = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        stream.width, stream.height, stream.pix_fmt = 64, 48, pixels
        stream.bit_rate = 4_000_000
        stream.codec_context.time_base = Fraction(1, 1000)
        stream.codec_context.max_b_frames = b_frames
        for image, pts in zip(pictures(len(times_ms), step=8), times_ms, strict=True):
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format=pixels)
            frame.pts, frame.time_base = pts, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def times_of_pyav(path: Path) -> list[float]:
    av = pytest.importorskip("av")
    with av.open(str(path)) as container:
        got = [frame.time for frame in container.decode(video=0)]
    return [time - got[0] for time in got]


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
@pytest.mark.parametrize("b_frames", [0, 2])
def test_a_variable_rate_keeps_the_times_of_the_file(tmp_path, suffix, b_frames):
    rng = np.random.default_rng(5)
    times = np.concatenate([[0], np.cumsum(rng.integers(11, 180, 29))]).tolist()
    path = write_with_times(tmp_path / f"clip.{suffix}", times, b_frames=b_frames)
    with rsflow.frames(path) as source:
        got = list(source)
        assert source.timestamps == "file"
        assert source.notes == ()
    assert np.allclose([frame.t_s for frame in got], np.array(times) / 1000.0, atol=1e-6)
    assert np.allclose([frame.t_s for frame in got], times_of_pyav(path), atol=1e-6)
    # The reading that the file's times replace is far off.
    assert np.abs(np.arange(30) / source.frame_rate - np.array(times) / 1000.0).max() > 0.1


def test_decoding_times_written_as_presentation_times_are_sorted(tmp_path):
    av = pytest.importorskip("av")
    good = write_with_times(tmp_path / "good.mkv", [33 * i for i in range(30)], b_frames=2)
    bad = tmp_path / "bad.mkv"
    with av.open(str(good)) as source, av.open(str(bad), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        # In the order of the packets, which is that of decoding.
        for number, packet in enumerate(p for p in source.demux(video=0) if p.dts is not None):
            packet.pts = packet.dts = 33 * number
            packet.stream = stream
            target.mux(packet)
    assert np.any(np.diff(times_of_pyav(bad)) < 0)
    with rsflow.frames(bad) as source:
        got = list(source)
        assert "sorted timestamps" in source.notes[0]
    assert [round((float(frame.image.mean()) - 8) / 8) for frame in got] == list(range(30))
    assert np.allclose([frame.t_s for frame in got], 0.033 * np.arange(30), atol=2e-3)
    with rsflow.frames(bad, start=4, stride=5, stop=27) as source:
        assert [frame.index for frame in source] == list(range(4, 27, 5))


def test_a_stream_without_timestamps_says_so(tmp_path):
    path = write_with_times(tmp_path / "clip.mjpeg", [33 * i for i in range(12)], codec="mjpeg")
    with rsflow.frames(path) as source:
        got = [frame.t_s for frame in source]
        assert source.timestamps == "rate"
        assert np.allclose(got, np.arange(12) / source.frame_rate)


def test_a_dropped_frame_is_a_gap_not_a_truncated_file(tmp_path):
    times = [40 * i for i in range(30) if i not in (7, 8, 9, 20)]
    path = write_with_times(tmp_path / "clip.mkv", times)
    with rsflow.frames(path) as source:
        got = [frame.t_s for frame in source]
    assert np.allclose(got, np.array(times) / 1000.0, atol=1e-6)


@pytest.mark.parametrize(("suffix", "fourcc"), [("avi", "MJPG"), ("mkv", "mp4v")])
def test_a_truncated_video_gives_what_it_has_and_then_says_so(tmp_path, suffix, fourcc):
    whole = write_video(tmp_path / f"whole.{suffix}", 60, 25.0, fourcc)
    data = whole.read_bytes()
    path = tmp_path / f"cut.{suffix}"
    path.write_bytes(data[: len(data) * 6 // 10])
    got = []
    with pytest.raises(rsflow.CaptureError, match=r"cut\.\w+: the video is truncated: it ends after frame \d+ at"):
        got.extend(rsflow.frames(path))
    assert 20 <= len(got) < 50
    assert [frame.index for frame in got] == list(range(len(got)))


def test_a_video_that_cannot_be_read_says_why(tmp_path):
    whole = write_video(tmp_path / "whole.mp4", 30, 25.0, "mp4v").read_bytes()
    (tmp_path / "headless.mp4").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty.mp4").write_bytes(b"")
    (tmp_path / "text.mp4").write_text("not a video at all\n" * 20)
    with pytest.raises(rsflow.CaptureError, match=r"missing\.mp4: no such file"):
        rsflow.frames(tmp_path / "missing.mp4")
    with pytest.raises(rsflow.CaptureError, match=r"empty\.mp4: the file is empty"):
        rsflow.frames(tmp_path / "empty.mp4")
    for name in ("headless", "text"):
        with pytest.raises(rsflow.CaptureError, match=rf"{name}\.mp4 \(\d+ bytes\): cannot be opened as a video"):
            rsflow.frames(tmp_path / f"{name}.mp4")
    # The libraries below say nothing of their own. In a process whose first video is ours: OpenCV asks only once.
    script = """if True:
        import sys, rsflow
        for path in sys.argv[1:]:
            try:
                print(len(list(rsflow.frames(path))))
            except rsflow.CaptureError:
                print("no")
        """
    cut = tmp_path / "cut.avi"
    data = write_video(tmp_path / "whole.avi", 60, 25.0).read_bytes()
    cut.write_bytes(data[: len(data) * 6 // 10])
    files = [tmp_path / "headless.mp4", tmp_path / "text.mp4", cut, tmp_path / "whole.avi"]
    done = subprocess.run([sys.executable, "-c", script, *files], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["no", "no", "no", "60"]
    assert done.stderr == ""


def test_a_video_without_frames_says_so(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "none.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (64, 48))
    writer.release()
    with pytest.raises(rsflow.CaptureError, match=r"none\.avi.*(no frame that can be decoded|cannot be opened)"):
        rsflow.frames(tmp_path / "none.avi")


def write_pictures(folder: Path, names: list[str], size: tuple[int, int] = (64, 48)) -> Path:
    folder.mkdir(exist_ok=True)
    for name, image in zip(names, pictures(len(names), size), strict=True):
        cv2.imwrite(str(folder / name), image)
    return folder


def test_pictures_come_in_natural_order_from_folder_glob_pattern_and_list(tmp_path):
    names = [f"img{i}.png" for i in range(12)]
    folder = write_pictures(tmp_path / "p", names)
    (folder / "notes.txt").write_text("not a picture")
    (folder / ".hidden.png").write_bytes(b"")
    sources = [folder, str(folder), str(folder / "img*.png"), str(folder / "img%d.png"), [folder / n for n in names]]
    for source in sources:
        with rsflow.frames(source) as got:
            assert got.count == 12
            assert got.size == (64, 48)
            assert got.timestamps == "none"
            assert numbers(got) == list(range(12))
    frame = next(rsflow.frames(folder / "img3.png"))
    assert Path(frame.name).name == "img3.png"
    assert np.isnan(frame.t_s)


def test_pictures_take_their_times_from_a_rate_a_list_or_a_csv(tmp_path):
    folder = write_pictures(tmp_path / "p", ["a.png", "b.png", "c.png"])
    given = [0.5, 0.61, 0.9]
    table = tmp_path / "times.csv"
    table.write_text("frame,t_s\n0,0.5\n1,0.61\n2,0.9\n")
    column = tmp_path / "column.csv"
    column.write_text("# seconds\n0.5\n0.61\n0.9\n")
    for times in (given, np.array(given), table, str(column)):
        source = rsflow.frames(folder, times=times)
        assert source.timestamps == "given"
        assert [frame.t_s for frame in source] == given
    assert [f.t_s for f in rsflow.frames(folder, frame_rate=20.0, start=1)] == [0.05, 0.1]
    pairs = list(zip(pictures(3), given, strict=True))
    assert [f.t_s for f in rsflow.frames(pairs)] == given
    assert [f.t_s for f in rsflow.frames(list(rsflow.frames(pairs)))] == given


def test_a_rate_overrules_a_slow_motion_clip(tmp_path):
    path = write_video(tmp_path / "slow.avi", 10, 25.0)
    source = rsflow.frames(path, frame_rate=240.0)
    assert source.timestamps == "given"
    assert np.allclose([f.t_s for f in source], np.arange(10) / 240.0)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.0, 1.0], "got 2 times for the 3 frames"),
        ([0.0, 1.0, 1.0], "got 1.0 s for frame 2 after 1.0 s, expected strictly increasing"),
        ([0.0, float("nan"), 2.0], "expected one finite time"),
    ],
)
def test_times_that_cannot_be_are_refused(times, message):
    with pytest.raises(rsflow.OptionError, match=message):
        rsflow.frames(pictures(3), times=times)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "got an empty file"),
        ("a,b\n1,2\n", "got the columns a, b, expected one that is called t_s"),
        ("t_s\n0.0\nsoon\n", "row 3: got 'soon', expected a time in seconds"),
    ],
)
def test_a_csv_of_times_that_is_none_is_refused(tmp_path, text, message):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(rsflow.FormatError, match=message):
        rsflow.frames(pictures(3), times=tmp_path / "t.csv")
    with pytest.raises(rsflow.CaptureError, match="no such file"):
        rsflow.frames(pictures(3), times=tmp_path / "missing.csv")


def test_depth_is_kept_and_colour_is_given_when_asked_for(tmp_path):
    deep = np.arange(48 * 64, dtype=np.uint16).reshape(48, 64) * 20
    cv2.imwrite(str(tmp_path / "deep.png"), deep)
    frame = next(rsflow.frames(tmp_path / "deep.png", color=True))
    assert frame.image.dtype == np.uint16
    assert np.array_equal(frame.image, deep)
    assert frame.color.shape == (48, 64, 3)
    bgr = np.zeros((4, 5, 3), np.uint8)
    bgr[:] = (200, 100, 50)
    frame = next(rsflow.frames([bgr], color=True, roi=(1, 2, 3, 2)))
    assert frame.image.shape == (2, 3)
    assert frame.color.shape == (2, 3, 3)
    # ITU-R BT.601: 0.114 B + 0.587 G + 0.299 R.
    assert abs(int(frame.image[0, 0]) - round(0.114 * 200 + 0.587 * 100 + 0.299 * 50)) <= 1
    assert next(rsflow.frames([bgr], grey=False)).image.shape == (4, 5, 3)
    float_frame = next(rsflow.frames(np.ones((2, 4, 5), np.float32)))
    assert float_frame.image.dtype == np.float32


def test_the_region_is_cut_without_a_copy():
    image = pictures(1)[0]
    frame = next(rsflow.frames([image], roi=(10, 20, 30, 12)))
    assert frame.image.shape == (12, 30)
    assert np.shares_memory(frame.image, image)
    with pytest.raises(rsflow.OptionError, match=r"\(40, 20, 30, 12\), expected a region inside the 64 x 48"):
        rsflow.frames([image], roi=(40, 20, 30, 12))
    with pytest.raises(rsflow.OptionError, match=r"roi: got .*four integers"):
        rsflow.frames([image], roi=(1, 2, 3))


def test_pictures_that_differ_are_named_with_their_sizes(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((48, 64), np.uint8))
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((24, 32), np.uint8))
    with pytest.raises(rsflow.ShapeError, match=r"b\.png: got 32 x 24 pixels, expected 64 x 48 as .*a\.png has"):
        list(rsflow.frames(tmp_path))
    with pytest.raises(rsflow.ShapeError, match=r"frame 1: got 6 x 4 pixels, expected 64 x 48 as .*frame 0 has"):
        list(rsflow.frames([np.zeros((48, 64), np.uint8), np.zeros((4, 6), np.uint8)]))
    with pytest.raises(rsflow.DTypeError, match=r"frame 1: got uint16, expected uint8 as .*frame 0 has"):
        list(rsflow.frames([np.zeros((4, 6), np.uint8), np.zeros((4, 6), np.uint16)]))


def test_pictures_that_are_broken_are_named(tmp_path, capfd):
    image = np.random.default_rng(0).integers(0, 255, (200, 200), np.uint8)
    for suffix in ("jpg", "png"):
        data = cv2.imencode(f".{suffix}", image)[1].tobytes()
        (tmp_path / f"cut.{suffix}").write_bytes(data[: len(data) // 2])
        with pytest.raises(rsflow.CaptureError, match=rf"cut\.{suffix}: the picture is truncated"):
            rsflow.frames(tmp_path / f"cut.{suffix}")
    (tmp_path / "text.bmp").write_text("hello")
    with pytest.raises(rsflow.CaptureError, match=r"text\.bmp: cannot be decoded as a picture \(5 bytes\)"):
        rsflow.frames([tmp_path / "text.bmp"])
    with pytest.raises(rsflow.CaptureError, match=r"gone\.png: cannot be read: No such file"):
        rsflow.frames([tmp_path / "gone.png"])
    (tmp_path / "zero.png").write_bytes(b"")
    with pytest.raises(rsflow.CaptureError, match=r"zero\.png: the file is empty"):
        rsflow.frames([tmp_path / "zero.png"])
    assert capfd.readouterr().err == ""


def test_a_closed_source_ends(tmp_path):
    source = rsflow.frames(write_video(tmp_path / "clip.avi", 5, 25.0))
    next(source)
    source.close()
    source.close()
    assert list(source) == []
    assert "64 x 48" in repr(source)


def test_none_is_not_taken_for_the_end():
    """cv2.imread gives None for a picture that it cannot read: what comes after must not be lost in silence."""
    picture = np.zeros((4, 5), np.uint8)
    source = rsflow.frames([picture, None, picture])
    next(source)
    with pytest.raises(rsflow.DTypeError, match="item 1: got NoneType"):
        next(source)
