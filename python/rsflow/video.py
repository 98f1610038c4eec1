"""Writing pictures as a video that plays in browsers.

With PyAV (``pip install 'rsflow[video]'``) the video is H.264 and keeps the true time of every picture. Without it
OpenCV's own encoder is used: VP9, which browsers play as well, at a constant rate and some thirty times slower.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import math
import os
import shutil
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ._files import writing
from .errors import DTypeError, OptionError, ShapeError

if TYPE_CHECKING:
    from contextlib import AbstractContextManager
    from types import TracebackType

    from numpy.typing import NDArray

    Picture = NDArray[np.uint8]

__all__ = ["VideoWriter", "encoder"]

# Codec -> (encoders of FFmpeg that PyAV may have, FourCC for OpenCV); in a suffix's order of preference.
_CODECS: dict[str, tuple[tuple[str, ...], str]] = {
    "h264": (("libx264", "libopenh264"), "avc1"),
    "vp9": (("libvpx-vp9",), "vp09"),
    "mp4v": ((), "mp4v"),
}
_SUFFIXES: dict[str, tuple[str, ...]] = {".mp4": ("h264", "vp9", "mp4v"), ".webm": ("vp9",)}

# x264's constant quality, close to what the eye tells apart; of its presets "superfast" gives the same size and error
# at this quality as "veryfast" at 18, in two thirds of the time.
_OPTIONS: dict[str, dict[str, str]] = {
    "libx264": {"preset": "superfast", "crf": "20"},
    "libvpx-vp9": {"deadline": "realtime", "cpu-used": "8", "row-mt": "1", "crf": "24", "b": "0"},
}
# MPEG's clock: divides every common frame rate, and fine enough for any camera's timestamps.
_CLOCK = 90_000
# FFmpeg's numbers for "SMPTE 170M", which is BT.601's matrix, and for luma from 16 to 235.
_BT601 = 6
_LIMITED = 1


class VideoWriter:
    """Write pictures to a video; used as a context manager.

    The file is written beside its final name and renamed when it is complete. Where the body of the ``with`` raises,
    nothing is left; call `finish` first to keep the pictures so far, as an interrupted job does.

    Parameters
    ----------
    path : path
        ``.mp4`` or ``.webm``.
    frame_rate : float
        Pictures a second, from 0.001 to 1000.
    codec : {"h264", "vp9", "mp4v"}, optional
        By default the first that can be written and that browsers play; `encoder` tells which. ``"mp4v"`` is quick
        everywhere but browsers do not play it.

    Raises
    ------
    OptionError
        If the suffix, the rate or the codec is not one of these, or this codec cannot be written here.

    Notes
    -----
    Pictures of an odd width or height are padded by their last column or row, as 4:2:0 colour demands.

    Examples
    --------
    >>> import numpy as np, rsflow, tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with rsflow.VideoWriter(pathlib.Path(folder, "a.mp4"), frame_rate=25) as video:
    ...         for grey in range(0, 250, 10):
    ...             video.write(np.full((48, 64), grey, np.uint8))
    ...     print(video.frames, sorted(p.name for p in pathlib.Path(folder).iterdir()))
    25 ['a.mp4']
    """

    def __init__(self, path: str | os.PathLike[str], *, frame_rate: float, codec: str | None = None) -> None:
        self.path = Path(path)
        if not (isinstance(frame_rate, int | float | Fraction | np.number) and 1e-3 <= frame_rate <= 1e3):
            raise OptionError(f"frame_rate must be from 0.001 to 1000 pictures a second, got {frame_rate!r}")
        self.codec, self._library = encoder(self.path.suffix, codec=codec)
        self.frames = 0
        self._rate = Fraction(float(frame_rate)).limit_denominator(1001)
        self._shape: tuple[int, int] | None = None
        self._sink: _Sink | None = None
        self._file: AbstractContextManager[Path] | None = None
        self._closed = False
        self._start_s: float | None = None
        self._last_tick = -1

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.finish()
        else:
            self.discard()

    @property
    def keeps_times(self) -> bool:
        """Whether the video holds the `t_s` of each picture, not only a constant rate."""
        return self._library == "av"

    def write(self, picture: Picture, t_s: float | None = None) -> None:
        """Append a picture.

        Parameters
        ----------
        picture : ndarray of uint8, (height, width) or (height, width, 3)
            Grey, or blue, green, red as in OpenCV; all of one size.
        t_s : float, optional
            Its time in seconds; the first picture's is where the video starts. By default they follow each other at
            the frame rate. Only PyAV keeps it (`keeps_times`).

        Raises
        ------
        DTypeError, ShapeError
            If it is not such a picture, or not of the first one's size.
        OptionError
            If the video is closed, or `t_s` does not increase or is given for some pictures only.
        OSError
            If it cannot be written, a full disk for one; nothing is left then.
        """
        if self._closed:
            raise OptionError(f"{self.path} is closed: no picture can be added")
        bgr = self._checked(picture)
        tick = self._tick(t_s)
        try:
            if self._sink is None or self._file is None:
                self._open(bgr.shape[1], bgr.shape[0])
            assert self._sink is not None
            self._sink.write(bgr, tick)
        except Exception as error:
            self.discard()
            raise self._named(error) from error
        self.frames += 1
        self._last_tick = tick

    def finish(self) -> None:
        """Complete the file under its final name; a second call does nothing, nor does a call without a picture.

        Raises
        ------
        OSError
            If the file cannot be completed, a full disk for one; nothing is left then.
        """
        if self._closed:
            return
        try:
            if self._sink is not None:
                self._sink.close()
        except Exception as error:
            self.discard()
            raise self._named(error) from error
        except BaseException:
            self.discard()
            raise
        self._closed = True
        self._sink = None
        file, self._file = self._file, None
        if file is not None:
            file.__exit__(None, None, None)

    def discard(self) -> None:
        """Close the video and leave nothing of it; an older file of that name stays as it was."""
        self._closed = True
        sink, self._sink = self._sink, None
        if sink is not None:
            with contextlib.suppress(Exception):
                sink.abandon()
        file, self._file = self._file, None
        if file is not None:
            with contextlib.suppress(_Discarded):
                reason = _Discarded()
                file.__exit__(_Discarded, reason, None)

    def _checked(self, picture: Picture) -> Picture:
        array = np.asarray(picture)
        if array.dtype != np.uint8:
            raise DTypeError(f"a picture of a video must be uint8, got {array.dtype}")
        if not (array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 3)) or array.size == 0:
            raise ShapeError(f"a picture must be (height, width) or (height, width, 3), got {array.shape}")
        shape = (array.shape[0], array.shape[1])
        if self._shape is None:
            self._shape = shape
        elif shape != self._shape:
            raise ShapeError(
                f"picture {self.frames} of {self.path} is {shape[1]} x {shape[0]}, "
                f"the first was {self._shape[1]} x {self._shape[0]}"
            )
        if array.ndim == 2:
            array = np.repeat(array[..., None], 3, axis=2)
        odd = (shape[0] % 2, shape[1] % 2)
        if any(odd):
            array = np.pad(array, ((0, odd[0]), (0, odd[1]), (0, 0)), mode="edge")
        return np.ascontiguousarray(array)

    def _tick(self, t_s: float | None) -> int:
        if self.frames == 0:
            self._start_s = None if t_s is None else float(t_s)
        if (t_s is None) != (self._start_s is None):
            raise OptionError("t_s must be given for every picture of a video or for none")
        since = self.frames / self._rate if t_s is None or self._start_s is None else float(t_s) - self._start_s
        tick = round(since * _CLOCK) if math.isfinite(since) else -1
        if tick <= self._last_tick:
            raise OptionError(f"t_s must increase from picture to picture, got {t_s} s for picture {self.frames}")
        return tick

    def _open(self, width: int, height: int) -> None:
        file = writing(self.path)
        partial = file.__enter__()
        self._file = file
        sink = _AvSink if self._library == "av" else _Cv2Sink
        self._sink = sink(partial, self.codec, self._rate, width, height)

    def _named(self, error: Exception) -> Exception:
        """Give an error of the file system the name of the video; others stay as they are."""
        if isinstance(error, OSError) and error.errno is not None:
            text = os.strerror(error.errno) if error.errno > 0 else str(error)
            return OSError(error.errno, f"cannot write {self.path}: {text}")
        return error


def encoder(suffix: str = ".mp4", *, codec: str | None = None) -> tuple[str, str]:
    """Tell which codec and library a `VideoWriter` uses for files of this suffix.

    Parameters
    ----------
    suffix : {".mp4", ".webm"}
        What the file's name ends in.
    codec : {"h264", "vp9", "mp4v"}, optional
        By default the first that works: H.264, VP9, then MPEG-4, of which browsers play the first two.

    Returns
    -------
    codec : str
        ``"h264"``, ``"vp9"`` or ``"mp4v"``.
    library : {"av", "cv2"}
        PyAV, or OpenCV where PyAV is missing or does not have the codec.

    Raises
    ------
    OptionError
        If a video of this suffix and codec cannot be written here.

    Examples
    --------
    >>> import rsflow.video
    >>> rsflow.video.encoder(".webm")[0]
    'vp9'
    """
    choices = _SUFFIXES.get(suffix.lower())
    if choices is None:
        raise OptionError(f"a video's name must end in one of {', '.join(_SUFFIXES)}, got {suffix!r}")
    if codec is not None and codec not in choices:
        raise OptionError(f"codec of a {suffix} must be one of {', '.join(choices)}, got {codec!r}")
    for name in choices if codec is None else (codec,):
        for library in ("av", "cv2"):
            if _av_encoder(name) if library == "av" else _cv2_writes(name, suffix.lower()):
                return name, library
    raise OptionError(
        f"no encoder for {codec or ' or '.join(choices)} in {suffix} here: pip install 'rsflow[video]' brings H.264"
    )


@functools.cache
def _av_encoder(codec: str) -> str | None:
    """Name of PyAV's encoder for a codec, None if there is none."""
    try:
        import av
    except ImportError:
        return None
    return next((name for name in _CODECS[codec][0] if name in av.codecs_available), None)


