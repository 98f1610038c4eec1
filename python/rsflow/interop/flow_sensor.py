"""What an autopilot's flow sensor would have said: velocities as angles of flow in the axes of a vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._display import fields
from ..errors import OptionError
from ..velocity import Velocity

__all__ = ["FlowReading", "Forward", "flow_reading", "quality_of"]

F64 = NDArray[np.float64]
Forward = Literal["top", "right", "bottom", "left", "x"]

_MOST = 1e9
# Below this the body looks past the ground: 80 degrees from straight down.
_LEAST_COSINE = 0.17
# What does not reach the flow: a height scales velocity and distance alike, a rate that was taken off is added again.
_NOT_OF_THE_FLOW = ("height", "gyro", "rotation")
# PX4's EKF2_OF_N_MIN and EKF2_OF_N_MAX: what it takes the qualities 255 and EKF2_OF_QMIN for, in rad/s.
PX4_NOISE_RAD_S = (0.15, 0.5)

# Forward, right, down from the axes of the velocity: what points forward.
_ROTATIONS: dict[str, tuple[tuple[float, float, float], ...]] = {
    "top": ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "right": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "bottom": ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "left": ((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "x": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}


@dataclass(frozen=True, eq=False)
class FlowReading:
    """Flow of one interval in the axes forward, right, down of a vehicle.

    Attributes
    ----------
    t_s, dt_s : float
        Time of the second frame, and time since the one before.
    flow_rad : (2,) float64
        Angles by which the ground seems to turn about the forward and the right axis, the sensor's own turn included:
        a turn of the vehicle to the right wing down is positive about the forward axis, as is a motion to the left.
        Moving forward is positive about the right axis. Zeros where the velocity was not measured.
    gyro_rad : (3,) float64
        Turn of the vehicle meanwhile, by a gyro, right-handed, as it was taken off; NaN where no rate was given.
    distance_m : float
        To the ground along the vehicle's down axis; NaN where not known.
    velocity_m_s, covariance : (3,) and (3, 3) float64
        Of the vehicle over the ground; NaN and infinite where not measured.
    rate_rad_s, rate_covariance : (3,) and (3, 3) float64
        Its mean rate, by a gyro or as the pictures tell; NaN and infinite where not known.
    noise_rad_s : float
        Standard deviation of the flow's rate along its worst axis; infinite where not measured.
    quality : int
        0 to 255, see `quality_of`; 0 where not measured.

    Examples
    --------
    >>> from rsflow import Velocity, VelocityStatus
    >>> from rsflow.interop.flow_sensor import flow_reading
    >>> v = Velocity(1.0, 0.1, 0.0, -3.0, 0.0, np.eye(3) * 1e-4, VelocityStatus.OK, 90, 0.0, 5.0)
    >>> reading = flow_reading(v, forward="top", height_m=2.0)  # the picture's top is forward: so moves the camera
    >>> float(reading.velocity_m_s[0]), round(float(reading.flow_rad[1]), 3), reading.quality
    (3.0, 0.15, 255)
    """

    t_s: float
    dt_s: float
    flow_rad: F64
    gyro_rad: F64
    distance_m: float
    velocity_m_s: F64
    covariance: F64
    rate_rad_s: F64
    rate_covariance: F64
    noise_rad_s: float
    quality: int

    __repr__ = fields

    @property
    def valid(self) -> bool:
        """Whether there is a flow: the velocity was measured, and the vehicle looks at the ground."""
        return math.isfinite(self.noise_rad_s)


def flow_reading(
    velocity: Velocity,
    *,
    forward: Forward,
    height_m: float | None = None,
    rate_rad_s: ArrayLike | None = None,
    down: ArrayLike | None = None,
    noise_rad_s: tuple[float, float] = PX4_NOISE_RAD_S,
) -> FlowReading:
    """Give what a flow sensor that looks along the vehicle's down axis would have measured.

    The flow is the velocity over the distance, plus the turn that was taken off for it. The height cancels: a velocity
    that was computed with 1 m and is divided by 1 m is the same flow as one of the true height.

    Parameters
    ----------
    velocity : Velocity
        Of an interval.
    forward : {"top", "right", "bottom", "left", "x"}
        Which side of the picture points forward, where velocities are in the axes of a camera that looks down; "x"
        where the estimator's `R_body_from_camera` already gives forward, right, down.
    height_m : float, optional
        Height that the velocity was computed with; by default, and where it is NaN, the velocity's own.
    rate_rad_s : (3,) array_like, optional
        Rate of a gyro that was given to the estimator, in the axes of the velocity; None and NaN where it had none.
    down : (3,) array_like, optional
        Straight down in the axes of the velocity, of any length; by default, and where it is NaN, its z axis.
    noise_rad_s : (float, float)
        Deviations of a flow's rate that the qualities 255 and 1 stand for.

    Returns
    -------
    FlowReading

    Raises
    ------
    OptionError
        If no height is known for a measured velocity, or an argument is outside of its range.
    ShapeError, DTypeError
        If a vector is of another shape or type.

    Examples
    --------
    >>> from rsflow import Velocity, VelocityStatus
    >>> from rsflow.interop.flow_sensor import flow_reading
    >>> right = Velocity(1.0, 0.1, 3.0, 0.0, 0.0, np.eye(3) * 1e-4, VelocityStatus.OK, 90, -5.0, 0.0)
    >>> round(float(flow_reading(right, forward="top", height_m=2.0).flow_rad[0]), 3)
    -0.15
    """
    _checks.instance("velocity", velocity, Velocity, "a Velocity")
    turn = np.array(_ROTATIONS[_checks.choice("forward", forward, tuple(_ROTATIONS))])
    best, worst = noise_bounds(noise_rad_s)
    rate, rate_covariance, by_gyro = _rate(velocity, rate_rad_s)
    height = _height(velocity, height_m)
    cosine = _cosine(down)
    distance = height / cosine if cosine > _LEAST_COSINE and height > 0 else math.nan
    v = _moved(turn, np.array([velocity.vx_m_s, velocity.vy_m_s, velocity.vz_m_s]))
    rate = _moved(turn, rate)
    known = bool(np.isfinite(rate).all())
    measured = velocity.valid and math.isfinite(distance) and velocity.dt_s > 0
    noise = math.inf
    flow = np.zeros(2)
    if measured:
        own = rate if known else np.zeros(3)
        flow = np.array([own[0] - v[1] / distance, own[1] + v[0] / distance]) * velocity.dt_s
        noise = float(np.sqrt(max(np.linalg.eigvalsh(_of_the_flow(velocity))[-1], 0.0)) / distance)
        if not (np.abs(flow) < _MOST).all():
            flow, noise = np.zeros(2), math.inf
    return FlowReading(
        t_s=velocity.t_s,
        dt_s=velocity.dt_s,
        flow_rad=flow,
        gyro_rad=rate * velocity.dt_s if known and by_gyro else np.full(3, np.nan),
        distance_m=distance,
        velocity_m_s=v,
        covariance=_turned(turn, velocity.covariance),
        rate_rad_s=rate if known else np.full(3, np.nan),
        rate_covariance=_turned(turn, rate_covariance),
        noise_rad_s=noise,
        quality=_quality(noise, best, worst),
    )


def quality_of(noise_rad_s: float, *, best: float = PX4_NOISE_RAD_S[0], worst: float = PX4_NOISE_RAD_S[1]) -> int:
    """Give the quality that stands for a standard deviation of the flow's rate, as PX4 reads it.

    ``255 - 254 (noise - best) / (worst - best)``, rounded, 255 below `best`, and 0 above `worst` or where nothing was
    measured: never more than is known.

    Parameters
    ----------
    noise_rad_s : float
        Standard deviation in rad/s; NaN where nothing was measured.
    best, worst : float
        PX4's EKF2_OF_N_MIN and EKF2_OF_N_MAX.

    Returns
    -------
    int

    Examples
    --------
    >>> [quality_of(noise) for noise in (0.01, 0.15, 0.325, 0.5, 0.51, float("nan"))]
    [255, 255, 128, 1, 0, 0]
    """
    least = _checks.number("best", best, above=0, most=_MOST, of="rad/s")
    most = _checks.number("worst", worst, above=0, most=_MOST, of="rad/s")
    if not least < most:
        raise OptionError(f"best, worst: got {least:g} and {most:g}, expected the smaller first")
    return _quality(_checks.number("noise_rad_s", noise_rad_s, least=0, of="rad/s", or_nan=True), least, most)


def _quality(noise: float, best: float, worst: float) -> int:
    return round(255 - 254 * max(noise - best, 0.0) / (worst - best)) if noise <= worst else 0


def noise_bounds(noise_rad_s: tuple[float, float]) -> tuple[float, float]:
    """Take two deviations, the smaller first."""
    expected = "two deviations in rad/s, above 0 and the smaller first, as (0.15, 0.5)"
    bounds = _checks.vector("noise_rad_s", noise_rad_s, 2, expected)
    if not 0 < bounds[0] < bounds[1]:
        raise _checks.refused("noise_rad_s", noise_rad_s, expected)
    return float(bounds[0]), float(bounds[1])


def _of_the_flow(velocity: Velocity) -> F64:
    """Covariance (2, 2) of what the flow is made of, times the distance squared."""
    covariance = np.array(velocity.covariance[:2, :2], dtype=np.float64)
    for name in _NOT_OF_THE_FLOW:
        part = velocity.parts.get(name)
        if part is not None:
            covariance -= part[:2, :2]
    return covariance


def _rate(velocity: Velocity, rate_rad_s: ArrayLike | None) -> tuple[F64, F64, bool]:
    """Give the rate that the velocity was computed with, its covariance, and whether a gyro measured it."""
    given = np.full(3, np.nan)
    if rate_rad_s is not None:
        given = _checks.array("rate_rad_s", rate_rad_s, (3,), "three numbers, NaN where not known").astype(np.float64)
    by_gyro = bool(np.isfinite(given).all()) or "gyro" in velocity.parts
    if not np.isfinite(velocity.rate_rad_s).all():
        return given, np.diag(np.full(3, np.inf)), by_gyro
    # What was learned of the gyro is taken off it, and what the pictures said of a rotation is in it.
    return velocity.rate_rad_s, velocity.rate_covariance, by_gyro


def _height(velocity: Velocity, height_m: float | None) -> float:
    own = velocity.height_m
    if height_m is not None:
        given = _checks.number("height_m", height_m, above=0, most=_MOST, of="metres", or_nan=True)
        return given if math.isfinite(given) else own
    if velocity.valid and not math.isfinite(own):
        raise OptionError("height_m: got None, expected the height that the velocity was computed with")
    return own


def _cosine(down: ArrayLike | None) -> float:
    if down is None:
        return 1.0
    vector = _checks.array("down", down, (3,), "three numbers, NaN where not known").astype(np.float64)
    if not np.isfinite(vector).all():
        return 1.0
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise OptionError("down: got (0, 0, 0), expected a direction")
    return float(vector[2]) / length


def _moved(turn: F64, vector: F64) -> F64:
    """Turn a vector about z by a multiple of 90 degrees; a component that is NaN leaves the others alone."""
    order = np.abs(turn).argmax(axis=1)
    return np.asarray(vector[order] * turn[np.arange(3), order], dtype=np.float64)


def _turned(turn: F64, covariance: F64) -> F64:
    """Turn a covariance likewise; what is infinite stays so."""
    order = np.abs(turn).argmax(axis=1)
    signs = turn[np.arange(3), order]
    return np.asarray(covariance[np.ix_(order, order)] * np.outer(signs, signs), dtype=np.float64)
