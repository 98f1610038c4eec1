"""How `rsflow.video` encodes: PyAV's encoders or OpenCV's own, behind one small interface."""

from __future__ import annotations

import contextlib
import errno
import functools
import shutil
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from .._core import get_num_threads
from ..io.fork_guard import OfProcess, opening
from ..io.native_names import native_name

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Picture = NDArray[np.uint8]

# Codec -> (encoders of FFmpeg that PyAV may have, FourCC for OpenCV); in a suffix's order of preference.
CODECS: dict[str, tuple[tuple[str, ...], str]] = {
    "h264": (("libx264", "libopenh264"), "avc1"),
    "vp9": (("libvpx-vp9",), "vp09"),
    "mp4v": ((), "mp4v"),
    "ffv1": ((), "FFV1"),
}

# x264's constant quality, close to what the eye tells apart; of its presets "superfast" gives the same size and error
# at this quality as "veryfast" at 18, in two thirds of the time.
_OPTIONS: dict[str, dict[str, str]] = {
    "libx264": {"preset": "superfast", "crf": "20"},
    "libvpx-vp9": {"deadline": "realtime", "cpu-used": "8", "row-mt": "1", "crf": "24", "b": "0"},
}
# MPEG's clock: divides every common frame rate, and fine enough for any camera's timestamps.
CLOCK = 90_000
# FFmpeg's numbers for "SMPTE 170M", which is BT.601's matrix, and for luma from 16 to 235.
_BT601 = 6
_LIMITED = 1


class Sink(Protocol):
    """An open video: pictures of even size with their time in ticks of the clock."""

    def write(self, bgr: Picture, tick: int) -> None:
        """Add a picture at a time."""

    def close(self) -> None:
        """End the video; raises where it was not written whole."""

    def abandon(self) -> None:
        """Let go of a video that is not wanted any more."""


class AvSink(OfProcess):
    """A video written by PyAV."""

    def __init__(
        self, path: Path, codec: str, rate: Fraction, width: int, height: int, threads: int | None = None
    ) -> None:
        with opening:
            import av
            import cv2

        self._av = av
        self._cv2 = cv2
        name = av_encoder(codec)
        assert name is not None
        # The index goes to the front, so that a browser starts before it has the whole file.
        options = {"movflags": "+faststart"} if path.suffix.lower() == ".mp4" else {}
        # The index is moved by opening the file once more, by its name.
        self._named = contextlib.ExitStack()
        name_here = self._named.enter_context(native_name(path))
        with opening:
            self._container = av.open(name_here, "w", options=options)
        self._stream: Any = self._container.add_stream(name, rate=rate, options=_OPTIONS.get(name, {}))
        self._stream.width, self._stream.height = width, height
        self._stream.pix_fmt = "yuv420p"
        self._stream.codec_context.time_base = Fraction(1, CLOCK)
        self._stream.codec_context.colorspace = _BT601
        self._stream.codec_context.color_range = _LIMITED
        self._stream.codec_context.gop_size = max(1, min(250, round(2 * rate)))
        self._stream.thread_count = get_num_threads() if threads is None else threads

    def write(self, bgr: Picture, tick: int) -> None:
        """Add a picture at a time."""
        # OpenCV's conversion (BT.601, as tagged) rounds; FFmpeg's own truncates, two grey levels too dark.
        yuv = self._cv2.cvtColor(bgr, self._cv2.COLOR_BGR2YUV_I420)
        frame = self._av.VideoFrame.from_ndarray(yuv, format="yuv420p")
        frame.colorspace = _BT601
        frame.color_range = _LIMITED
        frame.pts = tick
        frame.time_base = Fraction(1, CLOCK)
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        """End the video."""
        with self._named:
            self._container.mux(self._stream.encode(None))
            with opening:
                self._container.close()

    def abandon(self) -> None:
        """Let go of a video that is not wanted any more."""
        if self._elsewhere:
            return
        with self._named, opening:
            self._container.close()


class Cv2Sink(OfProcess):
    """A video written by OpenCV's own FFmpeg, at a constant rate."""

    def __init__(self, path: Path, codec: str, rate: Fraction, width: int, height: int) -> None:
        with opening:
            import cv2

        from ..io.opencv_files import quiet

        self._cv2 = cv2
        self._quiet = quiet
        self._path = path
        self._frames = 0
        fourcc = cv2.VideoWriter.fourcc(*CODECS[codec][1])
        self._named = contextlib.ExitStack()
        name = self._named.enter_context(native_name(path))
        with opening:
            self._writer = cv2.VideoWriter(name, cv2.CAP_FFMPEG, fourcc, float(rate), (width, height))
        if not self._writer.isOpened():
            raise self._failure(f"OpenCV cannot write {codec} as {path.suffix}")

    def write(self, bgr: Picture, _: int) -> None:
        """Add a picture; times are even here."""
        # What cannot be written is told by `close`, once.
        with self._quiet():
            self._writer.write(bgr)
        self._frames += 1

    def close(self) -> None:
        """End the video; raises where the file does not hold what was written."""
        from ..io.opencv_files import open_capture

        with self._quiet(), self._named, opening:
            self._writer.release()
        # OpenCV drops what it cannot write without a word, so what it left is read back.
        video = open_capture(str(self._path))
        frames = int(video.get(self._cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
        video.release()
        if frames != self._frames:
            raise self._failure(f"OpenCV kept {frames} of {self._frames} pictures")

    def abandon(self) -> None:
        """Let go of a video that is not wanted any more."""
        if self._elsewhere:
            return
        with self._named, opening:
            self._writer.release()

    def _failure(self, text: str) -> OSError:
        with contextlib.suppress(OSError):
            # Less than a last buffer of the encoder: the disk is as good as full.
            if shutil.disk_usage(self._path.parent).free > 1 << 18:
                return OSError(errno.EIO, text)
        return OSError(errno.ENOSPC, text)


@functools.cache
def av_encoder(codec: str) -> str | None:
    """Name of PyAV's encoder for a codec, None if there is none."""
    try:
        with opening:
            import av
    except ImportError:
        return None
    return next((name for name in CODECS[codec][0] if name in av.codecs_available), None)


@functools.cache
def cv2_writes(codec: str, suffix: str) -> bool:
    """Whether OpenCV's FFmpeg writes this codec: known only by trying, as builds differ."""
    if codec == "h264":
        # Builds with H.264 need a library of the system; where it is missing they print an error of their own.
        return False
    import tempfile

    with tempfile.TemporaryDirectory(prefix="rsflow-") as folder:
        try:
            sink = Cv2Sink(Path(folder, f"probe{suffix}"), codec, Fraction(25), 64, 64)
            sink.write(np.zeros((64, 64, 3), np.uint8), 0)
            sink.close()
        except OSError:
            return False
    return True
