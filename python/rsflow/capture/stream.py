"""A frame, and the frames of a source one by one: chosen, cropped, in grey, with their times."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .. import _checks, _display
from .._checks import unmasked
from ..errors import DTypeError, OptionError, ShapeError
from ..io.fork_guard import OfProcess
from ..io.time_series import doubtful_step
from .picture import check_roi, to_color, to_grey
from .reader import Raw, Reader, Timestamps
from .seeking import LEAST_FRAMES

__all__ = ["Frame", "FrameSource", "Frames", "Timestamps"]

FrameSource: TypeAlias = "int | str | os.PathLike[str] | NDArray[Any] | Iterable[Any]"

_DTYPES = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One picture of a sequence.

    Attributes
    ----------
    image : (H, W) array of uint8, uint16 or float32
        The grey picture, cropped to the region of interest; (H, W, 3) BGR where `frames` was called with
        ``grey=False`` and the source has colour.
    t_s : float
        Time in seconds. What its zero is depends on the source: the first frame of a video, the machine's monotonic
        clock for a live camera. NaN where nothing says when the picture was taken.
    index : int
        Position in the source, counted from 0 before `start` and `stride`. For a live camera it counts the frames
        that the camera gave, so a gap tells how many were dropped.
    color : (H, W, 3) array or None
        The same picture in colour, BGR, in the source's own depth; only with ``color=True``.
    name : str
        File name of a picture; empty where frames have no names.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> pictures = np.zeros((3, 48, 64), np.uint8)
    >>> [(frame.index, frame.t_s, frame.image.shape) for frame in rsflow.frames(pictures, frame_rate=4, start=1)]
    [(1, 0.25, (48, 64)), (2, 0.5, (48, 64))]
    """

    image: NDArray[Any]
    t_s: float
    index: int
    color: NDArray[Any] | None = None
    name: str = ""

    __repr__ = _display.fields

    def to_dict(self) -> dict[str, int | float | str]:
        """Give what is known beside the picture as a row, for ``pandas.DataFrame`` a list of such.

        Returns
        -------
        dict of str to int, float or str

        Examples
        --------
        >>> import numpy as np, rsflow
        >>> rsflow.Frame(np.zeros((48, 64), np.uint8), 0.25, 1).to_dict()
        {'index': 1, 't_s': 0.25, 'name': '', 'width': 64, 'height': 48, 'dtype': 'uint8'}
        """
        height, width = self.image.shape[:2]
        size = {"width": width, "height": height, "dtype": str(self.image.dtype)}
        return {"index": self.index, "t_s": self.t_s, "name": self.name, **size}

    def _repr_html_(self) -> str:
        picture = self.image if self.color is None else self.color
        return _display.html(repr(self), _display.displayed(picture) if picture.size else None)


