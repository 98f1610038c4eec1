"""What the filter says after a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._display import measured
from .._results.status import Status
from .result import Velocity

__all__ = ["FilterStatus", "FilteredVelocity"]

F64 = NDArray[np.float64]


class FilterStatus(Status):
    """What the filter did with a frame.

    Examples
    --------
    >>> import rsflow
    >>> flight = rsflow.synthetic.flight(frames=2, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> estimator = rsflow.VelocityEstimator(flight.camera, height_m=0.2)
    >>> kalman = rsflow.VelocityFilter()
    >>> for frame in flight:
    ...     print(kalman.update(estimator.update(frame.image, frame.t_s)).status)
    WAITING
    OK
    """

    OK = 0, "The velocity of this frame was taken in."
    WAITING = 1, "There was no velocity yet."
    PREDICTED = 2, "There is no velocity for this frame: carried on from those before."
    REJECTED = 3, "The velocity of this frame lies outside of the gate: carried on from those before."
    RESTARTED = 4, "The velocities lay outside of the gate for too long: begun anew with that of this frame."


@dataclass(frozen=True, eq=False)
class FilteredVelocity:
    """State of a body at the time of a frame, from all velocities up to it.

    Attributes
    ----------
    t_s : float
        Time of the frame.
    vx_m_s, vy_m_s, vz_m_s : float
        Velocity at that time, in the axes of the body, as of `Velocity`; NaN before the first velocity.
    covariance : (3, 3) float64
        Of (vx, vy, vz), in m^2/s^2; infinite before the first velocity.
    position_m : (3,) float64
        Way from where the first velocity's interval began, in level axes: those of the body there, z straight down.
    position_covariance : (3, 3) float64
    acceleration_m_s2 : (3,) float64
        In the axes of `position_m`.
    acceleration_covariance : (3, 3) float64
    heading_rad, heading_std_rad : float
        Turn about straight down since then.
    gyro_bias_rad_s, gyro_bias_std_rad_s : (3,) float64
        What the gyro reads where nothing turns, in the axes of the body.
    delay_s, delay_std_s : float
        By how much the gyro is late.
    status : FilterStatus
    innovation : float
        Mahalanobis distance of this frame's velocity from what was expected; NaN without one.
    acceleration_walk_m_s2 : float
        What accelerations are taken to change by within a second: as given, or more where the velocities show it.
    measurement : Velocity
        This frame's velocity, as it was given.

    Examples
    --------
    >>> import rsflow
    >>> flight = rsflow.synthetic.flight(frames=4, height_m=0.2, velocity_m_s=(0.03, -0.01, 0.0), seed=1)
    >>> estimator = rsflow.VelocityEstimator(flight.camera, height_m=0.2, rate_std_rad_s=0.0)
    >>> kalman = rsflow.VelocityFilter(acceleration_walk_m_s2=0.1)
    >>> for frame in flight:
    ...     now = kalman.update(estimator.update(frame.image, frame.t_s))
    >>> round(now.vx_m_s, 3), round(now.vy_m_s, 3), now.measurement.valid
    (0.03, -0.01, True)
    >>> way = (flight.t_s[-1] - flight.t_s[0]) * 0.03
    >>> bool(abs(now.position_m[0] - way) < 4 * now.position_covariance[0, 0] ** 0.5 < 0.05 * way)
    True
    """

    t_s: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    covariance: F64
    position_m: F64
    position_covariance: F64
    acceleration_m_s2: F64
    acceleration_covariance: F64
    heading_rad: float
    heading_std_rad: float
    gyro_bias_rad_s: F64
    gyro_bias_std_rad_s: F64
    delay_s: float
    delay_std_s: float
    status: FilterStatus
    innovation: float
    acceleration_walk_m_s2: float
    measurement: Velocity

    def __repr__(self) -> str:
        if not self.valid:
            return f"FilteredVelocity(t={self.t_s:.6g} s, {self.status}: {self.status.explanation})"
        std, off = np.sqrt(np.diag(self.covariance)), np.sqrt(np.diag(self.position_covariance))
        v = (self.vx_m_s, self.vy_m_s, self.vz_m_s)
        speeds = ", ".join(f"v{axis}={measured(v[k], std[k])}" for k, axis in enumerate("xyz"))
        places = ", ".join(f"{axis}={measured(self.position_m[k], off[k])}" for k, axis in enumerate("xyz"))
        return (
            f"FilteredVelocity(t={self.t_s:.6g} s, {speeds} m/s,\n"
            f"                 {places} m,\n"
            f"                 heading {measured(self.heading_rad, self.heading_std_rad)} rad, {self.status})"
        )

    @property
    def valid(self) -> bool:
        """Whether there is an estimate: a velocity was taken in, now or before."""
        return self.status is not FilterStatus.WAITING

    @property
    def unstated(self) -> tuple[str, ...]:
        """What deviations leave out since nobody stated it, as of the measurement."""
        return self.measurement.unstated

    def to_dict(self) -> dict[str, float | str]:
        """Give it as a row, for ``pandas.DataFrame`` a list of such.

        Returns
        -------
        dict of str to float or str
            Time, velocity, position and acceleration with standard deviations, heading, gyro bias, delay, status.

        Examples
        --------
        >>> import rsflow
        >>> v = rsflow.Velocity(1.0, 0.1, 3.0, 4.0, 0.5, np.eye(3) * 0.01, rsflow.VelocityStatus.OK, 90, 5.0, 5.0)
        >>> row = rsflow.VelocityFilter().update(v, rate_rad_s=(0.0, 0.0, 0.0)).to_dict()
        >>> row["t_s"], round(row["vx_m_s"], 6), round(row["x_m"], 6), row["status"]
        (1.0, 3.0, 0.3, 'ok')
        """
        row: dict[str, float | str] = {"t_s": self.t_s}
        v = np.array([self.vx_m_s, self.vy_m_s, self.vz_m_s])
        for (name, unit), value, covariance in (
            (("v{}", "m_s"), v, self.covariance),
            (("{}", "m"), self.position_m, self.position_covariance),
            (("a{}", "m_s2"), self.acceleration_m_s2, self.acceleration_covariance),
        ):
            std = np.sqrt(np.diag(covariance))
            for k, axis in enumerate("xyz"):
                row[f"{name.format(axis)}_{unit}"] = float(value[k])
                row[f"{name.format(axis)}_std_{unit}"] = float(std[k])
        row |= {"heading_rad": self.heading_rad, "heading_std_rad": self.heading_std_rad}
        for k, axis in enumerate("xyz"):
            row[f"gyro_bias_{axis}_rad_s"] = float(self.gyro_bias_rad_s[k])
            row[f"gyro_bias_{axis}_std_rad_s"] = float(self.gyro_bias_std_rad_s[k])
        row |= {"delay_s": self.delay_s, "delay_std_s": self.delay_std_s, "innovation": self.innovation}
        row["acceleration_walk_m_s2"] = self.acceleration_walk_m_s2
        without = "+".join(name.replace(" ", "_") for name in self.unstated)
        return row | {"status": self.status.word, "std_without": without}
