"""The three videos and the pictures of the report: drawn in one thread, encoded in one for each video."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._core import get_num_threads
from ..video.join import Part, join
from ..video.sinks import CLOCK
from .pictures import Drawn, Pictures
from .slides import Slide
from .worker import BackgroundWorker

if TYPE_CHECKING:
    from ..capture.stream import Frame
    from ..segmentation.result import MotionSegmentation
    from ..video.writer import VideoWriter
    from .pipeline import Measured

__all__ = ["Clip", "Views"]

# Pictures a second of videos whose source does not know: slow enough to follow by eye.
_DEFAULT_RATE = 10.0

_VIDEOS = ("flow", "moving", "static")

# Pictures that may wait for an encoder.
_WAITING = 2

# Quality of the JPEG pictures in the report: no artefact is seen at the size of the page.
_POSTER_QUALITY = 88


class Clip:
    """A video that grows in parts, each of which is whole as soon as the next one begins.

    Parameters
    ----------
    path : Path
        The final name.
    folder : Path
        Where the parts are.
    frame_rate : float
    threads : int
        Of the encoder.
    """

    def __init__(self, path: Path, folder: Path, frame_rate: float, threads: int = 1) -> None:
        from ..video.writer import encoder

        self.path, self._folder, self._rate, self._threads = path, folder, frame_rate, threads
        # Without PyAV browsers would play VP9 alone, which OpenCV writes at one frame a second: MPEG-4 keeps up.
        self.codec, self.library = encoder(path.suffix)
        if self.library != "av":
            self.codec, self.library = encoder(path.suffix, codec="mp4v")
        self.parts: list[Part] = []
        self._writer: VideoWriter | None = None
        self._failed = False
        self._first_s = math.nan
        self._part_s = math.nan
        self._interval_s = 1.0 / frame_rate
        self._last_s = -math.inf

    def write(self, picture: NDArray[np.uint8], t_s: float) -> None:
        """Append a picture at its time; where that is unknown or not later than the last, one interval after that."""
        from ..video.writer import VideoWriter

        if self._failed:
            # What was complete before stays all that there is.
            return
        if not (math.isfinite(t_s) and t_s > self._last_s):
            t_s = self._last_s + self._interval_s if math.isfinite(self._last_s) else 0.0
        self._last_s = t_s
        with self._named():
            if self._writer is None:
                name = f"{self.path.stem}-{len(self.parts):05d}{self.path.suffix}"
                self._writer = VideoWriter(
                    self._folder / name, frame_rate=self._rate, codec=self.codec, threads=self._threads
                )
                self._part_s = t_s
                self._first_s = t_s if math.isnan(self._first_s) else self._first_s
            try:
                self._writer.write(picture, t_s if self.library == "av" else None)
            except Exception:
                self._writer, self._failed = None, True
                raise

    def cut(self) -> None:
        """Complete the part at hand; the next picture begins a new one."""
        writer, self._writer = self._writer, None
        if writer is not None:
            with self._named():
                try:
                    writer.finish()
                except Exception:
                    self._failed = True
                    raise
            tick = round((self._part_s - self._first_s) * CLOCK)
            self.parts.append(Part(writer.path, writer.frames, tick))

    def joined(self) -> Path | None:
        """Give the file that all parts are in, beside them; None where there is no picture."""
        self.cut()
        if len(self.parts) < 2:
            return self.parts[0].path if self.parts else None
        whole = self._folder / self.path.name
        with self._named():
            join(self.parts, whole, codec=self.codec, library=self.library, frame_rate=self._rate)
        return whole

    def state(self) -> dict[str, Any]:
        """Give what `restore` needs, after `cut`."""
        parts = [(part.path.name, part.frames, part.tick) for part in self.parts]
        return {"codec": self.codec, "library": self.library, "parts": parts, "times": (self._first_s, self._last_s)}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on after the parts of a run that ended early."""
        if (state["codec"], state["library"]) != (self.codec, self.library):
            raise ValueError(f"its videos are {state['codec']} by {state['library']}, here {self.codec}")
        self.parts = [Part(self._folder / Path(name).name, frames, tick) for name, frames, tick in state["parts"]]
        for part in self.parts:
            if not part.path.is_file():
                raise ValueError(f"{part.path.name} is missing")
        self._first_s, self._last_s = state["times"]

    @contextlib.contextmanager
    def _named(self) -> Iterator[None]:
        """Let an error of the file system name the video, not its hidden file."""
        try:
            yield
        except OSError as error:
            if error.errno is None or error.errno <= 0:
                raise
            raise OSError(error.errno, os.strerror(error.errno), str(self.path)) from error

    def discard(self, *, parts: bool = False) -> None:
        """Leave off; the parts go with their folder, or now."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.discard()
        for part in self.parts if parts else ():
            with contextlib.suppress(OSError):
                part.path.unlink(missing_ok=True)


def _writes(clip: Clip) -> Callable[[tuple[NDArray[np.uint8], float]], None]:
    """Give what appends a picture, with its time, to a video."""
    return lambda item: clip.write(*item)


class Views:
    """Draw each frame three times in a thread of its own, and keep the pictures that tell most for the report.

    Each video is encoded in a thread of its own too: the encoders are as slow as all drawing, and leave Python alone.
    """

    def __init__(self, folder: Path, place: Path, stream: Any, *, style: Any, stride: int, videos: bool) -> None:
        rate = (stream.frame_rate or _DEFAULT_RATE * stride) / stride
        self.style = style
        self._pictures = Pictures(style, rate, stream.count)
        self.clips: dict[str, Clip] = {}
        self._encoders: dict[str, BackgroundWorker[tuple[NDArray[np.uint8], float]]] = {}
        if videos:
            rate, threads = float(min(max(rate, 0.1), 1000.0)), max(1, get_num_threads() // len(_VIDEOS))
            for name in _VIDEOS:
                clip = self.clips[name] = Clip(folder / f"{name}.mp4", place, rate, threads)
                self._encoders[name] = BackgroundWorker(_writes(clip), name=f"rsflow-{name}", depth=_WAITING)
        self.posters: dict[str, NDArray[np.uint8]] = {}
        self.poster_frame: int | None = None
        self._score = -1.0
        self._worker: BackgroundWorker[Measured | Callable[[], None]] = BackgroundWorker(
            self._take, name="rsflow-views"
        )

    @property
    def codec(self) -> str | None:
        """Codec of the videos, None without any."""
        return next((clip.codec for clip in self.clips.values()), None)

    def add(self, measured: Measured) -> None:
        """Queue one frame; raises what went wrong with an earlier one."""
        self._worker.put(measured)

    def learn(self, frame: Frame, seen: MotionSegmentation) -> None:
        """Take a frame before the first that is drawn: of what the scene is made of."""
        self._pictures.learn(frame, seen)

    def after(self, action: Callable[[], None]) -> None:
        """Queue what is to be done when all frames so far are drawn."""
        self._worker.put(action)

    def state(self) -> dict[str, Any]:
        """Give what `restore` needs; the parts of the videos at hand are completed first."""
        # Nothing waits after `drained`.
        self._keep(self._pictures.complete())
        for name, clip in self.clips.items():
            self._encoders[name].wait()
            clip.cut()
        return {
            "clips": {name: clip.state() for name, clip in self.clips.items()},
            "posters": dict(self.posters),
            "poster_frame": self.poster_frame,
            "score": self._score,
            "pictures": self._pictures.state(),
        }

    def restore(self, state: dict[str, Any], before: Any) -> None:
        """Go on as after the frame `before`."""
        for name, clip in self.clips.items():
            clip.restore(state["clips"][name])
        self.go_on(state, before)

    def go_on(self, state: dict[str, Any], before: Any) -> None:
        """Go on as after the frame `before`, in videos of its own."""
        self.posters, self.poster_frame, self._score = state["posters"], state["poster_frame"], state["score"]
        self._pictures.restore(state["pictures"], before)

    def _take(self, item: Measured | Callable[[], None]) -> None:
        if callable(item):
            item()
        else:
            self._draw(item)

    def _draw(self, measured: Measured) -> None:
        """Draw what a video or the report needs of one frame."""
        share = measured.motion.get("moving_share")
        # Where more than half of the picture "moves", the camera's motion is what was not understood.
        score = min(share, 1.0 - share) if isinstance(share, float) and math.isfinite(share) else 0.0
        # The report shows the frame where most moves; of a scene at rest, the first that has a flow.
        best = measured.flow is not None and score > self._score
        if best:
            self._score, self.poster_frame = score, measured.frame.index
        self._keep(self._pictures.draw(measured, wanted=bool(self.clips) or best))

    def _keep(self, drawn: list[Drawn]) -> None:
        """Write pictures into the videos, and keep those of the report."""
        for one in drawn:
            if one.view in self._encoders:
                self._encoders[one.view].put((one.picture, one.t_s))
            if one.frame == self.poster_frame:
                self.posters[one.view] = one.picture

    def drained(self) -> Exception | None:
        """Wait until all is drawn and encoded; give the error that ended it, if one did."""
        trouble: Exception | None = None
        pictures = (lambda: self._keep(self._pictures.complete()),)
        for end in (self._worker.close, *pictures, *(encoder.close for encoder in self._encoders.values())):
            try:
                end()
            except Exception as error:
                trouble = trouble or error
        return trouble

    def close(self) -> Exception | None:
        """Draw what ends the videos, after `drained`; give the error, if there is one."""
        try:
            # The three videos stay equally long.
            for one in self._pictures.last() if self.clips else ():
                self.clips[one.view].write(one.picture, one.t_s)
        except Exception as error:
            return error
        return None

    def background(self) -> NDArray[np.uint8] | None:
        """Give the static scene of all frames, after `drained`; None where there is none."""
        return self._pictures.background()

    def ground(self, corner: tuple[float, float], size: tuple[int, int], scale: float) -> NDArray[np.uint8] | None:
        """Give the scene as the first frame would show it, see `Pictures.ground`, after `drained`."""
        return self._pictures.ground(corner, size, scale)

    def slides(self) -> list[Slide]:
        """Give the pictures of the report's slider, after `drained`."""
        return self._pictures.slides.kept()

    def jpeg(self, name: str) -> bytes | None:
        """Give the picture of the report for one view."""
        import cv2

        picture = self.posters.get(name)
        if picture is None:
            return None
        done, data = cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, _POSTER_QUALITY))
        return data.tobytes() if done else None

    def discard(self) -> None:
        """Stop drawing and leave the videos off."""
        self.drained()
        for clip in self.clips.values():
            with contextlib.suppress(OSError):
                clip.discard()
