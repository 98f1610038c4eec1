"""A reading a frame: displacement, and velocity where camera and height are known, as numbers and words."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .._display import measured

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..capture.stream import Frame
    from ..extraction.ground import Ground
    from ..velocity import Velocity

__all__ = ["LiveReading", "reading"]

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


def reading(
    frame: Frame, dt_s: float, displacement: Mapping[str, Any], velocity: Velocity | None, ground: Ground | None
) -> LiveReading:
    """Make the reading of a frame; `displacement` has the columns of ``motion.csv`` for it."""
    return LiveReading(
        frame=frame.index,
        t_s=frame.t_s,
        dt_s=dt_s,
        **{name: displacement[name] for name in ("dx_px", "dy_px", "dx_std_px", "dy_std_px", "status")},
        **_velocity_fields(velocity),
        image=frame.color if frame.color is not None else frame.image,
        velocity=velocity,
        known={} if ground is None else ground.known,
        notes=() if ground is None or velocity is None else _notes(ground, velocity),
    )


def _notes(ground: Ground, velocity: Velocity) -> tuple[str, ...]:
    from ..velocity.result import not_stated

    return tuple(note for note in (*ground.notes, not_stated(velocity.unstated), *velocity.doubts) if note)


def _velocity_fields(velocity: Any) -> dict[str, Any]:
    from ..extraction.rows import status_word

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
