"""Video files, with the timestamps that they carry."""

from __future__ import annotations

import heapq
import itertools
import math
from collections import deque
from pathlib import Path
from typing import Any

from ..errors import CaptureError, ShapeError
from ..io.fork_guard import OfProcess, opening
from ..io.limits import check_pixels
from ..io.opencv_files import open_capture, quiet
from .containers import Container, read_container
from .packets import Packets
from .reader import Raw, Timestamps
from .seeking import gone_to

# Frames looked at when a file is opened, to see whether its timestamps exist and are in order. Reordering in H.264
# and HEVC spans at most 16 frames.
_PROBE_FRAMES = 24

# Damaged packets among them; behind the end, each attempt fails at once.
_PROBE_FAILURES = 48

# Backends of OpenCV that count frames and divide by the nominal rate instead of reading timestamps.
_COUNTING_BACKENDS = ("CV_MJPEG", "CV_IMAGES")

# Damaged packets that are passed over, one after the other.
_MAX_DAMAGED = 100_000

# Streams without a container carry no timestamps; FFmpeg makes up some for a few of them.
_BARE_STREAMS = (".h264", ".264", ".h265", ".265", ".hevc", ".m1v", ".m2v", ".mjpeg", ".mjpg", ".obu", ".av1")


class VideoReader(OfProcess):
    """One video file or finite URL, decoded in order."""

    def __init__(self, source: str, limit: int) -> None:
        with opening:
            import cv2

        self.source = source
        self._limit = limit
        self.live = False
        self.exact = False
        self._sorted: tuple[str, ...] = ()
        self._deep: tuple[str, ...] = ()
        local = "://" not in source
        self._container = read_container(Path(source)) if local else Container()
        for width, height in self._container.sizes:
            if (width, height) != (0, 0):
                check_pixels(
                    source,
                    width,
                    height,
                    pixel_bytes=3,
                    file_bytes=Path(source).stat().st_size,
                    limit=limit,
                    error=CaptureError,
                )
        self._start_s = 0.0
        self._capture = self._open()
        rate = float(self._capture.get(cv2.CAP_PROP_FPS))
        self.frame_rate: float | None = rate if math.isfinite(rate) and rate > 0 else None
        promised = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        self.count: int | None = int(promised) if math.isfinite(promised) and 0 < promised < 2**40 else None
        width = int(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        height = int(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        self.size: tuple[int, int] | None = (width, height) if width > 0 and height > 0 else None
        self._read = 0
        self._given = 0
        self._skipped = 0
        self._changed_s: float | None = None
        self._longest_s = 0.0
        self._last_s = -math.inf
        self._ended = False
        self._buffer: deque[Any] = deque()
        self._waiting_s: list[float] = []
        self._delay = self._probe(self._capture.getBackendName())
        if self.count is not None and self.frame_rate is not None and self._container.kind == "Matroska":
            # Its duration is the last time, from 0 on; it need not begin there.
            begun = round(self._start_s * self.frame_rate)
            self.count = self.count - begun if 0 < begun < self.count else self.count
        first_s = self._first_s if self.timestamps == "file" else []
        reliable = self._container.kind in ("Matroska", "MP4")
        self._packets = Packets(source, self.size, first_s=first_s, reliable=reliable) if local else None

    @property
    def lost(self) -> int:
        """Pictures that the file has and the decoder could not give, of those read so far."""
        return 0 if self._packets is None else self._packets.lost

    @property
    def notes(self) -> tuple[str, ...]:
        """Peculiarities that were mended."""
        if not self.lost or self._packets is None:
            return self._sorted + self._deep
        of = self._packets.count
        first = self._packets.first_lost
        times = "the times of the others are the file's" if self.timestamps == "file" else "they count for the times"
        lost = f"{self.source}: {self.lost} of {of} frames cannot be decoded, the first is frame {first}; {times}"
        return (*self._sorted, *self._deep, lost)

    def _open(self) -> Any:
        capture = open_capture(self.source)
        if not capture.isOpened():
            size = f" ({Path(self.source).stat().st_size} bytes)" if Path(self.source).exists() else ""
            raise CaptureError(
                f"{self.source}{size}: cannot be opened as a video: missing, truncated, damaged, "
                "or of a format that OpenCV cannot read"
            )
        return capture

    def _probe(self, backend: str) -> int:
        """Look at the first timestamps: find out what they are worth and how far they are out of order."""
        import cv2

        times: list[float] = []
        with quiet():
            failures = 0
            while len(times) < _PROBE_FRAMES and failures < _PROBE_FAILURES:
                if not self._capture.grab():
                    failures += 1
                    continue
                if not times:
                    # A picture that the file asks to be turned is turned; the header's size is that before.
                    done, image = self._capture.retrieve()
                    self.size = (image.shape[1], image.shape[0]) if done else self.size
                    self._look_at_first()
                times.append(float(self._capture.get(cv2.CAP_PROP_POS_MSEC)))
        with opening:
            self._capture.release()
        self._first_s = [round(t_ms * 1e-3, 9) for t_ms in times]
        if not times:
            raise CaptureError(f"{self.source}: the video holds no frame that can be decoded")
        self._capture = self._open()
        self.timestamps: Timestamps = "file"
        bare = Path(self.source).suffix.lower() in _BARE_STREAMS
        if bare or backend in _COUNTING_BACKENDS or (len(times) > 1 and max(times) <= times[0]):
            self.timestamps = "rate" if self.frame_rate is not None else "none"
            return 0
        rank = {position: place for place, position in enumerate(sorted(range(len(times)), key=times.__getitem__))}
        delay = max(position - place for position, place in rank.items())
        if delay > 0:
            self._sorted = (
                f"{self.source}: its timestamps go back and forth by up to {delay} frames although its pictures are in "
                "order: the sorted timestamps are used",
            )
            # Two more than seen, since the order may be worse further on.
            return delay + 2
        return 0

    def _look_at_first(self) -> None:
        """Note when the stream begins, in its own time, and how deep its pictures are."""
        import cv2

        begins = float(self._capture.get(getattr(cv2, "CAP_PROP_PTS", -1)))
        rate = self.frame_rate
        if rate is not None and math.isfinite(begins) and 0 < begins < 2**52:
            self._start_s = max(0.0, begins / rate - float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3)
        pixels = int(self._capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) & 0xFFFFFFFF
        # FFmpeg's words for formats of more than 8 bits end in their depth: Y3 11 10, Y1 0 16.
        depth = pixels >> 24
        if pixels & 0xFF == ord("Y") and 8 < depth <= 16:
            self._deep = (f"{self.source}: its pictures have {depth} bits, of which OpenCV gives the upper 8",)

    def _grab(self, wanted: bool) -> None:
        """Decode one more frame into the buffer, or note the end."""
        import cv2

        if not self._capture.grab() and not self._skip_damage():
            self._ended = True
            return
        index = self._read
        self._read += 1
        if self.timestamps == "file":
            t_s = round(float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3, 9)
        elif self.timestamps == "rate" and self.frame_rate:
            t_s = index / self.frame_rate
        else:
            t_s = math.nan
        # A picture of another size than the first must not even be fetched: OpenCV reads it as if it had the old one.
        if self._packets is not None and self._packets.changed_by(index + self._skipped, t_s):
            self._ended, self._changed_s = True, t_s
            return
        image = None
        # With reordered timestamps frames are read before it is known whether they are wanted.
        if wanted or self._delay:
            ok, image = self._capture.retrieve()
            if not ok:
                raise CaptureError(f"{self.source}: frame {index} cannot be decoded")
        self._buffer.append(image)
        heapq.heappush(self._waiting_s, t_s)

    def _skip_damage(self) -> bool:
        """Go on behind packets that cannot be decoded; False where none is left."""
        if self._packets is None:
            return False
        for _ in range(min(self._packets.remaining(self._read), _MAX_DAMAGED)):
            self._skipped += 1
            if self._capture.grab():
                return True
        return False

    def read(self, wanted: bool) -> Raw | None:
        """Give the next frame with its timestamp."""
        self._expect_here(self.source)
        while not self._ended and len(self._buffer) <= self._delay:
            self._grab(wanted)
        if not self._buffer:
            if self._changed_s is not None:
                raise self._size_changed(self._changed_s)
            if self._packets is not None:
                self._packets.finish(self._given)
            self._check_complete()
            return None
        image = self._buffer.popleft()
        t_s = heapq.heappop(self._waiting_s)
        if self._given:
            self._longest_s = max(self._longest_s, t_s - self._last_s)
        self._last_s = t_s
        index, t_s = (self._given, t_s) if self._packets is None else self._packets.place(t_s)
        if self.timestamps == "rate" and self.frame_rate:
            t_s = index / self.frame_rate
        self._given += 1
        return Raw(image, t_s, index)

    def skip(self, index: int) -> bool:
        """Go to frame `index` before anything was read; False, and at the beginning, where that would not be exact."""
        self._expect_here(self.source)
        if self._packets is None or self.timestamps != "file" or self._delay or not self._packets.reliable:
            return False
        times_s = gone_to(self._capture, self._packets, index)
        if times_s is None:
            with opening:
                self._capture.release()
            self._capture = self._open()
            return False
        self._packets.skip(index)
        self._read = self._given = index
        self._longest_s = max((after - before for before, after in itertools.pairwise(times_s)), default=0.0)
        self._last_s = times_s[-1]
        return True

    def _size_changed(self, t_s: float) -> ShapeError:
        """Make the error for a stream that changes the size of its pictures: OpenCV gives the old size for ever."""
        packets, change = self._packets, None if self._packets is None else self._packets.change
        if packets is None or change is None:
            return ShapeError(
                f"{self.source}: got a picture of another size, expected that of those before: the size "
                "changes within the stream"
            )
        index, t_s = packets.place(t_s)
        return ShapeError(
            f"{self.source}: frame {index}{f' at {t_s:.3f} s' if t_s == t_s else ''}: got {change.after[0]} x "
            f"{change.after[1]} pixels, expected {change.before[0]} x {change.before[1]} as before: the size "
            "changes within the stream; the frames before are whole"
        )

    def _check_complete(self) -> None:
        """Raise where the container promised more than it gave.

        A file that is as long as its header says is complete, whatever it says of frames: those of a damaged part are
        lost, and sound may go on longer. Elsewhere the count is exact in some formats and duration times rate in
        others, where dropped frames count too: the file is complete if either the frames or the time are there, within
        the longest pause between two frames. The duration may be counted from 0 or from the first frame. Pauses in a
        file that is shorter than its header says may be those that its end left: pictures whose references it cut off.
        """
        if self.count is None or self.frame_rate is None or self._container.cut is False:
            return
        # MP4 lists its pictures one by one.
        listed = self._container.cut is True and self._container.kind == "MP4"
        if self._given + self.lost >= self.count - (0 if listed else 2):
            return
        duration_s = self.count / self.frame_rate
        slack_s = max(3.0 / self.frame_rate, 0.0 if self._container.cut else 2.0 * self._longest_s)
        there = math.isnan(self._last_s) or self._last_s + slack_s >= duration_s
        there_too = self._container.cut is None and self._last_s + self._start_s + slack_s >= duration_s
        if not listed and (there or there_too):
            return
        raise CaptureError(
            f"{self.source}: the video is truncated: it ends after frame {self._given - 1} at {self._last_s:.3f} s, "
            f"its header promises {self.count} frames and {duration_s:.3f} s"
        )

    def close(self) -> None:
        """Release the file."""
        self._ended = True
        self._buffer.clear()
        self._waiting_s.clear()
        if self._elsewhere:
            return
        with opening:
            self._capture.release()
        if self._packets is not None:
            self._packets.close()
