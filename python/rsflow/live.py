"""Motion from a running camera, a reading a frame: displacement, and velocity where camera and height are known."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _checks
from ._checks import knobs
from ._display import measured
from .errors import OptionError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ._checks.knobs import Illumination
    from .camera.model import Camera
    from .capture.stream import Frames, FrameSource
    from .extraction.ground import Ground
    from .velocity import Sensors, Velocity

__all__ = ["LiveReading", "readings"]

# Of a reading, what is no number and no text.
_OBJECTS = ("image", "velocity", "known")


@dataclass(frozen=True, eq=False)
class LiveReading:
    """The motion from the frame before to this one.

    Attributes
    ----------
    frame : int
        Number of the frame in the source; a gap tells how many were dropped since nobody was ready for them.
    t_s, dt_s : float
        Its time and the time since the frame before, in seconds.
    dx_px, dy_px, dx_std_px, dy_std_px : float
        Displacement of the picture with standard deviations, in pixels; NaN and infinite where it cannot be measured.
    status : str
        Why not, or ``ok``.
    vx_m_s, vy_m_s, vz_m_s, vx_std_m_s, vy_std_m_s, vz_std_m_s : float or None
        Velocity of the camera over the ground, in m/s; None without a camera.
    velocity_status : str or None
        As `status`, for the velocity.
    image : (H, W) or (H, W, 3) array
        The frame, for a viewer.
    notes : tuple of str
        What to know of the velocities: that the camera was scaled to the size of the frames, what logs of sensors have
        holes, what their deviations leave out since it was not stated, and what is odd about the frame.
    velocity : Velocity or None
        The whole of the velocity.
    known : mapping
        What it was computed with: `height_m`, `rate_rad_s` and `down`, as of `rsflow.interop.flow_sensor.flow_reading`.

    Examples
    --------
    >>> import rsflow
    >>> from rsflow.live import readings
    >>> flight = rsflow.synthetic.flight(frames=3, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> reading = list(readings(flight, camera=flight.camera, height_m=0.2))[-1]
    >>> reading.frame, reading.status, round(reading.vx_m_s, 3)
    (2, 'ok', 0.03)
    >>> list(reading.to_dict())[:4]
    ['frame', 't_s', 'dt_s', 'dx_px']
    """

    frame: int
    t_s: float
    dt_s: float
    dx_px: float
    dy_px: float
    dx_std_px: float
    dy_std_px: float
    status: str
    vx_m_s: float | None
    vy_m_s: float | None
    vz_m_s: float | None
    vx_std_m_s: float | None
    vy_std_m_s: float | None
    vz_std_m_s: float | None
    velocity_status: str | None
    image: NDArray[Any]
    notes: tuple[str, ...] = ()
    velocity: Velocity | None = field(default=None, repr=False)
    known: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        dx, dy = measured(self.dx_px, self.dx_std_px), measured(self.dy_px, self.dy_std_px)
        first = f"LiveReading(frame {self.frame}, t={self.t_s:.6g} s: dx={dx}, dy={dy} px, {self.status}"
        if self.vx_m_s is None or self.vy_m_s is None or self.vz_m_s is None:
            return f"{first})"
        velocity = f"v=({self.vx_m_s:.4g}, {self.vy_m_s:.4g}, {self.vz_m_s:.4g}) m/s, {self.velocity_status}"
        return f"{first};\n            {velocity})"

    def to_dict(self) -> dict[str, Any]:
        """Give the numbers without the picture, NaN and infinity as None: what JSON can say.

        Returns
        -------
        dict of str to int, float, str, list of str or None
        """
        values = {item.name: getattr(self, item.name) for item in dataclasses.fields(self) if item.name not in _OBJECTS}
        values["notes"] = list(self.notes)
        return {
            name: None if isinstance(value, float) and not np.isfinite(value) else value
            for name, value in values.items()
        }


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
    timeout_s : float
        How long to wait for a frame before `CaptureError`.

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
    from .capture import frames

    if (camera is None) != (height_m is None):
        raise OptionError("camera, height_m: got one of them, expected both, since a velocity follows from both")
    if isinstance(height_m, (str, os.PathLike)):
        height_m = _checks.path("height_m", height_m, "metres or a path")
    elif height_m is not None:
        height_m = _checks.number("height_m", height_m, above=0, of="metres")
    if sensors is not None:
        from .velocity import Sensors

        _checks.instance("sensors", sensors, Sensors, "an rsflow.velocity.Sensors").validate()
        if camera is None:
            raise OptionError("sensors: got some, expected camera= and height_m= with them, for a velocity")
    height_std_m = _checks.number_or_none("height_std_m", height_std_m, least=0, of="metres")
    knobs.illumination(illumination)
    knobs.max_displacement(max_displacement)
    mask = _checks.path("mask", mask) if isinstance(mask, (str, os.PathLike)) else _checks.mask_or_none("mask", mask)
    stream = frames(source, color=True, roi=roi, timeout_s=timeout_s)
    ground = None
    if camera is not None and height_m is not None:
        from .extraction.ground import Ground

        ground = Ground(camera, height_m, height_std_m, sensors)
    return _measured(stream, ground, roi, mask, illumination=illumination, max_displacement=max_displacement)


def _measured(
    stream: Frames,
    ground: Ground | None,
    roi: tuple[int, int, int, int] | None,
    mask: NDArray[np.bool_] | str | os.PathLike[str] | None,
    **options: Any,
) -> Iterator[LiveReading]:
    from .capture.masks import mask_of_frames
    from .extraction.rows import status_word
    from .shift import estimate_shift

    prev: Any = None
    with stream:
        counts = mask_of_frames(mask, stream, roi)
        for frame in stream:
            velocity = None
            if ground is not None:
                if not ground.is_open:
                    ground.open(stream, roi, counts)
                velocity, _ = ground.update(frame)
            if prev is not None:
                shift = estimate_shift(prev.image, frame.image, mask=counts, next_mask=counts, **options)
                std = np.sqrt(np.diag(shift.covariance))
                yield LiveReading(
                    frame=frame.index,
                    t_s=frame.t_s,
                    dt_s=frame.t_s - prev.t_s,
                    dx_px=float(shift.dx) if shift.valid else float("nan"),
                    dy_px=float(shift.dy) if shift.valid else float("nan"),
                    dx_std_px=float(std[0]),
                    dy_std_px=float(std[1]),
                    status=status_word(shift.status),
                    **_velocity_fields(velocity),
                    image=frame.color if frame.color is not None else frame.image,
                    velocity=velocity,
                    known={} if ground is None else ground.known,
                    notes=() if ground is None or velocity is None else _notes(ground, velocity),
                )
            prev = frame


def _notes(ground: Ground, velocity: Velocity) -> tuple[str, ...]:
    from .velocity.result import not_stated

    return tuple(note for note in (*ground.notes, not_stated(velocity.unstated), *velocity.doubts) if note)


def _velocity_fields(velocity: Any) -> dict[str, Any]:
    from .extraction.rows import status_word

    if velocity is None:
        names = ("vx_m_s", "vy_m_s", "vz_m_s", "vx_std_m_s", "vy_std_m_s", "vz_std_m_s", "velocity_status")
        return dict.fromkeys(names)
    std = np.sqrt(np.diag(velocity.covariance))
    return {
        "vx_m_s": float(velocity.vx_m_s),
        "vy_m_s": float(velocity.vy_m_s),
        "vz_m_s": float(velocity.vz_m_s),
        "vx_std_m_s": float(std[0]),
        "vy_std_m_s": float(std[1]),
        "vz_std_m_s": float(std[2]),
        "velocity_status": status_word(velocity.status),
    }
