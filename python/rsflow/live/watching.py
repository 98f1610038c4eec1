"""A live run: every estimator on the newest frame, tables, and what is shown and recorded of it."""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import _checks
from .._beside import share_threads, soon_handed_over
from ..capture.too_few import too_few
from ..errors import CaptureError, OptionError, RsflowError
from ..extraction.pipeline import Pipeline
from ..extraction.settings import CameraMotion, ExtractSettings, Illumination, Preset
from ..extraction.stopping import StopRequest
from .frame import LiveFrame
from .opening import opened
from .showing import Showing
from .stages import Stages
from .summary import Ended, LiveSummary
from .tables import Tables

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..camera.model import Camera
    from ..capture.stream import Frames, FrameSource
    from ..velocity import Sensors

__all__ = ["watch"]

# How long the frame at hand may take when the run is ended, and how often a run that waits looks whether it is to end.
_LAST_FRAME_S, _LOOK_S = 5.0, 0.1
# Of the frames that came; when more are not measured, it is said what takes less time.
_MOST_MISSED = 0.1
# Threads for the displacement beside the dense flow, and for the velocity beside what moves.
_BESIDE = 2


def watch(
    source: FrameSource = 0,
    *,
    camera: Camera | str | os.PathLike[str] | None = None,
    height_m: float | str | os.PathLike[str] | None = None,
    height_std_m: float | None = None,
    sensors: Sensors | None = None,
    roi: tuple[int, int, int, int] | None = None,
    mask: NDArray[np.bool_] | str | os.PathLike[str] | None = None,
    scale_m_per_px: float | None = None,
    preset: Preset = "fast",
    illumination: Illumination = "gain_offset",
    max_displacement: float | None = None,
    camera_motion: CameraMotion = "auto",
    view: bool = False,
    serve: int | str | None = None,
    record: str | os.PathLike[str] | None = None,
    out: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    view_rate_hz: float = 30.0,
    frame_rate: float | None = None,
    real_time: bool = False,
    frames: int | None = None,
    seconds: float | None = None,
    timeout_s: float = 5.0,
    reconnect_s: float | None = 60.0,
    linger: bool = False,
    on_frame: Callable[[LiveFrame], Any] | None = None,
    on_wait: Callable[[float], Any] | None = None,
    on_open: Callable[[Showing], Any] | None = None,
) -> LiveSummary:
    """Measure everything while a camera runs, and show, record and keep it.

    Displacement, dense flow, what moves, things and their speeds, and with a camera and a height the velocity, of the
    newest frame always: what nobody is ready for is dropped and counted. Ctrl-C or SIGTERM ends it after the frame at
    hand, with everything closed.

    Parameters
    ----------
    source : int, str or any source of `rsflow.frames`
        A camera's index or a stream's URL. Of a file, pictures or arrays no frame is dropped, unless `real_time`.
    camera, height_m, height_std_m, sensors, roi, mask, scale_m_per_px, preset, illumination, max_displacement
        As for `rsflow.extract`.
    camera_motion : {"auto", "moving", "static"}
        Whether the camera moves; "auto" decides from the first dozen frames, whose figures come late.
    view : bool
        Open a window of the Rerun viewer (the extra ``viewer``).
    serve : int or str, optional
        Serve it to browsers at this port, with its data at the next one; ``"HOST:PORT"`` listens to that address alone,
        a number to all.
    record : path, optional
        Record what is shown in a file (``.rrd``) for the viewer, named when the run ends.
    out : path, optional
        Folder for ``motion.csv``, ``objects.csv`` and with a camera ``velocity.csv``, as `rsflow.extract` has them; of
        a file they are the same to the byte.
    overwrite : bool
        Replace the tables of another run in `out`, and a recording that is there.
    view_rate_hz : float
        Pictures a second to show and to record, at most; plots have every frame.
    frame_rate : float, optional
        Frames per second of pictures, which have no times.
    real_time : bool
        Play a file at its own pace, as a camera gives it, see `rsflow.frames`.
    frames : int, optional
        End after so many readings.
    seconds : float, optional
        End after so many seconds.
    timeout_s, reconnect_s : float
        How long to wait for a camera's first frame, and for one that went away (opened again meanwhile), before
        `CaptureError`. After a gap nothing is compared with what was before it.
    linger : bool
        Where it is shown and the source is a file: stay open after its end, until the window is closed, or Ctrl-C.
    on_frame : callable, optional
        Called with each `LiveFrame`, in order, from another thread.
    on_wait : callable, optional
        Called now and then, in the caller's thread, with how many seconds ago the last frame came.
    on_open : callable, optional
        Called once with what the run is shown by, a `Showing`: where to look at it.

    Returns
    -------
    LiveSummary

    Raises
    ------
    CaptureError
        If the camera cannot be opened or goes away for good, or a port is in use. What was measured is kept.
    OptionError
        If an option is outside of what it allows, or there is no screen for `view`; nothing is written then.
    MissingExtraError
        If the viewer is not installed and `view`, `serve` or `record` is asked for.
    OSError
        If a table cannot be written; a recording that cannot is ended, and noted.

    Examples
    --------
    >>> import tempfile, rsflow
    >>> flight = rsflow.synthetic.flight(frames=4, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = rsflow.live.watch(flight, camera=flight.camera, height_m=0.2, out=folder)
    >>> done.frames, done.gaps, sorted(done.files)
    (4, 0, ['motion', 'objects', 'velocity'])
    """
    settings = ExtractSettings(
        camera=camera,
        height_m=height_m,
        height_std_m=height_std_m,
        sensors=sensors,
        roi=roi,
        mask=mask,
        scale_m_per_px=scale_m_per_px,
        frame_rate=frame_rate,
        preset=preset,
        illumination=illumination,
        max_displacement=max_displacement,
        camera_motion=camera_motion,
        videos=False,
    )
    settings.validate()
    frames = _checks.integer_or_none("frames", frames, least=1)
    seconds = _checks.number_or_none("seconds", seconds, above=0, of="seconds")
    overwrite, linger = _checks.flag("overwrite", overwrite), _checks.flag("linger", linger)
    for name, function in (("on_frame", on_frame), ("on_wait", on_wait), ("on_open", on_open)):
        if function is not None:
            _checks.function(name, function, 1)
    folder = None if out is None else _checks.path("out", out, "a folder")
    showing = Showing.asked(view=view, serve=serve, record=record, rate_hz=view_rate_hz)
    showing.expect_new(source, settings, overwrite=overwrite)
    with contextlib.ExitStack() as stack:
        options: dict[str, Any] = {"frame_rate": frame_rate, "timeout_s": timeout_s, "reconnect_s": reconnect_s}
        stream = stack.enter_context(opened(source, real_time=real_time, roi=roi, **options))
        beside = ThreadPoolExecutor(_BESIDE, thread_name_prefix="rsflow-live-beside", initializer=share_threads)
        stack.enter_context(soon_handed_over())
        stack.callback(beside.shutdown, wait=False, cancel_futures=True)
        pipeline = Pipeline(settings, stream, covariance=False, beside=beside)
        tables = None
        if folder is not None:
            tables = stack.enter_context(Tables(folder, source, settings, overwrite=overwrite))
        stop = stack.enter_context(StopRequest(interrupts=False))
        stack.enter_context(showing)
        showing.start(stream, velocity=height_m is not None)
        if on_open is not None:
            on_open(showing)
        run = _Run(stream, pipeline, tables, showing, on_frame, frames)
        return run.until(stop, seconds, on_wait, linger=linger)