class Frames(Iterator[Frame]):
    """The frames of one source: an iterator, and a context manager that releases the source.

    Made by `frames`.

    Attributes
    ----------
    source : str
        What is read, as a message would name it.
    size : (int, int) or None
        Width and height of the frames to come, after the region of interest; None before the first frame of a source
        that does not say.
    frame_rate : float or None
        Nominal rate in frames per second of the source, before `stride`; None where it is not known.
    count : int or None
        How many frames are to be expected, after `start`, `stop` and `stride`. A container's own figure: a file with
        dropped frames gives fewer.
    timestamps : {"file", "given", "rate", "clock", "none"}
        Where `Frame.t_s` is from: the file's own timestamps; `times` or `frame_rate` of the call; the nominal rate,
        since the file has no timestamps; the monotonic clock at the moment a live frame came; nothing (NaN).
    live : bool
        True for a camera or stream, which has no end.
    lost : int
        Pictures of a video file that the decoder could not give, since they are damaged, of those read so far. They
        keep their place: `Frame.index` has a gap, and the times of the others are right.
    gaps : int
        How often a live source was away (it was opened again, or gave nothing for more than a second and five times
        as long as usual) before the last frame given: what it shows after that may have nothing to do with before.
    notes : tuple of str
        Peculiarities of the source that were mended, and pictures that are lost, one sentence each.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> with rsflow.frames(np.zeros((10, 48, 64), np.uint8), frame_rate=25, stride=3) as source:
    ...     source, source.count, source.size, source.timestamps
    (<Frames of list of 10 arrays: 64 x 48, 4 frames, timestamps from given>, 4, (64, 48), 'given')
    """

    def __init__(
        self,
        reader: Reader,
        *,
        grey: bool,
        color: bool,
        roi: tuple[int, int, int, int] | None,
        start: int,
        stop: int | None,
        stride: int,
        times: NDArray[np.float64] | None,
        frame_rate: float | None,
    ) -> None:
        if not (hasattr(reader, "read") and hasattr(reader, "source")):
            raise _checks.refused("reader", reader, "what rsflow.frames opens: call that", DTypeError)
        self._reader = reader
        self._grey, self._color, self._roi = grey, color, roi
        self._start, self._stop, self._stride = start, stop, stride
        self._times, self._given_rate = times, frame_rate
        self._position = 0
        self._first: tuple[tuple[int, ...], np.dtype[Any], str] | None = None
        self._closed = False
        self.gaps = 0
        self.source = reader.source
        self.live = reader.live
        self.frame_rate = frame_rate if frame_rate is not None else reader.frame_rate
        self.timestamps: Timestamps = reader.timestamps if times is None and frame_rate is None else "given"
        if reader.size is not None:
            check_roi(roi, reader.size, self.source)
        self._doubt: tuple[str, ...] = ()
        if times is not None:
            # The count of a container is an estimate: it is held against what comes.
            if reader.exact and reader.count is not None and len(times) != reader.count:
                raise _not_one_each(len(times), reader.count, self.source)
            doubt = doubtful_step(times)
            self._doubt = () if doubt is None else (f"times: {doubt[1]}",)

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of the frames, in pixels."""
        return (self._roi[2], self._roi[3]) if self._roi is not None else self._reader.size

    @property
    def source_size(self) -> tuple[int, int] | None:
        """Width and height of the whole pictures, before the region of interest."""
        return self._reader.size

    @property
    def count(self) -> int | None:
        """How many frames are to be expected; None where the source does not say."""
        total = self._reader.count
        if total is None:
            if self.live and self._stop is not None:
                total = self._stop
            else:
                return None
        end = total if self._stop is None else min(total, self._stop)
        return max(0, -((self._start - end) // self._stride))

    @property
    def lost(self) -> int:
        """Pictures that the source has and the decoder could not give, of those read so far."""
        return self._reader.lost

    @property
    def notes(self) -> tuple[str, ...]:
        """Peculiarities of the source that were mended, and pictures that are lost."""
        return self._reader.notes + self._doubt

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Frame:
        if self._closed:
            raise StopIteration
        if isinstance(self._reader, OfProcess):
            self._reader._expect_here(self.source)
        try:
            self._go_to_start()
            while self._stop is None or self._position < self._stop:
                offset = self._position - self._start
                wanted = offset >= 0 and offset % self._stride == 0
                raw = self._reader.read(wanted)
                if raw is None:
                    self._check_times()
                    break
                self._position += 1
                if wanted and raw.image is not None:
                    return self._frame(raw, raw.image)
        except BaseException:
            self.close()
            raise
        self.close()
        raise StopIteration

    def _go_to_start(self) -> None:
        """Leave out what is before the first frame, where a video tells exactly where that is."""
        skip = getattr(self._reader, "skip", None)
        ahead = self._position == 0 and self._start >= LEAST_FRAMES
        if skip is not None and ahead and (self._stop is None or self._stop > self._start) and skip(self._start):
            self._position = self._start

    def _frame(self, raw: Raw, image: NDArray[Any]) -> Frame:
        name = f"{self.source}, frame {raw.index}" if not raw.name else raw.name
        self.gaps = raw.gaps
        self._check(image, name)
        if self._roi is not None:
            height, width = image.shape[:2]
            check_roi(self._roi, (width, height), name)
            x, y, w, h = self._roi
            image = image[y : y + h, x : x + w]
        grey = to_grey(image) if self._grey else image
        color = to_color(image) if self._color else None
        return Frame(grey, self._time(raw), raw.index, color, raw.name)

    def _check(self, image: NDArray[Any], name: str) -> None:
        unmasked(name, image)
        if image.dtype not in _DTYPES:
            raise DTypeError(f"{name}: got a picture of {image.dtype}, expected uint8, uint16 or float32")
        if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)):
            raise ShapeError(f"{name}: got shape {image.shape}, expected (H, W), (H, W, 3) BGR or (H, W, 4) BGRA")
        if 0 in image.shape:
            raise ShapeError(f"{name}: got an empty picture of shape {image.shape}, expected at least one pixel")
        if self._first is None:
            self._first = (image.shape[:2], image.dtype, name)
            return
        shape, dtype, first = self._first
        if image.shape[:2] != shape:
            raise ShapeError(
                f"pictures of different sizes: {name}: got {image.shape[1]} x {image.shape[0]} pixels, expected "
                f"{shape[1]} x {shape[0]} as {first} has"
            )
        if image.dtype != dtype:
            raise DTypeError(f"pictures of different types: {name}: got {image.dtype}, expected {dtype} as {first} has")

    def _check_times(self) -> None:
        total = self._position + self.lost
        if self._times is not None and len(self._times) > total:
            raise _not_one_each(len(self._times), total, self.source)

    def _time(self, raw: Raw) -> float:
        if self._times is not None:
            if raw.index >= len(self._times):
                raise OptionError(
                    f"times: got {len(self._times)} times, expected one for each frame: {self.source} has a frame "
                    f"{raw.index}"
                )
            return float(self._times[raw.index])
        if self._given_rate is not None:
            return raw.index / self._given_rate
        return raw.t_s

    def close(self) -> None:
        """Release the camera or file; iteration ends."""
        self._closed = True
        self._reader.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        size = "size unknown" if self.size is None else f"{self.size[0]} x {self.size[1]}"
        count = "" if self.count is None else f", {self.count} frames"
        return f"<Frames of {self.source}: {size}{count}, timestamps from {self.timestamps}>"


def _not_one_each(times: int, frames: int, source: str) -> OptionError:
    """Make the error that there are not as many times as frames."""
    return OptionError(f"times: got {times} times for the {frames} frames of {source}, expected one for each")
