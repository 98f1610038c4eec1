"""A log of angular rates, read at any time: the rate itself, and the turn between two times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["RateLog"]

F64 = NDArray[np.float64]

# A pause in the log that is longer than this many usual steps is a hole: nothing is known inside of it.
_PAUSE = 6.0


@dataclass(frozen=True, eq=False)
class RateLog:
    """Rates at times, cubics between them, with their integrals up to each time.

    Straight lines would make rates that change too small: by 0.5 % at 2 Hz in a log of 50 Hz. The turn between two
    times is that of the rates' integral and, for axes that change on the way, the second term of Magnus' series, which
    changes its sign where the log's axes are left-handed.
    """

    t_s: F64
    rate_rad_s: F64
    slope: F64
    angle: F64
    twist: F64
    hole: NDArray[np.bool_]

    @classmethod
    def of(cls, t_s: F64, rate_rad_s: F64) -> RateLog:
        """Take times and rates; rows with NaN are left out."""
        known = np.isfinite(rate_rad_s).all(axis=1)
        t, rate = t_s[known], rate_rad_s[known]
        step = np.diff(t)[:, None]
        slope = _slopes(step, np.diff(rate, axis=0))
        middle = 0.5 * (rate[1:] + rate[:-1]) + step / 12 * (slope[:-1] - slope[1:])
        zero = np.zeros((1, 3))
        angle = np.vstack([zero, np.cumsum(middle * step, axis=0)])
        centre = 0.5 * (angle[1:] + angle[:-1])
        twist = np.vstack([zero, np.cumsum(np.cross(centre, middle) * step, axis=0)])
        hole = step[:, 0] > _PAUSE * np.median(step) if len(step) else np.zeros(0, np.bool_)
        return cls(t, rate, slope, angle, twist, hole)

    @property
    def noise(self) -> float:
        """Deviation of a sample: what four neighbours do not agree on."""
        if len(self.t_s) < 9:
            return 0.0
        # The fourth difference of noise has 70 times its variance; half of normal ones are below 0.6745 deviations.
        fourth = np.abs(np.diff(self.rate_rad_s, n=4, axis=0))
        return float(np.median(fourth, axis=0).max() / 0.6745 / np.sqrt(70))

    @property
    def step_s(self) -> float:
        """The usual time between two samples."""
        return float(np.median(np.diff(self.t_s)))

    def scaled(self, factor: float) -> RateLog:
        """Give the log with all rates multiplied."""
        return RateLog.of(self.t_s, self.rate_rad_s * factor)

    def _place(self, t: F64) -> tuple[NDArray[np.intp], F64]:
        place = np.clip(np.searchsorted(self.t_s, t, side="right") - 1, 0, len(self.t_s) - 2)
        return place, t - self.t_s[place]

    def rate(self, t: F64) -> F64:
        """Rate (K, 3) at times (K,)."""
        place, since = self._place(t)
        step = (self.t_s[place + 1] - self.t_s[place])[:, None]
        first, linear, square, cube = self._cubic(place, step)
        u = since[:, None]
        return np.asarray(first + u * (linear + u * (square + u * cube)))

    def _cubic(self, place: NDArray[np.intp], step: F64) -> tuple[F64, F64, F64, F64]:
        """Coefficients of the cubics (Hermite's) from these places on."""
        first, rise = self.rate_rad_s[place], (self.rate_rad_s[place + 1] - self.rate_rad_s[place]) / step
        left, right = self.slope[place], self.slope[place + 1]
        return first, left, (3 * rise - 2 * left - right) / step, (left + right - 2 * rise) / step**2

    def _integrals(self, t: F64) -> tuple[F64, F64]:
        place, since = self._place(t)
        first, linear, square, cube = self._cubic(place, (self.t_s[place + 1] - self.t_s[place])[:, None])
        u = since[:, None]
        step = u * (first + u * (linear / 2 + u * (square / 3 + u * cube / 4)))
        angle = self.angle[place] + step
        twist = self.twist[place] + np.cross(self.angle[place] + 0.5 * step, step)
        return angle, twist

    def turn(self, start: F64, stop: F64) -> tuple[F64, F64]:
        """Turn (K, 3) from `start` to `stop` (K,): the integral of the rate, and Magnus' second term."""
        (angle1, twist1), (angle2, twist2) = self._integrals(start), self._integrals(stop)
        return angle2 - angle1, 0.5 * (twist2 - twist1 - np.cross(angle1, angle2 - angle1))

    def covers(self, start: F64, stop: F64) -> NDArray[np.bool_]:
        """Which of the intervals (K,) lie inside the log and touch no hole of it."""
        inside = (start >= self.t_s[0]) & (stop <= self.t_s[-1])
        holes = np.concatenate([[0], np.cumsum(self.hole)])
        first, last = self._place(start)[0], self._place(stop)[0]
        return np.asarray(inside & (holes[last + 1] - holes[first] == 0))


def _slopes(step: F64, rise: F64) -> F64:
    """Change of the rate per second at each sample: of the parabola through it and its neighbours."""
    chord = rise / step
    if len(chord) < 2:
        return np.vstack([chord, chord])
    inner = (chord[:-1] * step[1:] + chord[1:] * step[:-1]) / (step[1:] + step[:-1])
    return np.vstack([chord[:1], inner, chord[-1:]])
