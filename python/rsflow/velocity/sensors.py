"""What stands beside a camera and what is known of it: logs of a gyro and of attitudes, mounting, clocks."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .. import _checks
from .._display import fields
from .attitudes import Earth
from .mounting import mounting

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["Sensors"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensors:
    """Logs beside a source of frames, how the camera is mounted, and how exact clocks and rates are.

    Attributes
    ----------
    rates : path, optional
        CSV of a gyro, see `Rates.read`: each frame gets the mean rate since the one before.
    rate_std_rad_s : float, optional
        Standard deviation of each axis of these means, of a gyro's bias for one; without `rates`, of the turning that
        is not known.
    rate_delay_s : float
        How much later than it happened a rate stands in the log.
    rate_delay_std_s : float, optional
        Standard deviation of that delay.
    attitude : path, optional
        CSV of attitudes, see `Attitudes.read`: each frame gets where straight down is. Without one, the optical axis.
    earth : {"ned", "enu"}
        The earth's axes of quaternions in `attitude`: north, east, down, or east, north, up.
    down_std_rad : float, optional
        Standard deviation of the direction of straight down, about each axis.
    dt_std_s : float, optional
        Standard deviation of the time between two frames.
    readout_s : float, optional
        Time from the exposure of the first row of a rolling shutter to that of the last; 0 where all are at once.
        Without it, it is learned where the camera turns.
    max_height_gap_s : float, optional
        How long a height is carried on by the pictures where the log has none.
    max_speed_m_s : float, optional
        The highest speed over the ground that is possible: on tiles it tells which of several motions it was.
    mount : str or (3, 3) array_like, optional
        How the camera is mounted on the body whose axes the logs are in, see `mounting`: velocities are then in the
        body's axes. Without it the body's axes are the camera's.
    log_start_s : float
        What the clock of all logs shows at the source's time 0.

    Examples
    --------
    >>> sensors = Sensors(rates="gyro.csv", rate_std_rad_s=0.01, mount="x-right")
    >>> sensors.validate()
    >>> Sensors(dt_std_s=-1.0).validate()
    Traceback (most recent call last):
    rsflow.errors.OptionError: dt_std_s: got -1.0, expected a finite number of seconds of at least 0, or None
    """

    rates: str | os.PathLike[str] | None = None
    rate_std_rad_s: float | None = None
    rate_delay_s: float = 0.0
    rate_delay_std_s: float | None = None
    attitude: str | os.PathLike[str] | None = None
    earth: Earth = "ned"
    down_std_rad: float | None = None
    dt_std_s: float | None = None
    readout_s: float | None = None
    max_height_gap_s: float | None = None
    max_speed_m_s: float | None = None
    mount: str | ArrayLike | None = None
    log_start_s: float = 0.0

    __repr__ = fields

    def validate(self) -> None:
        """Raise OptionError, ShapeError or DTypeError for what cannot be, whatever the logs hold."""
        for name in ("rates", "attitude"):
            if getattr(self, name) is not None:
                _checks.path(name, getattr(self, name))
        _checks.number_or_none("rate_std_rad_s", self.rate_std_rad_s, least=0, of="rad/s")
        _checks.number("rate_delay_s", self.rate_delay_s, of="seconds")
        _checks.number_or_none("rate_delay_std_s", self.rate_delay_std_s, least=0, of="seconds")
        _checks.choice("earth", self.earth, ("ned", "enu"))
        _checks.number_or_none("down_std_rad", self.down_std_rad, least=0, of="radians")
        _checks.number_or_none("dt_std_s", self.dt_std_s, least=0, of="seconds")
        _checks.number_or_none("readout_s", self.readout_s, least=-10, most=10, of="seconds")
        _checks.number_or_none("max_height_gap_s", self.max_height_gap_s, least=0, of="seconds")
        _checks.number_or_none("max_speed_m_s", self.max_speed_m_s, above=0, of="m/s")
        if self.mount is not None:
            mounting(self.mount)
        _checks.number("log_start_s", self.log_start_s, of="seconds")
