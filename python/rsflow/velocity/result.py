"""What a velocity is, what it is worth, and why there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._display import measured
from .._results.status import Status

__all__ = ["Velocity", "VelocityStatus", "not_stated", "unmeasured"]

F64 = NDArray[np.float64]


class VelocityStatus(Status):
    """What became of a frame: `OK`, or why there is no velocity.

    Examples
    --------
    >>> import rsflow
    >>> flight = rsflow.synthetic.flight(frames=2, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> estimator = rsflow.VelocityEstimator(flight.camera, height_m=0.2)
    >>> for frame in flight:
    ...     print(estimator.update(frame.image, frame.t_s).status)
    FIRST_FRAME
    OK
    """

    OK = 0, "Measured."
    FIRST_FRAME = 1, "There is no frame before this one."
    TIME_NOT_INCREASING = 2, "The frame is not later than the one before."
    NO_TEXTURE = 3, "There is nothing in the picture that could be followed."
    SCENE_CUT = 4, "The picture has nothing to do with the one before."
    TOO_FEW_POINTS = 5, "Too few points could be followed to fit a velocity and to judge it."
    INCONSISTENT = 6, "Fewer than half of the points move as one plane does."
    NO_HEIGHT = 7, "The flow was measured, but no height above the ground is known for this frame."
    NO_GROUND = 8, "The camera does not look at the ground, or less than 10 degrees below its horizon."
    REPEATED_FRAME = 9, "The picture is the one before again: the next one is compared with that, over both intervals."
    TWO_MOTIONS = 10, "Two motions hold for parts of the picture of similar size: either may be that of the ground."
    AMBIGUOUS = 11, "The ground repeats: another motion explains the pictures as well."


@dataclass(frozen=True, eq=False)
class Velocity:
    """Velocity of the camera over the ground in one interval, in the body frame half-way through.

    Attributes
    ----------
    t_s : float
        Time of the second frame.
    dt_s : float
        Time since the frame before; NaN for the first one.
    vx_m_s, vy_m_s, vz_m_s : float
        Mean velocity of the camera since the frame before, in the axes of the body (of the camera by default: x right,
        y down the picture, z along the optical axis); NaN where it could not be measured. A camera that moves to its
        right has vx > 0 while the picture flows to -x; one that goes down has vz > 0.
    covariance : (3, 3) float64
        Of (vx, vy, vz), in m^2/s^2; infinite where not measured.
    status : VelocityStatus
    n_points : int
        Tiles of the picture that move with the ground.
    dx_px, dy_px : float
        Median displacement of these points in the picture, in pixels.
    terms : tuple of str
        "vx" and "vy", and "vz" and, where no rate was given, "yaw" where they differ from zero by more than three
        standard deviations. All of them are always solved for.
    yaw_rate_rad_s : float
        Turn about straight down, as told and seen; NaN where there is no velocity.
    origin_velocity_m_s : (3,) float64
        Velocity of the body's origin: the camera's, less what the body's rate, as told and seen, makes of the lever
        arm.
    parts : mapping of str to (3, 3) float64
        What `covariance` is the sum of: "displacement", "rotation" (which nobody measured) or "gyro", each with
        that of straight down where nobody tells it, else "attitude"; "height", "focal length", "principal point",
        "time".
    unstated : tuple of str
        Which of these (but "displacement") `covariance` leaves out since no deviation was stated, of the height, of
        the camera's parameters: the velocity is only as exact as they are. Empty where all were.
    rate_rad_s : (3,) float64
        Angular rate of the body as told and seen, right-handed, in its axes; NaN where there is no velocity.
    rate_covariance : (3, 3) float64
    height_m, height_std_m : float
        Perpendicular distance from the ground with which the velocity was computed, and its deviation.
    doubts : tuple of str
        What is odd, in sentences: times that jitter against a steady flow, a rolling shutter, heights that contradict
        the vertical velocity or were carried on without any.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> flight = rsflow.synthetic.flight(frames=2, height_m=0.2, velocity_m_s=(0.03, -0.01, 0.0), seed=1)
    >>> estimator = rsflow.VelocityEstimator(flight.camera, height_m=0.2)
    >>> first, velocity = [estimator.update(frame.image, frame.t_s) for frame in flight]
    >>> first.valid, velocity.valid
    (False, True)
    >>> round(velocity.vx_m_s, 3), round(velocity.vy_m_s, 3)
    (0.03, -0.01)
    >>> bool(np.isnan(first.vx_m_s) and np.isinf(first.covariance[0, 0]))
    True
    """

    t_s: float
    dt_s: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    covariance: F64
    status: VelocityStatus
    n_points: int
    dx_px: float
    dy_px: float
    terms: tuple[str, ...] = ()
    yaw_rate_rad_s: float = np.nan
    origin_velocity_m_s: F64 = field(default_factory=lambda: np.full(3, np.nan))
    parts: Mapping[str, F64] = field(default_factory=dict, repr=False)
    unstated: tuple[str, ...] = ()
    rate_rad_s: F64 = field(default_factory=lambda: np.full(3, np.nan))
    rate_covariance: F64 = field(default_factory=lambda: np.diag(np.full(3, np.inf)), repr=False)
    height_m: float = np.nan
    height_std_m: float = np.nan
    doubts: tuple[str, ...] = ()

    def __repr__(self) -> str:
        if not self.valid:
            return f"Velocity(t={self.t_s:.6g} s, {self.status}: {self.status.explanation})"
        std = np.sqrt(np.diag(self.covariance))
        v = (self.vx_m_s, self.vy_m_s, self.vz_m_s)
        told = ", ".join(f"v{axis}={measured(v[k], std[k])}" for k, axis in enumerate("xyz"))
        unstated = f",\n         without the deviation of: {', '.join(self.unstated)}" if self.unstated else ""
        return f"Velocity(t={self.t_s:.6g} s, {told} m/s, {self.n_points} points, {self.status}{unstated})"

    @property
    def valid(self) -> bool:
        """Whether there is a velocity: the status is `OK`."""
        return self.status is VelocityStatus.OK

    @property
    def speed_m_s(self) -> float:
        """Speed over the ground: the length of (vx, vy), as in `budget`; NaN where there is no velocity.

        Examples
        --------
        >>> Velocity(1.0, 0.1, 3.0, 4.0, 0.5, np.eye(3) * 0.01, VelocityStatus.OK, 90, 5.0, 5.0).speed_m_s
        5.0
        """
        return float(np.hypot(self.vx_m_s, self.vy_m_s))

    def to_dict(self) -> dict[str, float | int | str]:
        """Give it as a row, for ``pandas.DataFrame`` a list of such.

        Returns
        -------
        dict of str to float, int or str
            The columns of ``velocity.csv`` but frame and height, and the speed over the ground.

        Examples
        --------
        >>> v = Velocity(1.0, 0.1, 3.0, 4.0, 0.5, np.eye(3) * 0.01, VelocityStatus.OK, 90, 5.0, 5.0)
        >>> row = v.to_dict()
        >>> row["vx_m_s"], row["vx_std_m_s"], row["speed_m_s"], row["status"]
        (3.0, 0.1, 5.0, 'ok')
        """
        std = np.sqrt(np.diag(self.covariance)).tolist()
        return {
            "t_s": self.t_s,
            "dt_s": self.dt_s,
            "vx_m_s": self.vx_m_s,
            "vy_m_s": self.vy_m_s,
            "vz_m_s": self.vz_m_s,
            "vx_std_m_s": std[0],
            "vy_std_m_s": std[1],
            "vz_std_m_s": std[2],
            "speed_m_s": self.speed_m_s,
            "dx_px": self.dx_px,
            "dy_px": self.dy_px,
            "n_points": self.n_points,
            "status": self.status.word,
            "std_without": "+".join(name.replace(" ", "_") for name in self.unstated),
        }

    @property
    def flow_px(self) -> float:
        """Length of the median displacement in pixels: the report's "optical flow"."""
        return float(np.hypot(self.dx_px, self.dy_px))

    def budget(self, *, dt_std_s: float = 0.0) -> str:
        """Where the uncertainty of the speed over ground comes from, in per cent of it, a line a part.

        What is not known since no deviation was stated has a line that says so, and there is no total then.

        Parameters
        ----------
        dt_std_s : float
            Standard deviation of the time between the frames, for one line more.

        Returns
        -------
        str
            Or why there is no velocity.

        Examples
        --------
        >>> v = Velocity(1.0, 0.1, 3.0, 4.0, 0.0, np.eye(3) * 0.01, VelocityStatus.OK, 90, 5.0, 5.0,
        ...              parts={"displacement": np.eye(3) * 0.0025, "height": np.eye(3) * 0.0075})
        >>> print(v.budget())
        speed           5 m/s
        displacement    1.00 %
        height          1.73 %
        total           2.00 %
        """
        dt_std_s = _checks.number("dt_std_s", dt_std_s, least=0, most=1e9, of="seconds")
        if not self.valid:
            return f"no velocity: {self.status.name.lower().replace('_', ' ')}"
        flat = np.array([self.vx_m_s, self.vy_m_s])
        speed = float(np.hypot(*flat))
        if speed == 0.0:
            return f"speed           0 m/s, +- {float(np.sqrt(np.trace(self.covariance[:2, :2]) / 2)):.3g} m/s each way"
        along = flat / speed
        variance = {name: float(along @ part[:2, :2] @ along) / speed**2 for name, part in self.parts.items()}
        if dt_std_s:
            variance["time"] = (dt_std_s / self.dt_s) ** 2
        lines = [f"{'speed':<16}{speed:.4g} m/s"]
        lines += [f"{name:<16}{100 * np.sqrt(value):.2f} %" for name, value in variance.items() if value > 0]
        lines += [f"{name:<16}not stated" for name in self.unstated]
        known = f"{100 * np.sqrt(sum(variance.values())):.2f} %"
        if self.unstated:
            return "\n".join([*lines, f"{'total':<16}unknown: {known}, and what is not stated"])
        return "\n".join([*lines, f"{'total':<16}{known}"])


def not_stated(unstated: Sequence[str]) -> str:
    """Say what deviations of velocities leave out, in a sentence without a full stop; empty where that is nothing."""
    if not unstated:
        return ""
    names = unstated[0] if len(unstated) == 1 else f"{', '.join(unstated[:-1])} and {unstated[-1]}"
    plural = "deviation" if len(unstated) == 1 else "deviations"
    these = f"the {names}" if len(unstated) == 1 else "these"
    return (
        f"{plural} of the {names} not stated: velocities are only as exact as {these}, which their standard deviations "
        "leave out"
    )


def unmeasured(
    status: VelocityStatus, t_s: float, dt_s: float, moved: F64 | None = None, n_points: int = 0
) -> Velocity:
    """Make the result of a frame without a velocity: NaN and infinite covariance."""
    dx, dy = (np.nan, np.nan) if moved is None else (float(moved[0]), float(moved[1]))
    return Velocity(t_s, dt_s, np.nan, np.nan, np.nan, np.diag(np.full(3, np.inf)), status, n_points, dx, dy)
