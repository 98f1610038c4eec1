"""The main job: one pass over a source, each frame measured once, everything written as it comes."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from .. import _checks
from ..capture.too_few import expect_range
from .checkpoint import CheckpointError, Saved, restoring
from .claim import Claim
from .outputs import Outputs
from .pipeline import Measured
from .result import Extraction
from .resume import finished, saved_run
from .run import Run
from .settings import CameraMotion, ExtractSettings, Illumination, Preset

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
            run = Run(stream, claim.settings, outputs, on_frame, saved)
        return run.run(progress)