@functools.cache
def _cv2_writes(codec: str, suffix: str) -> bool:
    """Whether OpenCV's FFmpeg writes this codec: known only by trying, as builds differ."""
    if codec == "h264":
        # Builds with H.264 need a library of the system; where it is missing they print an error of their own.
        return False
    import tempfile

    with tempfile.TemporaryDirectory(prefix="rsflow-") as folder:
        try:
            sink = _Cv2Sink(Path(folder, f"probe{suffix}"), codec, Fraction(25), 64, 64)
            sink.write(np.zeros((64, 64, 3), np.uint8), 0)
            sink.close()
        except OSError:
            return False
    return True


class _Discarded(Exception):  # noqa: N818 - a signal to `writing`, never seen outside
    """Why a partial file is removed when nothing failed."""


class _Sink(Protocol):
    """An open video: pictures of even size with their time in ticks of the clock."""

    def write(self, bgr: Picture, tick: int) -> None: ...
    def close(self) -> None: ...
    def abandon(self) -> None: ...


class _AvSink:
    """A video written by PyAV."""

    def __init__(self, path: Path, codec: str, rate: Fraction, width: int, height: int) -> None:
        import av
        import cv2

        from . import get_num_threads

        self._av = av
        self._cv2 = cv2
        name = _av_encoder(codec)
        assert name is not None
        # The index goes to the front, so that a browser starts before it has the whole file.
        options = {"movflags": "+faststart"} if path.suffix.lower() == ".mp4" else {}
        self._container = av.open(str(path), "w", options=options)
        self._stream: Any = self._container.add_stream(name, rate=rate, options=_OPTIONS.get(name, {}))
        self._stream.width, self._stream.height = width, height
        self._stream.pix_fmt = "yuv420p"
        self._stream.codec_context.time_base = Fraction(1, _CLOCK)
        self._stream.codec_context.colorspace = _BT601
        self._stream.codec_context.color_range = _LIMITED
        self._stream.codec_context.gop_size = max(1, min(250, round(2 * rate)))
        self._stream.thread_count = get_num_threads()

    def write(self, bgr: Picture, tick: int) -> None:
        # OpenCV's conversion (BT.601, as tagged) rounds; FFmpeg's own truncates, two grey levels too dark.
        yuv = self._cv2.cvtColor(bgr, self._cv2.COLOR_BGR2YUV_I420)
        frame = self._av.VideoFrame.from_ndarray(yuv, format="yuv420p")
        frame.colorspace = _BT601
        frame.color_range = _LIMITED
        frame.pts = tick
        frame.time_base = Fraction(1, _CLOCK)
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        self._container.mux(self._stream.encode(None))
        self._container.close()

    def abandon(self) -> None:
        self._container.close()


