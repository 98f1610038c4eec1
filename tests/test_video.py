"""Videos: what is read back, true times, interruption, a full disk, and both encoders."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import video
from rsflow.video import VideoWriter, encoder


def clip(frames: int = 20, height: int = 120, width: int = 160) -> list[np.ndarray]:
    """Colour waves that move: smooth, as 4:2:0 demands, and different in every frame."""
    y, x = np.mgrid[:height, :width]
    grey = [128 + 60 * np.sin((x + 2 * k) / 9) + 50 * np.cos(y / 7) for k in range(frames)]
    return [np.dstack([g, g // 2 + 40, 255 - g]).clip(0, 255).astype(np.uint8) for g in grey]


def read_back(path: Path) -> list[np.ndarray]:
    capture = cv2.VideoCapture(str(path))
    pictures = []
    while True:
        done, picture = capture.read()
        if not done:
            capture.release()
            return pictures
        pictures.append(picture)


@pytest.fixture(params=["av", "cv2"])
def library(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """With PyAV, and as if it were not installed."""
    if request.param == "av":
        pytest.importorskip("av")
    else:
        monkeypatch.setattr(video.sinks, "av_encoder", lambda codec: None)
    return request.param


@pytest.mark.parametrize(("suffix", "codec"), [(".mp4", None), (".webm", None), (".mp4", "vp9"), (".mp4", "mp4v")])
def test_what_is_written_is_read_back(tmp_path: Path, library: str, suffix: str, codec: str | None) -> None:
    pictures = clip()
    path = tmp_path / f"a{suffix}"
    with VideoWriter(path, frame_rate=29.97, codec=codec) as writer:
        for picture in pictures:
            writer.write(picture)
            assert not path.exists(), "nothing may stand under the final name before the end"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    back = read_back(path)
    assert len(back) == len(pictures) == writer.frames
    psnr = [cv2.PSNR(a, b) for a, b in zip(back, pictures, strict=True)]
    assert min(psnr) > 33, (writer.codec, psnr)
    # Colour and brightness stay: PyAV is given rounded 4:2:0, OpenCV's FFmpeg truncates by some grey levels.
    assert np.abs(np.mean(back, (0, 1, 2)) - np.mean(pictures, (0, 1, 2))).max() < (1.5 if writer.keeps_times else 4)
    capture = cv2.VideoCapture(str(path))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(29.97, rel=1e-3)


def test_which_encoder(library: str) -> None:
    assert encoder(".mp4") == (("h264", "av") if library == "av" else ("vp9", "cv2"))
    assert encoder(".webm") == ("vp9", library)
    assert encoder(".MP4", codec="mp4v") == ("mp4v", "cv2")
    if library == "cv2":
        with pytest.raises(rsflow.OptionError, match="no encoder for h264"):
            encoder(".mp4", codec="h264")


def test_h264_is_what_browsers_demand(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    path = tmp_path / "a.mp4"
    with VideoWriter(path, frame_rate=25) as writer:
        for picture in clip(3):
            writer.write(picture)
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat"), "the index must come first, for streaming"
    with av.open(str(path)) as container:
        context = container.streams.video[0].codec_context
        assert (context.name, context.pix_fmt) == ("h264", "yuv420p")


def test_true_times_are_kept(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    path = tmp_path / "a.mp4"
    times = [100.0, 100.04, 100.05, 100.2, 100.9, 101.0]
    with VideoWriter(path, frame_rate=25) as writer:
        assert writer.keeps_times
        for picture, t_s in zip(clip(6), times, strict=True):
            writer.write(picture, t_s)
    with av.open(str(path)) as container:
        back = [frame.time for frame in container.decode(video=0)]
    np.testing.assert_allclose(back, np.subtract(times, times[0]), atol=1e-4)


@pytest.mark.parametrize("shape", [(75, 101), (1, 1), (2, 33), (33, 2)])
def test_odd_sizes_are_padded_and_grey_is_grey(tmp_path: Path, library: str, shape: tuple[int, int]) -> None:
    path = tmp_path / "a.mp4"
    picture = np.full(shape, 90, np.uint8)
    with VideoWriter(path, frame_rate=10) as writer:
        for _ in range(3):
            writer.write(picture)
    back = read_back(path)
    assert len(back) == 3
    assert back[0].shape == (shape[0] + shape[0] % 2, shape[1] + shape[1] % 2, 3)
    assert np.abs(back[1].astype(int) - 90).max() <= (2 if library == "av" else 4)


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_exception_leaves_nothing_and_the_old_file(tmp_path: Path, library: str, error: type[BaseException]) -> None:
    path = tmp_path / "a.mp4"
    path.write_bytes(b"old")

    def interrupted() -> None:
        with VideoWriter(path, frame_rate=25) as writer:
            writer.write(clip(1)[0])
            raise error

    with pytest.raises(error):
        interrupted()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_finish_keeps_what_an_interrupted_job_has(tmp_path: Path, library: str) -> None:
    path = tmp_path / "a.mp4"

    def interrupted() -> None:
        with VideoWriter(path, frame_rate=25) as writer:
            try:
                for picture in clip(5):
                    writer.write(picture)
                raise KeyboardInterrupt
            except KeyboardInterrupt:
                writer.finish()
                raise

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert len(read_back(path)) == 5


def test_a_video_without_pictures_is_no_file(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "a.mp4", frame_rate=25) as writer:
        pass
    assert writer.frames == 0
    assert list(tmp_path.iterdir()) == []


def test_misuse_says_what_is_wrong(tmp_path: Path) -> None:
    for rate in (0, -1, float("nan"), float("inf"), 2000, "25"):
        with pytest.raises(
            rsflow.OptionError,
            match=r"frame_rate: got .*, expected a finite number of pictures a second from 0\.001 to 1000",
        ):
            VideoWriter(tmp_path / "a.mp4", frame_rate=rate)
    with pytest.raises(rsflow.OptionError, match=r'path: got ".*a\.gif", expected a name that ends in \.mp4 or \.webm'):
        VideoWriter(tmp_path / "a.gif", frame_rate=25)
    with pytest.raises(rsflow.OptionError, match='codec: got "h264", expected "vp9"'):
        VideoWriter(tmp_path / "a.webm", frame_rate=25, codec="h264")
    for threads in (0, -1, 2.5, 10_000):
        with pytest.raises(rsflow.RsflowError, match=r"threads: got .*, expected an integer from 1 to 1024"):
            VideoWriter(tmp_path / "a.mp4", frame_rate=25, threads=threads)
    picture = np.zeros((16, 16), np.uint8)
    with VideoWriter(tmp_path / "a.mp4", frame_rate=25, threads=1) as writer:
        with pytest.raises(rsflow.DTypeError, match="picture: got dtype float64, expected uint8"):
            writer.write(picture / 2)
        for bad in (np.zeros((0, 4), np.uint8), np.zeros((4, 4, 4), np.uint8), np.zeros(4, np.uint8)):
            with pytest.raises(rsflow.ShapeError, match="picture: got shape"):
                writer.write(bad)
        writer.write(picture, 1.0)
        with pytest.raises(
            rsflow.ShapeError,
            match=r"picture: got 16 x 15 pixels for picture 1 of .*, expected those of the first, 16 x 16",
        ):
            writer.write(picture[1:], 2.0)
        for t_s in (1.0, 0.5, float("nan")):
            with pytest.raises(rsflow.OptionError, match="t_s: got"):
                writer.write(picture, t_s)
        with pytest.raises(rsflow.OptionError, match="t_s: got None for picture 1, expected a time for every picture"):
            writer.write(picture)
    with pytest.raises(rsflow.OptionError, match="closed"):
        writer.write(picture, 9.0)
    assert len(read_back(tmp_path / "a.mp4")) == 1


FULL_DISK = """
import resource, sys
import numpy as np
from rsflow import video
if sys.argv[2] == "cv2":
    video.sinks.av_encoder = lambda codec: None
