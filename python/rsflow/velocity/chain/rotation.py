"""What is known of a camera's rotation between two frames, and what is learned of it from the pictures.

Over a plane a turn about an axis of the picture looks nearly like a way across it. How well the pictures tell both
apart depends on the field of view; the rest is what a gyro, an attitude, or nothing says, each with its own errors.
These errors are learned: whatever rotation the pictures show beyond what was told is compared with what it should be.

docs/explanation/algorithms.md, section "What is known of the rotation".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

# Standard deviations before anything was seen, in rad/s: of a rotation that nothing measures, about each axis; of what
# a gyro or an attitude leaves.
_UNMEASURED_RAD_S = 0.3
_UNDECLARED_RAD_S = 0.2
# Of a gyro's bias, in rad/s, and of its delay, in seconds; and how fast a bias walks, in rad/s per root of a second.
_BIAS_RAD_S = 0.05
_DELAY_S = 0.01
_WALK_RAD_S = 2e-4
# For how long what was seen is remembered, in seconds.
_MEMORY_S = 1.0
# An error of more than this many deviations counts as one of so many.
_MOST = 20.0
# Errors are there where they exceed what noise makes of them by so many deviations of that.
_CLEAR = 9.0
_FEW = 3.0
# What pictures tell to no more than this, in rad/s, must be clearer still.
_NARROW_RAD_S = 0.05
# A declared deviation is believed unless what is seen exceeds it by so many deviations of what is seen.
_BELIEVED = 4.0
# Deviations of a rate of which none is expected: not zero, for it is divided by.
_LEAST_RAD_S = 1e-6


@dataclass(frozen=True)
class Expected:
    """What a rotation is off by, in rad/s in the body's axes, before the pictures are asked.

    `covariance` is that under which it is estimated: the most likely one. `cover` is that which the covariance of the
    result holds: no less than may be, after what was seen so far.
    """

    covariance: F64
    cover: F64


@dataclass(frozen=True)
class GyroState:
    """What was learned of a gyro from the pictures.

    Attributes
    ----------
    bias_rad_s : (3,) float64
        What is to be added to its rates, in the body's axes.
    bias_std_rad_s : (3,) float64
    delay_s : float
        How much later than the frames its rates come.
    delay_std_s : float
    """

    bias_rad_s: F64
    bias_std_rad_s: F64
    delay_s: float
    delay_std_s: float

    def __repr__(self) -> str:
        bias = ", ".join(
            f"{value:+.4f} +- {std:.4f}" for value, std in zip(self.bias_rad_s, self.bias_std_rad_s, strict=True)
        )
        return f"GyroState(bias={bias} rad/s, delay={1e3 * self.delay_s:.1f} +- {1e3 * self.delay_std_s:.1f} ms)"


class Excess:
    """Variance of errors beyond what each observation's own noise explains, axis by axis, with a memory.

    Attributes
    ----------
    seen : (3,) float64
        The variance that was seen; 0 before anything was.
    likely : (3,) float64
        The variance that was clearly seen: none is more likely than one that noise explains.
    cover : (3,) float64
        The variance that may be there.
    doubt : (3,) float64
        Standard deviation of the variance that is seen where there is no excess.
    any : bool
        Whether anything was seen yet.
    """

    def __init__(self, first: F64) -> None:
        self.first = first
        self.count = 0.0
        self.squares = np.zeros(3)
        self.noise = np.zeros(3)
        # Variances of what looks like an error and is none.
        self.smooth = np.zeros(3)
        self._tell()

    def _tell(self) -> None:
        self.any = self.count > 0
        if not self.any:
            self.likely = self.cover = self.doubt = self.first
            self.seen = np.zeros(3)
            return
        noise, spread = self.noise / self.count, float(np.sqrt(2.0 / self.count))
        seen = self.seen = np.maximum(self.squares / self.count - noise, 0.0)
        self.doubt = np.minimum(noise * spread, self.first)
        self.cover = np.minimum(seen + self.doubt, np.maximum(self.first, seen))
        # A few squares scatter further than their deviation says, and noise has more causes than chance; a narrow view
        # tells a turn badly, and such causes weigh most there.
        least = _CLEAR * (1.0 + _FEW / self.count) * (1.0 + noise / _NARROW_RAD_S**2)
        self.likely = np.where(seen > least * (self.doubt + self.smooth * spread), seen, 0.0)
        self._most = _MOST**2 * seen

    def learn(self, error: F64, noise: F64, smooth: F64, dt_s: float) -> None:
        """Take an error (3,) whose own noise has these variances (3,), and what may look like one these."""
        keep = float(np.exp(-max(dt_s, 0.0) / _MEMORY_S))
        squares = error * error
        if self.any:
            squares = np.minimum(squares, self._most + _MOST**2 * noise)
        self.smooth = smooth
        self.count = keep * self.count + 1.0
        self.squares = keep * self.squares + squares
        self.noise = keep * self.noise + noise
        self._tell()

    def state(self) -> F64:
        """Everything that was learned, to be kept."""
        return np.stack([np.full(3, self.count), self.squares, self.noise, self.smooth])

    def restore(self, kept: F64) -> None:
        """Take over what `state` gave."""
        count, self.squares, self.noise, self.smooth = kept
        self.count = float(count[0])
        self._tell()


class RotationModel:
    """Expects what a told rotation is off by, and learns it.

    Parameters
    ----------
    rate_std_rad_s : float or None
        Declared deviation of a rate about each axis; None where nobody declared one.
    delay_std_s : float or None
    """

    def __init__(self, rate_std_rad_s: float | None, delay_std_s: float | None) -> None:
        self._declared = rate_std_rad_s
        bias = _BIAS_RAD_S if rate_std_rad_s is None or rate_std_rad_s > 0 else 0.0
        delay = _DELAY_S if delay_std_s is None else delay_std_s
        self._state = np.zeros(4)
        self._spread = np.diag([bias**2] * 3 + [delay**2])
        unmeasured, undeclared = np.full(3, _UNMEASURED_RAD_S**2), np.full(3, _UNDECLARED_RAD_S**2)
        self._excess = {
            "none": Excess(unmeasured),
            "attitude": Excess(np.append(undeclared[:2], unmeasured[2:])),
            "gyro": Excess(undeclared),
        }
        self._rate: F64 | None = None
        # How the last rate depends on bias and delay, and what is not known of it for their sake.
        self._jacobian = np.zeros((3, 4))
        self._lasting = np.zeros((3, 3))
        self._cover = np.zeros((3, 3))
        # What noise of the rates may have made of bias and delay.
        self._pull = np.zeros(4)
        # Bias and delay that were made good.
        self._used = np.zeros(4)

    @property
    def gyro(self) -> GyroState:
        """What was learned of a gyro."""
        std = np.sqrt(np.diag(self._spread) + self._pull**2)
        return GyroState(self._state[:3].copy(), std[:3], float(self._state[3]), float(std[3]))

    def correction(self, rate: F64, dt_s: float) -> F64:
        """Give what is to be added to a gyro's rate (3,), in the body's axes: bias and delay where they are clear."""
        slope = np.zeros(3) if self._rate is None else (rate - self._rate) / dt_s
        J = self._jacobian = np.column_stack([np.eye(3), slope])
        clear = np.abs(self._state) > _BELIEVED * np.sqrt(np.diag(self._spread))
        self._used = np.where(clear, self._state, 0.0)
        left = self._state - self._used
        self._lasting = J @ (np.outer(clear, clear) * self._spread) @ J.T
        self._cover = J @ (self._spread + np.diag(left * left)) @ J.T
        self._rate = rate
        return np.asarray(J @ self._used)

    def forget_rate(self) -> None:
        """Know no rate of the interval before."""
        self._rate = None

    def expected(self, source: str, axes: F64 | None) -> Expected:
        """Expect the error of a told rotation.

        Parameters
        ----------
        source : {"none", "attitude", "gyro"}
        axes : (3, 3), optional
            Axes, as rows in those of the body, in which errors are learned; by default those of the body.
        """
        excess = self._excess[source]
        likely, cover = excess.likely, excess.cover
        if self._declared is not None and source != "attitude":
            declared = np.full(3, self._declared**2)
            beyond = (likely > declared + _BELIEVED * excess.doubt) & excess.any
            likely, cover = np.where(beyond, likely, declared), np.where(beyond, cover, declared)
        none = np.zeros((3, 3))
        lasting, lasting_cover = (self._lasting, self._cover) if source == "gyro" else (none, none)
        least = _LEAST_RAD_S**2

        def turned(variances: F64, lasting: F64) -> F64:
            if axes is None:
                return np.asarray(np.diag(variances + least) + lasting)
            return np.asarray(axes.T @ ((variances + least)[:, None] * axes) + lasting)

        return Expected(turned(likely, lasting), turned(cover, lasting_cover))

    def learn(self, source: str, axes: F64 | None, error: F64, covariance: F64, smooth: F64, dt_s: float) -> None:
        """Take what the pictures alone say that the told rotation is off by, (3,) in the body's axes."""
        if source == "gyro":
            error = self._corrected(axes, error, covariance, dt_s)
        if axes is not None:
            error, covariance, smooth = axes @ error, axes @ covariance @ axes.T, axes @ smooth @ axes.T
        self._excess[source].learn(error, np.diagonal(covariance), np.diagonal(smooth), dt_s)

    def _corrected(self, axes: F64 | None, error: F64, covariance: F64, dt_s: float) -> F64:
        """Learn bias and delay from an error (Kalman's filter), and give what they leave of it."""
        J = self._jacobian
        # What may be there, not what is likely: with no more than that, bias and delay would be too sure.
        rest = covariance + self.expected("gyro", axes).cover - self._cover
        spread = self._spread + np.diag([_WALK_RAD_S**2 * dt_s] * 3 + [0.0])
        trust = np.linalg.inv(J @ spread @ J.T + rest)
        gain = spread @ J.T @ trust
        # The error is that beyond what was made good.
        innovation = error - J @ (self._state - self._used)
        change = gain @ innovation
        keep = np.eye(4) - gain @ J
        # The noise of a rate is in its slope too: an error in variables, which looks like a delay.
        looks = float(np.diag(trust) @ self._excess["gyro"].seen) / dt_s
        self._pull = keep @ self._pull - spread[:, 3] * looks
        self._state = self._state + change
        self._spread = keep @ spread @ keep.T + gain @ rest @ gain.T
        return np.asarray(innovation - J @ change)

    def state(self) -> dict[str, Any]:
        """Everything that was learned, to be kept."""
        kept: dict[str, Any] = {"state": self._state, "spread": self._spread, "rate": self._rate, "pull": self._pull}
        for name, excess in self._excess.items():
            kept[name] = excess.state()
        return kept

    def restore(self, kept: dict[str, Any]) -> None:
        """Take over what `state` gave."""
        self._state, self._spread, self._rate, self._pull = (kept[n] for n in ("state", "spread", "rate", "pull"))
        for name, excess in self._excess.items():
            excess.restore(kept[name])
