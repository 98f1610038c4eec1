"""The light way: displacement, and velocity with a camera and a height, and nothing else."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _checks
from .._checks import knobs
from ..errors import OptionError
from .opening import opened
from .reading import LiveReading, reading

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .._checks.knobs import Illumination
    from ..camera.model import Camera
    from ..capture.stream import Frames, FrameSource
    from ..extraction.ground import Ground
    from ..velocity import Sensors

__all__ = ["readings"]


def readings(
    source: FrameSource = 0,
    *,
    camera: Camera | str | os.PathLike[str] | None = None,
    height_m: float | str | os.PathLike[str] | None = None,
    height_std_m: float | None = None,
    sensors: Sensors | None = None,
    roi: tuple[int, int, int, int] | None = None,
    mask: NDArray[np.bool_] | str | os.PathLike[str] | None = None,
    illumination: Illumination = "gain_offset",
    max_displacement: float | None = None,
    timeout_s: float = 5.0,
    reconnect_s: float | None = None,
    real_time: bool = False,
    frame_rate: float | None = None,
) -> Iterator[LiveReading]:
    """Measure frame by frame while a camera runs, always on the newest frame.

    Parameters
    ----------
    source : int, str or any source of `rsflow.frames`
        A camera's index or a stream's URL; a video or a list of pictures serves for a rehearsal, without dropping.
    camera : Camera or path, optional
        With `height_m`: the calibrated camera, for velocities.
    height_m : float or path, optional
        Distance from the ground in metres, or for a rehearsal on a video a CSV, see `rsflow.velocity.Heights`.
    height_std_m : float, optional
        Its standard deviation in metres; 0 says that it is exact.
    sensors : rsflow.velocity.Sensors, optional
        How the camera is mounted, what is known of clocks and shutter; for a rehearsal also logs of sensors.
    roi : (x, y, width, height), optional
        Part of the picture to look at, in pixels.
    mask : ndarray of bool, (height, width), or path, optional
        True where a pixel counts, in every frame; of a picture file, what is not black. It is of the whole picture:
        `roi` is allowed for.
    illumination : {"gain_offset", "offset", "none"}
        Change of light that is allowed for.
    max_displacement : float, optional
        The longest displacement to look for, a length in pixels from frame to frame: longer ones are not sought, and
        none is valid. By default half the frame, or half the window, along each axis.
    timeout_s, reconnect_s, real_time, frame_rate
        As of `rsflow.frames`: how long to wait for a frame before `CaptureError`, and for a camera that went away after
        it had given some; whether a video is played at its own pace; frames per second of pictures.

    Yields
    ------
    LiveReading
        From the second frame on.

    Raises
    ------
    CaptureError
        If the camera cannot be opened, or goes away.
    OptionError
        If an option is outside of what it allows.
    DTypeError, ShapeError
        If the mask is not of bool, or has not the size of the pictures.

    Examples
    --------
    >>> from rsflow import live, synthetic
    >>> flight = synthetic.flight(frames=3, velocity_m_s=(0.02, 0.0, 0.0), seed=1)
    >>> [(reading.frame, round(reading.dx_px, 1)) for reading in live.readings(list(flight.images))]
    [(1, -0.6), (2, -0.6)]
    """
    if (camera is None) != (height_m is None):
        raise OptionError("camera, height_m: got one of them, expected both, since a velocity follows from both")
    if isinstance(height_m, (str, os.PathLike)):
        height_m = _checks.path("height_m", height_m, "metres or a path")
    elif height_m is not None:
        height_m = _checks.number("height_m", height_m, above=0, of="metres")
    if sensors is not None:
        from ..velocity import Sensors

        _checks.instance("sensors", sensors, Sensors, "an rsflow.velocity.Sensors").validate()
        if camera is None:
            raise OptionError("sensors: got some, expected camera= and height_m= with them, for a velocity")
    height_std_m = _checks.number_or_none("height_std_m", height_std_m, least=0, of="metres")
    knobs.illumination(illumination)
    knobs.max_displacement(max_displacement)
    mask = _checks.path("mask", mask) if isinstance(mask, (str, os.PathLike)) else _checks.mask_or_none("mask", mask)
    waits = {"timeout_s": timeout_s, "reconnect_s": reconnect_s}
    stream = opened(source, roi=roi, real_time=real_time, frame_rate=frame_rate, **waits)
    ground = None
    if camera is not None and height_m is not None:
        from ..extraction.ground import Ground

        ground = Ground(camera, height_m, height_std_m, sensors)
    return _measured(stream, ground, roi, mask, illumination=illumination, max_displacement=max_displacement)


def _measured(
    stream: Frames,
    ground: Ground | None,
    roi: tuple[int, int, int, int] | None,
    mask: NDArray[np.bool_] | str | os.PathLike[str] | None,
    **options: Any,
) -> Iterator[LiveReading]:
    from ..capture.masks import mask_of_frames
    from ..extraction.rows import status_word
    from ..shift import estimate_shift

    prev: Any = None
    with stream:
        counts = mask_of_frames(mask, stream, roi)
        gaps = 0
        for frame in stream:
            if stream.gaps > gaps:
                gaps, prev = stream.gaps, None
                if ground is not None:
                    ground.after_gap()
            velocity = None
            if ground is not None:
                if not ground.is_open:
                    ground.open(stream, roi, counts)
                velocity, _ = ground.update(frame)
            if prev is not None:
                shift = estimate_shift(prev.image, frame.image, mask=counts, next_mask=counts, **options)
                std = np.sqrt(np.diag(shift.covariance))
                displacement = {
                    "dx_px": float(shift.dx) if shift.valid else float("nan"),
                    "dy_px": float(shift.dy) if shift.valid else float("nan"),
                    "dx_std_px": float(std[0]),
                    "dy_std_px": float(std[1]),
                    "status": status_word(shift.status),
                }
                yield reading(frame, frame.t_s - prev.t_s, displacement, velocity, ground)
            prev = frame
