"""`rsflow.frames`: the frames of a camera, a video, a folder or glob of pictures, a list, or a URL."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ..errors import DTypeError, OptionError
from ..io.limits import max_pixels_of
from .reader import Reader
from .sources import open_source
from .stream import Frames, FrameSource
from .times import given_times

__all__ = ["frames"]


def frames(
    source: FrameSource,
    *,
    grey: bool = True,
    color: bool = False,
    roi: tuple[int, int, int, int] | None = None,
    start: int | None = None,
    stop: int | None = None,
    stride: int = 1,
    frame_rate: float | None = None,
    times: Sequence[float] | NDArray[Any] | str | os.PathLike[str] | None = None,
    newest: bool | None = None,
    timeout_s: float = 5.0,
    reconnect_s: float | None = None,
    real_time: bool = False,
    camera_size: tuple[int, int] | None = None,
    max_pixels: int | None = None,
) -> Frames:
    """Read frames with their times from a camera, a video, pictures, arrays or a URL.

    Parameters
    ----------
    source : int, str, path, array, or iterable
        A camera's index (0, or "0"); a video file; a folder of pictures; a glob ("left*.jpg") or numbered pattern
        ("img%04d.png"); one picture, or all pages of one file (TIFF, animated PNG, WebP, GIF); a URL (rtsp, http, ...);
        a list of paths, of arrays, or of (array, t_s) pairs;
        an array (N, H, W) or (N, H, W, 3); any iterable of arrays, pairs or `Frame`. Pictures of a folder or glob
        come in natural order (img2 before img10). Colour arrays are BGR, as OpenCV's.
    grey : bool
        Give `Frame.image` in grey (the default); False leaves it as the source has it.
    color : bool
        Also give `Frame.color`, BGR, to draw on.
    roi : (x, y, width, height), optional
        Crop to this region, in pixels.
    start, stop, stride : int, optional
        Frames to give, as `range(start, stop, stride)` of the source. Frames before `start` are passed over one by
        one, unless a video's packets tell exactly where it is.
    frame_rate : float, optional
        Frames per second: times are then index / frame_rate, whatever the file says. For pictures, which have no
        times of their own, and for slow-motion clips.
    times : sequence of float or path, optional
        Time in seconds of each frame of the source, as many as it has, strictly increasing; or a CSV with a column
        `t_s` (or `t_ms`, `t_us`, `t_ns`: the name says the unit), or with one column of seconds.
    newest : bool, optional
        Give the newest frame and drop the older ones that nobody has taken, so that a slow reader does not fall
        behind. By default True for a live source, and not possible for a file.
    timeout_s : float
        Live sources: how long to wait for a frame, trying to open the source again meanwhile, before `CaptureError`.
    reconnect_s : float, optional
        The same for a live source that went away after it had given frames; by default `timeout_s`.
    real_time : bool
        Play a file, pictures or arrays at their own pace, as a camera gives them: a rehearsal. It is then a live
        source, whose frames carry the clock's time; what a slow reader does not take is dropped, unless `newest` is
        False.
    camera_size : (width, height), optional
        Live sources: the size to ask the camera for; it may give another.
    max_pixels : int, optional
        Pixels that a picture may have, 2**28 by default or what the environment variable ``RSFLOW_MAX_PIXELS`` says;
        four bytes may be decoded for each. Headers are held to it before a decoder sees them.

    Returns
    -------
    Frames
        An iterator of `Frame`, and a context manager.

    Raises
    ------
    CaptureError
        If the source is missing, empty, cannot be decoded, or goes away. A truncated video gives the frames that it
        has; then the error says how many were promised.
    ShapeError, DTypeError
        If pictures differ in size or type (the message names both), also where the size changes within a video, or
        have a type that is not supported.
    OptionError
        If an option is outside of what it allows.

    Notes
    -----
    Times of a video are the file's own timestamps, also with a variable rate; `Frames.timestamps` says where they
    are from. Where a file's timestamps go backwards although its pictures are in order (a muxer that wrote decoding
    times), the sorted timestamps are given to the pictures. Times begin with the first picture, whatever the file
    counts from. Pictures that the decoder cannot give are counted (`Frames.lost`) and keep their place; one that it
    patches up from a damaged packet cannot be told from a whole one. A video that asks to be turned is turned; the
    orientation of a picture file is not applied, so that a camera's calibration fits. Videos are decoded to 8 bits,
    pictures keep their depth; alpha is left out. Pages of an animation have the times of their delays, where a delay
    of 0 is 0.1 s as in browsers; reduced copies and masks in a TIFF are no pages.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> pictures = [np.full((4, 6), value, np.uint8) for value in (10, 20, 30)]
    >>> with rsflow.frames(pictures, frame_rate=25.0, stride=2) as source:
    ...     [(frame.index, frame.t_s, int(frame.image[0, 0])) for frame in source]
    [(0, 0.0, 10), (2, 0.08, 30)]
    """
    grey, color = _checks.flag("grey", grey), _checks.flag("color", color)
    newest = None if newest is None else _checks.flag("newest", newest)
    begin = 0 if start is None else _checks.integer("start", start, least=0)
    end = _checks.integer_or_none("stop", stop, least=0)
    step = _checks.integer("stride", stride, least=1)
    region = None if roi is None else _checks.region("roi", roi)
    camera_size = None if camera_size is None else _checks.size("camera_size", camera_size)
    frame_rate = _checks.number_or_none("frame_rate", frame_rate, least=1e-9, most=1e9, of="frames per second")
    if frame_rate is not None and times is not None:
        raise OptionError("frame_rate and times: got both, expected one of them")
    timeout_s = _checks.number("timeout_s", timeout_s, above=0, most=1e9, of="seconds")
    reconnect_s = _checks.number_or_none("reconnect_s", reconnect_s, above=0, most=1e9, of="seconds")
    real_time = _checks.flag("real_time", real_time)
    limit = max_pixels_of(max_pixels)
    given = None if times is None else given_times(times)
    source = _checked_source(source)

    reader = open_source(
        source,
        newest=None if real_time else newest,
        timeout_s=timeout_s,
        reconnect_s=reconnect_s,
        camera_size=camera_size,
        limit=limit,
    )
    if real_time and not reader.live:
        reader, given, frame_rate = _paced(reader, given, frame_rate, newest=newest is not False), None, None
    elif reader.live and (frame_rate is not None or times is not None):
        reader.close()
        raise OptionError(
            f"frame_rate, times: got one for {reader.source}, which is live, expected None: its frames carry the "
            "clock's time"
        )
    try:
        return Frames(
            reader,
            grey=grey,
            color=color,
            roi=region,
            start=begin,
            stop=end,
            stride=step,
            times=given,
            frame_rate=frame_rate,
        )
    except BaseException:
        reader.close()
        raise


def _paced(reader: Reader, times: Any, frame_rate: float | None, *, newest: bool) -> Reader:
    """Play the frames of a reader at their own pace."""
    from .paced import PacedReader

    try:
        return PacedReader(reader, times=times, frame_rate=frame_rate, newest=newest)
    except BaseException:
        reader.close()
        raise


def _checked_source(source: Any) -> Any:
    """Refuse what only looks like a source: bytes, a camera's number that is none, a name that no file has."""
    expected = "a camera's index, a path, a URL, arrays or a list"
    if isinstance(source, (bytes, bytearray, memoryview, np.timedelta64, np.datetime64)):
        raise _checks.refused("source", source, expected, DTypeError)
    number = None if isinstance(source, np.ndarray) else _checks.whole(source)
    if number is not None:
        return _checks.integer("source", number, least=0, most=2**31 - 1)
    if isinstance(source, os.PathLike) or (isinstance(source, str) and source and "\0" not in source):
        _checks.path("source", source, expected)
    return source
