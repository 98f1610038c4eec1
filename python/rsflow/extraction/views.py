"""The three videos and the pictures of the report, drawn and encoded beside the measuring."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._files import working_name
from .background import BackgroundWorker
from .tables import partial_name

if TYPE_CHECKING:
    from .pipeline import Measured

__all__ = ["Clip", "Views"]

# Pictures a second of videos whose source does not know: slow enough to follow by eye.
_DEFAULT_RATE = 10.0

# Quality of the JPEG pictures in the report: no artefact is seen at the size of the page.
_POSTER_QUALITY = 88


class Clip:
    """A video under a hidden name until `keep` gives it its own."""

    def __init__(self, path: Path, frame_rate: float) -> None:
        from ..video import VideoWriter, encoder

        self.path = path
        self._working = working_name(path)
        # Without PyAV browsers would play VP9 alone, which OpenCV writes at one frame a second: MPEG-4 keeps up.
        codec = None if encoder(path.suffix)[1] == "av" else "mp4v"
        self._writer = VideoWriter(self._working, frame_rate=frame_rate, codec=codec)
        self.codec: str = self._writer.codec
        self._interval_s = 1.0 / frame_rate
        self._last_s = -math.inf

    def write(self, picture: NDArray[np.uint8], t_s: float) -> None:
        """Append a picture at its time; where that is unknown or not later than the last, one interval after that."""
        if not (math.isfinite(t_s) and t_s > self._last_s):
            t_s = self._last_s + self._interval_s if math.isfinite(self._last_s) else 0.0
        self._last_s = t_s
        with self._named():
            self._writer.write(picture, t_s if self._writer.keeps_times else None)

    def close(self) -> None:
        """Complete the video under its hidden name."""
        with self._named():
            self._writer.finish()

    @contextlib.contextmanager
    def _named(self) -> Iterator[None]:
        """Let an error of the file system name the video, not its hidden file."""
        try:
            yield
        except OSError as error:
            if error.errno is None or error.errno <= 0:
                raise
            raise OSError(error.errno, os.strerror(error.errno), str(self.path)) from error

    def keep(self, *, complete: bool) -> Path | None:
        """Give the video its name; None where it has no picture."""
        if not self._working.exists():
            return None
        final = self.path if complete else partial_name(self.path)
        self._working.replace(final)
        return final

    def discard(self) -> None:
        """Remove what was written."""
        self._writer.discard()
        self._working.unlink(missing_ok=True)


class Views:
    """Draw each frame three times in a thread of its own, and keep the pictures that tell most for the report."""

    def __init__(self, folder: Path, stream: Any, *, style: Any, stride: int, videos: bool) -> None:
        rate = (stream.frame_rate or _DEFAULT_RATE * stride) / stride
        self.style = style
        self.clips: dict[str, Clip] = {}
        if videos:
            for name in ("flow", "moving", "static"):
                self.clips[name] = Clip(folder / f"{name}.mp4", float(min(max(rate, 0.1), 1000.0)))
        self.posters: dict[str, NDArray[np.uint8]] = {}
        self.poster_frame: int | None = None
        self._score = -1.0
        self._before: Any = None
        self._worker: BackgroundWorker[Any] = BackgroundWorker(self._draw, name="rsflow-views")

    @property
    def codec(self) -> str | None:
        """Codec of the videos, None without any."""
        return next((clip.codec for clip in self.clips.values()), None)

    def add(self, measured: Measured) -> None:
        """Queue one frame; raises what went wrong with an earlier one."""
        self._worker.put(measured)

    def _draw(self, measured: Measured) -> None:
        """Draw what a video or the report needs of one frame; arrows stand on the frame that they start from."""
        before, self._before = self._before, measured.frame
        share = measured.motion.get("moving_share")
        # Where more than half of the picture "moves", the camera's motion is what was not understood.
        score = min(share, 1.0 - share) if isinstance(share, float) and math.isfinite(share) else 0.0
        # The report shows the frame where most moves; of a scene at rest, the first that has a flow.
        best = measured.flow is not None and before is not None and score > self._score
        if not self.clips and not best:
            return
        drawn = self._pictures(measured, before)
        for name, picture in drawn.items():
            if name in self.clips:
                self.clips[name].write(picture, before.t_s if name == "flow" else measured.frame.t_s)
        if best:
            self._score, self.posters, self.poster_frame = score, drawn, measured.frame.index

    def _pictures(self, measured: Measured, before: Any) -> dict[str, NDArray[np.uint8]]:
        color = measured.frame.color
        drawn = {
            "moving": measured.segmentation.moving_view(color),
            "static": measured.segmentation.static_view(color),
        }
        if before is not None and measured.flow is not None:
            drawn = {"flow": self._arrows(measured.flow, before), **drawn}
        return drawn

    def _arrows(self, flow: Any, before: Any) -> NDArray[np.uint8]:
        """Draw the arrows; only the pixels where one stands are looked at."""
        from .._arrows import grid
        from ..plotting import quiver

        height, width = flow.valid.shape
        points = grid(height, width, self.style.step)
        columns, rows = points.astype(int).T
        vectors, valid = flow.uv[rows, columns], flow.valid[rows, columns]
        return quiver(vectors, picture=before.color, points=points, valid=valid, style=self.style)

    def drained(self) -> Exception | None:
        """Wait until all is drawn; give the error that ended the drawing, if one did."""
        try:
            self._worker.close()
            before, self._before = self._before, None
            if before is not None and "flow" in self.clips:
                # From the last picture nothing goes on: it has no arrows, and the three videos stay equally long.
                self.clips["flow"].write(self._bare(before), before.t_s)
        except Exception as error:
            return error
        return None

    def _bare(self, frame: Any) -> NDArray[np.uint8]:
        from ..plotting import quiver

        nothing = np.zeros((0, 2), np.float32)
        return quiver(nothing, picture=frame.color, points=nothing, style=self.style)

    def jpeg(self, name: str) -> bytes | None:
        """Give the picture of the report for one view."""
        import cv2

        picture = self.posters.get(name)
        if picture is None:
            return None
        done, data = cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, _POSTER_QUALITY))
        return data.tobytes() if done else None

    def discard(self) -> None:
        """Stop drawing and remove videos that have no name yet."""
        self.drained()
        for clip in self.clips.values():
            with contextlib.suppress(OSError):
                clip.discard()
