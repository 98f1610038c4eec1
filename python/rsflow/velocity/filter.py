"""Velocities filtered over time: position, velocity and acceleration, and what a gyro's errors are.

docs/explanation/algorithms.md, section "Velocities filtered over time: VelocityFilter".
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._display import options
from .._shared import Shared, alone, anew
from ..errors import OptionError
from . import filter_inputs as inputs
from . import kalman
from .filter_common import CommonCauses
from .filter_result import FilteredVelocity, FilterStatus
from .filter_state import Belief, Sight, Turning
from .kalman import ACCELERATION, BIAS, DELAY, HEADING, POSITION, VELOCITY
from .result import Velocity

__all__ = ["VelocityFilter"]

F64 = NDArray[np.float64]

_MOST = 1e6
# By how much the logarithm of the power of the jerk rises for each unit of squared innovation above what is usual (1 is
# expected), with the most that counts of one velocity; and the most that it rises in all.
_LEARN = 0.15
_USUAL = 1.3
_MOST_OF_ONE = 8.0
_MOST_EXCESS = 9.0
# The fewest velocities in a row outside of the gate that let it be given up.
_LEAST_REJECTED = 3


class VelocityFilter(Shared):
    """Kalman filter of constant acceleration over velocities: smoother ones, the way, and what they are worth.

    Acceleration walks at random; frames may be any time apart. A frame without a velocity is bridged, with a covariance
    that grows. A velocity outside of the gate is not taken in; where that lasts, the filter begins anew with what is
    measured, and says so. `FilteredVelocity.measurement` is the velocity as it came.

    What is the same in every frame does not average out: a height that is 1 % wrong makes the way 1 % wrong, however
    many frames there are. The parts of `Velocity.parts` named in `common` are carried along for that with their
    variance, as consider states (Schmidt 1966), and never estimated: neither velocity nor position becomes surer than
    they allow. Those in `wandering` are the same for a while, as a rocking that no gyro measured.

    Threads that share one wait for each other. A copy, or a pickle read anywhere, goes on with the same bits.

    Parameters
    ----------
    acceleration_walk_m_s2 : float
        Standard deviation of the change of acceleration within a second, the square root of the power of the jerk: the
        smaller, the smoother. A multicopter that is flown hard has 10, one that hovers 1, a model on a table 0.1. Where
        velocities show more, more is taken (`FilteredVelocity.acceleration_walk_m_s2`), if `adaptive`.
    acceleration_std_m_s2 : float
        Standard deviation of the acceleration at the start.
    common : sequence of str
        Parts of the velocities' covariance whose error is the same in every frame. Leave "height" out where each
        frame has a height of its own with errors of its own, as from a range finder.
    wandering : sequence of str
        Parts whose error stays for a while alone; what is in neither is another in every frame.
    wander_s : float
        How long: the time constant of a Gauss-Markov process of first order. So long lasts the error of a gyro's rate
        in the heading too.
    gyro_bias_std_rad_s : float
        Standard deviation of each axis of a gyro's bias that the velocities were measured with and that is not in
        their covariance. With 0 there is none to estimate.
    rate_delay_std_s : float
        The same of its delay.
    yaw_rate_std_rad_s : float
        Standard deviation of a frame's yaw rate, where it does not come with a covariance.
    adaptive : bool
        Let innovations that are larger than expected raise `acceleration_walk_m_s2`, until they are not.
    gate : float
        Largest Mahalanobis distance of a velocity from what is expected; 5 is passed by 15 of a million good ones.
    max_rejected_s : float
        After so long outside of the gate, and three frames, the filter begins anew.

    Raises
    ------
    OptionError
        If a number is outside of its range, or a name is in both lists, or "displacement".

    Examples
    --------
    >>> import rsflow
    >>> flight = rsflow.synthetic.flight(frames=6, height_m=0.2, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> estimator = rsflow.VelocityEstimator(flight.camera, height_m=0.2, height_std_m=0.002)
    >>> kalman = rsflow.VelocityFilter(acceleration_walk_m_s2=0.01, acceleration_std_m_s2=0.01)
    >>> for frame in flight:
    ...     now = kalman.update(estimator.update(frame.image, frame.t_s))
    >>> now.status.name, round(now.vx_m_s, 3)
    ('OK', 0.03)
    >>> bool(now.covariance[0, 0] ** 0.5 > 0.0099 * now.vx_m_s)  # 1 % of height does not average out
    True
    """

    _state_types: ClassVar = {
        "_options": (dict,),
        "_common": (CommonCauses,),
        "_adaptive": (bool,),
        "_belief": (Belief, type(None)),
        "_turning": (Turning,),
        "_rate": (np.ndarray, type(None)),
        "_down": (np.ndarray,),
        "_taken_s": (numbers.Real,),
        "_rejected": (int,),
        "_excess": (numbers.Real,),
    }

    def __init__(
        self,
        *,
        acceleration_walk_m_s2: float = 5.0,
        acceleration_std_m_s2: float = 5.0,
        common: Sequence[str] = ("height", "focal length", "principal point", "gyro", "attitude"),
        wandering: Sequence[str] = ("rotation",),
        wander_s: float = 1.0,
        gyro_bias_std_rad_s: float = 0.0,
        rate_delay_std_s: float = 0.0,
        yaw_rate_std_rad_s: float = 0.02,
        adaptive: bool = True,
        gate: float = 5.0,
        max_rejected_s: float = 0.5,
    ) -> None:
        given = {
            "acceleration_walk_m_s2": _checks.number(
                "acceleration_walk_m_s2", acceleration_walk_m_s2, above=0, most=_MOST, of="m/s^2"
            ),
            "acceleration_std_m_s2": _checks.number(
                "acceleration_std_m_s2", acceleration_std_m_s2, least=0, most=_MOST, of="m/s^2"
            ),
            "gyro_bias_std_rad_s": _checks.number(
                "gyro_bias_std_rad_s", gyro_bias_std_rad_s, least=0, most=_MOST, of="rad/s"
            ),
            "rate_delay_std_s": _checks.number("rate_delay_std_s", rate_delay_std_s, least=0, most=_MOST, of="seconds"),
            "yaw_rate_std_rad_s": _checks.number(
                "yaw_rate_std_rad_s", yaw_rate_std_rad_s, least=0, most=_MOST, of="rad/s"
            ),
            "wander_s": _checks.number("wander_s", wander_s, above=0, most=_MOST, of="seconds"),
            "gate": _checks.number("gate", gate, above=0, most=_MOST),
            "max_rejected_s": _checks.number("max_rejected_s", max_rejected_s, least=0, most=_MOST, of="seconds"),
        }
        self._options: dict[str, float] = given
        self._adaptive = _checks.flag("adaptive", adaptive)
        memory_s = dict.fromkeys(inputs.names_of("common", common), math.inf)
        for name in inputs.names_of("wandering", wandering):
            if name in memory_s:
                raise OptionError(f"wandering: got {name!r}, which common names too, expected other parts")
            memory_s[name] = given["wander_s"]
        self._common = CommonCauses(memory_s)
        self.reset()

    def __repr__(self) -> str:
        shown = ("acceleration_walk_m_s2", "gyro_bias_std_rad_s", "rate_delay_std_s", "gate")
        told = options(**{name: self._options[name] for name in shown if self._options[name]})
        last = "no velocity yet" if math.isnan(self._taken_s) else f"last velocity at {self._taken_s:g} s"
        return f"VelocityFilter({told}): {last}"

    @anew
    def reset(self) -> None:
        """Forget all velocities: the next one is the first."""
        self._belief: Belief | None = None
        self._common.forget()
        self._turning = Turning()
        self._rate: F64 | None = None
        self._down = np.array([0.0, 0.0, 1.0])
        # When a velocity was last taken in, and how many were not since.
        self._taken_s = math.nan
        self._rejected = 0
        # Logarithm of what the power of the jerk is taken to be, to what was given.
        self._excess = 0.0

    @alone
    def update(
        self,
        velocity: Velocity,
        *,
        rate_rad_s: ArrayLike | None = None,
        residual_rate_rad_s: ArrayLike | None = None,
        residual_rate_covariance: ArrayLike | None = None,
        height_m: float | None = None,
        down: ArrayLike | None = None,
    ) -> FilteredVelocity:
        """Take the velocity of the next frame.

        Parameters
        ----------
        velocity : Velocity
            Measured or not.
        rate_rad_s : (3,) array_like, optional
            Mean rate of the body by the gyro since the frame before: the heading follows it. Without it the heading
            follows the rate that the velocity came with, or the turn that was seen, or walks.
        residual_rate_rad_s : (3,) array_like, optional
            By how much the gyro's rate is above the one that was measured otherwise, by the pictures say; NaN for an
            axis that was not measured. It tells the gyro's bias and, while the rate changes, its delay.
        residual_rate_covariance : (3, 3) array_like, optional
            Of `residual_rate_rad_s`; both or none.
        height_m : float, optional
            Height over the ground that the velocity was computed with: where a gyro's bias or delay are estimated, it
            says what these do to the velocity.
        down : (3,) array_like, optional
            Straight down in the body frame at this frame, of any length; by default the body's z axis, and where it is
            NaN what it was before.

        Returns
        -------
        FilteredVelocity

        Raises
        ------
        OptionError
            If a vector is not finite or zero, or what is to be estimated lacks its height or standard deviation.
        ShapeError, DTypeError
            If an argument is of another shape or type.
        """
        _checks.instance("velocity", velocity, Velocity, "a Velocity")
        estimates = self._options["gyro_bias_std_rad_s"] > 0 or self._options["rate_delay_std_s"] > 0
        rate = inputs.rate_of(velocity, rate_rad_s)
        residual = inputs.residual_of(residual_rate_rad_s, residual_rate_covariance, estimates)
        height = inputs.height_of(velocity, height_m, estimates)
        straight = self._down if (told := inputs.straight_of(down)) is None else told
        dt, end = velocity.dt_s, velocity.t_s
        if not (math.isfinite(dt) and dt > 0):
            # A first frame, or one that is not later: nothing went on.
            return self._result(velocity, FilterStatus.PREDICTED)
        if self._belief is not None:
            self._belief = self._belief.at(end - dt, self._turning)
        change = self._turned(velocity, rate, straight)
        self._down = straight
        if self._belief is not None and residual is not None:
            self._take_residual(self._belief, *residual, change)
        if not velocity.valid:
            if self._belief is not None:
                self._belief = self._belief.at(end, self._turning)
            return self._result(velocity, FilterStatus.PREDICTED)
        arm = kalman.cross(straight * height) if math.isfinite(height) else np.zeros((3, 3))
        sight = Sight(straight, arm, np.nan_to_num(change), *self._common.effects(velocity))
        return self._take(velocity, sight)

    def _take(self, velocity: Velocity, sight: Sight) -> FilteredVelocity:
        """Take in a velocity, in the middle of its interval, where constant acceleration has the mean velocity."""
        half, std = 0.5 * velocity.dt_s, self._options["acceleration_std_m_s2"]
        z = np.array([velocity.vx_m_s, velocity.vy_m_s, velocity.vz_m_s])
        seen = np.isfinite(z) & np.isfinite(np.diag(velocity.covariance))
        noise = self._common.own_noise(velocity)
        if self._belief is None:
            # The heading is that of the body where the interval began.
            begun = Belief.begin(velocity.t_s - 2 * half, self._common.memory_s, self._options)
            begun = begun.at(velocity.t_s - half, self._turning)
            self._belief = begun.seeded(z, noise, sight, seen, std).from_origin(half)
            return self._taken(velocity, FilterStatus.OK, 0.0)
        belief = self._belief.at(velocity.t_s - half, self._turning)
        design, expected = belief.design(sight)
        measurement = (z - expected)[seen], design[seen], noise[np.ix_(seen, seen)]
        innovation = kalman.distance(belief.covariance, *measurement)
        belief = self._learned(belief, innovation**2 / int(seen.sum()))
        if innovation <= self._options["gate"]:
            self._belief = belief.updated(*measurement)
            return self._taken(velocity, FilterStatus.OK, innovation)
        self._rejected += 1
        closed = velocity.t_s - self._taken_s
        if self._rejected < _LEAST_REJECTED or closed <= self._options["max_rejected_s"]:
            self._belief = belief
            return self._result(velocity, FilterStatus.REJECTED, innovation)
        # Since some time it has moved as it does now, and not as was thought: the way may be off by that.
        anew = belief.seeded(z, noise, sight, seen, std)
        self._belief = anew.astray((anew.mean - belief.mean)[VELOCITY] * closed)
        return self._taken(velocity, FilterStatus.RESTARTED, innovation)

    def _learned(self, belief: Belief, square: float) -> Belief:
        """Let accelerations change more than was given where innovations are larger than they would be."""
        if not self._adaptive:
            return belief
        rise = _LEARN * (min(square, _MOST_OF_ONE) - _USUAL)
        self._excess = min(max(self._excess + rise, 0.0), _MOST_EXCESS)
        return replace(belief, walk=self._options["acceleration_walk_m_s2"] ** 2 * math.exp(self._excess))

    def _taken(self, velocity: Velocity, status: FilterStatus, innovation: float) -> FilteredVelocity:
        self._taken_s, self._rejected = velocity.t_s, 0
        return self._result(velocity, status, innovation)

    def _turned(self, velocity: Velocity, rate: F64 | None, straight: F64) -> F64:
        """Learn how the heading goes on in this interval; give how the rate changes, NaN where that is not known."""
        dt, std = velocity.dt_s, self._options["yaw_rate_std_rad_s"]
        spacing = 0.5 * (dt + self._turning.dt_s)
        known = rate is not None and self._rate is not None
        change = (rate - self._rate) / spacing if known else np.full(3, np.nan)  # type: ignore[operator]
        self._rate = rate
        if rate is not None:
            own = velocity.rate_covariance
            variance = float(straight @ own @ straight) if np.isfinite(own).all() else std**2
            gyro = np.append(-straight, float(straight @ np.nan_to_num(change)))
            # A Gauss-Markov process of this time constant adds to an angle as errors that last twice as long.
            lasts_s = 2 * self._options["wander_s"] if "gyro" in velocity.parts else 0.0
            self._turning = Turning(float(rate @ straight), variance, dt, gyro, lasts_s)
        elif math.isfinite(velocity.yaw_rate_rad_s):
            self._turning = Turning(velocity.yaw_rate_rad_s, std**2, dt)
        else:
            self._turning = Turning(dt_s=dt)
        return change

    def _take_residual(self, belief: Belief, residual: F64, noise: F64, change: F64) -> None:
        """Take in by how much the gyro reads too much: its bias, less the delay times the change of the rate."""
        late = self._options["rate_delay_std_s"] > 0
        if late and not np.isfinite(change).all():
            return
        seen = np.isfinite(residual) & np.isfinite(np.diag(noise))
        design = np.zeros((3, len(belief.mean)))
        design[:, BIAS] = np.eye(3)
        design[:, DELAY] = -np.nan_to_num(change)
        measurement = (residual - design @ belief.mean)[seen], design[seen], noise[np.ix_(seen, seen)]
        if seen.any() and kalman.distance(belief.covariance, *measurement) <= self._options["gate"]:
            self._belief = belief.updated(*measurement)

    def _result(self, velocity: Velocity, status: FilterStatus, innovation: float = math.nan) -> FilteredVelocity:
        if self._belief is None:
            unknown = Belief.begin(velocity.t_s, self._common.memory_s, self._options)
            unknown.mean[:10] = np.nan
            unknown.covariance[:10, :10] = np.diag(np.full(10, np.inf))
            now, status = unknown, FilterStatus.WAITING
            v, of_v = now.mean[VELOCITY], now.covariance[VELOCITY, VELOCITY]
        else:
            now = self._belief.at(velocity.t_s, self._turning)
            v, of_v = now.body_velocity(self._down)
        variances = np.maximum(np.diag(now.covariance), 0.0)
        return FilteredVelocity(
            t_s=velocity.t_s,
            vx_m_s=float(v[0]),
            vy_m_s=float(v[1]),
            vz_m_s=float(v[2]),
            covariance=of_v.copy(),
            position_m=now.mean[POSITION].copy(),
            position_covariance=now.covariance[POSITION, POSITION].copy(),
            acceleration_m_s2=now.mean[ACCELERATION].copy(),
            acceleration_covariance=now.covariance[ACCELERATION, ACCELERATION].copy(),
            heading_rad=float(now.mean[HEADING]),
            heading_std_rad=math.sqrt(variances[HEADING]),
            gyro_bias_rad_s=now.mean[BIAS].copy(),
            gyro_bias_std_rad_s=np.sqrt(variances[BIAS]),
            delay_s=float(now.mean[DELAY]),
            delay_std_s=math.sqrt(variances[DELAY]),
            status=status,
            innovation=innovation,
            acceleration_walk_m_s2=self._options["acceleration_walk_m_s2"] * math.exp(self._excess / 2),
            measurement=velocity,
        )
