"""The main job: one pass over a source, each frame measured once, everything written as it comes."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import _checks
from ..capture.too_few import expect_range, too_few
from ..errors import RsflowError
from .checkpoint import CheckpointError, Saved, restoring
from .claim import Claim
from .finish import Ending, close
from .outputs import Outputs
from .pipeline import Measured, Pipeline
from .probe import PROBE_BYTES, PROBE_PAIRS
from .progress import Progress
from .result import Extraction, ExtractionInterrupted, PartialExtractionError
from .resume import finished, saved_run
from .settings import CameraMotion, ExtractSettings, Illumination, Preset
from .stopping import StopRequest
from .worker import BackgroundWorker

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..camera.model import Camera
    from ..capture.stream import FrameSource
    from ..velocity import Sensors

__all__ = ["extract"]


def extract(
    source: FrameSource,
    out: str | os.PathLike[str],
    *,
    camera: Camera | str | os.PathLike[str] | None = None,
    height_m: float | str | os.PathLike[str] | None = None,
    height_std_m: float | None = None,
    sensors: Sensors | None = None,
    start: int | None = None,
    stop: int | None = None,
    stride: int = 1,
    roi: tuple[int, int, int, int] | None = None,
    mask: NDArray[np.bool_] | str | os.PathLike[str] | None = None,
    lines: Sequence[Sequence[float]] = (),
    scale_m_per_px: float | None = None,
    frame_rate: float | None = None,
    times: str | os.PathLike[str] | None = None,
    preset: Preset = "fast",
    illumination: Illumination = "gain_offset",
    max_displacement: float | None = None,
    camera_motion: CameraMotion = "auto",
    videos: bool = True,
    progress: bool = False,
    on_frame: Callable[[Measured], None] | None = None,
    overwrite: bool = False,
    resume: bool = False,
) -> Extraction:
    """Extract the motion of one source into a folder: tables, videos and a report page, in one pass.

    Writes ``motion.csv`` (a row a frame), ``objects.csv`` (a row for each moving thing in each frame), ``flow.mp4``
    (arrows over the picture), ``moving.mp4``, ``static.mp4``, ``background.png``, ``summary.json`` and ``report.html``;
    with `camera` and `height_m` also ``velocity.csv`` and ``trajectory.csv``. The report explains every column.

    Parameters
    ----------
    source : int, str, path, array or iterable
        As for `rsflow.frames`: a camera's index, a video, a folder or glob of pictures, a URL, arrays.
    out : path
        Folder for the results; made if it is missing. The result of an earlier run with the same source and settings
        is replaced when this one ends; any other is left alone, see `overwrite`.
    camera : Camera or path, optional
        The calibrated camera, of the whole picture: `roi` is allowed for.
    height_m : float or path, optional
        Perpendicular distance from the ground in metres, or a CSV with the columns ``t_s,height_m`` or ``t_s,range_m``,
        see `rsflow.velocity.Heights`.
    height_std_m : float, optional
        Standard deviation of the height, in metres; 0 says that it is exact. Without it the velocities' deviations
        leave it out, and the report says so.
    sensors : rsflow.velocity.Sensors, optional
        Logs of a gyro and of attitudes, how the camera is mounted, what is known of clocks and shutter.
    start, stop, stride : int, optional
        Frames to take, as ``range(start, stop, stride)``.
    roi : (x, y, width, height), optional
        Part of the picture to look at, in pixels.
    mask : ndarray of bool, (height, width), or path, optional
        True where a pixel counts, in every frame; of a picture file, what is not black. It is of the whole picture:
        `roi` is allowed for. What is fixed to the sensor (letters over the picture, a part of the own vehicle) is left
        out of every figure, arrow and thing that moves; the shares in the tables are of the pixels that count.
    lines : sequence of (x0, y0, x1, y1), optional
        Count the things that cross these, in pixels of the whole first picture; see `rsflow.objects.CountingLine`.
    scale_m_per_px : float, optional
        Metres on the ground for each pixel, for the speeds of things; a camera and its height say it themselves.
    frame_rate : float, optional
        Frames per second, for pictures, which have no times, and for slow-motion clips.
    times : path, optional
        In its place a CSV with the time of each frame of the source, in ``t_s``, ``t_ms``, ``t_us`` or ``t_ns``.
    preset : {"ultrafast", "fast", "balanced", "accurate"}
        Of the dense flow. Displacement and velocity do not depend on it; of what moves, "fast" gives as good outlines
        as the others.
    illumination : {"gain_offset", "offset", "none"}
        Change of light that every estimator allows for.
    max_displacement : float, optional
        The longest displacement to look for, a length in pixels from frame to frame: longer ones are not sought, and
        none is valid. By default half the frame, or half the window, along each axis.
    camera_motion : {"auto", "moving", "static"}
        Whether the camera moves; "auto" decides from the first frames and says so in the report.
    videos : bool
        Write the three videos.
    progress : bool
        Show a progress bar on standard error.
    on_frame : callable, optional
        Called with each frame's `Measured`: its picture, flow, segmentation, velocity and rows; in order, from
        another thread.
    overwrite : bool
        Replace the result of another source or of other settings too. A camera, a stream or an iterable, which two
        runs cannot be known to see alike, always count as another source.
    resume : bool
        Go on with the run of this source and these settings that was interrupted, failed or was killed in `out`, from
        its last checkpoint: the tables become the same, to the byte, as those of a run in one piece. Where there is
        none, begin; where the result is complete, give it. `on_frame` sees the new frames alone.

    Returns
    -------
    Extraction
        Paths of the files and the key figures.

    Raises
    ------
    PartialExtractionError
        If the source breaks off, the disk becomes full or anything else fails on the way. What is finished is kept
        in files named ``*.partial.*``, with a report; its `extraction` names them.
    ExtractionInterrupted
        At Ctrl-C or SIGTERM, likewise; a `KeyboardInterrupt`. A live source is ended by it and complete.
    CaptureError
        If the source cannot be opened, or no frame is left of it by `start`, `stop` and `stride`.
    OptionError, FormatError
        If an option is outside of what it allows, the camera file is not one, no frame has a height, a result would be
        written over a file that is read, `out` holds the result of another run, or there is something to resume that
        cannot be. Nothing is written then.
    ShapeError
        If the mask has not the size of the pictures.
    OSError
        If the folder cannot be written.

    Examples
    --------
    >>> import tempfile, rsflow
    >>> from rsflow import synthetic
    >>> flight = synthetic.flight(frames=4, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = rsflow.extract(flight.images, folder, frame_rate=30, camera=flight.camera, height_m=0.2)
    >>> done.frames, round(done.summary["speed_median_m_s"], 3)
    (4, 0.03)
    """
    settings = ExtractSettings(
        camera=camera,
        height_m=height_m,
        height_std_m=height_std_m,
        sensors=sensors,
        start=start,
        stop=stop,
        stride=stride,
        roi=roi,
        mask=mask,
        lines=lines,
        scale_m_per_px=scale_m_per_px,
        frame_rate=frame_rate,
        times=times,
        preset=preset,
        illumination=illumination,
        max_displacement=max_displacement,
        camera_motion=camera_motion,
        videos=videos,
    )
    settings.validate()
    out, progress = _checks.path("out", out, "a folder"), _checks.flag("progress", progress)
    overwrite, resume = _checks.flag("overwrite", overwrite), _checks.flag("resume", resume)
    if on_frame is not None:
        _checks.function("on_frame", on_frame, 1)
    from ..capture.opening import frames

    options: dict[str, Any] = {"color": True, "roi": roi, "stop": stop, "stride": stride}
    options |= {"frame_rate": frame_rate, "times": times}
    with frames(source, start=start, **options) as stream:
        expect_range(stream)
        claim = Claim(out, source, settings, overwrite=overwrite)
        saved = saved_run(claim, overwrite=overwrite) if resume else None
        done = finished(claim) if resume and saved is None else None
        if done is not None:
            return done
        if saved is None:
            return _run(stream, claim, on_frame, progress)
    try:
        with frames(source, start=saved.frame, **options) as stream:
            return _run(stream, claim, on_frame, progress, saved)
    except CheckpointError:
        if not overwrite:
            raise
    with frames(source, start=start, **options) as stream:
        return _run(stream, claim, on_frame, progress)


def _run(
    stream: Any, claim: Claim, on_frame: Callable[[Measured], None] | None, progress: bool, saved: Saved | None = None
) -> Extraction:
    with restoring(saved):
        outputs = Outputs(claim.folder, stream, claim.settings, claim, saved)
    with outputs:
        with restoring(saved):
            job = _Job(stream, claim.settings, outputs, on_frame, saved)
        return job.run(progress)


# Frames that wait to be measured, and to be separated after that: what is read is kept where a run is stopped.
_AHEAD, _MEASURED = 1, 2


class _Job:
    """One pass over a source, until its end, Ctrl-C, or a failure."""

    def __init__(
        self,
        stream: Any,
        settings: ExtractSettings,
        outputs: Outputs,
        on_frame: Callable[[Measured], None] | None,
        saved: Saved | None = None,
    ) -> None:
        self.stream, self.settings, self.outputs, self.on_frame = stream, settings, outputs, on_frame
        self.pipeline = Pipeline(settings, stream, whole=saved is None)
        self.held: list[tuple[Any, Any, Any]] = []
        self.settled = saved is not None
        self.last: int | None = None
        # A run that is gone on with had its first pair before.
        self.taken = 0 if saved is None else 2
        self.begin = time.monotonic()
        if saved is not None:
            self._go_on(saved)
        self.second: BackgroundWorker[tuple[Any, Any, Any]] = BackgroundWorker(
            self._process, name="rsflow-separate", depth=_MEASURED
        )
        self.first: BackgroundWorker[Any] = BackgroundWorker(self._measure, name="rsflow-measure", depth=_AHEAD)

    def _go_on(self, saved: Saved) -> None:
        """Be as after the frame of a checkpoint, which is the first that the stream gives."""
        frame = next(self.stream, None)
        if frame is None or frame.index != saved.frame:
            raise ValueError(f"the source has no frame {saved.frame} any more")
        self.pipeline.go_on(saved, frame)
        self.outputs.go_on(saved, frame)
        self.last = frame.index

    def run(self, progress: bool) -> Extraction:
        """Take all frames; raise what ended the run early, after keeping what is finished."""
        with StopRequest() as stop:
            interrupted, failure = False, None
            try:
                with Progress(self.stream.count, label=Path(self.stream.source).name, enabled=progress) as bar:
                    for frame in self.stream:
                        self.take(frame)
                        bar.advance()
                        if stop.requested:
                            break
            except KeyboardInterrupt:
                interrupted = True
            except Exception as error:
                failure = error
            interrupted = interrupted or stop.requested
            failure = _trouble(self.first.close) or failure
            interrupted = interrupted and failure is None
            # What the probe decides from fewer frames than it wants is not what the whole run would decide.
            whole = self.settled
            failure = self._drained() or failure
            alone = self.taken < 2 and failure is None and not interrupted
            if self.last is None or alone:
                # Nothing to keep: the folder stays as it was.
                raise failure or (KeyboardInterrupt() if interrupted else too_few(self.stream, self.taken))
            if failure is None and not interrupted:
                failure = self.pipeline.without_log()
            if interrupted and whole and failure is None:
                failure = self._last_checkpoint()
            return self._ended(interrupted, failure, time.monotonic() - self.begin)

    def take(self, frame: Any) -> None:
        """Have one frame measured: the next ones are read meanwhile."""
        self.taken += 1
        self.first.put(frame)

    def _measure(self, frame: Any) -> None:
        """Measure one frame; the first ones wait until the probe is decided."""
        shift, flow = self.pipeline.measure(frame)
        if self.settled:
            self.second.put((frame, shift, flow))
            return
        self.held.append((frame, shift, flow))
        size = frame.image.nbytes + frame.color.nbytes + (0 if flow is None else flow.uv.nbytes)
        if len(self.held) > min(PROBE_PAIRS, max(2, PROBE_BYTES // max(size, 1))):
            self.settle()

    def settle(self) -> None:
        """Decide what the probe is for and process the frames that waited."""
        self.settled = True
        held, self.held = self.held, []
        if held:
            width = held[0][0].image.shape[1]
            self.outputs.begin(self.pipeline.settle([(shift, flow) for _, shift, flow in held], width))
        for item in held:
            self.second.put(item)

    def _process(self, item: tuple[Any, Any, Any]) -> None:
        """Separate, measure the velocity, and hand over to the files: beside the measuring of the next frame."""
        frame, shift, flow = item
        measured = self.pipeline.finish(frame, shift, flow)
        self.outputs.add(measured, self.pipeline.attitude)
        self.last = frame.index
        if self.on_frame is not None:
            self.on_frame(measured)
        if self.outputs.schedule.due():
            self.outputs.checkpoint(frame.index, self.pipeline.state(), time.monotonic() - self.begin)

    def _drained(self) -> Exception | None:
        """Process what waits, also where the run was too short for the probe; give the error that ended it."""
        settled = None if self.settled else _trouble(self.settle)
        return _trouble(self.second.close) or settled

    def _last_checkpoint(self) -> Exception | None:
        """Let the rest be measured later as if nothing had happened; give the error that stands in the way."""
        assert self.last is not None
        try:
            assert self.outputs.views is not None
            trouble = self.outputs.views.drained()
            if trouble is None:
                seconds = time.monotonic() - self.begin
                self.outputs.checkpoint(self.last, self.pipeline.state(), seconds, drained=True)
        except Exception as error:
            return error
        return trouble

    def _ended(self, interrupted: bool, failure: BaseException | None, seconds: float) -> Extraction:
        """Complete the files and give or raise the result."""
        live_end = interrupted and self.stream.live
        reason = ""
        if failure is not None:
            reason = _reason(failure)
        elif interrupted and not live_end:
            reason = f"interrupted after frame {self.last}"
        seconds += self.outputs.seconds_before
        extraction, trouble = close(self.outputs, self.pipeline, Ending(reason, self.last, seconds))
        failure = failure or trouble
        if failure is not None:
            raise PartialExtractionError(f"{_reason(failure)}; {_kept(extraction)}", extraction) from failure
        if reason:
            raise ExtractionInterrupted(
                f"{reason}; {_kept(extraction)}; {_going_on(extraction, self.outputs.resumable)}", extraction
            )
        return extraction


def _trouble(end: Callable[[], None]) -> Exception | None:
    """Call `end`; give the error that it raised."""
    try:
        end()
    except Exception as error:
        return error
    return None


def _reason(error: BaseException) -> str:
    """Give the message of an expected error; the type too where it is not one of those."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}" if error.filename is None else f"{error.filename}: {error.strerror}"
    if isinstance(error, RsflowError):
        return " ".join(str(error).split())
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _kept(extraction: Extraction) -> str:
    if not extraction.files:
        return f"nothing could be kept in {extraction.folder}"
    kept = "1 frame is kept" if extraction.frames == 1 else f"{extraction.frames} frames are kept"
    return f"{kept} as *.partial.* in {extraction.folder}"


def _going_on(extraction: Extraction, resumable: bool) -> str:
    if resumable:
        return "the same command with --resume goes on"
    return f"go on into another folder with --start {extraction.summary['next_start']}"