noise = np.random.default_rng(1).integers(0, 255, (30, 144, 176, 3), np.uint8)
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
try:
    with video.VideoWriter(sys.argv[1], frame_rate=25, codec=sys.argv[3]) as writer:
        for picture in noise:
            writer.write(picture)
except OSError as error:
    print("OSError", error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="RLIMIT_FSIZE is POSIX")
@pytest.mark.parametrize(("library", "codec"), [("av", "h264"), ("cv2", "mp4v"), ("cv2", "vp9")])
def test_a_full_disk_is_an_error_and_leaves_nothing(tmp_path: Path, library: str, codec: str) -> None:
    if library == "av":
        pytest.importorskip("av")
    path = tmp_path / "a.mp4"
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(path), library, codec], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("OSError [Errno ")
    assert f"cannot write {path}: " in done.stdout
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(OSError, match=r"cannot write .*a\.mp4"),
        VideoWriter(tmp_path / "file" / "a.mp4", frame_rate=25) as writer,
    ):
        writer.write(np.zeros((16, 16), np.uint8))


@pytest.mark.parametrize("library", ["av", "cv2"])
def test_a_forgotten_writer_does_not_hang_the_exit(tmp_path: Path, library: str) -> None:
    code = (
        "import sys, numpy as np\nfrom rsflow import video\n"
        f"if {library!r} == 'cv2': video.sinks.av_encoder = lambda codec: None\n"
        "writer = video.VideoWriter(sys.argv[1], frame_rate=25)\n"
        "for _ in range(30): writer.write(np.zeros((64, 64), np.uint8))\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "a.mp4")], capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "a.mp4").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="names that are no text are for Linux")
@pytest.mark.parametrize("suffix", [".mp4", ".webm", ".avi", ".\udcff"])
def test_names_that_are_no_text_are_read_and_written(tmp_path: Path, library: str, suffix: str) -> None:
    # In a process of its own: OpenCV ends the process at a name that is no UTF-8.
    code = f"""
import os, sys, numpy as np, rsflow
from rsflow import video
if {library!r} == "cv2":
    video.sinks.av_encoder = lambda _: None
path, suffix = os.fsdecode(b"\\xff\\xfe clip"), {suffix!a}
pictures = [np.full((48, 64), grey, np.uint8) for grey in (0, 100, 200)]
if suffix == ".avi":
    video.write_lossless(path + suffix, pictures, frame_rate=30)
else:
    first = path + (".webm" if suffix == ".webm" else ".mp4")
    with rsflow.VideoWriter(first, frame_rate=30) as out:
        for picture in pictures:
            out.write(picture)
    os.rename(first, path + suffix)
read = [frame.image.mean() for frame in rsflow.frames(path + suffix)]
assert np.abs(np.array(read) - (0, 100, 200)).max() < 4, read
assert os.listdir(".") == [path + suffix], os.listdir(".")
"""
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True, timeout=60)