class _Run:
    """One live run, from its first frame to closed files."""

    def __init__(
        self,
        stream: Frames,
        pipeline: Pipeline,
        tables: Tables | None,
        showing: Showing,
        on_frame: Callable[[LiveFrame], Any] | None,
        most: int | None,
    ) -> None:
        self._stream, self._pipeline, self._tables, self._showing = stream, pipeline, tables, showing
        self._on_frame, self._most = on_frame, most
        self._readings = 0
        self._ended: Ended = "end"
        self._begin_s = self._last_s = math.nan
        self._stages = Stages(stream, pipeline, self._take, probe=pipeline.settings.camera_motion == "auto")

    def _take(self, frame: LiveFrame) -> bool:
        """Keep and show the figures of a frame, in the thread that made them; False ends the run."""
        self._last_s = time.monotonic()
        if math.isnan(self._begin_s):
            self._begin_s = self._last_s
        if self._tables is not None:
            self._tables.add(frame.measured)
        self._showing.offer(frame)
        if self._on_frame is not None:
            self._on_frame(frame)
        self._readings += frame.reading is not None
        if self._most is not None and self._readings >= self._most:
            self._ended = "frames"
            return False
        return True

    def until(
        self, stop: StopRequest, seconds: float | None, on_wait: Callable[[float], Any] | None, *, linger: bool
    ) -> LiveSummary:
        """Run until something ends it, and close everything."""
        begin_s = time.monotonic()
        stages = self._stages
        stages.start()
        while not stages.done.wait(_LOOK_S):
            now_s = time.monotonic()
            if stop.requested:
                self._ended = "interrupted"
            elif seconds is not None and now_s - begin_s >= seconds:
                self._ended = "seconds"
            if self._ended in ("interrupted", "seconds"):
                stages.stop()
                break
            if on_wait is not None:
                on_wait(now_s - stages.last_frame_s)
        ended = stages.join(_LAST_FRAME_S)
        failure = stages.failure
        if failure is None and not ended:
            failure = RsflowError("the frame at hand takes too long: it is left")

        def goes_on() -> bool:
            if on_wait is not None:
                on_wait(0.0)
            return not stop.requested

        shown_on = linger and failure is None and self._ended == "end" and not self._stream.live
        return self._closed(failure, goes_on if shown_on else None)

    def _closed(self, failure: BaseException | None, goes_on: Callable[[], bool] | None) -> LiveSummary:
        """Name the files; raise what ended the run early after that."""
        stages = self._stages
        files: dict[str, Path] = {}
        gone = isinstance(failure, CaptureError)
        if self._tables is not None and stages.frames:
            try:
                files |= self._tables.keep(complete=failure is None or gone)
            except OSError as error:
                failure = failure or error
        files |= self._showing.close_recording(keep=stages.frames > 0)
        if goes_on is not None:
            self._showing.linger(goes_on)
        self._showing.close()
        if failure is None and not stages.frames and self._ended == "end":
            failure = too_few(self._stream, stages.frames)
        if failure is not None:
            raise _with_files(failure, files)
        return LiveSummary(
            ended=self._ended,
            frames=stages.frames,
            not_measured=stages.not_measured,
            not_shown=self._showing.not_shown,
            gaps=stages.gaps,
            seconds=max(0.0, self._last_s - self._begin_s) if stages.frames else 0.0,
            delay_median_s=stages.delays.quantile(0.5),
            delay_p95_s=stages.delays.quantile(0.95),
            delay_p99_s=stages.delays.quantile(0.99),
            files=files,
            notes=(*self._too_slow(), *self._pipeline.notes, *self._stream.notes, *self._showing.notes),
        )

    def _too_slow(self) -> tuple[str, ...]:
        """Say what takes less time, where many frames could not be measured."""
        stages = self._stages
        came = stages.frames + stages.not_measured
        if stages.not_measured <= _MOST_MISSED * came:
            return ()
        return (
            f"{stages.not_measured} of {came} frames came faster than they could be measured: a smaller picture "
            '(--roi), or --preset ultrafast (preset="ultrafast"), takes less time',
        )


def _with_files(failure: BaseException, files: dict[str, Path]) -> BaseException:
    """Let an expected error say what is kept."""
    if files and isinstance(failure, RsflowError) and not isinstance(failure, OptionError):
        kept = ", ".join(str(path) for path in files.values())
        return type(failure)(f"{failure}; kept: {kept}")
    return failure
