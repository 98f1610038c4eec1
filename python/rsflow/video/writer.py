"""Writing pictures as a video that plays in browsers.

With PyAV (``pip install 'rsflow-motion[video]'``) the video is H.264 and keeps the true time of every picture. Without
it OpenCV's own encoder is used: VP9, which browsers play as well, at a constant rate and some thirty times slower.
"""

from __future__ import annotations

import contextlib
import os
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from .. import _checks
from ..errors import DTypeError, OptionError, ShapeError
from ..io.atomic import Working, writing
from ..io.fork_guard import OfProcess
from . import sinks

if TYPE_CHECKING:
    from collections.abc import Iterable
    from types import TracebackType

    from numpy.typing import NDArray

    Picture = NDArray[np.uint8]

__all__ = ["VideoWriter", "encoder", "write_lossless"]

# A video that is longer is an error of its times: a century.
_LONGEST_S = 3.2e9

_SUFFIXES: dict[str, tuple[str, ...]] = {".mp4": ("h264", "vp9", "mp4v"), ".webm": ("vp9",)}


class VideoWriter(OfProcess):
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
    threads : int, optional
        Threads of the encoder; by default those of `rsflow.set_num_threads`.

    Raises
    ------
    OptionError
        If the suffix, the rate or the codec is not one of these, the codec cannot be written here, or there are no
        such threads.

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

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        frame_rate: float,
        codec: str | None = None,
        threads: int | None = None,
    ) -> None:
        self.path = _checks.file_name("path", path, tuple(_SUFFIXES))
        rate = _rate(frame_rate)
        self._threads = None if threads is None else _checks.integer("threads", threads, least=1, most=1024)
        self.codec, self._library = encoder(self.path.suffix, codec=codec)
        self.frames = 0
        self._rate = rate
        self._shape: tuple[int, int] | None = None
        self._sink: sinks.Sink | None = None
        self._file: Working | None = None
        self._closed = False
        self._start_s: float | None = None
        self._last_tick = -1

    def __repr__(self) -> str:
        state = f"{self.frames} frames, {'closed' if self._closed else 'open'}"
        return f'VideoWriter("{self.path}", {self.codec}, {float(self._rate):g} frames/s): {state}'

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._elsewhere:
            return
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
        RsflowError
            In a child of ``fork()``: the process that made the writer alone writes with it.
        """
        self._expect_here(str(self.path))
        if self._closed:
            raise OptionError(f"picture: got one for {self.path}, which is closed, expected none after finish()")
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
        self._expect_here(str(self.path))
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
            file.keep()

    def discard(self) -> None:
        """Close the video and leave nothing of it; an older file of that name stays as it was."""
        if self._elsewhere:
            # It is the parent's to go on with.
            return
        self._closed = True
        sink, self._sink = self._sink, None
        if sink is not None:
            with contextlib.suppress(Exception):
                sink.abandon()
        file, self._file = self._file, None
        if file is not None:
            file.discard()

    def _checked(self, picture: Picture) -> Picture:
        array = _checks.picture("picture", picture, uint8_only=True)
        shape = (array.shape[0], array.shape[1])
        if self._shape is None:
            self._shape = shape
        elif shape != self._shape:
            raise ShapeError(
                f"picture: got {shape[1]} x {shape[0]} pixels for picture {self.frames} of {self.path}, "
                f"expected those of the first, {self._shape[1]} x {self._shape[0]}"
            )
        if array.ndim == 2:
            array = np.repeat(array[..., None], 3, axis=2)
        odd = (shape[0] % 2, shape[1] % 2)
        if any(odd):
            array = np.pad(array, ((0, odd[0]), (0, odd[1]), (0, 0)), mode="edge")
        return np.ascontiguousarray(array)

    def _tick(self, t_s: float | None) -> int:
        t_s = _checks.number_or_none("t_s", t_s, of="seconds")
        if self.frames == 0:
            self._start_s = t_s
        if (t_s is None) != (self._start_s is None):
            raise OptionError(
                f"t_s: got {t_s} for picture {self.frames}, expected a time for every picture or for none"
            )
        since = self.frames / self._rate if t_s is None or self._start_s is None else t_s - self._start_s
        if not since <= _LONGEST_S:
            raise OptionError(f"t_s: got {t_s} s for picture {self.frames}, expected at most {_LONGEST_S:g} s of video")
        tick = round(since * sinks.CLOCK)
        if tick <= self._last_tick:
            raise OptionError(f"t_s: got {t_s} s for picture {self.frames}, expected more than for the one before")
        return tick

    def _open(self, width: int, height: int) -> None:
        self._file = Working(self.path)
        args = (self._file.path, self.codec, self._rate, width, height)
        self._sink = sinks.AvSink(*args, self._threads) if self._library == "av" else sinks.Cv2Sink(*args)

    def _named(self, error: Exception) -> Exception:
        """Give an error of the file system the name of the video; others stay as they are."""
        if isinstance(error, OSError) and error.errno is not None:
            text = os.strerror(error.errno) if error.errno > 0 else str(error)
            return OSError(error.errno, f"cannot write {self.path}: {text}")
        return error


def _rate(frame_rate: float) -> Fraction:
    rate = _checks.number("frame_rate", frame_rate, least=1e-3, most=1e3, of="pictures a second")
    return Fraction(rate).limit_denominator(1001)


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
    suffix = _checks.text("suffix", suffix).lower()
    choices = _SUFFIXES[_checks.choice("suffix", suffix, _SUFFIXES)]
    if codec is not None:
        _checks.choice("codec", codec, choices, or_none=True)
    for name in choices if codec is None else (codec,):
        for library in ("av", "cv2"):
            if sinks.av_encoder(name) if library == "av" else sinks.cv2_writes(name, suffix):
                return name, library
    raise OptionError(
        f"codec: got no encoder for {codec or ' or '.join(choices)} in {suffix} here, "
        "expected one: pip install 'rsflow-motion[video]' brings H.264"
    )


def write_lossless(path: str | os.PathLike[str], pictures: Iterable[Picture], *, frame_rate: float) -> None:
    """Write grey pictures of one size as a video without loss: FFV1 in AVI, at a constant rate.

    Parameters
    ----------
    path : path
        Ends in ``.avi``. The file is written beside this name and renamed when it is complete.
    pictures : iterable of (height, width) uint8
        At least one.
    frame_rate : float
        Pictures a second.

    Raises
    ------
    OptionError
        If there is no picture.
    OSError
        If it cannot be written, a full disk for one; nothing is left then.

    Notes
    -----
    AVI, since Matroska rounds times to milliseconds: 3 % of a frame at 30 frames/s.

    Examples
    --------
    >>> import numpy as np, rsflow, tempfile, pathlib
    >>> from rsflow.video import write_lossless
    >>> noise = list(np.random.default_rng(1).integers(0, 256, (3, 48, 64), np.uint8))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "a.avi")
    ...     write_lossless(path, noise, frame_rate=30)
    ...     all(np.array_equal(a.image, b) for a, b in zip(rsflow.frames(path), noise))
    True
    """
    import cv2

    path, rate = _checks.file_name("path", path, (".avi",)), _rate(frame_rate)
    sink: sinks.Cv2Sink | None = None
    with writing(path) as partial:
        try:
            for picture in _checks.iterable("pictures", pictures, "pictures of uint8, (height, width)"):
                _checks.frame("pictures", picture)
                if picture.dtype != np.uint8 or picture.size == 0:
                    raise _checks.refused("pictures", picture, "pictures of uint8, (height, width)", DTypeError)
                if sink is None:
                    sink = sinks.Cv2Sink(partial, "ffv1", rate, picture.shape[1], picture.shape[0])
                sink.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), 0)
            if sink is None:
                raise OptionError(f"pictures: got none for {path}, expected at least one")
            sink.close()
        except BaseException:
            if sink is not None:
                sink.abandon()
            raise