class _Cv2Sink:
    """A video written by OpenCV's own FFmpeg, at a constant rate."""

    def __init__(self, path: Path, codec: str, rate: Fraction, width: int, height: int) -> None:
        import cv2

        self._cv2 = cv2
        self._path = path
        self._frames = 0
        fourcc = cv2.VideoWriter.fourcc(*_CODECS[codec][1])
        self._writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, fourcc, float(rate), (width, height))
        if not self._writer.isOpened():
            raise self._failure(f"OpenCV cannot write {codec} as {path.suffix}")

    def write(self, bgr: Picture, _: int) -> None:
        self._writer.write(bgr)
        self._frames += 1

    def close(self) -> None:
        self._writer.release()
        # OpenCV drops what it cannot write without a word, so what it left is read back.
        video = self._cv2.VideoCapture(str(self._path), self._cv2.CAP_FFMPEG)
        frames = int(video.get(self._cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
        video.release()
        if frames != self._frames:
            raise self._failure(f"OpenCV kept {frames} of {self._frames} pictures")

    def abandon(self) -> None:
        self._writer.release()

    def _failure(self, text: str) -> OSError:
        with contextlib.suppress(OSError):
            # Less than a last buffer of the encoder: the disk is as good as full.
            if shutil.disk_usage(self._path.parent).free > 1 << 18:
                return OSError(errno.EIO, text)
        return OSError(errno.ENOSPC, text)
